"""The verdict on a flight."""

from dataclasses import dataclass
from typing import Literal

ViolationKind = Literal[
    "below-band",
    "above-band",
    "clearance",
    "below-sea-level-limit",
    "above-sea-level-limit",
    "fence",
    "obstacle",
    "ground-speed",
    "deviation",
]

GapReason = Literal["never-in-range", "too-oblique", "occluded", "out-of-limits", "too-coarse", "too-few-looks"]
"""Why a cell was not seen: no look had it in range and field of view; those that had were too oblique; ground or an
obstacle stood between; no place inside the limits sees it at all; a pixel saw too much ground; it was seen,
but by fewer looks than it has to be."""


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
        violations: limits that were not kept.
        max_deviation_m: largest distance from the planned route between its ends, none without a plan.
        max_ground_speed_m_s: largest speed over ground on the route, over a second of flight; none without a route.
        gaps: what was not seen, the largest first.
        cells: how well the cells were seen.
        coverage_by_time: how coverage grew; with several tracks, each is taken to begin right after the one before.
        samples: how many samples the track has.
        level_assumed: looks whose attitude the track does not know; the camera was taken as level there.
        unobserved_s: time inside the flight without samples (gaps that were not joined by a straight line).
        passed: whether every requirement holds.
        reasons: why not, one line each.
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
    violations: tuple[Violation, ...]
    max_deviation_m: float | None
    max_ground_speed_m_s: float | None
    gaps: tuple[Gap, ...]
    cells: CellStatistics
    coverage_by_time: tuple[CoverageMoment, ...]
    samples: int
    level_assumed: int
    unobserved_s: float
    passed: bool
    reasons: tuple[str, ...]
