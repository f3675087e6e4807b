"""Version of this program: a result depends on it beside its inputs."""

import functools
import hashlib
import platform
from importlib import metadata
from pathlib import Path

from uavcover.run.provenance import version

_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "shapely", "pyproj")


@functools.cache
def program() -> dict[str, str]:
    """Versions of uavcover and of what computes its results, and a hash of its sources, by name.

    Two programs of which all of this is equal give equal results on processors of one kind.
    """
    return {
        "uavcover": version(),
        "uavcover's sources": _sources_sha256()[:16],
        "python": platform.python_version(),
        "processor": platform.machine(),
        **{name: metadata.version(name) for name in _PACKAGES},
    }


def differences(ours: dict[str, str], theirs: dict[str, str]) -> str:
    """In words, what is not the same here and there; empty when all is."""
    return ", ".join(
        f"{name} {ours.get(name, 'none')} here and {theirs.get(name, 'none')} there"
        for name in ours | theirs
        if ours.get(name) != theirs.get(name)
    )


def _sources_sha256() -> str:
    root = Path(__file__).resolve().parents[1]
    found = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()
