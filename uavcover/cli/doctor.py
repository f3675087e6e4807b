"""``uavcover doctor``: installed packages, their function, and the requirements of optional parts."""

import contextlib
import importlib
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from uavcover.cli import options
from uavcover.cli.options import option
from uavcover.errors import InfeasibleError
from uavcover.run.user import User

if TYPE_CHECKING:
    from uavcover.model.route import Route
    from uavcover.model.track import Track
    from uavcover.scenario.site import Site

_PACKAGES = {
    "numpy": "numpy", "scipy": "scipy", "numba": "numba", "pyproj": "pyproj", "rasterio": "rasterio", "shapely": "shapely",
    "pydantic": "pydantic", "pymavlink": "pymavlink", "mavsdk": "mavsdk", "rerun-sdk": "rerun", "matplotlib": "matplotlib",
}  # fmt: skip
_REINSTALL = "reinstall the package from its clone: pip install -e ."


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Result of one check."""

    name: str  # what
    ok: bool  # whether it is there and works
    needed: bool  # whether uavcover cannot do without it
    text: str  # version, or what to do


def examine(*, try_imports: bool) -> list[Diagnosis]:
    """Run all checks."""
    return [*_basics(), *_packages(try_imports), *_data(), *_extensions(), *_optional()]


def _basics() -> Iterator[Diagnosis]:
    yield Diagnosis("uavcover", True, True, metadata.version("uavcover"))
    yield Diagnosis(
        "python", sys.version_info >= (3, 11), True, f"{platform.python_version()} on {platform.platform()}"
    )
    yield Diagnosis("cores", True, True, str(os.cpu_count()))
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    yield Diagnosis("free disk space here", free > 0.5, False, f"{free:.1f} GB")
    try:
        with tempfile.TemporaryFile():
            yield Diagnosis("temporary files", True, True, tempfile.gettempdir())
    except OSError as error:
        yield Diagnosis("temporary files", False, True, f"{error}; set TMPDIR to a writable folder")


def _packages(try_imports: bool) -> Iterator[Diagnosis]:
    for name, module in _PACKAGES.items():
        try:
            version = metadata.version(name)
            if try_imports:
                importlib.import_module(module)
            yield Diagnosis(name, True, True, version)
        except (ImportError, OSError) as error:
            yield Diagnosis(name, False, True, f"{error}; {_REINSTALL}")


def _data() -> Iterator[Diagnosis]:
    from uavcover.errors import UavcoverError

    try:
        from uavcover.scenario.scenario_file import bundled_scenarios
        from uavcover.scenario.site import load_site
    except (ImportError, OSError) as error:
        yield Diagnosis("scenarios", False, True, f"{error}; {_REINSTALL}")
        return
    for name in bundled_scenarios():
        try:
            site = load_site(name)
            yield Diagnosis(f"scenario {name}", True, True, site.scenario.description)
        except UavcoverError as error:
            yield Diagnosis(f"scenario {name}", False, True, str(error))


def _extensions() -> Iterator[Diagnosis]:
    """The extras of uavcover and what packages of third parties add."""
    from uavcover.errors import InputError
    from uavcover.plugins import GROUPS, load, package_of, registered

    for group in GROUPS:
        for name, entry in registered(group).items():
            what = f"{group.removeprefix('uavcover.').replace('_', ' ').removesuffix('s')} {name}"
            try:
                load(group, name)
                yield Diagnosis(what, True, False, f"{entry.value}, of package {package_of(entry)}")
            except InputError as error:
                yield Diagnosis(what, False, False, str(error))


def _optional() -> Iterator[Diagnosis]:
    display = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")) or sys.platform in {
        "darwin",
        "win32",
    }
    yield Diagnosis(
        "screen for inspect", display, False,
        "there" if display else "none; uavcover inspect --text and --screenshot do not need one",
    )  # fmt: skip
    vulkan = sys.platform != "linux" or any(Path(p).is_dir() and any(Path(p).iterdir()) for p in _VULKAN)
    yield Diagnosis(
        "Vulkan driver for --screenshot", vulkan, False,
        "there" if vulkan else "none found; on Debian and Ubuntu: apt install mesa-vulkan-drivers libvulkan1",
    )  # fmt: skip
    for name, purpose, extra in (
        ("pyulog", "PX4 logs (.ulg)", "ulog"),
        ("pyserial", "serial links", "serial"),
        ("pyogrio", "GeoPackage and Shapefile areas", "gis"),
        ("anywidget", "maps in notebooks", "jupyter"),
        ("distributed", "planning on several processes or machines (--scheduler)", "cluster"),
    ):
        try:
            yield Diagnosis(name, True, False, f"{metadata.version(name)}, for {purpose}")
        except metadata.PackageNotFoundError:
            yield Diagnosis(name, False, False, f"required for {purpose}: pip install {name} (extra {extra})")
    for name, variable in (("ArduCopter simulator", "UAVCOVER_ARDUCOPTER"), ("PX4 simulator", "UAVCOVER_PX4")):
        path = os.environ.get(variable)
        ok = path is not None and Path(path).exists()
        yield Diagnosis(name, ok, False, path if ok and path else f"set {variable} to its path to use it in sitl_tests")


_VULKAN = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d")


def doctor(
    output: options.Output,
    imports: Annotated[bool, option("Import every package instead of only checking that it is installed.")] = True,
    compile_ahead: Annotated[
        bool, option("--compile", "Compile the numeric kernels now instead of during the first search.")
    ] = False,
) -> int:
    """Check the installation, and list the requirements of each optional feature."""
    console = output.console()
    if compile_ahead:
        wall_s = compile_kernels(console)
        console.say(f"compiled the numeric kernels ({wall_s:.0f} s)")
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


# Compiles the numeric kernels before they are needed, so that no search and no verdict waits for it.
#
# A kernel is compiled for the types that it is called with. The rounds below plan, judge and close gaps once with
# each kind of sensor and encoding, on little work; what they call is what every scenario calls.

ROUNDS = (("jacksboro", 200), ("paper-R2", 200))
"""A camera along its path, and a sphere at waypoints; with evaluations enough for the local search too."""

_SAMPLE_S = 0.2
_GAP_CELLS = 40


def compile_kernels(user: User) -> float:
    """Compile the kernels that are not compiled yet; returns the seconds that it took.

    Args:
        user: receives a message at the start of each round.
    """
    # Not at the top, because doctor must report missing packages if the numeric ones do not load.
    from uavcover.missions.flights import compile_flights
    from uavcover.planner.gap_route import plan_gap_route
    from uavcover.planner.plan_files import bounds
    from uavcover.planner.plan_search import SearchRequest, plan
    from uavcover.scenario.site import load_site
    from uavcover.sensing.site_maps import judging_map
    from uavcover.verification.flown_route import PlannedRoute
    from uavcover.verification.verify import FlownTrack, verify_flight

    started = time.monotonic()
    for number, (name, evaluations) in enumerate(ROUNDS, start=1):
        user.say(f"compiling the numeric kernels: {number} of {len(ROUNDS)}")
        site = load_site(name)
        result = plan(site, SearchRequest(evaluations=evaluations, seed=1))
        bounds(site, result, time_s=0.0)
        chosen = result.chosen
        promised = PlannedRoute(chosen.route.waypoints_m, chosen.metrics.coverage_fraction)
        coverage = judging_map(site)
        track = _flown(site, chosen.route)
        verify_flight(site, coverage, [FlownTrack(track, promised)])
        if site.home_m is not None:
            compile_flights(site, chosen.route)
            distance_m = np.linalg.norm(coverage.grid.cells.centre_m - chosen.route.waypoints_m[-1], axis=1)
            missing = coverage.coverable & (distance_m <= np.sort(distance_m)[_GAP_CELLS])
            with contextlib.suppress(InfeasibleError):
                plan_gap_route(coverage, missing, start_m=site.home_m, end_m=site.home_m)
    return time.monotonic() - started


def _flown(site: "Site", route: "Route") -> "Track":
    """A track at cruise speed along a route."""
    from uavcover.model.track import Track

    path = route.waypoints_m
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    speed_m_s = site.scenario.vehicle.cruise_speed_m_s
    time_s = np.arange(0.0, max(along_m[-1] / speed_m_s, 2.0 * _SAMPLE_S), _SAMPLE_S)
    enu_m = np.column_stack([np.interp(time_s * speed_m_s, along_m, path[:, axis]) for axis in range(3)])
    geodetic = enu_m[:, [1, 0, 2]] * 0.0 if site.frame is None else np.column_stack(site.frame.geodetic_from_enu(enu_m))
    return Track(
        time_s=time_s,
        geodetic=geodetic,
        enu_m=enu_m,
        attitude_deg=np.outer(np.cos(np.arange(len(time_s))), (1e-6, -1e-6, 0.0)),  # all zero would be no measurement
        current_waypoint=np.searchsorted(along_m, time_s * speed_m_s).astype(np.int64),
        attitude_age_s=np.zeros(len(time_s)),
    )
