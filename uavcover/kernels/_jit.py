"""The compiler settings of every kernel, in one place.

No fastmath: no-data is NaN, and NaN must stay NaN. ``nogil`` lets threads evaluate routes side by side; ``cache`` keeps the
machine code between runs. ``NUMBA_DISABLE_JIT=1`` turns all of it off, for debugging and for measuring test coverage.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

_F = TypeVar("_F", bound=Callable[..., object])


def kernel(function: _F) -> _F:
    """Compile ``function`` to machine code on its first call."""
    return cast(_F, numba.njit(cache=True, nogil=True, fastmath=False)(function))
