"""The verdict on a flight."""

from dataclasses import dataclass
from typing import Literal

ViolationKind = Literal[
    "below-band", "above-band", "clearance", "below-sea-level-limit", "above-sea-level-limit", "fence"
]


@dataclass(frozen=True, slots=True)
class Violation:
    """A limit that was not kept, once for each stretch of the track.

    Attributes:
        kind: which limit.
        start_s: vehicle time at which it began.
        end_s: vehicle time at which it ended.
        worst: the worst value reached, in the unit of the limit.
        limit: the limit.
        lat_deg: where it was worst.
        lon_deg: where it was worst.
        phase: "route" between the first and the last planned waypoint, "transit" elsewhere.
    """

    kind: ViolationKind
    start_s: float
    end_s: float
    worst: float
    limit: float
    lat_deg: float
    lon_deg: float
    phase: Literal["route", "transit"]


@dataclass(frozen=True, slots=True)
class Gap:
    """A connected group of cells that could have been seen and were not.

    Attributes:
        cells: how many.
        area_m2: ground area.
        lat_deg: middle.
        lon_deg: middle.
        east_m: middle.
        north_m: middle.
    """

    cells: int
    area_m2: float
    lat_deg: float
    lon_deg: float
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class VerificationReport:
    """Coverage and safety of a flown track; ``verification.json``.

    Attributes:
        coverage_fraction: share of the area's ground that was seen, 0..1.
        coverage_of_coverable: share of what can be seen from inside the limits.
        planned_coverage_fraction: what the plan promised, none without a plan.
        min_height_agl_m: lowest point between the first and the last planned waypoint.
        max_height_agl_m: highest point there.
        min_transit_clearance_m: lowest point above ground on the way there and home, take-off and landing apart.
        violations: limits that were not kept.
        max_deviation_m: largest distance from the planned route between its ends, none without a plan.
        gaps: what was not seen, the largest first.
        samples: how many samples the track has.
        unobserved_s: time inside the flight without samples (gaps that were not joined by a straight line).
        passed: whether every requirement holds.
        reasons: why not, one line each.
    """

    coverage_fraction: float
    coverage_of_coverable: float
    planned_coverage_fraction: float | None
    min_height_agl_m: float | None
    max_height_agl_m: float | None
    min_transit_clearance_m: float | None
    violations: tuple[Violation, ...]
    max_deviation_m: float | None
    gaps: tuple[Gap, ...]
    samples: int
    unobserved_s: float
    passed: bool
    reasons: tuple[str, ...]
