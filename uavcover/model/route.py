"""Planned routes with their metrics, and lower bounds that no route can beat."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import FloatArray
from uavcover.model.area import svg_map

PART_OF = "part of "
"""Prefix of the origin of a route that is part of another."""


@dataclass(frozen=True, slots=True)
class RouteMetrics:
    """Metrics of a route on the cells of the area."""

    coverage_fraction: float  # fraction of the area's ground that is covered, 0..1
    coverage_of_coverable: float  # fraction of the area that can be covered within the limits, 0..1
    waypoint_count: int  # number of waypoints
    path_length_m: float  # length of the open path in three dimensions
    flight_time_s: float  # of the route alone, with climbs, descents, turns and wind
    min_height_agl_m: float  # lowest height above ground, along the legs or at the waypoints as the limits require
    max_height_agl_m: float  # largest height above ground, at the same positions
    # the minimised cost by ``planner.objective`` and ``planner.band_deviation_price``; by default ``mission_time_s``,
    # and ``path_length_m`` without a home
    cost: float
    # of the whole mission, from the ground at home to the ground at home, of all flights that it takes; None without a home
    mission_time_s: float | None = None
    mission_energy_hover_s: float | None = None  # energy of the same mission, as seconds of hovering in the stated wind

    @property
    def time_s(self) -> float:
        """The time that tables show: of the whole mission, or of the route alone without a home."""
        return self.flight_time_s if self.mission_time_s is None else self.mission_time_s


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Waypoints in flying order.

    Attributes:
        waypoints_m: (n, 3) east, north, up in metres, read-only.
        begins: numbers of waypoints at which other vehicles begin the route of another part of the area; no vehicle flies the leg
            to them. Only for fleets whose vehicles have their own parts.
    """

    waypoints_m: FloatArray
    begins: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        points = np.array(self.waypoints_m, dtype=float).reshape(-1, 3)
        points.flags.writeable = False
        object.__setattr__(self, "waypoints_m", points)
        ends = (0, *self.begins, len(points))
        if self.begins and any(first >= last for first, last in itertools.pairwise(ends)):
            raise ValueError(f"begins: must be increasing waypoint numbers from 0 to {len(points)}, not {self.begins}")

    def __len__(self) -> int:
        return int(self.waypoints_m.shape[0])

    def __repr__(self) -> str:
        return f"<Route: {len(self)} waypoints, {self.length_m:.0f} m>"

    def _repr_html_(self) -> str:
        return svg_map([("route", self.waypoints_m)], repr(self)[1:-1])

    @classmethod
    def of_parts(cls, routes: "Sequence[Route]") -> "Route":
        """The routes of parts of the area, one after the other."""
        ends = np.cumsum([len(route) for route in routes])
        return cls(np.vstack([route.waypoints_m for route in routes]), tuple(int(end) for end in ends[:-1]))

    @property
    def parts(self) -> "tuple[Route, ...]":
        """The routes of the parts of the area; itself where there is one."""
        if not self.begins:
            return (self,)
        ends = (0, *self.begins, len(self))
        return tuple(Route(self.waypoints_m[first:last]) for first, last in itertools.pairwise(ends))

    @property
    def length_m(self) -> float:
        """Length of the open path in three dimensions (Eq. 6); of all parts together."""
        return sum(float(np.linalg.norm(np.diff(part.waypoints_m, axis=0), axis=1).sum()) for part in self.parts)


@dataclass(frozen=True, slots=True)
class MissionSize:
    """Size of a route's mission, split into flights, allocated to vehicles and timed as it would be flown."""

    sorties: int  # number of flights
    vehicles: int  # how many fly them
    makespan_s: float  # from the first take-off to the last landing, with changes of battery and the order of starts


@dataclass(frozen=True, slots=True)
class RouteMember:
    """A route of the Pareto set with its metrics."""

    route: Route  # the waypoints
    metrics: RouteMetrics  # its metrics on the cells of the area
    violation: float  # total violation of the hard limits, 0 for a feasible route
    origin: str  # the algorithm or baseline that made it; for a part of a route, PART_OF and the origin of the whole
    # size of its mission; None if it cannot be flown, or was not split into flights
    mission: MissionSize | None = None

    @property
    def is_part(self) -> bool:
        """Whether it is part of another route."""
        return self.origin.startswith(PART_OF)


@dataclass(frozen=True, slots=True)
class Plan:
    """The outcome of planning.

    Attributes:
        chosen: the selected route.
        members: the Pareto set, by coverage.
        baselines: routes computed for comparison.
        rule: the selection rule.
        rule_met: whether the rule was met; otherwise the best available route was selected.
        algorithm: the optimizer.
        evaluations: full route evaluations spent.
        wall_s: time spent.
        interrupted: whether the search was ended early by the user.
        by_vehicles: size of the chosen route's mission with fewer vehicles, and with all.
        folder: its run folder; empty if it was not written.
    """

    chosen: RouteMember
    members: tuple[RouteMember, ...]
    baselines: tuple[RouteMember, ...]
    rule: str
    rule_met: bool
    algorithm: str
    evaluations: int
    wall_s: float
    interrupted: bool = False
    by_vehicles: tuple[MissionSize, ...] = ()
    folder: str = field(default="", compare=False)

    def __repr__(self) -> str:
        m = self.chosen.metrics
        met = "" if self.rule_met else f"; {self.rule} is NOT met"
        return (
            f"<Plan: {100.0 * m.coverage_of_coverable:.2f} % of the visible ground, {m.waypoint_count} waypoints, "
            f"{m.path_length_m:.0f} m, {m.time_s:.0f} s; {counted(len(self.members), 'route')} in the Pareto set{met}>"
        )

    def _repr_html_(self) -> str:
        return svg_map([("route", self.chosen.route.waypoints_m)], repr(self)[1:-1])


Question = Literal["fewest_waypoints", "most_coverage", "shortest_path_m"]


@dataclass(frozen=True, slots=True)
class Bound:
    """A proved bound, and the best result found."""

    # fewest waypoints for a coverage; largest coverage by a number of waypoints; shortest path for a coverage
    question: Question
    required: float  # the coverage as a fraction of the coverable area, 0..1, or the number of waypoints
    limit: float  # the proved lower bound; for "most_coverage" an upper bound
    found: float | None  # the best of the plan's routes; None if no route meets the requirement
    proved_on: str  # the positions considered: a route through others may beat a bound that was proved on a lattice
    method: str  # method of the proof
    # what the limit's share is a fraction of: "cells", which are seen where one place in each is, as ``found`` is counted; or
    # "ground", all of it between those places too
    counted: Literal["cells", "ground"] = "cells"

    @property
    def gap(self) -> float | None:
        """Relative gap between the best result and the bound; negative if other positions beat it."""
        if self.found is None:
            return None
        if self.question == "most_coverage":
            return self.limit - self.found
        return (self.found - self.limit) / self.limit if self.limit > 0.0 else None
