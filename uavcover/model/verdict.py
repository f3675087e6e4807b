"""Decisions as data: findings with their effects on requirements, and the verdicts on tracks and flights made of them.

Verdicts on flights, on foreign missions (``check``) and on photos are made here. Text is written from findings, and never read
back.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

VerdictName = Literal["passed", "failed", "not proved"]
"""Failed: what was observed exceeds a limit or misses a requirement. Not proved: nothing does, but something essential was not
observed."""

Holds = Literal["yes", "no", "not proved"]
"""Whether a requirement holds."""

Effect = Literal["fails", "not proved", "noted"]
"""Effect of a finding on its requirements: they fail; they are not proved; none."""

Requirement = Literal[
    "coverage",
    "sure-coverage",
    "overlap",
    "detection",
    "photos",
    "unobserved-fraction",
    "unobserved-gap",
    "ends",
    "transit-observed",
    "height-band",
    "transit-clearance",
    "transit-height",
    "sea-level",
    "fence",
    "obstacles",
    "no-fly-zones",
    "ground-speed",
    "deviation",
    "separation",
    "evidence",
    "mission",
]
"""Requirements; ``evidence``: that the record can be believed; ``mission``: the subject of ``check``."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found."""

    effect: Effect  # what it does to what it concerns
    concerns: tuple[Requirement, ...]  # the requirements; none only where it is noted
    text: str  # one line as text


def fails(concerns: Requirement | tuple[Requirement, ...], text: str) -> Finding:
    """A finding by which requirements do not hold."""
    return Finding("fails", concerns if isinstance(concerns, tuple) else (concerns,), text)


def unproved(concerns: Requirement | tuple[Requirement, ...], text: str) -> Finding:
    """A finding by which nothing proves that requirements hold."""
    return Finding("not proved", concerns if isinstance(concerns, tuple) else (concerns,), text)


def noted(text: str) -> Finding:
    """A finding that decides nothing."""
    return Finding("noted", (), text)


def combined(effects: Iterable[Effect]) -> VerdictName:
    """The verdict: failed when anything fails, else not proved when anything is not proved, else passed.

    >>> combined(["noted", "not proved"]), combined(["not proved", "fails"]), combined([])
    ('not proved', 'failed', 'passed')
    """
    found = set(effects)
    return "failed" if "fails" in found else "not proved" if "not proved" in found else "passed"


def worst(verdicts: Iterable[VerdictName]) -> VerdictName:
    """The verdict on several things together.

    >>> worst(["passed", "not proved"])
    'not proved'
    """
    effects: dict[VerdictName, Effect] = {"failed": "fails", "not proved": "not proved", "passed": "noted"}
    return combined(effects[verdict] for verdict in verdicts)


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict and its grounds."""

    findings: tuple[Finding, ...] = ()  # everything that was found

    @property
    def verdict(self) -> VerdictName:
        """Passed, failed or not proved."""
        return combined(finding.effect for finding in self.findings)

    def texts(self, effect: Effect) -> tuple[str, ...]:
        """The findings with one effect, as text."""
        return tuple(finding.text for finding in self.findings if finding.effect == effect)

    def holds(self, *requirements: Requirement) -> Holds:
        """Whether all of these requirements hold."""
        verdict = combined(finding.effect for finding in self.findings if set(requirements) & set(finding.concerns))
        return {"failed": "no", "not proved": "not proved", "passed": "yes"}[verdict]  # type: ignore[return-value]


_FEWEST_DECIMALS, _MOST_DECIMALS = 2, 9


def percent_beside(fraction: float, limit: float) -> str:
    """Format a share 0..1 beside a limit, with enough decimals that one does not read as the other.

    94.998 % is below 95 %, where 95.00 % would not be.
    """
    digits = _FEWEST_DECIMALS
    one, other = 100.0 * fraction, 100.0 * limit
    while fraction != limit and digits < _MOST_DECIMALS and f"{one:.{digits}f}" == f"{other:.{digits}f}":
        digits += 1
    return f"{100.0 * fraction:.{digits}f} %"


ViolationKind = Literal[
    "below-band",
    "above-band",
    "clearance",
    "above-transit-height",
    "below-sea-level-limit",
    "above-sea-level-limit",
    "fence",
    "obstacle",
    "no-fly-zone",
    "ground-speed",
    "deviation",
    "separation",
]

LIMIT_OF: Mapping[ViolationKind, Requirement] = {
    "below-band": "height-band",
    "above-band": "height-band",
    "clearance": "transit-clearance",
    "above-transit-height": "transit-height",
    "below-sea-level-limit": "sea-level",
    "above-sea-level-limit": "sea-level",
    "fence": "fence",
    "obstacle": "obstacles",
    "no-fly-zone": "no-fly-zones",
    "ground-speed": "ground-speed",
    "deviation": "deviation",
    "separation": "separation",
}
"""The requirement that each kind of violation breaks."""

GapReason = Literal[
    "never-in-range",
    "too-oblique",
    "occluded",
    "out-of-limits",
    "too-coarse",
    "too-few-looks",
    "attitude-not-known",
]
"""Reason why a cell was not observed.

In order: never in range and field of view; too oblique; occluded by ground or an obstacle; not visible from any position within
the limits; ground sample distance too large; fewer observations than required; possibly observed, by observations of unknown
direction. In the order of their numbers in ``coverage.tif``.
"""

PhotoSource = Literal["reported", "predicted"]
"""Whether the photos of a flight are those that its vehicle reported, or those that its track predicts."""

UnobservedReason = Literal[
    "no samples", "no satellite fix", "impossible motion", "before the first sample", "after the last sample"
]


@dataclass(frozen=True, slots=True)
class Violation:
    """A violation of a limit on one stretch of the track."""

    kind: ViolationKind  # the limit violated
    start_s: float  # vehicle time at which it began
    end_s: float  # vehicle time at which it ended
    worst_s: float  # vehicle time at which it was worst
    # the worst value reached, in the unit of the limit; for the fence, metres outside; for an obstacle, metres of
    # missing clearance beside or above it, whichever is less; for a no-fly zone, metres inside of its outline
    worst: float
    limit: float  # the limit
    excess: float  # how far the worst value is beyond the limit, above 0
    unit: Literal["m", "m/s"]  # of all three
    lat_deg: float  # where it was worst
    lon_deg: float  # where it was worst
    east_m: float  # where it was worst
    north_m: float  # where it was worst
    phase: Literal["route", "transit"]  # "route" between the first and the last planned waypoint, "transit" elsewhere
    track: int = 0  # number of the track, counted from 0
    name: str = ""  # of the no-fly zone
    # number of the other vehicle's track, for the separation; its place is the first vehicle's
    other_track: int | None = None
    worst_utc_s: float | None = None  # when it was worst on the ground station's clock, for the separation


@dataclass(frozen=True, slots=True)
class PairSeparation:
    """Least distance of two vehicles."""

    first: int  # number of the first track, counted from 0
    second: int  # number of the second one
    least_m: float  # least distance, while one of them was in the air at least
    # least distance that the errors of clocks and positions, and unobserved stretches, leave possible
    possibly_m: float
    utc_s: float  # when they were nearest, on the ground station's clock
    first_s: float  # the same in the first vehicle's time
    second_s: float  # in the second one's
    together_s: float  # for how long both were recorded, vehicle time


@dataclass(frozen=True, slots=True)
class Gap:
    """A connected region of cells unseen for the same reason."""

    cells: int  # number of cells
    area_m2: float  # ground area
    lat_deg: float  # latitude of its centre
    lon_deg: float  # longitude of its centre
    east_m: float  # east of its centre
    north_m: float  # north of its centre
    reason: GapReason  # why it was not seen
    coverable: bool  # whether it can be seen from within the limits


@dataclass(frozen=True, slots=True)
class CellStatistics:
    """Statistics of how well the cells were seen, over seen cells only; None when no cell has a value."""

    count: int  # number of cells of the area
    seen: int  # number of cells seen
    looks_mean: float | None  # mean number of separate passes over a seen cell
    looks_max: int  # largest number of passes over any cell
    seen_twice_fraction: float  # fraction of the area seen in two or more passes
    ground_sample_median_m: float | None  # median of the cells' smallest ground sample distances
    ground_sample_p95_m: float | None  # 95th percentile of the same
    incidence_median_deg: float | None  # median of the cells' smallest incidence angles
    incidence_p95_deg: float | None  # 95th percentile of the same


@dataclass(frozen=True, slots=True)
class PhotoStatistics:
    """In how many photos the ground of the area is, as it was drawn, without its margin."""

    taken: int  # how many photos there are
    # how many looks they are: photos from one place, in a like direction, are one look, and overlap counts looks
    looks: int
    # number of photos in which the required overlap puts a point: floor(1 / (1 - forward)) times floor(1 / (1 - side)); None
    # where no overlap is required
    asked: int | None
    overlap_fraction: float | None  # fraction of the ground in at least ``asked`` photos, 0..1
    overlap_holds: bool | None  # whether that is enough
    fewest: int  # of any cell
    median: float  # of the cells
    # median of the best ground sample distance of each cell; None if unknown
    ground_sample_median_m: float | None
    ground_sample_p95_m: float | None  # 95 % of the cells have a better one


@dataclass(frozen=True, slots=True)
class CoverageMoment:
    """Coverage reached at a moment."""

    time_s: float  # vehicle time
    coverage_fraction: float  # fraction of the area seen by then


@dataclass(frozen=True, slots=True)
class Unobserved:
    """An unobserved stretch of a flight: it proves neither coverage nor any limit."""

    reason: UnobservedReason  # why it was not observed
    detail: str  # the same with figures, as text
    start_s: float  # vehicle time of the last evidence before it
    # vehicle time of the first evidence after it; both are the same before the first sample and after the last
    end_s: float
    # straight distance between its ends; before the first sample and after the last, the length of the planned route
    # that is missing
    length_m: float
    lat_deg: float  # where it begins
    lon_deg: float  # where it begins
    east_m: float  # where it begins
    north_m: float  # where it begins
    # "route" when it lies between the first and the last planned waypoint, "transit" elsewhere
    phase: Literal["route", "transit"]
    in_flight: bool = True  # whether it lies between take-off and landing
    track: int = 0  # number of the track, counted from 0

    @property
    def duration_s(self) -> float:
        """Its duration."""
        return self.end_s - self.start_s


@dataclass(frozen=True, slots=True)
class MissingPhotos:
    """A stretch of a flight on which photos were expected that the vehicle did not report."""

    expected: int  # number of photos that are missing
    start_s: float  # vehicle time of the last reported photo before it, or at which its route began
    end_s: float  # vehicle time of the next reported photo, or at which its route ended
    length_m: float  # length flown between them
    lat_deg: float  # where it begins
    lon_deg: float  # where it begins
    east_m: float  # where it begins
    north_m: float  # where it begins
    track: int = 0  # number of the track, counted from 0

    def __str__(self) -> str:
        """Description as text."""
        return (
            f"no photo was reported over {self.length_m:.0f} m ({self.end_s - self.start_s:.0f} s from "
            f"{self.start_s:.1f} s); {self.expected} {'was' if self.expected == 1 else 'were'} expected"
        )


@dataclass(frozen=True, slots=True)
class VerificationReport:
    """Coverage and safety of a flown track; ``verification.json``.

    Attributes:
        coverage_fraction: fraction of the area's ground that was seen, 0..1.
        coverage_of_coverable: fraction of the area that can be covered within the limits.
        surely_covered_fraction: fraction of the area seen for every error within [uncertainty].
        surely_covered_of_coverable: the same of the coverable area.
        possibly_covered_fraction: fraction of the area seen for some error within [uncertainty].
        planned_coverage_fraction: coverage that the plan promised, None without a plan.
        min_height_agl_m: lowest height above ground between the first and the last planned waypoint.
        max_height_agl_m: largest height above ground there.
        min_transit_clearance_m: lowest height above ground in transit, without take-off and landing.
        max_transit_height_agl_m: largest height above ground outside the route, including take-off and landing.
        violations: limits that were broken.
        max_deviation_m: largest distance from the planned route between its ends, None without a plan.
        max_ground_speed_m_s: largest ground speed on the route, averaged over a second; None without a route.
        gaps: coverage gaps, largest first.
        cells: how well the cells were seen.
        pictures: in how many photos they are; None for a sensor that takes no single photos.
        coverage_by_time: coverage over time; with several tracks, each is taken to begin right after the previous one.
        samples: number of samples of the track.
        unknown_attitude_looks: number of observations of unknown direction; what they may have seen counts as possibly seen.
        unobserved: unobserved stretches of the flight, in order of tracks and time.
        unobserved_s: their total duration between take-off and landing.
        unobserved_m: their total length in metres.
        unobserved_route_fraction: unobserved fraction of the route's time; None without a route.
        verdict: passed, failed or not proved.
        passed: whether the verdict is "passed".
        reasons: why it failed, one line each.
        doubts: why it is not proved, one line each.
        findings: other irregularities, one line each.
        requirements: the requirements and limits that were judged, by their names in the scenario.
        flown_utc: first and last moment of the tracks that tell the time of day, UTC; None where none does. No-fly zones are
            judged by it.
        separation: of each two tracks that overlap in time; None where no separation is required.
        photo_source: whether photos count that the vehicle reported, or that its tracks predict; None for a sensor that takes no
            single photos, or where real photos tell the coverage.
        missing_photos: stretches on which expected photos were not reported.
        judgement: the findings that the verdict, its reasons and its doubts come from, each with what it concerns.
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
    pictures: PhotoStatistics | None
    coverage_by_time: tuple[CoverageMoment, ...]
    samples: int
    unknown_attitude_looks: int
    unobserved: tuple[Unobserved, ...]
    unobserved_s: float
    unobserved_m: float
    unobserved_route_fraction: float | None
    verdict: VerdictName = field(init=False)
    passed: bool = field(init=False)
    reasons: tuple[str, ...] = field(init=False)
    doubts: tuple[str, ...] = field(init=False)
    findings: tuple[str, ...] = field(init=False)
    requirements: Mapping[str, Any]
    flown_utc: tuple[str, str] | None = None
    separation: tuple[PairSeparation, ...] = ()
    photo_source: PhotoSource | None = None
    missing_photos: tuple[MissingPhotos, ...] = ()
    judgement: Judgement = field(default_factory=Judgement)

    def __post_init__(self) -> None:
        object.__setattr__(self, "verdict", self.judgement.verdict)
        object.__setattr__(self, "passed", self.verdict == "passed")
        effects: dict[str, Effect] = {"reasons": "fails", "doubts": "not proved", "findings": "noted"}
        for name, effect in effects.items():
            object.__setattr__(self, name, self.judgement.texts(effect))

    def with_findings(self, more: Iterable[Finding]) -> "VerificationReport":
        """The same report with more findings, and the verdict that follows."""
        return replace(self, judgement=Judgement((*self.judgement.findings, *more)))
