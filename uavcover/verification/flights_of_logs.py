"""The flights of a log: autopilots write all flights between two restarts into one file.

A log is cut where the vehicle stands on the ground. Flights that pass no planned waypoints, such as a test hop, are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.track import Track
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site
from uavcover.verification.flown_route import TRACK, PlannedRoute, passing
from uavcover.verification.judged_track import position_radius_m, track_positions_m
from uavcover.verification.run_logs import planned_for, read_log
from uavcover.verification.track_doubts import ENDS, ground_tolerance_m


@dataclass(frozen=True, slots=True, eq=False)
class LoggedFlights:
    """Flights of logs, in order."""

    paths: tuple[Path, ...]  # of each flight's log
    tracks: tuple[tuple[Track, PlannedRoute | None], ...]  # each with the plan that it followed
    warnings: tuple[str, ...]  # what was dropped or assumed, one line each
    notes: tuple[str, ...]  # which logs contain several flights, one line each


def flights_of_logs(paths: Sequence[Path], run: RunFolder, site: Site, *, system: int | None = None) -> LoggedFlights:
    """Read the logs of a run; a track of uavcover is one flight.

    Raises:
        InputError: a log or a plan cannot be read.
    """
    of, tracks = list[Path](), list[tuple[Track, PlannedRoute | None]]()
    warnings, notes = list[str](), list[str]()
    for path in paths:
        read = read_log(path, site, system=system)
        warnings += read.warnings
        flights = [(each, planned_for(path, run, each)) for each in flights_in(read.track, site)]
        kept = [flight for flight in flights if _follows(*flight, site)]
        if len(flights) > 1:
            follow = f"{counted(len(kept), 'follows', 'follow')} the plan" if kept else "none follows the plan"
            ignored = "; the others are ignored" if 0 < len(kept) < len(flights) else ""
            notes.append(f"{path.name} contains {len(flights)} flights; {follow}{ignored}")
            flights = flights if kept else [(read.track, planned_for(path, run, read.track))]
        tracks += kept or flights
        of += [path] * len(kept or flights)
    return LoggedFlights(tuple(of), tuple(tracks), tuple(warnings), tuple(notes))


def flights_in(track: Track, site: Site) -> list[Track]:
    """The track, cut where its vehicle stands on the ground for ``TRACK.stand_s`` between two flights."""
    if len(track) < 2 or (track.current_waypoint >= 0).any():
        return [track]
    enu_m = track_positions_m(site, track)
    agl_m = site.bare_ground.heights_agl_m(enu_m)
    low = ~(np.abs(agl_m) > ground_tolerance_m(site.scenario))  # or over ground that is not the scenario's
    stands = low & _at_rest(track.time_s, enu_m)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int8)))
    cuts = []
    for first, end in zip(edges[0::2].tolist(), edges[1::2].tolist(), strict=True):
        lasts_s = float(track.time_s[end - 1] - track.time_s[first])
        if first == 0 or end == len(track) or lasts_s < TRACK.stand_s:
            continue
        gaps_s = np.diff(track.time_s[first:end])
        longest = int(np.argmax(gaps_s))
        middle = int(np.searchsorted(track.time_s, track.time_s[first] + 0.5 * lasts_s))
        cuts.append(first + longest + 1 if gaps_s[longest] > ENDS.still_s else middle)
    return [track.taken(np.arange(*ends)) for ends in zip([0, *cuts], [*cuts, len(track)], strict=True)]


def _at_rest(time_s: FloatArray, enu_m: FloatArray) -> BoolArray:
    """(n,) whether (n, 3) positions barely change in the time before or after each, as at the ends of a flight."""
    found = np.zeros(len(time_s), dtype=bool)
    here = np.arange(len(time_s))
    before = np.searchsorted(time_s, time_s - ENDS.still_s)
    after = np.searchsorted(time_s, time_s + ENDS.still_s, side="right") - 1
    for first, last in ((before, here), (here, after)):
        seconds = time_s[last] - time_s[first]
        moved_m = np.abs(enu_m[last] - enu_m[first])
        slow = np.hypot(moved_m[:, 0], moved_m[:, 1]) <= ENDS.still_level_m_s * seconds
        slow &= moved_m[:, 2] <= ENDS.still_vertical_m_s * seconds
        found |= slow & (seconds >= 0.5 * ENDS.still_s)
    return found


def _follows(track: Track, planned: PlannedRoute | None, site: Site) -> bool:
    """Whether a flight passes two planned waypoints, or the only one."""
    if planned is None or not len(planned.waypoints_m):
        return True
    joined = np.diff(track.time_s) <= site.scenario.requirements.max_gap_s
    passed = passing(track_positions_m(site, track), joined, planned.waypoints_m, radius_m=position_radius_m(site))
    return int(passed.passed.sum()) >= min(2, len(planned.waypoints_m))
