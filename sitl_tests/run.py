"""Running one cell of the matrix: start the vehicle, try the capability, stop the vehicle, keep the logs."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from mission_io.errors import MissionIoError
from mission_io.model.items import GeoPoint
from sitl_tests.capabilities import ALL, PREPARATIONS
from sitl_tests.capabilities.demonstration import SCENARIO
from sitl_tests.case import Case, Finding, Stopwatch
from sitl_tests.errors import CheckFailedError
from sitl_tests.matrix import Cell
from sitl_tests.simulators import ardupilot, mock, px4
from sitl_tests.simulators.files import sha256
from sitl_tests.simulators.running import Start, StartRequest
from uavcover.errors import UavcoverError
from uavcover.flight.connect import require_home
from uavcover.scenario.site import load_site

FAILED = "failed"
EVENTS = "events.txt"
RESULT = "result.json"


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a cell.

    Attributes:
        cell: which.
        finding: what came of it; its outcome is "failed" for a check that failed, with the reason as the detail.
        version: what flew.
        wall_s: how long it took.
        log_sha256: the autopilot's logs of this case, by file name.
    """

    cell: Cell
    finding: Finding
    version: str
    wall_s: float
    log_sha256: Mapping[str, str]

    @property
    def as_expected(self) -> bool:
        """Whether the outcome is the one that the matrix has."""
        return self.finding.outcome == self.cell.expected.outcome


def kept_result(cell: Cell, folder: Path) -> Result | None:
    """What came of a cell that was run in this folder before; none when it was not, or not to its end."""
    path = folder / RESULT
    if not path.exists():
        return None
    kept = json.loads(path.read_text(encoding="utf-8"))
    finding = Finding(kept["outcome"], kept["detail"])
    return Result(cell, finding, kept["version"], kept["wall_s"], MappingProxyType(kept["log_sha256"]))


def _keep(result: Result, folder: Path) -> None:
    kept = {
        "outcome": result.finding.outcome,
        "detail": result.finding.detail,
        "version": result.version,
        "wall_s": result.wall_s,
        "log_sha256": dict(result.log_sha256),
    }
    (folder / RESULT).write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def run_cell(cell: Cell, folder: Path, *, seed: int = 1) -> Result:
    """Run a cell in a folder of its own, which must not exist yet.

    Raises:
        MissingSimulatorError: its simulator was not named.
        SimulatorError: its simulator does not start.
    """
    folder.mkdir(parents=True)
    if cell.capability in PREPARATIONS:
        PREPARATIONS[cell.capability](folder.parent)
    watch = Stopwatch()
    request = StartRequest(folder, home(), cell.vehicle.speed, cell.parameters)
    with _starter(cell)(request) as vehicle:
        case = Case(
            vehicle=vehicle,
            autopilot=cell.vehicle.autopilot,
            client=cell.client,
            folder=folder,
            seed=seed,
            speed=cell.vehicle.speed,
        )
        found = _found(lambda: ALL[cell.capability](case))
        (folder / EVENTS).write_text("".join(f"{line}\n" for line in case.events))
    finding = found if isinstance(found, Finding) else _found(found)
    unsaid = cell.expected.unsaid(case.events)
    if unsaid and finding.outcome == cell.expected.outcome:
        finding = Finding(FAILED, f"{finding.outcome}, and no event says {unsaid[0]!r}: {finding.detail}")
    logs = {path.name: sha256(path) for path in vehicle.log_files()}
    result = Result(cell, finding, vehicle.version, watch.elapsed_s, MappingProxyType(logs))
    _keep(result, folder)
    return result


FoundT = TypeVar("FoundT")


def _found(work: Callable[[], FoundT]) -> FoundT | Finding:
    """What work comes to; a check that fails and an error of ours are findings too."""
    try:
        return work()
    except (CheckFailedError, UavcoverError, MissionIoError) as error:
        return Finding(FAILED, f"{type(error).__name__}: {error}")


@cache
def home() -> GeoPoint:
    """The demo's home: the lowest ground of its area, because simulators without terrain are flat at home's height."""
    return require_home(load_site(SCENARIO))


def _starter(cell: Cell) -> Start:
    match cell.vehicle.simulator:
        case "mock":
            return mock.starter(cell.vehicle.autopilot, vehicle_type=cell.vehicle.mav_type)
        case "arducopter":
            return ardupilot.starter(ardupilot.COPTER)
        case "arduplane":
            return ardupilot.starter(ardupilot.PLANE)
        case "ardurover":
            return ardupilot.starter(ardupilot.ROVER)
        case "px4":
            return px4.start
