"""One track judged separately: its evidence, compared with the limits."""

from dataclasses import dataclass, replace

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.errors import TrackError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import Track
from uavcover.model.verdict import LIMIT_OF, Finding, PhotoSource, Unobserved, Violation, fails, noted, unproved
from uavcover.scenario.site import Site
from uavcover.verification.attitude import known_attitude
from uavcover.verification.flown_route import (
    SAFETY,
    TRACK,
    Passing,
    PlannedRoute,
    contradiction,
    on_route,
    passing,
    plan_doubt,
    position_of,
    turned_back,
    unobserved_stretches,
)
from uavcover.verification.measured_motion import POSITION_ERROR_M
from uavcover.verification.observations import (
    Observations,
    TrackPhotos,
    observations_of,
    photos_of,
    reached_m,
    reports_photos,
)
from uavcover.verification.possible_motion import MAX_JUMP_M, judge_motion, motion_limits, within_reach
from uavcover.verification.safety import (
    Heights,
    Phases,
    SampleValues,
    ViolationFinder,
    commanded_pace_doubt,
    deviations_m,
    find_violations,
    ground_speeds_m_s,
    track_heights,
    zones_at_unknown_time,
)
from uavcover.verification.track_doubts import (
    TrackEnd,
    ground_tolerance_m,
    motion_doubts,
    sampling_doubts,
    track_ends,
    without_fix,
)


@dataclass(frozen=True, slots=True, eq=False)
class JudgedTrack:
    """Result of judging one track."""

    track: Track  # the samples that are evidence, with the attitudes that are known
    enu_m: FloatArray  # (n, 3) their positions
    joined: BoolArray  # (n - 1,) legs that were observed
    planned: PlannedRoute | None  # its plan, if any
    passed: Passing | None  # where it passed the planned waypoints, None without a plan
    phases: Phases  # phase of each sample
    heights: Heights  # heights above ground
    speeds_m_s: FloatArray  # (n,) ground speed
    deviations_m: FloatArray | None  # (n,) distance from the planned route, None without a plan
    violations: tuple[Violation, ...]  # limits that it exceeds
    begin: TrackEnd  # its first sample
    end: TrackEnd  # its last sample
    unobserved: tuple[Unobserved, ...]  # unobserved stretches between its samples
    # reasons to fail or not to prove it, without coverage, and other irregularities
    findings: tuple[Finding, ...]
    attitude_problems: tuple[str, ...]  # problems of its attitudes
    photos: TrackPhotos | None  # where photos were taken; None for a sensor that looks along the path

    def observations(self, site: Site) -> Observations:
        """The observations of its sensor."""
        return observations_of(site, self.track, self.enu_m, self.phases.route, self.joined, self.photos)


def judge_track(
    site: Site, track: Track, planned: PlannedRoute | None, *, photo_source: PhotoSource | None = None
) -> JudgedTrack:
    """Judge a track.

    Args:
        site: the scenario on its ground.
        track: what was flown.
        planned: its plan, if any.
        photo_source: which photos count; None: those that the vehicle reported, where it reported any.

    Raises:
        TrackError: it is empty, or has a position that is not on Earth; the sensor looks from waypoints only, and there is no
            plan that says where they are.
    """
    scenario = site.scenario
    checked_m = _checked_positions_m(site, track)
    limits = motion_limits(scenario.vehicle, scenario.wind)
    error_m = max(POSITION_ERROR_M, scenario.uncertainty.position_m)
    motion = judge_motion(
        track.time_s, checked_m, limits, max_gap_s=scenario.requirements.max_gap_s, velocity_m_s=track.velocity_enu_m_s,
        position_error_m=error_m,
    )  # fmt: skip
    kept = np.flatnonzero(motion.evidence & ~without_fix(track))
    kept = kept if len(kept) else np.zeros(1, dtype=np.int64)
    contradiction_m = float(np.max(np.linalg.norm(checked_m - track.enu_m, axis=1)))
    whole, enu = track, checked_m
    if len(kept) < len(track):
        enu, track = checked_m[kept], track.taken(kept)
    joined = (np.diff(kept) == 1) & motion.joined[kept[:-1]]
    known = known_attitude(track, enu, joined)
    track = replace(track, attitude_deg=known.attitude_deg)
    radius_m = position_radius_m(site)
    passed, misnumbered = None, None
    if planned is not None and len(planned.waypoints_m):
        passed = passing(enu, joined, planned.waypoints_m, radius_m=radius_m)
        misnumbered = contradiction(
            track, enu, joined, planned.waypoints_m, radius_m=radius_m, speed_m_s=limits.speed_m_s
        )
    # Begin, end and "under the ground" use the bare ground: a vehicle stands below the surface model.
    here_m = site.bare_ground.heights_agl_m(enu)
    begin, end = track_ends(scenario, track.time_s, enu, here_m, noise_m=motion.noise_m)
    if np.linalg.norm(checked_m[: kept[0]] - begin.enu_m, axis=1).max(initial=0.0) > MAX_JUMP_M:
        begin = replace(begin, on_ground=False)
    if np.linalg.norm(checked_m[kept[-1] :] - end.enu_m, axis=1).max(initial=0.0) > MAX_JUMP_M:
        end = replace(end, on_ground=False)
    route = on_route(
        track, enu, planned, acceptance_radius_m=scenario.vehicle.acceptance_radius_m, passed=passed,
        # Where the positions do not match the plan, only the recorded waypoint numbers remain.
        believed=misnumbered is None or (passed is not None and not passed.passed.any()),
        on_ground=(begin.on_ground, end.on_ground),
        hides=lambda at_m: ~joined & within_reach(track.time_s, enu, at_m, limits.speed_m_s),
    )  # fmt: skip
    if planned is not None and passed is not None and begin.on_ground and site.home_m is not None and turned_back(
        track, enu, joined, planned, passed, home_m=site.home_m, speed_m_s=limits.speed_m_s
    ):  # fmt: skip
        route = np.zeros_like(route)
    if planned is None and not (track.current_waypoint >= 0).any():
        route = route & ~_take_off_and_landing(site, enu, here_m, begin, end)
    phases = _phases(site, enu, route, planned, end)
    heights = track_heights(site, enu, joined, phases)
    speeds = ground_speeds_m_s(track, enu, joined)
    deviations = deviations_m(enu, route, planned)
    broken = find_violations(site, track, enu, heights, phases, joined)
    off = _requirement_violations(site, track, enu, phases, speeds, deviations)
    unbelieved = [
        *motion_doubts(site, whole, checked_m, motion, limits, position_error_m=error_m),
        *sampling_doubts(whole, motion, known),
        known.contradiction,
        # a flight that ended before its route need not keep the positions and the pace of the plan.
        commanded_pace_doubt(
            track,
            enu,
            joined,
            scenario.vehicle,
            planned if route.any() else None,
            passed=None if passed is None else passed.passed,
        ),
        None if passed is None or not route.any() else plan_doubt(passed),
        None if misnumbered is None else f"{misnumbered}; the verdict ignores current_waypoint and uses the positions",
    ]
    if not contradiction_m <= TRACK.max_contradiction_m:
        unbelieved.append(
            "the track contradicts itself: east, north, up differ from latitude, longitude, height by up to "
            f"{contradiction_m:.1f} m"
        )
    findings = [
        *_reasons(site, phases, speeds, deviations, broken),
        *_ground_doubts(site, track, enu, here_m, heights, phases),
        *(unproved("evidence", text) for text in unbelieved if text is not None),
    ]
    for name in zones_at_unknown_time(site, track, enu, joined):
        text = f"the vehicle entered no-fly zone {name}, which is inactive in flight_window_utc; the track has no time of day"
        findings.append(unproved("no-fly-zones", text))
    if scenario.requirements.max_deviation_m is not None and deviations is None:
        text = "the deviation from the planned route is unknown: there is no plan, or the track never follows its route"
        findings.append(unproved("deviation", text))
    source = photo_source or ("reported" if reports_photos(whole) else "predicted")
    photos = photos_of(site, track, enu, route, joined, planned, source=source)
    findings += map(noted, [*_findings(site, begin, end), *([] if photos is None else photos.findings)])
    if known.unconfirmed is not None:
        findings.append(noted(f"{known.unconfirmed}; observations that depend on them count only as possible"))
    return JudgedTrack(
        track=track,
        enu_m=enu,
        joined=joined,
        planned=planned,
        passed=passed,
        phases=phases,
        heights=heights,
        speeds_m_s=speeds,
        deviations_m=deviations,
        violations=tuple(sorted([*broken, *off], key=lambda violation: violation.start_s)),
        begin=begin,
        end=end,
        unobserved=tuple(unobserved_stretches(site, track, enu, joined, route, motion, kept)),
        findings=tuple(findings),
        attitude_problems=known.problems,
        photos=photos,
    )


def track_positions_m(site: Site, track: Track) -> FloatArray:
    """(n, 3) ENU positions of a track, from its geodetic positions where the site is georeferenced."""
    if site.frame is None:
        return track.enu_m
    return site.frame.enu_from_geodetic(*track.geodetic.T)


def _checked_positions_m(site: Site, track: Track) -> FloatArray:
    if len(track) == 0:
        raise TrackError("the track has no samples: nothing was flown, or nothing was recorded")
    enu = track_positions_m(site, track)
    if not np.isfinite(enu).all():
        bad = int(np.argmin(np.isfinite(enu).all(axis=1)))
        raise TrackError(
            f"sample {bad} of the track, at {track.time_s[bad]} s, is not a position on Earth; "
            "are latitude and longitude swapped?"
        )
    if not (np.diff(track.time_s) > 0.0).all():
        bad = int(np.argmax(~(np.diff(track.time_s) > 0.0))) + 1
        raise TrackError(f"sample {bad} of the track, at {track.time_s[bad]} s, is not later than the previous sample")
    return enu


def _requirement_violations(
    site: Site, track: Track, enu_m: FloatArray, phases: Phases, speeds_m_s: FloatArray, deviations: FloatArray | None
) -> list[Violation]:
    """Stretches of the route flown too fast, or too far from the plan."""
    requirements = site.scenario.requirements
    numbers = np.arange(len(track), dtype=float)
    find = ViolationFinder(track, enu_m)
    found: list[Violation] = []
    if requirements.max_ground_speed_m_s is not None:
        found += find.above(
            "ground-speed", phases.route, SampleValues(speeds_m_s, numbers), requirements.max_ground_speed_m_s,
            phase="route", unit="m/s",
        )  # fmt: skip
    if requirements.max_deviation_m is not None and deviations is not None:
        found += find.above(
            "deviation", phases.route, SampleValues(deviations, numbers), requirements.max_deviation_m, phase="route"
        )
    return found


def _reasons(
    site: Site, phases: Phases, speeds_m_s: FloatArray, deviations: FloatArray | None, violations: list[Violation]
) -> list[Finding]:
    """Limits that a track exceeds, one line each."""
    requirements = site.scenario.requirements
    reasons: list[Finding] = []
    if violations:
        kinds = sorted({violation.kind for violation in violations})
        concerns = tuple(dict.fromkeys(LIMIT_OF[kind] for kind in kinds))
        reasons.append(fails(concerns, f"violations of the limits: {len(violations)} ({', '.join(kinds)})"))
    off, most_m = largest(deviations), requirements.max_deviation_m
    if most_m is not None and off is not None and off > most_m + SAFETY.speed_tolerance:
        reasons.append(
            fails("deviation", f"the deviation from the planned route, {off:.1f} m, exceeds the limit of {most_m} m")
        )
    fastest, allowed = largest(speeds_m_s[phases.route]), requirements.max_ground_speed_m_s
    if allowed is not None and fastest is not None and fastest > allowed + SAFETY.speed_tolerance:
        reasons.append(
            fails("ground-speed", f"the speed over ground, {fastest:.1f} m/s, exceeds the limit of {allowed} m/s")
        )
    return reasons


def _ground_doubts(
    site: Site, track: Track, enu_m: FloatArray, here_m: FloatArray, heights: Heights, phases: Phases
) -> list[Finding]:
    doubts = []
    unknown = np.isnan(heights.lowest.values) & ~phases.vertical
    if unknown.any():
        first = float(track.time_s[int(np.argmax(unknown))])
        text = (
            f"there is no elevation data below {counted(int(unknown.sum()), 'sample')} of the flight, the first at "
            f"{first:.1f} s, so their height above ground cannot be judged (latitude and longitude may be swapped)"
        )
        doubts.append(unproved(("height-band", "transit-clearance", "transit-height"), text))
    lowest = int(np.nanargmin(here_m)) if np.isfinite(here_m).any() else 0
    if here_m[lowest] < -ground_tolerance_m(site.scenario):
        text = (
            f"positions are below the ground by up to {-here_m[lowest]:.1f} m at {track.time_s[lowest]:.1f} s, "
            f"{position_of(site, enu_m[lowest])}; the heights have a different datum, or the track a different location"
        )
        doubts.append(unproved("evidence", text))
    return doubts


def _findings(site: Site, begin: TrackEnd, end: TrackEnd) -> list[str]:
    """Irregularities of the take-off and landing positions."""
    findings = []
    for did, where in (("took off", begin), ("landed", end)):
        if where.on_ground and abs(where.height_agl_m) > TRACK.reported_height_m:
            side = "above" if where.height_agl_m > 0.0 else "under"
            findings.append(
                f"the vehicle {did} {abs(where.height_agl_m):.1f} m {side} the scenario's ground, so all heights "
                "above ground may be wrong by this amount"
            )
        if site.home_m is None:
            continue
        most_m = site.scenario.limits.max_home_error_m
        away_m = float(np.hypot(*(where.enu_m[:2] - site.home_m[:2])))
        if where.on_ground and away_m > most_m:
            findings.append(
                f"the vehicle {did} {away_m:.0f} m from the scenario's home, at {position_of(site, where.enu_m)}"
            )
    return findings


def position_radius_m(site: Site) -> float:
    """Distance within which a planned waypoint counts as passed."""
    return _position_radius_m(site) + site.scenario.uncertainty.position_m


def _position_radius_m(site: Site) -> float:
    return reached_m(site) + TRACK.position_margin_m


def _take_off_and_landing(
    site: Site, enu_m: FloatArray, height_agl_m: FloatArray, begin: TrackEnd, end: TrackEnd
) -> BoolArray:
    """(n,) samples of take-off and landing of a flight without a plan: straight above them, or as low as a roll."""
    found = np.zeros(len(enu_m), dtype=bool)
    low = height_agl_m < TRACK.roll_m
    if begin.on_ground:
        found |= np.cumsum(~(_at(site, enu_m, begin.enu_m) | low)) == 0
    if end.on_ground:
        found |= np.cumsum(~(_at(site, enu_m, end.enu_m) | low)[::-1])[::-1] == 0
    return found


def _at(site: Site, enu_m: FloatArray, position_m: FloatArray) -> BoolArray:
    """(n,) which positions are at a place, at any height."""
    return np.asarray(np.hypot(enu_m[:, 0] - position_m[0], enu_m[:, 1] - position_m[1]) <= _position_radius_m(site))


def _phases(site: Site, enu_m: FloatArray, route: BoolArray, planned: PlannedRoute | None, end: TrackEnd) -> Phases:
    nowhere = np.zeros(len(enu_m), dtype=bool)
    vertical = nowhere if site.home_m is None else _at(site, enu_m, site.home_m)
    if end.on_ground:
        # Wherever the vehicle lands, the last metres of the flight are a landing.
        vertical = vertical | (np.cumsum(~_at(site, enu_m, end.enu_m)[::-1])[::-1] == 0)
    junction = nowhere
    if planned is not None and len(planned.waypoints_m):
        junction = _at(site, enu_m, planned.waypoints_m[0]) | _at(site, enu_m, planned.waypoints_m[-1])
    return Phases(route=route, vertical=vertical & ~route, junction=junction & ~route & ~vertical)


def largest(values: FloatArray | None) -> float | None:
    """The largest number, ignoring NaN; None without one."""
    known = np.empty(0) if values is None else values[np.isfinite(values)]
    return float(known.max()) if known.size else None
