"""How every leg of a route stands to the hard limits, at its full length.

Planning sums these figures up as constraint violations; the mission compiler refuses a route by them. Verification does
not use them: it judges the flown track by itself.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.site import Site

FloatArray = NDArray[np.float64]

CLIMB_TOLERANCE_DEG = 1e-6
HEIGHT_TOLERANCE_M = 1e-6


@dataclass(frozen=True, slots=True)
class LegProblem:
    """A leg that breaks a limit.

    Attributes:
        leg: number of the waypoint at its end, counted from 0; leg k goes from waypoint k - 1 to k.
        kind: which limit.
        value: what the leg has there.
        limit: what is allowed.
        unit: of both.
        east_m: where it is worst.
        north_m: where it is worst.
    """

    leg: int
    kind: Literal[
        "no elevation data", "too low", "too high", "below sea-level limit", "above sea-level limit", "climb", "fence"
    ]
    value: float
    limit: float
    unit: str
    east_m: float
    north_m: float

    def __str__(self) -> str:
        where = f"at {self.east_m:.0f} m east, {self.north_m:.0f} m north"
        if self.kind == "no elevation data":
            return f"leg to waypoint {self.leg}: no elevation data {where}"
        if self.kind == "fence":
            return f"leg to waypoint {self.leg}: {self.value:.1f} m outside the fence {where}"
        amounts = f"{self.value:.1f} {self.unit} against {self.limit:.1f} {self.unit}"
        return f"leg to waypoint {self.leg}: {self.kind}, {amounts} {where}"


@dataclass(frozen=True, slots=True, eq=False)
class Violations:
    """How much of each hard limit a route breaks; all zero when it keeps them.

    Attributes:
        below_m: metres below the lower limit of height above ground, summed over the legs.
        above_m: metres above the upper limit, likewise.
        sea_level_m: metres outside the sea-level limits, summed over the waypoints.
        climb_deg: degrees steeper than the limit, summed over the legs.
        fence_m: metres of the route outside the fence.
        no_data_legs: legs without elevation data.
    """

    below_m: float
    above_m: float
    sea_level_m: float
    climb_deg: float
    fence_m: float
    no_data_legs: int

    @property
    def total(self) -> float:
        """One number, 0 when every limit holds: metres and degrees added up, 1000 for a leg without data."""
        return (
            self.below_m + self.above_m + self.sea_level_m + self.climb_deg + self.fence_m + 1000.0 * self.no_data_legs
        )


def measure_violations(site: Site, route_m: FloatArray, *, margin_m: float) -> Violations:
    """How much an (n, 3) ENU route breaks the limits of the sensing route.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        margin_m: how far inside both ends of the height band the route must stay.
    """
    limits = site.scenario.limits
    figures = _leg_figures(site, route_m)
    known = np.isfinite(figures[:, 0])
    low, high = limits.min_height_agl_m + margin_m, limits.max_height_agl_m - margin_m
    below = np.maximum(0.0, low - HEIGHT_TOLERANCE_M - figures[known, 0])
    above = np.maximum(0.0, figures[known, 2] - high - HEIGHT_TOLERANCE_M)
    sea = 0.0
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        alts = site.alts_amsl_m(route_m)
        if limits.min_alt_amsl_m is not None:
            sea += float(np.maximum(0.0, limits.min_alt_amsl_m - HEIGHT_TOLERANCE_M - alts).sum())
        if limits.max_alt_amsl_m is not None:
            sea += float(np.maximum(0.0, alts - limits.max_alt_amsl_m - HEIGHT_TOLERANCE_M).sum())
    climb = 0.0
    if limits.applies_to == "legs":
        climb = float(
            np.maximum(0.0, climb_angles_deg(route_m) - limits.max_climb_angle_deg - CLIMB_TOLERANCE_DEG).sum()
        )
    return Violations(
        below_m=float(below.sum()),
        above_m=float(above.sum()),
        sea_level_m=sea,
        climb_deg=climb,
        fence_m=_length_outside_fence_m(site, route_m),
        no_data_legs=int((~known).sum()),
    )


def find_problems(
    site: Site, route_m: FloatArray, *, lowest_agl_m: float, highest_agl_m: float | None
) -> list[LegProblem]:
    """Every leg of an (n, 3) ENU route that breaks a limit, in flying order; legs are always looked at in full.

    Args:
        site: the scenario on its ground.
        route_m: waypoints in flying order.
        lowest_agl_m: lowest height above ground.
        highest_agl_m: largest height above ground, or none.
    """
    limits = site.scenario.limits
    problems: list[LegProblem] = []
    ranges = site.ground.leg_height_ranges_m(route_m)
    alts = site.alts_amsl_m(route_m)
    angles = climb_angles_deg(route_m)
    for leg, (low, low_at, high, high_at) in enumerate(ranges, start=1):
        a, b = route_m[leg - 1], route_m[leg]

        def problem(
            kind: str,
            value: float,
            limit: float,
            unit: str,
            t: float,
            *,
            leg: int = leg,
            a: FloatArray = a,
            b: FloatArray = b,
        ) -> LegProblem:
            place = a + t * (b - a)
            return LegProblem(leg, kind, float(value), float(limit), unit, float(place[0]), float(place[1]))  # type: ignore[arg-type]

        if not np.isfinite(low):
            problems.append(problem("no elevation data", 0.0, 0.0, "", 0.5))
            continue
        if low < lowest_agl_m - HEIGHT_TOLERANCE_M:
            problems.append(problem("too low", low, lowest_agl_m, "m above ground", low_at))
        if highest_agl_m is not None and high > highest_agl_m + HEIGHT_TOLERANCE_M:
            problems.append(problem("too high", high, highest_agl_m, "m above ground", high_at))
        lowest, highest = sorted((alts[leg - 1], alts[leg]))
        if limits.min_alt_amsl_m is not None and lowest < limits.min_alt_amsl_m - HEIGHT_TOLERANCE_M:
            problems.append(
                problem("below sea-level limit", lowest, limits.min_alt_amsl_m, "m AMSL", float(alts[leg] == lowest))
            )
        if limits.max_alt_amsl_m is not None and highest > limits.max_alt_amsl_m + HEIGHT_TOLERANCE_M:
            problems.append(
                problem("above sea-level limit", highest, limits.max_alt_amsl_m, "m AMSL", float(alts[leg] == highest))
            )
        if angles[leg - 1] > limits.max_climb_angle_deg + CLIMB_TOLERANCE_DEG:
            problems.append(problem("climb", angles[leg - 1], limits.max_climb_angle_deg, "degrees", 1.0))
        outside = _length_outside_fence_m(site, route_m[leg - 1 : leg + 1])
        if outside > 0.0:
            problems.append(problem("fence", outside, 0.0, "m", 1.0))
    return problems


def climb_angles_deg(route_m: FloatArray) -> FloatArray:
    """(n - 1,) angle of each leg of an (n, 3) route to the horizontal, 0..90 degrees, up or down."""
    steps = np.diff(route_m, axis=0)
    return np.degrees(np.arctan2(np.abs(steps[:, 2]), np.hypot(steps[:, 0], steps[:, 1])))


def _leg_figures(site: Site, route_m: FloatArray) -> FloatArray:
    """Rows as of :meth:`Ground.leg_height_ranges_m`, for the legs or for the waypoints alone, as the limits apply."""
    if site.scenario.limits.applies_to == "legs" and len(route_m) > 1:
        return site.ground.leg_height_ranges_m(route_m)
    heights = route_m[:, 2] - site.ground.heights_m(route_m[:, :2])
    return np.column_stack([heights, np.zeros_like(heights), heights, np.zeros_like(heights)])


def route_height_range_m(site: Site, route_m: FloatArray) -> tuple[float, float]:
    """Lowest and largest height above ground of an (n, 3) ENU route, on legs or waypoints as the limits apply."""
    figures = _leg_figures(site, route_m)
    return float(np.min(figures[:, 0])), float(np.max(figures[:, 2]))


def _length_outside_fence_m(site: Site, route_m: FloatArray) -> float:
    places = route_m[:, :2]
    if site.scenario.limits.applies_to == "waypoints" or len(places) < 2:
        inside = shapely.intersects_xy(site.fence, places[:, 0], places[:, 1])
        return float(sum(site.fence.distance(shapely.Point(place)) for place in places[~inside]))
    line = shapely.LineString(places)
    shapely.prepare(site.fence)
    if site.fence.covers(line):
        return 0.0
    # A leg along the fence can differ from it by rounding: that much is no violation.
    return float(line.difference(site.fence.buffer(1e-6)).length)
