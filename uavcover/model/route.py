"""Planned routes with their metrics, and lower bounds that no route can beat."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.outline import svg_map

PART_OF = "part of "
"""Begins the origin of a route that is a stretch of another."""


@dataclass(frozen=True, slots=True)
class RouteMetrics:
    """What a route is worth, judged on the cells of the area.

    Attributes:
        coverage_fraction: share of the area's ground that is seen, 0..1.
        coverage_of_coverable: share of what can be seen at all from inside the limits, 0..1.
        waypoint_count: how many waypoints.
        path_length_m: length of the open path in three dimensions.
        flight_time_s: time to fly it at cruise speed, climbs and descents at their own limits, with wind and turns where the
            scenario has them.
        min_height_agl_m: lowest point above ground, along the legs or at the waypoints as the limits say.
        max_height_agl_m: highest point above ground, likewise.
        cost: what ``planner.objective`` and ``planner.band_deviation_price`` make of it; without them ``path_length_m``.
    """

    coverage_fraction: float
    coverage_of_coverable: float
    waypoint_count: int
    path_length_m: float
    flight_time_s: float
    min_height_agl_m: float
    max_height_agl_m: float
    cost: float


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Waypoints in flying order.

    Attributes:
        waypoints_m: (n, 3) east, north, up in metres, read-only.
    """

    waypoints_m: FloatArray

    def __post_init__(self) -> None:
        points = np.array(self.waypoints_m, dtype=float).reshape(-1, 3)
        points.flags.writeable = False
        object.__setattr__(self, "waypoints_m", points)

    def __len__(self) -> int:
        return int(self.waypoints_m.shape[0])

    def __repr__(self) -> str:
        return f"<Route: {len(self)} waypoints, {self.length_m:.0f} m>"

    def _repr_html_(self) -> str:
        return svg_map([("route", self.waypoints_m)], repr(self)[1:-1])

    @property
    def length_m(self) -> float:
        """Length of the open path in three dimensions (Eq. 6)."""
        return float(np.linalg.norm(np.diff(self.waypoints_m, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True)
class RouteMember:
    """A route of the Pareto set with its figures.

    Attributes:
        route: the waypoints.
        metrics: judged on the cells of the area.
        violation: total violation of the hard limits, 0 when they hold.
        origin: what made it: the algorithm, or the name of a baseline; for a part of a route PART_OF and what made the whole.
    """

    route: Route
    metrics: RouteMetrics
    violation: float
    origin: str

    @property
    def is_part(self) -> bool:
        """Whether it is a stretch of another route."""
        return self.origin.startswith(PART_OF)


@dataclass(frozen=True, slots=True)
class Plan:
    """The outcome of planning.

    Attributes:
        chosen: the route that is handed over.
        members: the Pareto set, by coverage.
        baselines: routes computed for comparison.
        rule: how the chosen one was chosen.
        rule_met: whether the rule could be met; when not, the best there is was chosen.
        algorithm: which optimizer.
        evaluations: full route evaluations spent.
        wall_s: time spent.
        interrupted: whether the search was ended early by the user.
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

    def __repr__(self) -> str:
        m = self.chosen.metrics
        met = "" if self.rule_met else f"; {self.rule} is NOT met"
        return (
            f"<Plan: {100.0 * m.coverage_of_coverable:.2f} % of what can be seen, {m.waypoint_count} waypoints, "
            f"{m.path_length_m:.0f} m, {m.flight_time_s:.0f} s; {len(self.members)} routes in the Pareto set{met}>"
        )

    def _repr_html_(self) -> str:
        return svg_map([("route", self.chosen.route.waypoints_m)], repr(self)[1:-1])


Question = Literal["fewest_waypoints", "most_coverage", "shortest_path_m"]


@dataclass(frozen=True, slots=True)
class Bound:
    """A proved limit beside the best that was found.

    Attributes:
        question: fewest waypoints that see a share; most that so many waypoints see; shortest path that sees a share.
        asked: the share of what can be covered, 0..1, or the number of waypoints.
        limit: proved: at least, or for "most_coverage" at most.
        found: the best of the plan's routes, none when no route reaches what was asked.
        proved_on: among which places: a route over others may beat a limit that is proved on a lattice.
        method: how it was proved.
    """

    question: Question
    asked: float
    limit: float
    found: float | None
    proved_on: str
    method: str

    @property
    def gap(self) -> float | None:
        """How far the best found is from the limit: a share of it, or of the coverage; negative where other places beat it."""
        if self.found is None:
            return None
        if self.question == "most_coverage":
            return self.limit - self.found
        return (self.found - self.limit) / self.limit if self.limit > 0.0 else None
