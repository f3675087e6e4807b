"""One recording of all flights of a fleet, on the clock that they share."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.recording.fleet import record_fleet
from uavcover.run.flight_folders import TRACK
from uavcover.run.folder import RunFolder
from uavcover.run.planned import read_planned
from uavcover.run.track_file import read_track
from uavcover.sensing.coverage_map import judging_map
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.shared_clock import shared_times
from uavcover.verification.verify import flown_coverage

FLEET_RECORDING = "fleet.rrd"
_LEAST_STEP_S = 1e-6


def write_fleet_recording(run: RunFolder, folders: Sequence[RunFolder]) -> Path | None:
    """Write ``fleet.rrd`` of all flights in these folders; none where nothing was recorded.

    Raises:
        InputError: a track does not tell when its positions arrived, or cannot be read.
        OutputError: the file cannot be written.
    """
    site, planned = read_planned(run)
    coverage = judging_map(site)
    shared: dict[str, tuple[FloatArray, FloatArray]] = {}
    first_seen: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    paces = []
    for folder in folders:
        if not folder.file(TRACK).exists():
            continue
        track = read_track(folder.file(TRACK))
        if len(track) < 2:
            continue
        times = shared_times(track)
        if times is None:
            raise InputError(
                f"{folder.file(TRACK)}: does not tell when its positions arrived, so {FLEET_RECORDING} is left out"
            )
        own, flown_plan = read_planned(folder)
        eyes = coverage if own.scenario.sensor == site.scenario.sensor else judging_map(own)
        flown = flown_coverage(eyes, track, PlannedRoute(flown_plan.route.waypoints_m, 0.0))
        name = str(folder.path.relative_to(run.path)).replace("/", ", ")
        shared[name] = (times.taken_utc_s, track.enu_m)
        first_seen.append((flown.first_seen_s, track.time_s, times.taken_utc_s))
        paces.append(times.pace)
    if not shared:
        return None
    begin, pace = min(float(t[0]) for t, _ in shared.values()), float(np.median(paces))

    def since_first_s(taken_utc_s: FloatArray) -> FloatArray:
        return (taken_utc_s - begin) / pace

    seen = np.full(coverage.grid.count, np.inf)
    for first_s, own_s, taken_utc_s in first_seen:
        on_shared = since_first_s(np.interp(first_s, own_s, taken_utc_s))
        seen = np.fmin(seen, np.where(np.isfinite(first_s), on_shared, np.inf))
    tracks = {}
    for name, (taken_utc_s, enu_m) in shared.items():
        time_s = since_first_s(taken_utc_s)
        kept = np.concatenate([[True], np.diff(time_s) > _LEAST_STEP_S])
        tracks[name] = (time_s[kept], enu_m[kept])
    path = run.file(FLEET_RECORDING)
    record_fleet(path, coverage=coverage, planned=planned.route, tracks=tracks, first_seen_s=seen)
    return path
