"""A flight's log for a run: its track, the plan that it followed, its dates, and its flights where it contains several."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, time
from pathlib import Path

import numpy as np

from mission_io.data_tables import read_document
from mission_io.model.plain_text import counted
from uavcover.errors import InputError, TrackError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.model.limits import flown_window, window_text
from uavcover.model.track import ReadTrack, Track
from uavcover.run import provenance
from uavcover.run.documents import TRACK as TRACK_FILE
from uavcover.run.documents import plans_of, read_plan_document
from uavcover.run.folder import RunFolder
from uavcover.run.track_file import read_track_with_warnings
from uavcover.scenario.site import Site
from uavcover.verification.flown_route import TRACK, PlannedRoute, passing
from uavcover.verification.judged_track import position_radius_m, track_positions_m
from uavcover.verification.track_doubts import ENDS, ground_tolerance_m
from uavcover.verification.track_logs.readers import CLOCK, READERS, read_foreign_log

# Check a track's clocks: its date, and the receive times on the clock of the ground station.
#
# A date counts only when it is plausible: not before the firmware that flew it, nor before the plan that was flown,
# not after the file that holds it, and in agreement with the ground station. Receivers count weeks modulo 1,024; when
# the count starts anew they report a date 1,024 weeks too early.
#
# A vehicle's own time begins when it is switched on, so it says nothing about other vehicles. What all share is the
# clock on which their positions arrived. A position may arrive late, and never early: near every sample, the one that
# was least late tells how the two clocks stand to each other.

# Find the firmware that wrote a log, and its earliest date: a flight is not older than its autopilot's release.
#
# The version stands in every kind of log: as text (ArduPilot's MSG and VER), as a number (``ver_sw_release`` of PX4),
# and in the AUTOPILOT_VERSION that a ground station received. A track of ours has its telemetry log beside it.

_ARDUPILOT = re.compile(rb"Ardu(?:Copter|Plane|Rover|Sub) V(\d+)\.(\d+)\.\d+(-?[a-z]*)")
_PX4 = re.compile(rb"uint32_t ver_sw_release(.{4})", re.DOTALL)
_MESSAGE = re.compile(rb"\xfd[\x14-\xff].{5}\x94\x00\x00.{16}(.{4})", re.DOTALL)
"""AUTOPILOT_VERSION (148) as MAVLink 2: the version comes after two numbers of 64 bits."""
_TELEMETRY = "flight.tlog"


@dataclass(frozen=True, slots=True)
class Firmware:
    """A firmware's version."""

    autopilot: str  # "ardupilot" or "px4"
    major: int  # first number
    minor: int  # second number
    official: bool  # whether it is a release, and not a build on the way to one

    def __str__(self) -> str:
        """Name and version."""
        name = "ArduPilot" if self.autopilot == "ardupilot" else "PX4"
        return f"{name} {self.major}.{self.minor}{'' if self.official else ' (not a release)'}"

    @property
    def released_s(self) -> float | None:
        """Release date of the firmware in seconds since 1970: no earlier flight is possible. None if unknown."""
        minor = self.minor if self.official else self.minor - CLOCK.unreleased_versions
        released = read_document("uavcover/data/firmware_releases.toml")[self.autopilot].get(f"{self.major}.{minor}")
        return None if released is None else datetime.combine(released, time(), UTC).timestamp()


def firmware_of(log: Path) -> Firmware | None:
    """The firmware that a log, or the telemetry log beside one of our tracks, names; None where it names none."""
    path = log.with_name(_TELEMETRY) if log.suffix.lower() in (".csv", ".rrd") else log
    if not path.is_file():
        return None
    with path.open("rb") as file:
        head = file.read(CLOCK.head_bytes)
    kind = path.suffix.lower()
    if kind == ".bin":
        found = _ARDUPILOT.search(head)
        return None if found is None else Firmware("ardupilot", int(found[1]), int(found[2]), not found[3].strip(b"-"))
    number = {".ulg": _PX4, ".tlog": _MESSAGE}.get(kind)
    found = None if number is None else number.search(head)
    if found is None:
        return None
    level, _, minor, major = found[1]
    autopilot = "px4" if kind == ".ulg" or major == 1 else "ardupilot"
    return Firmware(autopilot, major, minor, level == 255)  # FIRMWARE_VERSION_TYPE_OFFICIAL


ROLLOVER_S = 1024 * 604_800.0
FIRST_LOG_S = 1_420_070_400.0
"""2015: no firmware that writes the logs read here is older."""
BEFORE_PLAN_S, AFTER_FILE_S = 600.0, 86_400.0
"""Differences that clocks of computers have; files on memory cards have the local time."""


@dataclass(frozen=True, slots=True)
class DateBounds:
    """Between what a track's date lies, seconds since 1970; None if unknown."""

    planned_s: float | None = None  # when its plan was made
    written_s: float | None = None  # when its file was written
    firmware: Firmware | None = None  # that flew it


UNKNOWN_DATES = DateBounds()


def dated(track: Track, bounds: DateBounds) -> tuple[Track, tuple[str, ...]]:
    """The track without a date that is not plausible, and what is wrong with that."""
    window = flown_window(track.unix_time_s)
    if window is None:
        return track, ()
    wrong = [*_date_problems(track, bounds)]
    if not wrong:
        return track, ()
    text = f"the track's date, {window_text(window)}, is implausible: {'; '.join(wrong)}"
    later = replace(track, unix_time_s=track.unix_time_s + ROLLOVER_S)
    window = flown_window(later.unix_time_s)
    if window is not None and not any(_date_problems(later, bounds)):
        text += (
            f"; a date 1,024 weeks later is plausible ({window_text(window)}), because the receiver's week "
            "number rolled over"
        )
    text += ". No-fly zones with times are judged as if the time were unknown"
    return replace(track, unix_time_s=np.full(len(track), np.nan)), (text,)


def clocks_apart(track: Track) -> str | None:
    """Find where one of two clocks that run alike advances more than the other: the record lost or gained time."""
    known = np.isfinite(track.unix_time_s)
    own_s, apart_s = track.time_s[known], track.unix_time_s[known] - track.time_s[known]
    if not own_s.size or np.ptp(apart_s) <= CLOCK.clock_step_s:
        return None
    at_s = np.append(np.arange(own_s[0], own_s[-1], CLOCK.clocks_compared_s), own_s[-1])
    drift_s = np.diff(np.interp(at_s, own_s, apart_s))
    # a simulation that runs fast, or waits, drifts all the time.
    if np.median(np.abs(drift_s)) > CLOCK.alike_s and np.abs(np.diff(apart_s)).max() <= CLOCK.clock_step_s:
        return None
    worst = int(np.argmax(np.abs(drift_s)))
    further, other = ("satellites'", "vehicle's") if drift_s[worst] > 0.0 else ("vehicle's", "satellites'")
    return (
        f"from {at_s[worst]:.1f} s to {at_s[worst + 1]:.1f} s the {further} clock advances {abs(drift_s[worst]):.1f} "
        f"s more than the {other}, so time was inserted or removed there"
    )


def _date_problems(track: Track, bounds: DateBounds) -> Iterator[str]:
    known = np.isfinite(track.unix_time_s)
    unix_s, own_s = track.unix_time_s[known], track.time_s[known]
    first_s, last_s = float(unix_s.min()), float(unix_s.max())
    jumps_s = np.diff(unix_s) - np.diff(own_s)
    if jumps_s.size and np.abs(jumps_s).max() > CLOCK.jump_s:
        at = int(np.argmax(np.abs(jumps_s)))
        yield f"the track's clock jumps by {jumps_s[at] / 3600.0:.1f} hours at {own_s[at + 1]:.1f} s"
    released_s = None if bounds.firmware is None else bounds.firmware.released_s
    if released_s is not None and first_s < released_s:
        yield f"the firmware, {bounds.firmware}, dates from {_day(released_s)[:7]}"
    elif first_s < FIRST_LOG_S:
        yield f"no firmware that writes such logs is older than {_day(FIRST_LOG_S)}"
    if bounds.planned_s is not None and first_s < bounds.planned_s - BEFORE_PLAN_S:
        yield f"the plan dates from {_day(bounds.planned_s)}"
    if bounds.written_s is not None and last_s > bounds.written_s + AFTER_FILE_S:
        yield f"the log file dates from {_day(bounds.written_s)}"
    late_s = track.received_utc_s[known] - unix_s
    if np.isfinite(late_s).any() and abs(float(np.nanmedian(late_s))) > CLOCK.disagrees_s:
        yield f"the ground station received it on {_day(float(np.nanmedian(track.received_utc_s)))}"


def _day(unix_s: float) -> str:
    return f"{datetime.fromtimestamp(unix_s, UTC):%Y-%m-%d %H:%M}"


@dataclass(frozen=True, slots=True, eq=False)
class SharedTimes:
    """The samples of a track on the shared clock."""

    taken_utc_s: FloatArray  # (n,) when each sample was taken, not decreasing
    pace: float  # seconds of the shared clock in a second of vehicle time; below 1 for a simulation that runs fast


def shared_times(track: Track) -> SharedTimes | None:
    """The samples of a track on the shared clock; None where times of arrival are missing, or go back."""
    received, own = track.received_utc_s, track.time_s
    if len(track) < 2 or not np.isfinite(received).all() or (np.diff(received) < 0.0).any():
        return None
    pace = float((received[-1] - received[0]) / (own[-1] - own[0]))
    if not pace > 0.0:
        return None
    late_s = received - pace * own
    first = np.searchsorted(own, own - CLOCK.window_s)
    last = np.searchsorted(own, own + CLOCK.window_s, side="right")
    least = np.array([late_s[a:b].min() for a, b in zip(first, last, strict=True)])
    return SharedTimes(np.maximum.accumulate(np.minimum(pace * own + least, received)), pace)


LOG_ENDINGS = (".csv", ".rrd", *READERS)


def read_log(path: Path, site: Site, *, system: int | None = None) -> ReadTrack:
    """A flown track from a file, by its ending: uavcover's own (.csv, .rrd), or another program's.

    Args:
        path: the file.
        site: the site of the frame.
        system: the vehicle of a telemetry log that has several; None: the only one.

    Raises:
        InputError: no such file, an ending that is not known, a file without a track; or a log of another program for a
            scenario that has no position on Earth.
        TrackError: it cannot be read, or lasts longer than any flight.
    """
    read = _read(path, site, system)
    lasts_s = float(np.ptp(read.track.time_s)) if len(read.track) else 0.0
    if lasts_s > CLOCK.longest_s:
        raise TrackError(
            f"{path}: the track lasts {lasts_s:.0f} s, longer than any flight: its times are damaged, or logs were joined; use "
            "the log of a single flight"
        )
    return read


def _read(path: Path, site: Site, system: int | None) -> ReadTrack:
    if not path.is_file():
        raise InputError(f"{path}: no such file; record a track with: uavcover fly")
    ending = path.suffix.lower()
    if ending == ".csv":
        read = read_track_with_warnings(path)
        return replace(read, warnings=(*read.warnings, *_of_its_standing(path)))
    if ending == ".rrd":
        # Importing rerun takes a second that other logs need not wait for.
        from uavcover.recording.layout import read_recorded_track_with_warnings

        return read_recorded_track_with_warnings(path)
    if ending not in READERS:
        raise InputError(
            f"{path}: {path.suffix or 'no ending'} is not a supported track format; use {', '.join(LOG_ENDINGS)}"
        )
    if site.frame is None:
        raise InputError(f"{path}: scenario {site.scenario.name} has no position on Earth, so the log does not fit")
    return read_foreign_log(path, site.frame, system=system)


def _of_its_standing(path: Path) -> list[str]:
    """Finding on the track of a flight that continues, or that was not followed to its end."""
    if path.name != TRACK_FILE:
        return []
    words = {
        provenance.FLYING: "is still in progress; the track does not contain later observations yet",
        provenance.INTERRUPTED: "was interrupted, because the program that followed it ended early; continue with fly --resume",
    }.get(provenance.settled_ending(RunFolder(path.parent)) or "")
    return [] if words is None else [f"{path}: this flight {words}"]


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

    A log from elsewhere is judged by the plan of which its ``track`` reached the largest fraction of the waypoints: the run's, or
    that of a sortie, of a flight that resumed it, or of its gap mission.

    Raises:
        InputError: the plan cannot be read.
    """
    folder = RunFolder(log.parent)
    if not folder.file("plan.json").exists():
        folder = run if track is None else _followed_by(track, run)
    planned = read_planned_route(folder)
    if planned is None or not any(sortie.path in folder.file(TRACK_FILE).parents for sortie in run.sorties()):
        return planned
    # The flights of one plan count together, and so does what it promised.
    whole = read_planned_route(run)
    return planned if whole is None else replace(planned, coverage_fraction=whole.coverage_fraction)


_NEAR_M = 10.0


def _followed_by(track: Track, run: RunFolder) -> RunFolder:
    """The folder of the plan that a track followed; of equals the one with the most waypoints."""
    positions_m = track.enu_m[:: 1 + len(track) // 5000]

    def follows(folder: RunFolder) -> tuple[float, int]:
        planned = read_planned_route(folder)
        if planned is None:
            return 0.0, 0
        nearest_m = [float(np.linalg.norm(positions_m - waypoint, axis=1).min()) for waypoint in planned.waypoints_m]
        return sum(distance <= _NEAR_M for distance in nearest_m) / len(nearest_m), len(nearest_m)

    plans = plans_of(run)
    return max(plans, key=follows) if len(plans) > 1 and len(track) else run


def date_bounds(log: Path, run: RunFolder) -> DateBounds:
    """Earliest and latest date of a log, from its firmware, its run's plan and its file time."""
    return DateBounds(provenance.planned_at_s(run), log.stat().st_mtime, firmware_of(log))


# The flights of a log: autopilots write all flights between two restarts into one file.
#
# A log is cut where the vehicle stands on the ground. Flights that pass no planned waypoints, such as a test hop, are left out.


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
