"""The verdict on a flight."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

VerdictName = Literal["passed", "failed", "not proved"]
"""Failed: what was observed breaks a limit or misses a requirement. Not proved: nothing does, but something essential was not
observed."""

ViolationKind = Literal[
    "below-band",
    "above-band",
    "clearance",
    "above-transit-height",
    "below-sea-level-limit",
    "above-sea-level-limit",
    "fence",
    "obstacle",
    "ground-speed",
    "deviation",
]

GapReason = Literal[
    "never-in-range",
    "too-oblique",
    "occluded",
    "out-of-limits",
    "too-coarse",
    "too-few-looks",
    "attitude-not-known",
]
"""Why a cell was not seen: no look had it in range and field of view; those that had were too oblique; ground or an
obstacle stood between; no place inside the limits sees it at all; a pixel saw too much ground; it was seen,
but by fewer looks than it has to be; it may have been seen, by looks whose direction is not known."""

UnobservedReason = Literal["no samples", "impossible motion", "before the first sample", "after the last sample"]


@dataclass(frozen=True, slots=True)
class Violation:
    """A limit that was not kept, once for each stretch of the track.

    Attributes:
        kind: which limit.
        start_s: vehicle time at which it began.
        end_s: vehicle time at which it ended.
        worst_s: vehicle time at which it was worst.
        worst: the worst value reached, in the unit of the limit; of the fence, metres outside; of an obstacle, metres of
            clearance that were lacking, aside or in height, whichever is less.
        limit: the limit.
        excess: how far the worst value is beyond the limit, above 0.
        unit: of all three.
        lat_deg: where it was worst.
        lon_deg: where it was worst.
        east_m: where it was worst.
        north_m: where it was worst.
        phase: "route" between the first and the last planned waypoint, "transit" elsewhere.
        track: number of the track, counted from 0.
    """

    kind: ViolationKind
    start_s: float
    end_s: float
    worst_s: float
    worst: float
    limit: float
    excess: float
    unit: Literal["m", "m/s"]
    lat_deg: float
    lon_deg: float
    east_m: float
    north_m: float
    phase: Literal["route", "transit"]
    track: int = 0


@dataclass(frozen=True, slots=True)
class Gap:
    """A connected region of cells that were not seen for the same reason.

    Attributes:
        cells: how many.
        area_m2: ground area.
        lat_deg: middle.
        lon_deg: middle.
        east_m: middle.
        north_m: middle.
        reason: why not.
        coverable: whether it could have been seen from inside the limits.
    """

    cells: int
    area_m2: float
    lat_deg: float
    lon_deg: float
    east_m: float
    north_m: float
    reason: GapReason
    coverable: bool


@dataclass(frozen=True, slots=True)
class CellStatistics:
    """How well the cells of the area were seen. Figures of cells that were not seen are left out; none when no cell has one.

    Attributes:
        count: cells of the area.
        seen: of them, seen.
        looks_mean: separate passes over a seen cell, mean.
        looks_max: the most passes over any cell.
        seen_twice_fraction: share of the area that was seen in two passes or more.
        ground_sample_median_m: of the smallest ground sample distances of the cells.
        ground_sample_p95_m: 95 % of the seen cells have a ground sample distance not above this.
        incidence_median_deg: of the smallest incidence angles of the cells.
        incidence_p95_deg: likewise.
    """

    count: int
    seen: int
    looks_mean: float | None
    looks_max: int
    seen_twice_fraction: float
    ground_sample_median_m: float | None
    ground_sample_p95_m: float | None
    incidence_median_deg: float | None
    incidence_p95_deg: float | None


@dataclass(frozen=True, slots=True)
class CoverageMoment:
    """How much had been seen at a moment.

    Attributes:
        time_s: vehicle time.
        coverage_fraction: share of the area seen by then.
    """

    time_s: float
    coverage_fraction: float


@dataclass(frozen=True, slots=True)
class Unobserved:
    """A stretch of a flight of which nothing is known: nothing was seen there, and no limit was kept.

    Attributes:
        reason: why not.
        detail: the same with figures, for people.
        start_s: vehicle time of the last evidence before it.
        end_s: vehicle time of the first evidence after it; both are the same before the first sample and after the last.
        length_m: the straight way between its ends; before the first sample and after the last, of the planned route that is
            missing.
        lat_deg: where it begins.
        lon_deg: where it begins.
        east_m: where it begins.
        north_m: where it begins.
        phase: "route" when it lies between the first and the last planned waypoint, "transit" elsewhere.
        in_flight: whether it lies between take-off and landing.
        track: number of the track, counted from 0.
    """

    reason: UnobservedReason
    detail: str
    start_s: float
    end_s: float
    length_m: float
    lat_deg: float
    lon_deg: float
    east_m: float
    north_m: float
    phase: Literal["route", "transit"]
    in_flight: bool = True
    track: int = 0

    @property
    def duration_s(self) -> float:
        """How long it is."""
        return self.end_s - self.start_s


@dataclass(frozen=True, slots=True)
class VerificationReport:
    """Coverage and safety of a flown track; ``verification.json``.

    Attributes:
        coverage_fraction: share of the area's ground that was seen, 0..1.
        coverage_of_coverable: share of what can be seen from inside the limits.
        surely_covered_fraction: share of the area that was seen whatever the errors of [uncertainty] were.
        surely_covered_of_coverable: the same of what can be seen from inside the limits.
        possibly_covered_fraction: share of the area that may have been seen, these errors being as they may.
        planned_coverage_fraction: what the plan promised, none without a plan.
        min_height_agl_m: lowest point between the first and the last planned waypoint.
        max_height_agl_m: highest point there.
        min_transit_clearance_m: lowest point above ground on the way there and home, take-off and landing apart.
        max_transit_height_agl_m: highest point above ground outside of the route, take-off and landing among them.
        violations: limits that were not kept.
        max_deviation_m: largest distance from the planned route between its ends, none without a plan.
        max_ground_speed_m_s: largest speed over ground on the route, over a second of flight; none without a route.
        gaps: what was not seen, the largest first.
        cells: how well the cells were seen.
        coverage_by_time: how coverage grew; with several tracks, each is taken to begin right after the one before.
        samples: how many samples the track has.
        unknown_attitude_looks: looks whose direction is not known: what they may have seen is possibly seen, not seen.
        unobserved: stretches of the flight that were not observed, in order of tracks and time.
        unobserved_s: how long they are in all, between take-off and landing.
        unobserved_m: how long they are in all, in metres.
        unobserved_route_fraction: share of the route's time that was not observed; none without a route.
        verdict: passed, failed or not proved.
        passed: whether the verdict is "passed".
        reasons: why it failed, one line each.
        doubts: why it is not proved, one line each.
        findings: what is odd without being a reason for either, one line each.
        requirements: the requirements and limits that were judged, by their names in the scenario.
    """

    coverage_fraction: float
    coverage_of_coverable: float
    surely_covered_fraction: float
    surely_covered_of_coverable: float
    possibly_covered_fraction: float
    planned_coverage_fraction: float | None
    min_height_agl_m: float | None
    max_height_agl_m: float | None
    min_transit_clearance_m: float | None
    max_transit_height_agl_m: float | None
    violations: tuple[Violation, ...]
    max_deviation_m: float | None
    max_ground_speed_m_s: float | None
    gaps: tuple[Gap, ...]
    cells: CellStatistics
    coverage_by_time: tuple[CoverageMoment, ...]
    samples: int
    unknown_attitude_looks: int
    unobserved: tuple[Unobserved, ...]
    unobserved_s: float
    unobserved_m: float
    unobserved_route_fraction: float | None
    verdict: VerdictName
    passed: bool
    reasons: tuple[str, ...]
    doubts: tuple[str, ...]
    findings: tuple[str, ...]
    requirements: Mapping[str, Any]
