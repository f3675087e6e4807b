"""The paper's simulation: MODBO and IMODBO on each reading, five times each, as in section 5.3; its tables and figures.

A reading is one way to understand the paper's sensor: the paper does not say which made its Tables 5 and 6, which stand here as
printed. Ours are beside them, as Markdown and CSV. Figures 7 to 11 show the terrain and what both algorithms planned over it.
"""

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from uavcover.extras.benchmarks.runs import KeptRuns, csv_text, drawn, kept, markdown, write_texts
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import RouteMember
from uavcover.model.scenario import PlannerAlgorithm
from uavcover.model.sensor import SphereSensor
from uavcover.model.sensor_base import LineOfSight
from uavcover.planner.planner import Effort, plan_routes
from uavcover.planner.selection_rule import PAPER_WEIGHTS
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap


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
    line_of_sight: LineOfSight | None  # how a cell is hidden by ground; None where nothing hides it
    meaning: str  # in words

    def site(self) -> Site:
        """The paper's ground, observed by this reading's sensor."""
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

    def __str__(self) -> str:
        """Key of its file."""
        return f"{self.reading}/{self.algorithm}/{self.number}"


@dataclass(frozen=True, slots=True, eq=False)
class Scheme:
    """A member of a Pareto set."""

    figures: Figures
    route: FloatArray  # (n, 3) waypoints


@dataclass(frozen=True, slots=True, eq=False)
class PaperResult:
    """Result of a run."""

    front: tuple[Scheme, ...]  # the Pareto set, by coverage
    chosen: int  # number of the member that the weights choose
    cpu_s: float  # processor time


def paper_runs(readings: Collection[str], runs: int) -> list[PaperRun]:
    """Every run, first runs first, so that a benchmark that is stopped early has run everything once."""
    return [
        PaperRun(reading, algorithm, number)
        for number in range(1, runs + 1)
        for reading in readings
        for algorithm in ALGORITHMS
    ]


def make_runs(
    folder: KeptRuns, runs: Sequence[PaperRun], *, population: int, iterations: int, processes: int
) -> Iterator[PaperRun]:
    """Make the runs and yield each once it is in the folder; errors as of :func:`kept`."""
    make = functools.partial(_make, population=population, iterations=iterations)
    return kept(folder, make, runs, processes=processes)


def _make(run: PaperRun, *, population: int, iterations: int) -> dict[str, Any]:
    site = READINGS[run.reading].site()
    settings = dataclasses.replace(
        site.scenario.planner,
        algorithm=run.algorithm,
        seed=run.number,
        population_size=population,
        evaluations=population * iterations,
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
    document = folder.read(str(run))
    members = document["members"]
    return PaperResult(
        front=tuple(
            Scheme(
                Figures(*(float(member[name]) for name in _OBJECTIVES)),
                np.array(member["route"], dtype=float).reshape(-1, 3),
            )
            for member in members
        ),
        chosen=int(document["chosen"]),
        cpu_s=float(document["cpu_s"]),
    )


Results = Mapping[tuple[str, str], Sequence[PaperResult]]
"""The results of the runs by reading and algorithm, in the order of their numbers."""

PAPERS_NODES = (38, 44)
"""Numbers of nodes that the paper's schemes have: both means of Table 5, give or take a standard deviation."""


def by_weights(results: Sequence[PaperResult]) -> Scheme:
    """The smallest weighted sum of the objectives, each scaled to 0..1 over the sets of all results (section 5.3)."""
    schemes = [scheme for result in results for scheme in result.front]
    values = np.array([[-s.figures.coverage, s.figures.nodes, s.figures.length] for s in schemes])
    spread = np.ptp(values, axis=0)
    scaled = (values - values.min(axis=0)) / np.where(spread > 0.0, spread, 1.0)
    return schemes[int(np.argmin(scaled @ np.array(PAPER_WEIGHTS)))]


def by_nodes(results: Sequence[PaperResult]) -> Scheme:
    """Most coverage with as many nodes as the paper has; with the nearest number where there is none such."""
    low, high = PAPERS_NODES

    def away(scheme: Scheme) -> float:
        return max(0.0, low - scheme.figures.nodes, scheme.figures.nodes - high)

    schemes = (scheme for result in results for scheme in result.front)
    return min(schemes, key=lambda s: (away(s), -s.figures.coverage, s.figures.length))


CHOICES: Final = MappingProxyType[str, Callable[[Sequence[PaperResult]], Scheme]](
    {"weights": by_weights, "nodes": by_nodes}
)
"""Ways to choose one scheme: by the paper's weights, or by its number of nodes."""


TableRow = tuple[Figures, Figures]
"""A row of Table 5: mean and standard deviation (of a sample; NaN for one run) over the runs."""


def row(results: Sequence[PaperResult], choice: str) -> TableRow:
    """The runs of one algorithm on one reading."""
    chosen = [CHOICES[choice]([result]).figures for result in results]
    values = np.array([[c.coverage, c.nodes, c.length] for c in chosen])
    std = values.std(axis=0, ddof=1) if len(values) > 1 else np.full(3, math.nan)
    return Figures(*values.mean(axis=0).tolist()), Figures(*std.tolist())


def misfit(rows: Mapping[str, TableRow]) -> float:
    """Distance of both algorithms' rows from Table 5: root mean square of the six means' relative deviations."""
    deviations = [
        getattr(rows[algorithm][0], name) / getattr(mean, name) - 1.0
        for algorithm, (mean, _) in TABLE_5.items()
        for name in ("coverage", "nodes", "length")
    ]
    return math.sqrt(sum(d * d for d in deviations) / len(deviations))


_CHOSEN = {
    "weights": "chosen by the weights 0.6, 0.2, 0.2 (section 5.3)",
    "nodes": f"chosen by the paper's number of nodes: most coverage with {PAPERS_NODES[0]} to {PAPERS_NODES[1]}",
}


def readings_done(results: Results) -> list[str]:
    """Readings that both algorithms have runs of, in our order."""
    return [name for name in READINGS if all((name, algorithm) in results for algorithm in ALGORITHMS)]


def runs_csv(results: Results) -> str:
    """``runs.csv``: reading, algorithm, run, choice, coverage, nodes, length, cpu_s; unrounded."""
    rows = (
        [*key, number, choice, *dataclasses.astuple(choose([result]).figures), result.cpu_s]
        for key, found in results.items()
        for number, result in enumerate(found, start=1)
        for choice, choose in CHOICES.items()
    )
    return csv_text(["reading", "algorithm", "run", "choice", "coverage", "nodes", "length", "cpu_s"], rows)


def tables_markdown(results: Results, *, population: int, iterations: int, version: str) -> str:
    """``tables.md``: both tables for both choices, and the readings by how well they fit."""
    runs = sorted({len(found) for found in results.values()})
    text = str(runs[0]) if len(runs) == 1 else f"{runs[0]} to {runs[-1]}"
    parts = [
        "# The paper's simulation under five readings\n",
        f"uavcover {version}; population {population}, {iterations} iterations, {text} run(s) of each, seeds from 1. Mean ± "
        "standard deviation. Lengths in the paper's units.\n",
        "| reading | meaning |\n|---|---|\n"
        + "\n".join(f"| {name} | {READINGS[name].meaning} |" for name in readings_done(results))
        + "\n",
    ]
    for choice, text in _CHOSEN.items():
        parts += [f"## Table 5, {text}\n", _table_5(results, choice)]
    for choice, text in _CHOSEN.items():
        parts += [f"## Table 6: of all runs one scheme, {text}\n", _table_6(results, choice)]
    parts += [
        "## Which reading fits\n",
        "Root mean square of the relative deviations of the six means of Table 5 (coverage, nodes and length of both "
        "algorithms); coverage apart, in percentage points, ours less the paper's; least misfit first.\n",
        _fits(results),
    ]
    return "\n".join(parts)


def _table_5(results: Results, choice: str) -> str:
    lines = [["paper", algorithm, *_spread(row), ""] for algorithm, row in TABLE_5.items()]
    for reading in readings_done(results):
        rows: dict[str, TableRow] = {algorithm: row(results[reading, algorithm], choice) for algorithm in ALGORITHMS}
        fit = f"{misfit(rows):.3f}"
        lines += [[reading, algorithm, *_spread(rows[algorithm]), fit] for algorithm in ALGORITHMS]
    return markdown(["reading", "algorithm", "coverage %", "length", "nodes", "misfit"], lines) + "\n"


def _table_6(results: Results, choice: str) -> str:
    lines = [["paper", algorithm, *_plain(figures)] for algorithm, figures in TABLE_6.items()]
    for reading in readings_done(results):
        for algorithm in ALGORITHMS:
            lines.append([reading, algorithm, *_plain(CHOICES[choice](results[reading, algorithm]).figures)])
    return markdown(["reading", "algorithm", "coverage %", "length", "nodes"], lines) + "\n"


def _fits(results: Results) -> str:
    found: list[tuple[float, list[str]]] = []
    for choice in CHOICES:
        for reading in readings_done(results):
            rows: dict[str, TableRow] = {
                algorithm: row(results[reading, algorithm], choice) for algorithm in ALGORITHMS
            }
            gaps = [100.0 * (rows[name][0].coverage - TABLE_5[name][0].coverage) for name in ALGORITHMS]
            gain = 100.0 * (rows["imodbo"][0].coverage - rows["modbo"][0].coverage)
            fit = misfit(rows)
            cells = [reading, choice, f"{fit:.3f}", *(f"{gap:+.1f}" for gap in gaps), f"{gain:+.1f}"]
            found.append((fit, cells))
    paper_gain = 100.0 * (TABLE_5["imodbo"][0].coverage - TABLE_5["modbo"][0].coverage)
    header = ["reading", "choice", "misfit", "modbo", "imodbo", f"imodbo less modbo (paper {paper_gain:+.1f})"]
    return markdown(header, [cells for _, cells in sorted(found, key=lambda item: item[0])]) + "\n"


def _spread(row: TableRow) -> Sequence[str]:
    mean, std = row
    return (
        f"{100 * mean.coverage:.2f} ± {100 * std.coverage:.2f}",
        f"{mean.length:.2f} ± {std.length:.2f}",
        f"{mean.nodes:.1f} ± {std.nodes:.1f}",
    )


def _plain(figures: Figures) -> Sequence[str]:
    return f"{100 * figures.coverage:.1f}", f"{figures.length:.2f}", f"{figures.nodes:.0f}"


_FIGURES = {"modbo": (8, 10), "imodbo": (9, 11)}
_SIDE = 10.0


def draw_terrain(path: Path) -> Path:
    """Figure 7: the terrain (Eq. 26); returns the file."""
    with drawn(path, dpi=80) as plt:
        page = plt.figure(figsize=(5.0, 3.8))
        axis = page.add_subplot(projection="3d")
        axis.plot_surface(*_surface(READINGS["planar"]), cmap="terrain", linewidth=0.0)
        axis.set(xlabel="x", ylabel="y", zlabel="z", title="As the paper's Figure 7: z = sin(y) cos(x)")
        page.tight_layout()
    return path


def draw_schemes(path: Path, reading: Reading, schemes: dict[str, Scheme]) -> Path:
    """Figures 8 to 11 for a reading: side view and top view of each algorithm's scheme; returns the file.

    The top view has what is observed in green and what is not in red.
    """
    with drawn(path, dpi=80) as plt:
        page = plt.figure(figsize=(9.0, 7.6))
        for column, algorithm in enumerate(ALGORITHMS):
            scheme = schemes[algorithm]
            figures = scheme.figures
            side, top = _FIGURES[algorithm]
            text = f"{100 * figures.coverage:.1f} %, {figures.nodes:.0f} nodes, length {figures.length:.1f}"
            axis = page.add_subplot(2, 2, 1 + column, projection="3d")
            _side_view(axis, reading, scheme.route)
            axis.set_title(f"As Figure {side}: {algorithm}, {text}", fontsize=9)
            axis = page.add_subplot(2, 2, 3 + column)
            _top_view(axis, reading, scheme.route)
            axis.set_title(f"As Figure {top}: {algorithm}", fontsize=9)
        page.suptitle(f"{reading.name}: {reading.meaning}", fontsize=10)
        page.tight_layout()
    return path


def _side_view(axis: Any, reading: Reading, route: FloatArray) -> None:
    axis.plot_surface(*_surface(reading), cmap="terrain", linewidth=0.0, alpha=0.45)
    axis.plot(*route.T, ".-", color="tab:red", markersize=4.0, linewidth=1.0)
    axis.view_init(elev=18.0, azim=-60.0)
    axis.set(xlabel="x", ylabel="y", zlabel="z")
    axis.tick_params(labelsize=6)


def _top_view(axis: Any, reading: Reading, route: FloatArray) -> None:
    site = reading.site()
    coverage = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
    lattice = coverage.grid.cells.lattice
    image = np.where(lattice >= 0, coverage.observed(route)[lattice], np.nan)
    axis.imshow(image, origin="lower", extent=(0.0, _SIDE, 0.0, _SIDE), cmap="RdYlGn", vmin=-0.3, vmax=1.3, alpha=0.6)
    axis.contour(*_surface(reading), levels=7, colors="0.4", linewidths=0.4)
    axis.plot(*route[:, :2].T, ".-", color="black", markersize=5.0, linewidth=0.9)
    axis.plot(*route[:1, :2].T, "o", color="tab:blue", markersize=7.0, markerfacecolor="none")
    axis.set(xlabel="x", ylabel="y", aspect="equal")
    axis.tick_params(labelsize=6)


def _surface(reading: Reading) -> tuple[FloatArray, FloatArray, FloatArray]:
    axis = np.linspace(0.0, _SIDE, 81)
    x, y = np.meshgrid(axis, axis)
    z = reading.site().ground.heights_m(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    return x, y, z


def read_results(folder: KeptRuns) -> Results:
    """All finished runs. Raises InputError: the file of a run cannot be read."""
    found: dict[tuple[str, str], list[PaperResult]] = {}
    done = set(folder.done())
    for run in paper_runs(READINGS, 1000):
        if str(run) in done:
            found.setdefault((run.reading, run.algorithm), []).append(read_result(folder, run))
    return found


def write_results(folder: KeptRuns) -> list[Path]:
    """Write runs.csv, tables.md, the routes and the figures; returns the files.

    Raises:
        InputError: the file of a run cannot be read.
        OutputError: a file cannot be written.
    """
    results = read_results(folder)
    population, iterations = int(folder.settings["population"]), int(folder.settings["iterations"])
    text = tables_markdown(results, population=population, iterations=iterations, version=version("uavcover"))
    texts = {"runs.csv": runs_csv(results), "tables.md": text}
    shown: dict[str, dict[str, Scheme]] = {}
    for reading in readings_done(results):
        for choice, choose in CHOICES.items():
            schemes: dict[str, Scheme] = {algorithm: choose(results[reading, algorithm]) for algorithm in ALGORITHMS}
            shown.setdefault(reading, schemes)
            for algorithm, scheme in schemes.items():
                texts[f"route-{reading}-{algorithm}-{choice}.csv"] = csv_text("xyz", scheme.route.tolist())
    files = [*write_texts(folder.path, texts), draw_terrain(folder.path / "figure7.png")]
    for reading, schemes in shown.items():
        files.append(draw_schemes(folder.path / f"figures8-11-{reading}.png", READINGS[reading], schemes))
    return files
