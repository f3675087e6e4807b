"""Sites on flat ground, made from the published areas and tours of others, and plans of them side by side."""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import numpy as np
from pyproj import Transformer

from uavcover.errors import InfeasibleError
from uavcover.extras.benchmarks.runs import KeptRuns, completed
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Plan
from uavcover.planner.planner import Effort, plan_routes
from uavcover.scenario.site import Site, load_site

# routes are HEIGHT_M above the ground
HEIGHT_M, _ALT_AMSL_M, LAT_DEG, LON_DEG = 20.0, 100.0, 46.0, 10.0
CRS: Final = f"+proj=tmerc +lat_0={LAT_DEG} +lon_0={LON_DEG} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"


class NamedTask(Protocol):
    """One that a plan is made for."""

    @property
    def name(self) -> str:
        """Key of its run."""
        ...


Task = TypeVar("Task", bound=NamedTask)


def earth_from_metres() -> Transformer:
    """From metres in `CRS` to longitude and latitude."""
    return Transformer.from_crs(CRS, 4326, always_xy=True)


def flat_site(
    folder: Path, scenario: str, *, corner_m: tuple[float, float], shape: tuple[int, int], pixel_m: float
) -> Site:
    """The site of a scenario over flat ground in ``dem.asc``; both files are written to a folder.

    Args:
        folder: for the files.
        scenario: the text of its file.
        corner_m: the south-west corner of the ground.
        shape: number of its rows and columns.
        pixel_m: side of a pixel.
    """
    rows, columns = shape
    (folder / "dem.asc").write_text(
        f"ncols {columns}\nnrows {rows}\nxllcorner {corner_m[0]}\nyllcorner {corner_m[1]}\n"
        f"cellsize {pixel_m}\nNODATA_value -9999\n" + (f"{_ALT_AMSL_M} " * columns + "\n") * rows,
        encoding="utf-8",
    )
    (folder / "scenario.toml").write_text(scenario, encoding="utf-8")
    return load_site(str(folder / "scenario.toml"))


def home_en_m(site: Site) -> FloatArray:
    """Home (2,) in metres of the site."""
    return np.zeros(2) if site.home_m is None else site.home_m[:2]


def planned(site: Site, name: str, budget_s: float) -> Plan:
    """The plan of a site within a processor time. Raises InfeasibleError: there is none; it has the name."""
    settings = site.scenario.planner
    effort = Effort(settings.evaluations, budget_s, time.process_time)
    try:
        return plan_routes(site, settings=settings, select_rule=site.scenario.select, effort=effort)
    except InfeasibleError as error:
        raise InfeasibleError(f"{name}: {error}") from error


def plan_each(
    folder: KeptRuns, plan: Callable[[Task], dict[str, Any]], tasks: Sequence[Task], *, processes: int
) -> Iterator[str]:
    """Plan side by side, and keep what each plan comes to; the name of each that is done."""
    for task, document in completed(plan, tasks, processes=processes):
        folder.write(task.name, document)
        yield task.name
