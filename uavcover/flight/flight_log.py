"""The record of a flight in progress: the track, the events, the growing recording."""

import contextlib
import json
import logging
import math
import sys
from collections import deque
from collections.abc import Callable

import numpy as np

from mission_io.autopilots.autopilot import Mode, mode_from_custom
from mission_io.links.opening import TelemetryLogWriter
from mission_io.wire import messages as m
from uavcover.errors import OutputError
from uavcover.flight.connect import Connected
from uavcover.flight.fly import RECORDS
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import landing_time, leg_times, turn_times
from uavcover.model.route import Route
from uavcover.model.track import EventKind, FlightEvent, TrackSample
from uavcover.recording import flight as recorded
from uavcover.recording.writer import LiveRecording
from uavcover.run import provenance
from uavcover.run.documents import TRACK
from uavcover.run.file_group import writing
from uavcover.run.folder import (
    AFTER_FLIGHT_FILES,
    FLIGHT_FILES,
    MISSION_FILES,
    PLAN_FILES,
    VERDICT_FILES,
    RunFolder,
    json_text,
    moves_of_an_older_flight,
)
from uavcover.run.track_file import SpaceReserve, TrackWriter
from uavcover.run.user import ProgressBar, User
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import pace_of
from uavcover.sensing.site_maps import judging_map

TELEMETRY_LOG = "flight.tlog"
_GROWING = ".flight.rrd.growing"
_GROWING_TELEMETRY = ".flight.tlog.growing"
LIVE_LINE = ".flight.line"
"""While a flight goes on: its line and its last warning, for maps in other processes."""
_log = logging.getLogger(__name__)


def live_recording(run: RunFolder, site: Site, route: Route, *, viewer_url: str | None) -> LiveRecording | None:
    """The recording that grows with a flight, not yet under its own name; none on Windows, which has no ``/dev/fd``."""
    if sys.platform == "win32":
        return None
    return LiveRecording(
        run.file(_GROWING), site=site, coverage=judging_map(site), planned=route, viewer_url=viewer_url
    )


class FlightLog:
    """The track and the events of a flight, kept as they come.

    ``track.csv``, ``flight.rrd`` and ``flight.tlog`` begin with ``begin``, just before the vehicle is armed, so a flight that
    never began changes nothing in the run folder; then the recording and the verdict of an older flight are removed, and
    ``run.json`` speaks of this one. What cannot be written is known before that, and room for all of it is kept free. The
    telemetry log has what was said before, too. When the recording or the telemetry log ends early, the track goes on. When the
    track cannot be written any more, the vehicle is in the air: the flight is followed to its end, and the error comes after it.

    Args:
        run: where to.
        overwrite: whether to replace an existing track.
        user: receives events.
        bar: shows the waypoints, and the vehicle's action.
        route: the planned one.
        site: the scenario on its ground.
        reserve: disk space reserved for the record until the flight ends.
        vehicle: whose battery and link are recorded.
        live: the recording that grows; None for the track alone.
        took_off_s: vehicle time of the take-off; None when it comes.

    Attributes:
        events: what happened.
        states: battery and link, once a second of vehicle time.
        error: why the track ended before the flight did.
        begun: whether the flight has begun, so that ``run.json`` speaks of it.
        sample_count: of the track.
    """

    def __init__(
        self, run: RunFolder, *, overwrite: bool, user: User, bar: ProgressBar, site: Site, route: Route,
        reserve: SpaceReserve, vehicle: Connected, live: LiveRecording | None, took_off_s: float | None = None,
    ) -> None:  # fmt: skip
        self.events: list[FlightEvent] = []
        self.states: list[recorded.VehicleState] = []
        self.error: OutputError | None = None
        self.sample_count = 0
        self._run, self._overwrite, self._user, self._bar = run, overwrite, user, bar
        self._waypoint_count, self._vehicle, self._live = len(route), vehicle, live
        self._line = LiveLine(site, route, vehicle, covered=lambda: None if live is None else live.covered)
        self._took_off_s = took_off_s
        self._line_at = (-math.inf, -math.inf)
        self._warning = ""
        self._writer: TrackWriter | None = None
        self._reserve = reserve
        self.begun = False
        self._telemetry: TelemetryLogWriter | None = None
        if vehicle.link is not None:
            self._telemetry = TelemetryLogWriter(run.file(_GROWING_TELEMETRY))
            vehicle.link.log_to(self._telemetry)

    @property
    def recorded_events(self) -> list[recorded.RecordedEvent]:
        """The events that have a time, for the recording."""
        return [shown for event in self.events if (shown := _recorded(event)) is not None]

    def begin(self) -> None:
        """Rename the files, because the vehicle is about to be armed.

        Raises:
            OutputError, InputError: a file cannot be written, so the vehicle must stay on the ground.
        """
        for ended in (self._live, self._telemetry):
            if ended is not None and ended.error is not None:
                raise OutputError(f"{ended.error}; the vehicle was not armed")
        self._set_older_flight_aside()
        provenance.forget(self._run)
        self._writer = TrackWriter(self._run.file("track.csv"), overwrite=self._overwrite, reserve=self._reserve)
        if self._live is not None:
            self._live.rename(self._run.file("flight.rrd"))
        if self._telemetry is not None:
            self._telemetry.move_to(self._run.file(TELEMETRY_LOG))
            if self._telemetry.error is not None:
                raise OutputError(f"{self._telemetry.error}; the vehicle was not armed")
        provenance.note_flying(self._run)
        self.begun = True

    def take_sample(self, sample: TrackSample) -> None:
        """Write a sample: into the track first."""
        if self._writer is None:
            raise OutputError(f"{self._run}: the recording has not started")
        if self.error is None:
            room = self._reserve.held
            try:
                self._writer.write(sample)
                self.sample_count += 1
            except OutputError as error:
                self.error = error
                self._user.warn(f"{error}; the flight continues without a recording")
            if room and not self._reserve.held:
                self._user.warn(f"{self._run}: the disk is full; the track continues in the reserved space")
        if self._live is not None:
            self._live.take_sample(sample)
        if not self.states or sample.time_s - self.states[-1].time_s >= RECORDS.state_every_s:
            self.states.append(self._state(sample.time_s))
            if self._live is not None:
                self._live.take_state(self.states[-1])

        self._show_line(sample)

    def _show_line(self, sample: TrackSample) -> None:
        """Show what the vehicle does, twice a second."""
        flown_s, now = self.flown_s(sample.time_s), self._vehicle.client.clock.now()
        if flown_s is None or (
            now - self._line_at[0] < RECORDS.line_every_s and flown_s - self._line_at[1] < RECORDS.line_every_flown_s
        ):
            return
        self._line_at = (now, flown_s)
        try:
            line = self._line.text(sample)
            self._bar.status(line, at_s=flown_s)
            with contextlib.suppress(OSError):  # on a full disk, the flight goes on without it
                self._run.file(LIVE_LINE).write_text(
                    json.dumps({"line": line, "warning": self._warning}), encoding="utf-8"
                )
        except Exception:  # any error: the flight goes on without the line
            _log.exception("the flight continued past its last line")
            self._line_at = (math.inf, math.inf)

    def flown_s(self, time_s: float | None) -> float | None:
        """Seconds since the take-off at a vehicle time; None before it."""
        if time_s is None:
            return None
        if self._took_off_s is None and self._vehicle.monitor.on_ground is False:
            self._took_off_s = time_s
        return None if self._took_off_s is None else time_s - self._took_off_s

    def _set_older_flight_aside(self) -> None:
        """Move the older flight with a copy of its plan; none of it counts for the new flight."""
        if not any(self._run.file(name).exists() for name in FLIGHT_FILES):
            self._run.remove(VERDICT_FILES)
            return
        moved = moves_of_an_older_flight(self._run)
        older = self._run.file(next(iter(moved.values()))).parent
        plan = [name for name in (*PLAN_FILES, *MISSION_FILES) if self._run.file(name).is_file()]
        # No older track is there any more, and the record says so in the same write.
        gone = dict.fromkeys((*FLIGHT_FILES, *(f"{name}/{TRACK}" for name in moved if name not in AFTER_FLIGHT_FILES)))
        document = provenance.run_document(self._run)
        record = provenance.with_entry(document, "begin", command=sys.argv, wrote=gone, moved=moved)
        with writing(older):
            copies: dict[str, str | bytes] = {
                f"{older.name}/{name}": self._run.file(name).read_bytes() for name in plan
            }
        self._run.write_together({**copies, provenance.RUN_FILE: json_text(record)}, moved=moved)
        self._user.warn(f"moved the previous flight to {older}, a separate run folder")

    def take_event(self, event: FlightEvent) -> None:
        """Record an event."""
        self.events.append(event)
        shown = _recorded(event)
        if self._live is not None and shown is not None:
            self._live.take_event(shown)
        if event.kind is EventKind.WAYPOINT and event.waypoint is not None:
            note = f"waypoint {event.waypoint} of {self._waypoint_count}"
            self._bar.update(event.waypoint, total=self._waypoint_count, note=note)
        elif event.kind is EventKind.WARNING:
            self._user.warn(event.text)
            self._warning = event.text
            if event.alarm:
                self._user.ring()
        else:
            flown_s = self.flown_s(event.time_s)
            line = f"  {'' if flown_s is None else f'{flown_s:.1f} s '}{event.text}"
            if event.limits:
                self._user.show_limits(line, event.limits)
            else:
                self._user.say(line)

    def close(self) -> None:
        """Close the track, the growing recording and the telemetry log; the latter two go when the flight never began."""
        self._bar.status("", at_s=0.0)
        with contextlib.suppress(OSError):
            self._run.file(LIVE_LINE).unlink(missing_ok=True)
        self._reserve.release()
        if self._writer is not None and self.error is None:
            self._writer.close()
        if self._live is not None:
            self._live.close()
            if self._live.error is not None:
                self._user.warn(self._live.error)
            if self._writer is None:
                self._run.remove([_GROWING])
        self._close_telemetry()

    def _close_telemetry(self) -> None:
        if self._telemetry is None or self._vehicle.link is None:
            return
        self._vehicle.link.log_to(None)
        self._telemetry.close()
        if self._telemetry.error is not None:
            self._user.warn(self._telemetry.error)
        if self._writer is None:
            self._run.remove([_GROWING_TELEMETRY])

    def _state(self, time_s: float) -> recorded.VehicleState:
        status, link = self._vehicle.monitor.latest(m.SysStatus), self._vehicle.client.statistics
        percent = None if status is None else status.battery_remaining_percent
        return recorded.VehicleState(
            time_s=time_s,
            battery_v=None if status is None else status.battery_v,
            battery_percent=None if percent is None else float(percent),
            frames_in=link.frames_in,
            frames_lost=link.lost,
        )


def _recorded(event: FlightEvent) -> recorded.RecordedEvent | None:
    if event.time_s is None:
        return None
    return recorded.RecordedEvent(event.time_s, event.text, "WARN" if event.kind is EventKind.WARNING else "INFO")


class LiveLine:
    """Mode, waypoint, height above ground, speed, battery, link, distance home, coverage and remaining time, as text.

    Everything except the coverage comes from the latest messages. Another thread computes the coverage.

    Args:
        site: the scenario on its ground.
        route: the planned one.
        vehicle: the one that flies it.
        covered: the observed fraction of the area so far, 0 to 1; None if unknown.
    """

    def __init__(self, site: Site, route: Route, vehicle: Connected, *, covered: Callable[[], float | None]) -> None:
        self._site, self._vehicle, self._covered = site, vehicle, covered
        self._count = len(route)
        self._waypoint = 0
        self._frames: deque[tuple[int, int]] = deque(maxlen=20)
        self._left = _TimeLeft(site, route.waypoints_m, vehicle) if site.home_m is not None else None

    def text(self, sample: TrackSample) -> str:
        """The line at a sample of the track, about 100 characters long, without unknown values."""
        if sample.current_waypoint >= 0:
            self._waypoint = sample.current_waypoint
        at_m = np.array([sample.east_m, sample.north_m, sample.up_m])
        client, monitor = self._vehicle.client, self._vehicle.monitor
        mode = mode_from_custom(client.vehicle.autopilot, client.vehicle.custom_mode)
        # Item and mode tell that the last waypoint is behind: in another mode no planned waypoint is flown to.
        between = sample.current_waypoint < 0 and mode is Mode.MISSION
        homeward = between and self._waypoint == self._count - 1
        elsewhere = between and 0 < self._waypoint < self._count - 1  # as on the return after a stop
        parts = [
            f"mode {client.vehicle.custom_mode}" if mode is None else mode.value,
            "homeward"
            if homeward
            else "off the planned route"
            if elsewhere
            else f"waypoint {self._waypoint} of {self._count}",
        ]
        height_m = float(self._site.ground.heights_agl_m(at_m[None])[0])
        if math.isfinite(height_m):
            parts.append(f"{height_m:.0f} m AGL")
        position, status = monitor.latest(m.GlobalPositionInt), monitor.latest(m.SysStatus)
        if position is not None:
            parts.append(f"{math.hypot(position.velocity_north_m_s, position.velocity_east_m_s):.1f} m/s")
        if status is not None and status.battery_remaining_percent is not None:
            parts.append(f"battery {status.battery_remaining_percent:.0f} %")
        if (received := self._received_percent()) is not None:
            parts.append(f"link {received:.0f} %")
        if self._site.home_m is not None:
            parts.append(f"home {math.hypot(*(at_m - self._site.home_m)[:2]):.0f} m")
        covered = self._covered()
        if covered is not None:
            parts.append(f"covered {100.0 * covered:.0f} %")
        if self._left is not None and not elsewhere:
            left_s = self._left.seconds(at_m, None if homeward else self._waypoint)
            parts.append(f"{int(left_s) // 60}:{int(left_s) % 60:02d} left")
        return ", ".join(parts)

    def _received_percent(self) -> float | None:
        """The messages that arrived since some lines ago, of those that were sent."""
        counts = self._vehicle.client.statistics
        self._frames.append((counts.frames_in, counts.lost))
        arrived, lost = (last - first for first, last in zip(self._frames[0], self._frames[-1], strict=True))
        return 100.0 * arrived / (arrived + lost) if arrived + lost > 0 else None


class _TimeLeft:
    """Remaining time of a flight from a position, at the planned pace: the route, then home."""

    def __init__(self, site: Site, waypoints_m: FloatArray, vehicle: Connected) -> None:
        assert site.home_m is not None
        self._pace, self._home_m = pace_of(site, vehicle.autopilot), site.home_m
        above_home = np.array([*site.home_m[:2], waypoints_m[-1, 2]])
        self._path_m = np.vstack([waypoints_m, above_home])
        turns_s = turn_times(self._pace, self._path_m)
        legs_s = leg_times(self._pace, self._path_m) + 0.5 * (turns_s[:-1] + turns_s[1:])
        self._from_waypoint_s = np.append(np.cumsum(legs_s[::-1])[::-1], 0.0)

    def seconds(self, at_m: FloatArray, waypoint: int | None) -> float:
        """Seconds to the landing; ``waypoint`` is None once the last one is reached."""
        to = len(self._path_m) - 1 if waypoint is None else waypoint
        target = self._path_m[to] if waypoint is not None else np.array([*self._home_m[:2], at_m[2]])
        there_s = float(leg_times(self._pace, np.vstack([at_m, target]))[0]) if math.dist(at_m, target) > 0.1 else 0.0
        sinks_m = max(0.0, float((target if waypoint is None else self._path_m[-1])[2] - self._home_m[2]))
        return there_s + float(self._from_waypoint_s[to]) + float(landing_time(self._pace, sinks_m))
