"""Read and write ``pareto.csv`` and ``pareto_routes.csv`` of a run folder."""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.errors import InputError
from uavcover.model.route import MissionSize, Plan, Route, RouteMember

PARETO_COLUMNS = (
    "index",
    "coverage_fraction",
    "coverage_of_coverable",
    "waypoint_count",
    "path_length_m",
    "flight_time_s",
    "mission_time_s",
    "mission_energy_hover_s",
    "sorties",
    "vehicles",
    "makespan_s",
    "min_height_agl_m",
    "max_height_agl_m",
    "violation",
    "made_by",
    "chosen",
)

_LATER_COLUMNS = {"mission_time_s", "mission_energy_hover_s", "sorties", "vehicles", "makespan_s"}
"""Files of older versions do without them."""

ROUTE_COLUMNS = ("index", "waypoint", "east_m", "north_m", "up_m")
"""Columns of ``pareto_routes.csv``."""
PART_COLUMN = "part"
"""Its last column if vehicles have parts of the area: the number of the part, from 1."""


def pareto_csv(plan: Plan) -> str:
    """``pareto.csv``: one row a member, with exact numbers."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(PARETO_COLUMNS)
    for index, member in enumerate(plan.members):
        writer.writerow([index, *_pareto_values(member), int(member is plan.chosen)])
    return out.getvalue()


def _pareto_values(member: RouteMember) -> list[Any]:
    m, size = member.metrics, member.mission
    sized = [None] * 3 if size is None else [size.sorties, size.vehicles, size.makespan_s]
    return [
        m.coverage_fraction, m.coverage_of_coverable, m.waypoint_count, m.path_length_m, m.flight_time_s,
        m.mission_time_s, m.mission_energy_hover_s, *sized,
        m.min_height_agl_m, m.max_height_agl_m, member.violation, member.origin,
    ]  # fmt: skip


def pareto_routes_csv(plan: Plan) -> str:
    """``pareto_routes.csv``: the waypoints of every member in flying order, with exact numbers."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    in_parts = any(member.route.begins for member in plan.members)
    writer.writerow([*ROUTE_COLUMNS, PART_COLUMN] if in_parts else ROUTE_COLUMNS)
    for index, member in enumerate(plan.members):
        for number, point in enumerate(member.route.waypoints_m.tolist()):
            part = [1 + sum(number >= begin for begin in member.route.begins)] if in_parts else []
            writer.writerow([index, number, *point, *part])
    return out.getvalue()


def read_pareto_routes(text: str, *, source: str) -> list[Route]:
    """The routes of a Pareto set, by their index.

    Raises:
        InputError: a column is missing, a value is not a number, or the rows are out of order; names the line.
    """
    routes: list[list[list[float]]] = []
    begins: list[list[int]] = []
    rows = csv.DictReader(io.StringIO(text))
    if tuple(rows.fieldnames or ()) not in (ROUTE_COLUMNS, (*ROUTE_COLUMNS, PART_COLUMN)):
        raise InputError(
            f"{source}: line 1: the columns must be {', '.join(ROUTE_COLUMNS)}; create the file again with: uavcover plan"
        )
    for line, row in enumerate(rows, start=2):
        try:
            index, number = int(row["index"]), int(row["waypoint"])
            point = [float(row[name]) for name in ROUTE_COLUMNS[2:]]
            part = int(row.get(PART_COLUMN, 1))
        except (TypeError, ValueError) as error:
            raise InputError(f"{source}: line {line}: {error}; create the file again with: uavcover plan") from error
        if number == 0:
            routes.append([])
            begins.append([])
        if routes and part == len(begins[-1]) + 2 and number > 0:
            begins[-1].append(number)
        in_order = bool(routes) and part == len(begins[-1]) + 1
        if not (in_order and index == len(routes) - 1 and number == len(routes[-1]) and np.isfinite(point).all()):
            raise InputError(f"{source}: line {line}: waypoints are out of order; create it again with: uavcover plan")
        routes[-1].append(point)
    return [Route(np.array(points), tuple(begin)) for points, begin in zip(routes, begins, strict=True)]


@dataclass(frozen=True, slots=True)
class ParetoRow:
    """A row of ``pareto.csv``: one member of the Pareto set."""

    index: int  # its number, for ``select RUN index:N``
    coverage_of_coverable: float  # fraction of the visible ground, 0..1
    waypoint_count: int  # how many waypoints
    path_length_m: float  # length of the open path in three dimensions
    flight_time_s: float  # of the route alone
    # of the whole mission from home; None without a home, or in the file of an older version
    mission_time_s: float | None
    mission_energy_hover_s: float | None  # its battery energy, in seconds of hovering; None in the same cases
    # its sorties, vehicles and makespan; None if the file has none
    mission: MissionSize | None
    violation: float  # of the hard limits, 0 when they hold
    made_by: str  # the algorithm or baseline that found it
    chosen: bool  # whether it is the one in ``plan.json``

    @property
    def time_s(self) -> float:
        """As of :class:`~uavcover.model.route.RouteMetrics`."""
        return self.flight_time_s if self.mission_time_s is None else self.mission_time_s


@dataclass(frozen=True, slots=True)
class TradeOffAxis:
    """Axis against which coverage is drawn."""

    label: str  # with its unit
    # minutes of the whole mission, or minutes of hovering for its energy; otherwise kilometres of the route
    is_time: bool
    members: tuple[float, ...]  # of the Pareto set
    baselines: tuple[float, ...]  # the simple routes


def trade_off_axis(
    members: Sequence[ParetoRow], baselines: Sequence[dict[str, Any]], objective: object = None
) -> TradeOffAxis:
    """Mission time if every route has one, otherwise route length; mission energy if the plan minimises energy.

    Args:
        members: of the Pareto set.
        baselines: of ``plan.json``.
        objective: of ``plan.json``; plans of older versions have none.
    """
    label, key = "mission time, minutes", "mission_time_s"
    if objective == "energy":
        label, key = "mission energy, minutes of hovering", "mission_energy_hover_s"
    times_s = [getattr(m, key) for m in members], [b.get(key) for b in baselines]
    if any(time_s is None for part in times_s for time_s in part):
        return TradeOffAxis(
            "route length, km", False, tuple(m.path_length_m / 1000.0 for m in members),
            tuple(float(b["path_length_m"]) / 1000.0 for b in baselines),
        )  # fmt: skip
    minutes = [tuple(float(time_s or 0.0) / 60.0 for time_s in part) for part in times_s]
    return TradeOffAxis(label, True, minutes[0], minutes[1])


def read_pareto(path: Path) -> tuple[ParetoRow, ...]:
    """The members in the order of the file.

    Raises:
        InputError: the file cannot be read, or a row is invalid; names the row.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = csv.DictReader(file)
            missing = {*PARETO_COLUMNS} - _LATER_COLUMNS - set(rows.fieldnames or ())
            if missing:
                raise InputError(
                    f"{path}: the file has no column {sorted(missing)[0]!r}; create it again with: uavcover plan"
                )
            return tuple(_row(row, where=f"{path}, line {rows.line_num}") for row in rows)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: the file cannot be read ({error}); create it again with: uavcover plan") from error


def _float_or_none(text: str | None) -> float | None:
    return float(text) if text else None


def _size(row: dict[str, str]) -> MissionSize | None:
    """Sorties, vehicles and makespan of a row; None without these columns."""
    if not row.get("sorties"):
        return None
    return MissionSize(sorties=int(row["sorties"]), vehicles=int(row["vehicles"]), makespan_s=float(row["makespan_s"]))


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
            mission=_size(row),
            violation=float(row["violation"]),
            made_by=str(row["made_by"]),
            chosen=row["chosen"] == "1",
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{where}: cannot read the row as a member of a Pareto set ({error}); create the file again with: uavcover plan"
        ) from error
    if not (math.isfinite(member.coverage_of_coverable) and math.isfinite(member.path_length_m)):
        raise InputError(f"{where}: a value is not a finite number; create the file again with: uavcover plan")
    return member
