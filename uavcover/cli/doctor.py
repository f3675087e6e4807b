"""``uavcover doctor``: what is installed, what works, what the optional parts would need."""

import importlib
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options

_PACKAGES = {
    "numpy": "numpy", "scipy": "scipy", "numba": "numba", "pyproj": "pyproj", "rasterio": "rasterio", "shapely": "shapely",
    "pydantic": "pydantic", "pymavlink": "pymavlink", "mavsdk": "mavsdk", "rerun-sdk": "rerun", "matplotlib": "matplotlib",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One thing that was looked at.

    Attributes:
        name: what.
        ok: whether it is there and works.
        needed: whether uavcover cannot do without it.
        text: version, or what to do.
    """

    name: str
    ok: bool
    needed: bool
    text: str


def examine(*, try_imports: bool) -> list[Diagnosis]:
    """Look at everything."""
    return [*_basics(), *_packages(try_imports), *_data(), *_optional()]


def _basics() -> Iterator[Diagnosis]:
    yield Diagnosis("uavcover", True, True, metadata.version("uavcover"))
    yield Diagnosis(
        "python", sys.version_info >= (3, 11), True, f"{platform.python_version()} on {platform.platform()}"
    )
    yield Diagnosis("cores", True, True, str(os.cpu_count()))
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    yield Diagnosis("free disk here", free > 0.5, False, f"{free:.1f} GB")
    try:
        with tempfile.TemporaryFile():
            yield Diagnosis("temporary files", True, True, tempfile.gettempdir())
    except OSError as error:
        yield Diagnosis("temporary files", False, True, f"{error}; set TMPDIR to a folder that can be written to")


def _packages(try_imports: bool) -> Iterator[Diagnosis]:
    for name, module in _PACKAGES.items():
        try:
            version = metadata.version(name)
            if try_imports:
                importlib.import_module(module)
            yield Diagnosis(name, True, True, version)
        except (ImportError, OSError) as error:
            yield Diagnosis(name, False, True, f"{error}; install the package again, from its clone: pip install -e .")


def _data() -> Iterator[Diagnosis]:
    from uavcover.errors import UavcoverError
    from uavcover.scenario.scenario_file import bundled_scenarios
    from uavcover.scenario.site import load_site

    for name in bundled_scenarios():
        try:
            site = load_site(name)
            yield Diagnosis(f"scenario {name}", True, True, site.scenario.description)
        except UavcoverError as error:
            yield Diagnosis(f"scenario {name}", False, True, str(error))


def _optional() -> Iterator[Diagnosis]:
    display = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")) or sys.platform in {
        "darwin",
        "win32",
    }
    yield Diagnosis(
        "screen for inspect", display, False,
        "there" if display else "none here; uavcover inspect --text and --screenshot work without one",
    )  # fmt: skip
    vulkan = sys.platform != "linux" or any(Path(p).is_dir() and any(Path(p).iterdir()) for p in _VULKAN)
    yield Diagnosis(
        "Vulkan driver for --screenshot", vulkan, False,
        "there" if vulkan else "none found; on Debian and Ubuntu: apt install mesa-vulkan-drivers libvulkan1",
    )  # fmt: skip
    for name, purpose, extra in (
        ("pyulog", ".ulg logs of PX4", "ulog"),
        ("pyserial", "serial links", "serial"),
        ("pyogrio", "areas in GeoPackage and Shapefile", "gis"),
        ("distributed", "--scheduler: large areas on several processes or machines", "cluster"),
    ):
        yield _extra(name, purpose, extra)
    for name, variable in (("ArduCopter simulator", "UAVCOVER_ARDUCOPTER"), ("PX4 simulator", "UAVCOVER_PX4")):
        path = os.environ.get(variable)
        ok = path is not None and Path(path).exists()
        yield Diagnosis(name, ok, False, path if ok and path else f"set {variable} to fly it in sitl_tests")


def _extra(name: str, purpose: str, extra: str) -> Diagnosis:
    """A package that only one extra of uavcover brings."""
    try:
        return Diagnosis(name, True, False, f"{metadata.version(name)}, for {purpose}")
    except metadata.PackageNotFoundError:
        return Diagnosis(
            name,
            False,
            False,
            f"needed for {purpose}: pip install {name} (extra {extra})",
        )


_VULKAN = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")


def doctor(
    output: options.Output,
    imports: Annotated[bool, typer.Option(help="Try every package, not only look it up.")] = True,
    compile_ahead: Annotated[
        bool, typer.Option("--compile", help="Compile the numeric kernels now, so that no search waits for it.")
    ] = False,
) -> int:
    """Say what is installed, what works, and what each optional part would need."""
    console = output.console()
    if compile_ahead:
        from uavcover.run.compile_ahead import compile_kernels

        wall_s = compile_kernels(console)
        console.say(f"the numeric kernels are compiled ({wall_s:.0f} s)")
        console.result({"compiled": True, "wall_s": wall_s})
        return 0
    findings = examine(try_imports=imports)
    for finding in findings:
        console.say(
            f"{'ok     ' if finding.ok else 'MISSING' if finding.needed else 'absent '} {finding.name:28} {finding.text}"
        )
    healthy = all(finding.ok for finding in findings if finding.needed)
    console.result({"healthy": healthy, "findings": [asdict(finding) for finding in findings]})
    return 0 if healthy else 1
