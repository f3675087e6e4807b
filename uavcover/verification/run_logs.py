"""A flight's log for a run: its track, the plan that it followed, and the dates between which it was flown."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from uavcover.errors import InputError
from uavcover.model.track import ReadTrack, Track
from uavcover.run import provenance
from uavcover.run.documents import read_plan_document
from uavcover.run.flight_folders import TRACK, plans_of
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track_with_warnings
from uavcover.scenario.site import Site
from uavcover.verification.firmware import firmware_of
from uavcover.verification.phases import PlannedRoute
from uavcover.verification.shared_clock import DateBounds
from uavcover.verification.track_logs.readers import READERS, read_foreign_log

LOG_ENDINGS = (".csv", ".rrd", *READERS)


def read_log(path: Path, site: Site, *, system: int | None = None) -> ReadTrack:
    """A flown track from a file, by its ending: uavcover's own (.csv, .rrd), or another program's.

    Args:
        path: the file.
        site: in whose frame.
        system: the vehicle of a telemetry log that has several; none: the only one.

    Raises:
        InputError: no such file, an ending that is not known, a file without a track; or a log of another program for a
            scenario that has no position on Earth.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; record a track with: uavcover fly")
    ending = path.suffix.lower()
    if ending == ".csv":
        read = read_track_with_warnings(path)
        return replace(read, warnings=(*read.warnings, *_of_its_standing(path)))
    if ending == ".rrd":
        # Importing rerun takes a second that other logs need not wait for.
        from uavcover.recording.reader import read_recorded_track_with_warnings

        return read_recorded_track_with_warnings(path)
    if ending not in READERS:
        raise InputError(
            f"{path}: {path.suffix or 'no ending'} is not a supported track format; use {', '.join(LOG_ENDINGS)}"
        )
    if site.frame is None:
        raise InputError(
            f"{path}: scenario {site.scenario.name} has no position on Earth, so this log has no positions in it"
        )
    return read_foreign_log(path, site.frame, system=system)


def _of_its_standing(path: Path) -> list[str]:
    """Finding on the track of a flight that still goes on, or that was not followed to its end."""
    if path.name != TRACK:
        return []
    match provenance.settled_ending(RunFolder(path.parent)):
        case provenance.FLYING:
            return [f"{path}: this flight is still in progress; later observations are not in the track yet"]
        case provenance.INTERRUPTED:
            return [
                f"{path}: this flight was interrupted: the program that followed it ended early; continue with fly --resume"
            ]
        case _:
            return []


def read_planned_route(run: RunFolder) -> PlannedRoute | None:
    """Read the route and figures that a run folder's plan promised; None without a plan.

    Raises:
        InputError: the plan cannot be read.
    """
    if not run.file("plan.json").exists():
        return None
    document = run.read_json("plan.json", made_by="uavcover plan")
    planned = read_plan_document(document, source=str(run.file("plan.json")))
    return PlannedRoute(planned.route.waypoints_m, planned.coverage_fraction)


def planned_for(log: Path, run: RunFolder, track: Track | None = None) -> PlannedRoute | None:
    """Find the plan that a log followed: the one beside it, as in the folder of a gap mission or a sortie.

    A log from elsewhere is judged by the plan of which its ``track`` reached the largest share of the waypoints: the run's, or
    that of a sortie, of a flight that resumed it, or of its gap mission.

    Raises:
        InputError: the plan cannot be read.
    """
    folder = RunFolder(log.parent)
    if not folder.file("plan.json").exists():
        folder = run if track is None else _followed_by(track, run)
    planned = read_planned_route(folder)
    if planned is None or not any(sortie.path in folder.file(TRACK).parents for sortie in run.sorties()):
        return planned
    # The flights of one plan count together, and so does what it promised.
    whole = read_planned_route(run)
    return planned if whole is None else replace(planned, coverage_fraction=whole.coverage_fraction)


_NEAR_M = 10.0
_MOST_SAMPLES = 5000


def _followed_by(track: Track, run: RunFolder) -> RunFolder:
    """The folder of the plan that a track followed; of equals the one with the most waypoints."""
    places_m = track.enu_m[:: 1 + len(track) // _MOST_SAMPLES]

    def follows(folder: RunFolder) -> tuple[float, int]:
        planned = read_planned_route(folder)
        if planned is None:
            return 0.0, 0
        nearest_m = [float(np.linalg.norm(places_m - waypoint, axis=1).min()) for waypoint in planned.waypoints_m]
        return sum(distance <= _NEAR_M for distance in nearest_m) / len(nearest_m), len(nearest_m)

    plans = plans_of(run)
    return max(plans, key=follows) if len(plans) > 1 and len(track) else run


def date_bounds(log: Path, run: RunFolder) -> DateBounds:
    """Earliest and latest date of a log, from its firmware, its run's plan and its file time."""
    return DateBounds(provenance.planned_at_s(run), log.stat().st_mtime, firmware_of(log))
