"""Machine code for copies of the packages: what is compiled here is not compiled for a minute once more."""

import shutil
from pathlib import Path

from uavcover.kernels import jit

KERNELS = Path("uavcover") / "kernels"


def lend_compiled_kernels(copy: Path) -> None:
    """Put the machine code of this tree beside the kernels in a copy, which uses it when all their sources are the same.

    Args:
        copy: folder that holds the package ``uavcover``, a clone or where a wheel was installed.
    """
    compiled = jit.folder()
    if compiled is not None:
        shutil.copytree(compiled, copy / KERNELS / "__pycache__" / compiled.name, dirs_exist_ok=True)
