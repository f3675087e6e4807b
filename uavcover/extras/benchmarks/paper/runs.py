"""The runs of the paper's simulation: MODBO and IMODBO on each reading, five times each, as in section 5.3.

A reading is one way to understand the paper's sensor: the paper does not say which made its Tables 5 and 6, which stand here as
printed.
"""

import dataclasses
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from uavcover.extras.benchmarks.runs import KeptRuns, completed
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import RouteMember
from uavcover.model.scenario import PlannerAlgorithm
from uavcover.model.sensor import SphereSensor
from uavcover.model.sensor_base import LineOfSight
from uavcover.planner.planner import Effort, plan_routes
from uavcover.planner.selection_rule import PAPER_WEIGHTS
from uavcover.scenario.site import Site, load_site


@dataclass(frozen=True, slots=True)
class Figures:
    """Coverage as a share 0..1, number of nodes, length of the path in the paper's units."""

    coverage: float
    nodes: float
    length: float


TABLE_5: Final = MappingProxyType(
    {
        "modbo": (Figures(0.7284, 41.8, 72.1694), Figures(0.014876, 2.1679, 2.3748)),
        "imodbo": (Figures(0.8680, 41.2, 71.6046), Figures(0.003670, 1.9235, 1.1020)),
    }
)
"""Mean and standard deviation over five runs, by algorithm."""

TABLE_6: Final = MappingProxyType({"modbo": Figures(0.746, 40.0, 71.1091), "imodbo": Figures(0.872, 40.0, 70.7435)})
"""The scheme chosen by the weights 0.6, 0.2, 0.2, by algorithm."""


@dataclass(frozen=True, slots=True)
class Reading:
    """A reading of sections 2.2 and 5.2."""

    name: str  # short
    scenario: str  # the bundled scenario that it is a variant of
    line_of_sight: LineOfSight | None  # how a cell is hidden by ground; none where nothing hides it
    meaning: str  # in words

    def site(self) -> Site:
        """The paper's ground, seen by this reading's sensor."""
        site = load_site(self.scenario)
        sensor = site.scenario.sensor
        if self.line_of_sight is None:
            return site
        changed = SphereSensor(kind="sphere", range_m=sensor.reach_m, line_of_sight=self.line_of_sight)
        return dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, sensor=changed))


READINGS: Final = MappingProxyType(
    {
        reading.name: reading
        for reading in (
            Reading("R2-ray", "paper-R2", "ray", "R = 2 in three dimensions (Table 1), exact line of sight"),
            Reading("R2-midpoint", "paper-R2", "midpoint", "R = 2 in three dimensions, the midpoint test of Eq. 5"),
            Reading("r1-ray", "paper-r1", "ray", "r = 1 in three dimensions (section 2.2.2), exact line of sight"),
            Reading("r1-midpoint", "paper-r1", "midpoint", "r = 1 in three dimensions, the midpoint test of Eq. 5"),
            Reading("planar", "paper-planar", None, "r = 1 in the horizontal plane (S = pi r^2), nothing hides a cell"),
        )
    }
)
"""The readings by name."""


ALGORITHMS: tuple[PlannerAlgorithm, ...] = ("modbo", "imodbo")
RULE = "weighted:" + ",".join(map(str, PAPER_WEIGHTS))

_OBJECTIVES = ("coverage", "nodes", "length")


@dataclass(frozen=True, slots=True)
class PaperRun:
    """One run; its number, from 1, is the seed."""

    reading: str
    algorithm: PlannerAlgorithm
    number: int

    @property
    def key(self) -> str:
        """Key of its file."""
        return f"{self.reading}/{self.algorithm}/{self.number}"


@dataclass(frozen=True, slots=True, eq=False)
class PaperResult:
    """Result of a run."""

    front: tuple[Figures, ...]  # the Pareto set, by coverage
    routes: tuple[FloatArray, ...]  # the waypoints (n, 3) of each member
    chosen: int  # number of the member that the weights choose
    cpu_s: float  # processor time


def paper_runs(readings: Collection[str], runs: int) -> list[PaperRun]:
    """Every run, first runs first, so that a benchmark that is stopped early has seen everything once."""
    return [
        PaperRun(reading, algorithm, number)
        for number in range(1, runs + 1)
        for reading in readings
        for algorithm in ALGORITHMS
    ]


@dataclass(frozen=True, slots=True)
class _PaperTask:
    run: PaperRun
    population: int
    iterations: int

    def __str__(self) -> str:
        return self.run.key


def make_runs(
    folder: KeptRuns, runs: Sequence[PaperRun], *, population: int, iterations: int, processes: int
) -> Iterator[PaperRun]:
    """Make the runs and yield each once it is in the folder.

    The result does not depend on the number of processes.

    Raises:
        UavcoverError: a process was killed, or a run failed; what is done is kept.
    """
    tasks = [_PaperTask(run, population, iterations) for run in runs]
    for task, document in completed(_make, tasks, processes=processes):
        folder.write(task.run.key, document)
        yield task.run


def _make(task: _PaperTask) -> dict[str, Any]:
    run = task.run
    site = READINGS[run.reading].site()
    settings = dataclasses.replace(
        site.scenario.planner,
        algorithm=run.algorithm,
        seed=run.number,
        population_size=task.population,
        evaluations=task.population * task.iterations,
    )
    effort = Effort(settings.evaluations, None, time.process_time)
    plan = plan_routes(site, settings=settings, select_rule=RULE, effort=effort)
    chosen = next(k for k, member in enumerate(plan.members) if member is plan.chosen)
    return {"chosen": chosen, "cpu_s": plan.wall_s, "members": [_member(member) for member in plan.members]}


def _member(member: RouteMember) -> dict[str, object]:
    metrics = member.metrics
    values = (metrics.coverage_fraction, metrics.waypoint_count, metrics.path_length_m)
    return dict(zip(_OBJECTIVES, values, strict=True)) | {"route": member.route.waypoints_m.tolist()}


def read_result(folder: KeptRuns, run: PaperRun) -> PaperResult:
    """A run that is done. Raises InputError: its file cannot be read."""
    document = folder.read(run.key)
    members = document["members"]
    return PaperResult(
        front=tuple(Figures(*(float(member[name]) for name in _OBJECTIVES)) for member in members),
        routes=tuple(np.array(member["route"], dtype=float).reshape(-1, 3) for member in members),
        chosen=int(document["chosen"]),
        cpu_s=float(document["cpu_s"]),
    )
