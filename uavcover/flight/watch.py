"""Watches a vehicle in flight for silence, lost position or satellites, low battery and a restart.

An alarm is raised at once, when its amount has doubled, every half minute while it lasts, and when it is over.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from mission_io.client.client import Client
from mission_io.data_tables import data_table
from mission_io.model.enums import AutopilotId, EkfFlag, GpsFix
from mission_io.wire import messages as m
from uavcover.flight.evidence import WATCH, Cause, Causes
from uavcover.flight.monitor import Monitor
from uavcover.flight.orders import FlightTimeouts
from uavcover.model.track import Ending, EventKind, FlightFaultError, Incident
from uavcover.model.vehicle import Vehicle


class ReportReason(Enum):
    """Reason for which an alarm is reported now."""

    BEGUN = "it has begun"
    DOUBLED = "it has doubled since the last report"
    LASTS = "it continues"
    ENDED = "it has ended"


class Alarm:
    """One alarm: its amount, and the times of its reports. Knows no clock: time is an argument.

    What is over for less than ``settle_s`` is not over: an amount that swings about its limit is one alarm and not a hundred.

    Args:
        settle_s: how long it has to be away before it counts as over.

    Attributes:
        largest: the largest amount since it began.
    """

    def __init__(self, *, settle_s: float = 0.0) -> None:
        self._settle_s = settle_s
        self._reported_at_s: float | None = None
        self._reported_amount = 0.0
        self._away_since_s: float | None = None
        self.largest = 0.0

    def measure(self, amount: float | None, now: float) -> ReportReason | None:
        """Take what was measured at ``now`` (seconds), None for nothing wrong; returns the reason for a report."""
        if self._reported_at_s is None:
            if amount is None:
                return None
            self._reported_amount = self.largest = amount
            return self._tell(ReportReason.BEGUN, now)
        if amount is None:
            if self._away_since_s is None:
                self._away_since_s = now
            if now - self._away_since_s < self._settle_s:
                return None
            self._reported_at_s = self._away_since_s = None
            return ReportReason.ENDED
        self._away_since_s = None
        self.largest = max(self.largest, amount)
        if amount >= 2.0 * self._reported_amount and amount > self._reported_amount:
            self._reported_amount = amount
            return self._tell(ReportReason.DOUBLED, now)
        if now - self._reported_at_s >= WATCH.repeat_s:
            return self._tell(ReportReason.LASTS, now)
        return None

    def _tell(self, reason: ReportReason, now: float) -> ReportReason:
        self._reported_at_s, self._away_since_s = now, None
        return reason


_OTHER_MISSION = ("changed", "received", "updated", "uploaded", "new")
"""Words beside "mission" or "flight plan" that speak of another one."""

_SILENCE = frozenset({Ending.LINK_LOST, Ending.HEARTBEAT_LOST, Ending.POSITION_LOST})


@dataclass(slots=True)
class _Going:
    """A current failure: its incident, its alarm, and its last reported text."""

    number: int
    alarm: Alarm
    since_s: float
    text: str = ""
    amount: float | None = 0.0


class Watch:
    """Detects failures and their end, and reports both.

    Attributes:
        incidents: all that went wrong so far, in the order in which it began.
        causes: evidence for what the vehicle does by itself.
        unanswered: that the vehicle is heard and does not answer, as text; empty while it answers.
        mission_words: how many lines of the vehicle spoke of another mission.
    """

    def __init__(
        self,
        client: Client,  # hears the vehicle
        monitor: Monitor,  # hears what the client hears
        timeouts: FlightTimeouts,  # how long silence may be
        tell: Callable[[EventKind, str], None],  # receives every report
        sound: Callable[[str], None],  # receives the reports that are also sounded
    ) -> None:
        self._client, self._monitor, self._timeouts = client, monitor, timeouts
        self._tell, self._sound = tell, sound
        self._open: dict[Ending, _Going] = {}
        self._taken: tuple[Ending, _Going] | None = None
        self._closed_at_s: dict[Ending, float] = {}
        self.causes = Causes(client, monitor)
        self.unanswered = ""
        self._in_flight = False
        self._heard_again_at_s = client.clock.now()
        self.incidents: list[Incident] = []
        self.mission_words = 0

    def take_off(self) -> None:
        """Watch for a lost fix from here on; on the ground it was waited for."""
        self._in_flight = True

    def take_text(self, said: m.StatusText) -> None:
        """Take note of a warning of the vehicle."""
        words = said.text.lower()
        about = "mission" in words or "flight plan" in words
        self.mission_words += about and any(word in words for word in _OTHER_MISSION)
        self.causes.take_text(said)

    def is_open(self, kind: Ending) -> bool:
        """Whether an incident of this kind is open."""
        return kind in self._open

    def text_of(self, kind: Ending) -> str:
        """The reported text of a kind's latest incident; the kind's own text without one."""
        return next((i.text for i in reversed(self.incidents) if i.kind is kind), kind.value)

    def opened_at_s(self, kind: Ending) -> float:
        """When an open incident began, on the link's clock; infinity when none of this kind is open."""
        going = self._open.get(kind)
        return math.inf if going is None else going.since_s

    @property
    def open_kinds(self) -> frozenset[Ending]:
        """The kinds of the incidents that are open."""
        return frozenset(self._open)

    def open(self, kind: Ending, text: str, amount: float = 0.0, *, evidence: tuple[str, ...] = ()) -> None:
        """Report a failure with an amount in its own unit: at once, when it doubles, and while it lasts."""
        going = self._open.get(kind)
        if going is None:
            going = self._open[kind] = _Going(
                len(self.incidents), Alarm(settle_s=WATCH.settle_s), self._client.clock.now()
            )
            self.incidents.append(Incident(kind, text, self._monitor.time_s, evidence=evidence))
        elif amount > going.alarm.largest:
            self.incidents[going.number] = replace(self.incidents[going.number], text=text)
        going.text, going.amount = text, amount
        self._measure(kind, going, amount)

    def measure(self, kind: Ending, amount: float | None, text: str, over: str) -> None:
        """Like ``open``, and with None its end, reported as ``over``, once it has stayed away for a moment."""
        going = self._open.get(kind)
        if amount is not None:
            self.open(kind, text, amount)
        elif going is not None:
            going.amount = None
            if self._measure(kind, going, None) is ReportReason.ENDED:
                self.close(kind, over)

    def close(self, kind: Ending, text: str) -> None:
        """Tell that it is over, if it was there."""
        going = self._open.pop(kind, None)
        if going is None:
            return
        self._closed_at_s[kind] = self._client.clock.now()
        self.incidents[going.number] = replace(self.incidents[going.number], end_s=self._monitor.time_s)
        self._tell(EventKind.WARNING, text)

    def taken(self, kind: Ending, text: str, evidence: tuple[str, ...]) -> None:
        """Report that a pilot or a failsafe has the vehicle: an incident of its own, which outlasts its alarm."""
        self._taken = kind, _Going(len(self.incidents), Alarm(), self._client.clock.now(), text)
        self.incidents.append(Incident(kind, text, self._monitor.time_s, evidence=evidence))
        self._measure(*self._taken, 0.0)

    def given_back(self, text: str) -> None:
        """Tell that nothing else has the vehicle any more."""
        if self._taken is not None:
            number, self._taken = self._taken[1].number, None
            self.incidents[number] = replace(self.incidents[number], end_s=self._monitor.time_s)
            self._tell(EventKind.WARNING, text)

    def rest(self) -> None:
        """Stop the reports of failures that are open and no longer measured, as during the return."""
        for going in self._open.values():
            going.amount = None

    def _measure(self, kind: Ending, going: "_Going", amount: float | None) -> ReportReason | None:
        now, vehicle_s = self._client.clock.now(), self._monitor.time_s
        if kind not in _SILENCE and vehicle_s is not None:  # the vehicle's own time stands still while nothing is heard
            now = vehicle_s
        reason = going.alarm.measure(amount, now)
        if reason in (ReportReason.BEGUN, ReportReason.DOUBLED):
            self._sound(going.text)
        elif reason is ReportReason.LASTS:
            self._sound(f"still: {going.text}")
        return reason

    def recent_cause(self, *, within_s: float) -> Cause | None:
        """Most likely reason if the vehicle acts by itself now: from its reports or current failures.

        Args:
            within_s: how long ago that may be, in seconds of the link's clock.
        """
        found = self.causes.recent(within_s=within_s)
        if found is not None:
            return found
        recent = self._recent_incidents(within_s)
        for kind in (Ending.BATTERY_FAILSAFE, Ending.GPS_LOST, Ending.WIND_ABOVE_LIMITS, Ending.LINK_LOST):
            if kind in recent:
                return Cause(kind, recent[kind], (recent[kind],))
        return None

    def cause_of_mode_change(self) -> Cause:
        """Reason for which the vehicle left the commanded mode a moment ago."""
        return self.causes.of_mode_change(self._recent_incidents(WATCH.cause_within_s), unanswered=self.unanswered)

    def _recent_incidents(self, within_s: float) -> dict[Ending, str]:
        """Failures of the last seconds on the link's clock, by kind."""
        now = self._client.clock.now()
        recent = {kind for kind, closed_s in self._closed_at_s.items() if now - closed_s <= within_s}
        return {kind: self.text_of(kind) for kind in [*self._open, *recent]}

    def look(self) -> None:
        """Look at everything once. Raises FlightFaultError: the vehicle is gone, or it restarted."""
        now = self._client.clock.now()
        silence_s = self._monitor.silence_s(now)
        self._look_at_silence(silence_s)
        if self._monitor.restarted:
            text = f"vehicle {self._client.vehicle.system_id} restarted: its clock was reset"
            self.open(Ending.RESTARTED, text)
            raise FlightFaultError(Ending.RESTARTED, text)
        if silence_s <= self._timeouts.deadman_s:
            self._look_at_heartbeat(now)
            self._look_at_positions(now)
            self.causes.look()
        if self._in_flight:
            self._look_at_fix()
            self._look_at_battery()
        for kind, going in [*self._open.items(), *([] if self._taken is None else [self._taken])]:
            if going.amount is not None:
                self._measure(kind, going, going.amount)

    def _look_at_silence(self, silence_s: float) -> None:
        vehicle = self._client.vehicle.system_id
        if silence_s > self._timeouts.link_lost_s and self.is_open(
            Ending.LINK_LOST
        ):  # a pause of ours is no silence yet
            text = f"link lost: no messages from vehicle {vehicle} for {silence_s:.1f} s"
            self.open(Ending.LINK_LOST, text)
            raise FlightFaultError(Ending.LINK_LOST, f"{text}; check the vehicle and the link")
        if silence_s > self._timeouts.deadman_s:
            self.open(
                Ending.LINK_LOST,
                f"no messages from vehicle {vehicle} for {silence_s:.1f} s; waiting up to {self._timeouts.link_lost_s:g} s",
                silence_s,
            )
        elif self.is_open(Ending.LINK_LOST):
            self._heard_again_at_s = self._client.clock.now()
            self.close(Ending.LINK_LOST, f"receiving messages from vehicle {vehicle} again")

    def _look_at_heartbeat(self, now: float) -> None:
        """A missing heartbeat while other messages arrive: following continues with these."""
        age_s = min(self._client.heartbeat_age_s, now - self._heard_again_at_s)
        vehicle = self._client.vehicle.system_id
        if age_s > self._timeouts.heartbeat_s:
            self.open(
                Ending.HEARTBEAT_LOST,
                f"heartbeat lost: none from vehicle {vehicle} for {age_s:.1f} s, although other messages are "
                "arriving; its mode and armed state are unknown",
                age_s,
            )
        elif self.is_open(Ending.HEARTBEAT_LOST):
            self.close(Ending.HEARTBEAT_LOST, f"receiving heartbeats from vehicle {vehicle} again")

    def _look_at_positions(self, now: float) -> None:
        if self._monitor.position_at_s is None:
            return
        heard_at = max(self._monitor.position_at_s, self._monitor.gap_ended_at_s)  # stamps are doubted after a gap
        if now - heard_at > self._timeouts.deadman_s:
            text = f"no position for {now - heard_at:.1f} s, although other messages are arriving"
            if self._monitor.doubts_positions:
                text = (
                    f"no position for {now - heard_at:.1f} s whose time agrees with the others; two vehicles may share "
                    f"system ID {self._client.vehicle.system_id}"
                )
            self.open(Ending.POSITION_LOST, text, now - heard_at)
        elif (apart_m := self._monitor.positions.apart_m) is not None:
            text = (
                f"positions alternate between two places {apart_m:.0f} m apart: the vehicle's position is not known, or two "
                f"vehicles share system ID {self._client.vehicle.system_id}"
            )
            self.open(Ending.POSITION_LOST, text, apart_m)
        elif self.is_open(Ending.POSITION_LOST):
            self.close(Ending.POSITION_LOST, "receiving positions again")

    def _look_at_fix(self) -> None:
        gps = self._monitor.latest(m.GpsRawInt)
        lacks = []
        if gps is not None and gps.fix_type < GpsFix.FIX_3D:
            lacks.append(f"satellite fix (GPS fix type {gps.fix_type})")
        ekf = self._monitor.latest(m.EkfStatusReport)
        if self._client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT and ekf is not None and not has_position(ekf):
            lacks.append("position estimate (EKF)")
        if lacks:
            self.open(Ending.GPS_LOST, f"the vehicle has lost its {' and its '.join(lacks)}")
        else:
            self.close(Ending.GPS_LOST, "the vehicle has its position again")

    def _look_at_battery(self) -> None:
        """A battery that is low; it doubles when half of what was left then is gone."""
        status = self._monitor.latest(m.SysStatus)
        left = None if status is None else status.battery_remaining_percent
        if left is None or left < 0:
            return
        low = left <= WATCH.low_battery_percent
        text = f"the battery has {left} % left"
        self.measure(Ending.BATTERY_LOW, 100.0 / max(left, 1) if low else None, text, f"{text} again")


def has_fix(monitor: Monitor) -> float:
    """Whether the vehicle reports a satellite fix and a position estimate, 1 or 0; NaN while it reports neither."""
    gps, ekf = monitor.latest(m.GpsRawInt), monitor.latest(m.EkfStatusReport)
    if gps is None and ekf is None:
        return math.nan
    return float((gps is None or gps.fix_type >= GpsFix.FIX_3D) and (ekf is None or has_position(ekf)))


def has_position(ekf: m.EkfStatusReport) -> bool:
    """Whether ArduPilot's filter knows where the vehicle is."""
    return bool(ekf.flags & EkfFlag.POSITION_HORIZONTAL_ABSOLUTE) and not ekf.flags & EkfFlag.CONSTANT_POSITION


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reserve:
    rounding_percent: float
    climb_s: float
    measured_s: float
    use_home_ratio: float
    use_on_ratio: float
    to_turn_s: float


RESERVE = data_table(_Reserve, "uavcover/data/flight.toml", "reserve")


@dataclass(slots=True)
class BatteryUse:
    """Battery use of a flight: whether the charge lasts for the rest of the mission, or only for the return.

    Knows no clock: times are arguments.
    """

    vehicle: Vehicle  # with its endurance and reserve
    planned_each_s: float  # percent that a second in the air is planned to use
    # time in the air, and the charge at the first report after the climb; None before
    first: tuple[float, float] | None = None
    percent: float = math.nan  # its latest report
    aloft_s: float = 0.0  # time in the air by then

    def take(self, percent: float, *, aloft_s: float) -> None:
        """Take the battery's report at a time after take-off."""
        if self.first is None and aloft_s >= RESERVE.climb_s:
            self.first = aloft_s, percent
        self.percent, self.aloft_s = percent, aloft_s

    @property
    def each_s(self) -> float:
        """Percent of the battery for a second in the air: planned at first, measured once it reports any use."""
        if self.first is None or self.aloft_s - self.first[0] < RESERVE.measured_s or self.percent >= self.first[1]:
            return self.planned_each_s
        return (self.first[1] - self.percent) / (self.aloft_s - self.first[0])

    @property
    def spare(self) -> float:
        """Percent above the reserve."""
        return self.percent - RESERVE.rounding_percent - 100.0 * self.vehicle.reserve_fraction

    def lasts_home(self, seconds: float) -> bool:
        """Whether the return can still be begun a moment later."""
        return self.spare > RESERVE.use_home_ratio * self.each_s * (seconds + RESERVE.to_turn_s)

    def lasts_on(self, seconds: float) -> bool:
        """Whether so much more of the mission keeps the reserve."""
        return self.spare >= RESERVE.use_on_ratio * self.each_s * seconds

    def may_wait_s(self, seconds: float) -> float:
        """Time that it may hold before a rest of the mission; infinite while the battery reports nothing."""
        if math.isnan(self.percent):
            return math.inf
        return self.spare / self.each_s - RESERVE.use_on_ratio * seconds

    def allows_on(self, *, rest_s: float, home_s: float) -> bool:
        """Whether it may go on, with ``rest_s`` to the landing by the mission and ``home_s`` straight home."""
        return home_s + RESERVE.to_turn_s >= rest_s or self.lasts_home(home_s) or self.lasts_on(rest_s)
