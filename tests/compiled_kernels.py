"""What tests know of machine code: copies of the packages borrow it; without the JIT fewer cases will do."""

import shutil
from pathlib import Path

import numba

from uavcover.kernels import jit

KERNELS = Path("uavcover") / "kernels"


def cases(*, compiled: int, interpreted: int) -> int:
    """How many cases to try.

    ``NUMBA_DISABLE_JIT=1`` runs the tests of the kernels once more only to measure which lines they reach. There a step takes a
    hundred times as long, and the compiled run has already tried every case.
    """
    return interpreted if numba.config.DISABLE_JIT else compiled


def lend_compiled_kernels(copy: Path) -> None:
    """Put the machine code of this tree beside the kernels in a copy, which uses what has the same sources.

    Args:
        copy: folder that holds the package ``uavcover``, a clone or where a wheel was installed.
    """
    compiled = jit.root()
    if compiled is not None:
        shutil.copytree(compiled, copy / KERNELS / "__pycache__" / compiled.name, dirs_exist_ok=True)
