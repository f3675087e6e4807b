"""The JSON and CSV documents of a run folder, from the objects they describe and back.

Reading ``pareto.csv``.
"""

import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.fleet import Fleet
from uavcover.model.route import Bound, Plan, Question, Route, RouteMember
from uavcover.model.verdict import VerificationReport
from uavcover.run.folder import SCHEMA_VERSION
from uavcover.scenario.site import Site

PARETO_COLUMNS = (
    "index",
    "coverage_fraction",
    "coverage_of_coverable",
    "waypoint_count",
    "path_length_m",
    "flight_time_s",
    "mission_time_s",
    "mission_energy_hover_s",
    "min_height_agl_m",
    "max_height_agl_m",
    "violation",
    "made_by",
    "chosen",
)

ROUTE_COLUMNS = ("index", "waypoint", "east_m", "north_m", "up_m")
"""Of ``pareto_routes.csv``."""
PART_COLUMN = "part"
"""Its last column where vehicles have parts of the area: the number of the part, from 1."""


@dataclass(frozen=True, slots=True, eq=False)
class PlannedDocument:
    """What later stages need of a ``plan.json``.

    Attributes:
        route: the chosen route.
        coverage_fraction: planned share of the area.
        coverage_of_coverable: planned share of what can be seen.
        rule_met: whether the selection rule was met.
        vehicles: how many fly it; a sortie, a gap mission or what is left of a flight is for one.
    """

    route: Route
    coverage_fraction: float
    coverage_of_coverable: float
    rule_met: bool
    vehicles: int = 1


def plan_document(
    site: Site,
    plan: Plan,
    *,
    seed: int,
    bounds: dict[str, Any],
    sorties: Sequence[dict[str, Any]] = (),
    fleet: dict[str, Any] | None = None,
    baselines: Sequence[dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """``plan.json``: equal for equal seed and evaluations in everything but ``wall_s``.

    Args:
        site: the scenario on its ground.
        plan: what was planned.
        seed: of every random number.
        bounds: what no plan can beat.
        sorties: what is said of each flight when there are several.
        fleet: what is said of the vehicles when there are several.
        baselines: as an older ``plan.json`` of the same set has them; default: the plan's.
    """
    frame = site.frame
    origin = None
    if frame is not None:
        origin = {"lat_deg": frame.lat_deg, "lon_deg": frame.lon_deg, "alt_amsl_m": frame.alt_amsl_m}
    return {
        "schema_version": SCHEMA_VERSION,
        "name": site.scenario.name,
        "seed": seed,
        "algorithm": plan.algorithm,
        "made_by": plan.chosen.origin,
        "evaluations": plan.evaluations,
        "interrupted": plan.interrupted,
        "wall_s": plan.wall_s,
        "origin": origin,
        "select": plan.rule,
        "rule_met": plan.rule_met,
        "objective": site.scenario.objective,
        "waypoints": _waypoints(site, plan.chosen.route.waypoints_m),
        **({"part_begins": list(plan.chosen.route.begins)} if plan.chosen.route.begins else {}),
        "metrics": dataclasses.asdict(plan.chosen.metrics),
        "sorties": list(sorties),
        "fleet": fleet,
        "bounds": bounds,
        "baselines": [
            {"name": b.origin, "violation": b.violation, **dataclasses.asdict(b.metrics)} for b in plan.baselines
        ]
        if baselines is None
        else list(baselines),
    }


def bound_document(bound: Bound) -> dict[str, Any]:
    """One entry of ``bounds``, under the name of its question."""
    asked: dict[str, float] = {"for_coverage_of_coverable": bound.asked}
    if bound.question == "most_coverage":
        asked = {"with_waypoints": int(bound.asked)}
    limit = "at_most" if bound.question == "most_coverage" else "at_least"
    return {
        **asked, limit: bound.limit, "found": bound.found, "gap": bound.gap,
        "proved_on": bound.proved_on, "method": bound.method, "counted": bound.counted,
    }  # fmt: skip


def bound_in_words(question: str, entry: dict[str, Any]) -> str:
    """What an entry of ``bounds`` says, in one line.

    Raises:
        InputError: it is none.
    """
    try:
        found, gap = entry["found"], entry["gap"]
        if question == "most_coverage":
            what = f"most coverage with {entry['with_waypoints']} waypoints: at most {_percent(entry['at_most'])}"
            found_text = None if found is None else _percent(found)
        else:
            name, unit = ("fewest waypoints", "") if question == "fewest_waypoints" else ("shortest path", " m")
            what = f"{name} for {_percent(entry['for_coverage_of_coverable'])}: at least {entry['at_least']:.0f}{unit}"
            found_text = None if found is None else f"{found:.0f}{unit}"
        text = f"{what}, found {found_text or 'none'}"
        gap_text = "" if gap is None else f", {_gap_in_words(gap)}"
        return f"{text}{gap_text}; proved for {entry['proved_on']}, by {entry['method']}"
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"plan.json: bounds.{question} is not a bound ({type(error).__name__}: {error})") from error


def _gap_in_words(gap: float) -> str:
    """As a share of the bound, or how many times it what was found is."""
    return f"gap {_percent(gap)}" if gap <= 1.0 else f"{1.0 + gap:.1f} times that"


def bounds_in_words(bounds: dict[str, Any]) -> list[str]:
    """The proved bounds of a plan, a line each."""
    return [bound_in_words(name, bounds[name]) for name in get_args(Question) if name in bounds]


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f} %"


def _waypoints(site: Site, points_m: FloatArray) -> list[dict[str, float | None]]:
    heights = site.ground.heights_agl_m(points_m)
    geodetic: list[tuple[float | None, float | None, float | None]] = [(None, None, None)] * len(points_m)
    if site.frame is not None:
        geodetic = [tuple(map(float, row)) for row in zip(*site.frame.geodetic_from_enu(points_m), strict=True)]  # type: ignore[misc]
    return [
        {
            "east_m": float(e), "north_m": float(n), "up_m": float(u),
            "lat_deg": lat, "lon_deg": lon, "alt_amsl_m": alt, "height_agl_m": float(h),
        }
        for (e, n, u), (lat, lon, alt), h in zip(points_m, geodetic, heights, strict=True)
    ]  # fmt: skip


def read_plan_document(document: dict[str, Any], *, source: str) -> PlannedDocument:
    """What later stages need of a plan.

    Raises:
        InputError: a key is missing or has the wrong kind; says which.
    """
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(
            f"{source}: schema_version {version} cannot be read by this version, which knows {SCHEMA_VERSION}"
        )
    try:
        points = np.array([[w["east_m"], w["north_m"], w["up_m"]] for w in document["waypoints"]], dtype=float)
        metrics = document["metrics"]
        planned = PlannedDocument(
            Route(points.reshape(-1, 3), tuple(int(number) for number in document.get("part_begins", ()))),
            float(metrics["coverage_fraction"]),
            float(metrics["coverage_of_coverable"]),
            bool(document["rule_met"]),
            _vehicles(document.get("fleet")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{source}: is not a plan ({type(error).__name__}: {error}); make it again with: uavcover plan"
        ) from error
    if not np.isfinite(points).all():
        raise InputError(
            f"{source}: a waypoint has a coordinate that is not a number; make it again with: uavcover plan"
        )
    return planned


def _vehicles(fleet: Any) -> int:
    """How many fly, of the ``fleet`` of a plan."""
    return 1 if fleet is None else Fleet(vehicles=int(fleet["vehicles"])).vehicles


def pareto_csv(plan: Plan) -> str:
    """``pareto.csv``: one row a member, numbers unrounded."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(PARETO_COLUMNS)
    for index, member in enumerate(plan.members):
        writer.writerow([index, *_pareto_values(member), int(member is plan.chosen)])
    return out.getvalue()


def _pareto_values(member: RouteMember) -> list[Any]:
    m = member.metrics
    return [
        repr(m.coverage_fraction), repr(m.coverage_of_coverable), m.waypoint_count, repr(m.path_length_m),
        repr(m.flight_time_s), *("" if v is None else repr(v) for v in (m.mission_time_s, m.mission_energy_hover_s)),
        repr(m.min_height_agl_m), repr(m.max_height_agl_m), repr(member.violation), member.origin,
    ]  # fmt: skip


def pareto_routes_csv(plan: Plan) -> str:
    """``pareto_routes.csv``: the waypoints of every member in flying order, numbers unrounded."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    in_parts = any(member.route.begins for member in plan.members)
    writer.writerow([*ROUTE_COLUMNS, PART_COLUMN] if in_parts else ROUTE_COLUMNS)
    for index, member in enumerate(plan.members):
        for number, point in enumerate(member.route.waypoints_m.tolist()):
            part = [1 + sum(number >= begin for begin in member.route.begins)] if in_parts else []
            writer.writerow([index, number, *map(repr, point), *part])
    return out.getvalue()


def read_pareto_routes(text: str, *, source: str) -> list[Route]:
    """The routes of a Pareto set, by their index.

    Raises:
        InputError: a column is missing, a number is none, or the rows are not in their order; says in which line.
    """
    routes: list[list[list[float]]] = []
    begins: list[list[int]] = []
    rows = csv.DictReader(io.StringIO(text))
    if tuple(rows.fieldnames or ()) not in (ROUTE_COLUMNS, (*ROUTE_COLUMNS, PART_COLUMN)):
        raise InputError(
            f"{source}: line 1: the columns are not {', '.join(ROUTE_COLUMNS)}; make it again with: uavcover plan"
        )
    for line, row in enumerate(rows, start=2):
        try:
            index, number = int(row["index"]), int(row["waypoint"])
            point = [float(row[name]) for name in ROUTE_COLUMNS[2:]]
            part = int(row.get(PART_COLUMN, 1))
        except (TypeError, ValueError) as error:
            raise InputError(f"{source}: line {line}: {error}; make it again with: uavcover plan") from error
        if number == 0:
            routes.append([])
            begins.append([])
        if part == len(begins[-1]) + 2 and number > 0:
            begins[-1].append(number)
        in_order = part == len(begins[-1]) + 1
        if not (in_order and index == len(routes) - 1 and number == len(routes[-1]) and np.isfinite(point).all()):
            raise InputError(f"{source}: line {line}: is not the next waypoint; make it again with: uavcover plan")
        routes[-1].append(point)
    return [Route(np.array(points), tuple(begin)) for points, begin in zip(routes, begins, strict=True)]


def verification_document(report: VerificationReport, *, source: str) -> dict[str, Any]:
    """``verification.json``."""
    return {"schema_version": SCHEMA_VERSION, "track": source, **dataclasses.asdict(report)}


@dataclass(frozen=True, slots=True)
class ParetoRow:
    """A member of the Pareto set as its file has it.

    Attributes:
        index: its number, for ``select RUN index:N``.
        coverage_of_coverable: share of what can be seen, 0..1.
        waypoint_count: how many waypoints.
        path_length_m: length of the open path in three dimensions.
        flight_time_s: of the route alone.
        mission_time_s: of the whole mission from home; none without a home, or in the file of an older version.
        mission_energy_hover_s: what it takes from the batteries, likewise.
        violation: of the hard limits, 0 when they hold.
        made_by: the algorithm or baseline that found it.
        chosen: whether it is the one in ``plan.json``.
    """

    index: int
    coverage_of_coverable: float
    waypoint_count: int
    path_length_m: float
    flight_time_s: float
    mission_time_s: float | None
    mission_energy_hover_s: float | None
    violation: float
    made_by: str
    chosen: bool

    @property
    def time_s(self) -> float:
        """As of :class:`~uavcover.model.route.RouteMetrics`."""
        return self.flight_time_s if self.mission_time_s is None else self.mission_time_s


@dataclass(frozen=True, slots=True)
class TradeOffAxis:
    """What coverage is drawn against.

    Attributes:
        label: with its unit.
        is_time: minutes of the whole mission, or minutes of hovering for its energy; otherwise kilometres of the route.
        members: of the Pareto set.
        baselines: likewise.
    """

    label: str
    is_time: bool
    members: tuple[float, ...]
    baselines: tuple[float, ...]


def trade_off_axis(
    members: Sequence[ParetoRow], baselines: Sequence[dict[str, Any]], objective: object = None
) -> TradeOffAxis:
    """The time of the mission where every route has one, otherwise the length of the route; its energy where that is made small.

    Args:
        members: of the Pareto set.
        baselines: as ``plan.json`` has them.
        objective: of ``plan.json``; plans of older versions have none.
    """
    label, key = "time of the mission, minutes", "mission_time_s"
    if objective == "energy":
        label, key = "energy of the mission, minutes of hovering", "mission_energy_hover_s"
    times_s = [getattr(m, key) for m in members], [b.get(key) for b in baselines]
    if any(time_s is None for part in times_s for time_s in part):
        return TradeOffAxis(
            "length of the route, km", False, tuple(m.path_length_m / 1000.0 for m in members),
            tuple(float(b["path_length_m"]) / 1000.0 for b in baselines),
        )  # fmt: skip
    minutes = [tuple(float(time_s or 0.0) / 60.0 for time_s in part) for part in times_s]
    return TradeOffAxis(label, True, minutes[0], minutes[1])


def read_pareto(path: Path) -> tuple[ParetoRow, ...]:
    """The members in the order of the file.

    Raises:
        InputError: the file cannot be read, or a row is not one of a Pareto set; says which.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(file)
            missing = {*PARETO_COLUMNS} - {"mission_time_s", "mission_energy_hover_s"} - set(rows.fieldnames or ())
            if missing:
                raise InputError(f"{path}: has no column {sorted(missing)[0]!r}; make it again with: uavcover plan")
            return tuple(_row(row, where=f"{path}, line {rows.line_num}") for row in rows)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error}); make it again with: uavcover plan") from error


def _float_or_none(text: str | None) -> float | None:
    return float(text) if text else None


def _row(row: dict[str, str], *, where: str) -> ParetoRow:
    try:
        member = ParetoRow(
            index=int(row["index"]),
            coverage_of_coverable=float(row["coverage_of_coverable"]),
            waypoint_count=int(row["waypoint_count"]),
            path_length_m=float(row["path_length_m"]),
            flight_time_s=float(row["flight_time_s"]),
            mission_time_s=_float_or_none(row.get("mission_time_s")),
            mission_energy_hover_s=_float_or_none(row.get("mission_energy_hover_s")),
            violation=float(row["violation"]),
            made_by=str(row["made_by"]),
            chosen=row["chosen"] == "1",
        )
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{where}: is not a member of a Pareto set ({error}); make it again with: uavcover plan"
        ) from error
    if not (math.isfinite(member.coverage_of_coverable) and math.isfinite(member.path_length_m)):
        raise InputError(f"{where}: a figure is not a finite number; make it again with: uavcover plan")
    return member
