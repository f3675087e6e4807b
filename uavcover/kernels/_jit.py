"""The compiler settings of every kernel, in one place.

No fastmath: no-data is NaN, and NaN must stay NaN. ``nogil`` lets threads evaluate routes side by side; the machine code is kept
between runs (:mod:`uavcover.kernels._cache`). ``NUMBA_DISABLE_JIT=1`` turns all of it off, for debugging and for measuring test
coverage.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

from uavcover.kernels._cache import SETTINGS, keep_compiled

_F = TypeVar("_F", bound=Callable[..., object])


def kernel(function: _F) -> _F:
    """Compile ``function`` to machine code on its first call."""
    compiled = numba.njit(nogil=True, fastmath=False)(function)
    if not SETTINGS.DISABLE_JIT:
        keep_compiled(compiled)
    return cast(_F, compiled)
