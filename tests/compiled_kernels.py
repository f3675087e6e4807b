"""Machine code for copies of the packages: what is compiled here is not compiled for a minute once more."""

import os
import shutil
from pathlib import Path

ROOT = Path(__file__).parents[1]
KERNELS = Path("uavcover") / "kernels"


def lend_compiled_kernels(copy: Path) -> None:
    """Put numba's cache of this tree beside the same kernels in a copy; numba looks at their size and time of change.

    Args:
        copy: folder that holds the package ``uavcover``, a clone or where a wheel was installed.
    """
    here, there = ROOT / KERNELS, copy / KERNELS
    (there / "__pycache__").mkdir(exist_ok=True)
    for source in here.glob("*.py"):
        if (there / source.name).read_bytes() != source.read_bytes():
            continue  # changed here and not committed yet: the copy compiles its own
        changed = source.stat()
        os.utime(there / source.name, ns=(changed.st_atime_ns, changed.st_mtime_ns))
        for compiled in (here / "__pycache__").glob(f"{source.stem}.*.nb?"):
            shutil.copy(compiled, there / "__pycache__")
