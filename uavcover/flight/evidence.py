"""Evidence about a vehicle: whether its known state is newer than the last gap, and why it acts by itself.

During silence, a failsafe, a pilot or another ground station can take over the vehicle. Messages after a gap may have waited in a
buffer and be older than the gap. So we request the vehicle's time with our own number (TIMESYNC), and only messages after the
answer count. Until mode, armed state, landed state and mission item arrive again, the state is unknown, and no command is sent.

A link can fall behind without a gap: messages arrive every second, but all of them are old. So the question is repeated once a
second. If an answer takes longer than the link needs at its best, the messages with it are as old, and the state is also unknown.

Texts of every severity, PX4's events, SYS_STATUS, EKF_STATUS_REPORT, the state in the heartbeat, jumps of the position and gaps
of the link are evidence of a cause. Without evidence, the cause is reported as unknown.
"""

import math
import re
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from mission_io.client.client import Client
from mission_io.data_tables import data_table
from mission_io.model.enums import AutopilotId, EkfFlag, Severity
from mission_io.model.items import ground_distance_m
from mission_io.wire import messages as m
from uavcover.flight.monitor import Monitor
from uavcover.model.track import Ending


@dataclass(frozen=True, slots=True, kw_only=True)
class _Watch:
    repeat_s: float
    settle_s: float
    cause_within_s: float
    low_battery_percent: int
    bad_variance: float
    jump_m: float
    most_signs: int
    failsafe_gap_s: float
    sign_within_s: float


WATCH = data_table(_Watch, "uavcover/data/flight.toml", "watch")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Evidence:
    old_beat_s: float
    behind_s: float
    ask_s: float
    ask_again_s: float
    unanswered_s: float
    agreeing_beats: int
    remembered: int


EVIDENCE = data_table(_Evidence, "uavcover/data/flight.toml", "evidence")


_KINDS: Mapping[type[m.Message], str] = MappingProxyType(
    {m.ExtendedSysState: "EXTENDED_SYS_STATE", m.MissionCurrent: "MISSION_CURRENT"}
)


class Evidence:
    """Request fresh evidence after each gap, and report its arrival.

    A gap is a silence of the vehicle, or a pause of this process: both show as time between two messages.
    """

    def __init__(self, client: Client, monitor: Monitor) -> None:
        self._client, self._monitor = client, monitor
        self._gap_ended_s = monitor.gap_ended_at_s
        self._requested_s: dict[int, float] = {}
        self._ask_at_s = -math.inf
        self._shortest_s, self._latest_s, self._answered_at_s = math.inf, 0.0, -math.inf
        self._proved_at_s: float | None = self._gap_ended_s
        self._complete = True
        self._unknown_since_s: float | None = None

    @property
    def current(self) -> bool:
        """Whether mode, armed state, landed state and mission item are known since the last gap."""
        now, monitor = self._client.clock.now(), self._monitor
        silent = monitor.has_gap(now) or self._client.heartbeat_age_s > EVIDENCE.old_beat_s
        return not (silent or self._behind) and self._gap_ended_s == monitor.gap_ended_at_s and self._complete

    @property
    def unknown_s(self) -> float:
        """Time for which the vehicle was heard while its state was unknown; 0 while no message comes."""
        return 0.0 if self._unknown_since_s is None else self._client.clock.now() - self._unknown_since_s

    @property
    def missing(self) -> str:
        """Messages that must arrive before the vehicle's state is known."""
        if self._client.heartbeat_age_s > EVIDENCE.old_beat_s:
            return "a heartbeat"
        if self._behind:
            return f"an answer to the TIMESYNC request (the last answer took {self._latest_s:.0f} s)"
        if self._proved_at_s is None:
            return "an answer to the TIMESYNC request"
        proved_at_s = self._proved_at_s
        lacking = [name for kind, name in _KINDS.items() if self._monitor.arrived_at_s(kind) < proved_at_s]
        return " and ".join(lacking) or "two matching heartbeats"

    def look(self) -> None:
        """Ask for fresh evidence where it is needed, and take what has come; called whenever messages were received."""
        self._look()
        now = self._client.clock.now()
        if self.current or self._monitor.has_gap(now):
            self._unknown_since_s = None
        elif self._unknown_since_s is None:
            self._unknown_since_s = now

    @property
    def _behind(self) -> bool:
        """Whether the answer that came last took long. Where none comes, only our way to the vehicle is known to be lost."""
        answers = self._client.clock.now() - self._answered_at_s <= EVIDENCE.unanswered_s
        return answers and self._latest_s > EVIDENCE.behind_s + self._shortest_s

    def _look(self) -> None:
        now, monitor = self._client.clock.now(), self._monitor
        answers = self._take_answers()
        if monitor.gap_ended_at_s > self._gap_ended_s:
            self._gap_ended_s = self._ask_at_s = monitor.gap_ended_at_s
            self._proved_at_s, self._complete = None, False
        if monitor.has_gap(now):
            return
        if now >= self._ask_at_s:
            self._ask(now)
        if self._complete:
            return
        if self._proved_at_s is None:
            since_gap = (arrived_s for arrived_s, requested_s in answers if requested_s >= self._gap_ended_s)
            self._proved_at_s = next(since_gap, now if now - self._gap_ended_s > EVIDENCE.unanswered_s else None)
        if self._proved_at_s is None:
            return
        beats = [beat for arrived_s, beat in monitor.beats if arrived_s >= self._proved_at_s]
        agree = (
            len(beats) >= EVIDENCE.agreeing_beats
            and len({(b.armed, b.custom_mode) for b in beats[-EVIDENCE.agreeing_beats :]}) == 1
        )
        self._complete = agree and all(monitor.arrived_at_s(kind) >= self._proved_at_s for kind in _KINDS)

    def _ask(self, now: float) -> None:
        number = round(now * 1e9) or 1
        self._requested_s[number] = now
        while len(self._requested_s) > EVIDENCE.remembered:
            del self._requested_s[next(iter(self._requested_s))]
        overdue = self._proved_at_s is None or self._behind
        self._ask_at_s = now + (EVIDENCE.ask_again_s if overdue else EVIDENCE.ask_s)
        self._client.send(m.TimeSync(answered_ns=0, requested_ns=number))

    def _take_answers(self) -> list[tuple[float, float]]:
        """The answers to questions of ours since the last look: when each arrived, and when it was requested."""
        answers = []
        while self._monitor.time_answers:
            arrived_s, answer = self._monitor.time_answers.popleft()
            requested_s = self._requested_s.get(answer.requested_ns)
            if requested_s is not None:
                answers.append((arrived_s, requested_s))
                self._latest_s, self._answered_at_s = arrived_s - requested_s, arrived_s
                self._shortest_s = min(self._shortest_s, self._latest_s)
        return answers


_WORDS: tuple[tuple[Ending, tuple[str, ...]], ...] = (
    (Ending.CRASHED, ("crash",)),
    (Ending.FALLING, ("thrust loss", "motor failure", "attitude failure")),
    (Ending.BATTERY_FAILSAFE, ("battery",)),
    (Ending.WIND_ABOVE_LIMITS, ("wind",)),
    (Ending.FENCE_BREACHED, ("fence",)),
    (Ending.GPS_LOST, ("gps", "gnss", "ekf", "position estimate", "global position", "position lost", "deadreckon")),
    (Ending.LINK_LOST, ("gcs", "data link", "datalink", "ground station", "ground control")),
    (Ending.RADIO_LOST, ("radio failsafe", "manual control", "rc failsafe", "rc lost")),
    (Ending.FAILSAFE, ("failsafe",)),
)
"""What the words of a warning are about; the first that fits."""
_SURE = re.compile(
    r"failsafe|fence.* breach|breach.* fence|geofence|glitch|connection .*lost|lost .*connection|crash|thrust loss"
)
"""A text of less than a warning counts only with such words: ArduPilot reports a breached fence as a notice."""
_OVER = re.compile(r"clear|regained|is back|continuing|recovered")
"""Words of a text that says that something is over, or that the vehicle does nothing about it."""

_FAILSAFE_EVENTS: Mapping[int, int] = MappingProxyType({26528394: 5, 30481910: 7})
"""PX4's events commander_failsafe_enter and commander_failsafe_enter_hold: where in their arguments the cause is."""
_PILOT_EVENT = 17738815
"""PX4's event failsafe_rc_override."""
_EVENT_CAUSES: Mapping[int, tuple[Ending, str]] = MappingProxyType(
    {
        1: (Ending.RADIO_LOST, "manual control loss"),
        2: (Ending.LINK_LOST, "GCS connection loss"),
        3: (Ending.BATTERY_FAILSAFE, "low battery level"),
        4: (Ending.BATTERY_FAILSAFE, "critical battery level"),
        5: (Ending.BATTERY_FAILSAFE, "emergency battery level"),
        6: (Ending.BATTERY_FAILSAFE, "remaining flight time low"),
    }
)
"""PX4's failsafe_cause_t (src/lib/events/enums.json)."""

_BITS: tuple[tuple[int, Ending, str], ...] = (
    (0x100000, Ending.FENCE_BREACHED, "SYS_STATUS reports a breached geofence"),
    (0x20, Ending.GPS_LOST, "SYS_STATUS reports an unhealthy GPS"),
    (0x10000, Ending.RADIO_LOST, "SYS_STATUS reports an unhealthy RC receiver"),
    (0x2000000, Ending.BATTERY_FAILSAFE, "SYS_STATUS reports an unhealthy battery"),
)
_CRITICAL_STATES: Mapping[int, str] = MappingProxyType({5: "CRITICAL", 6: "EMERGENCY"})
"""MAV_STATE of a heartbeat while a failsafe acts."""


@dataclass(frozen=True, slots=True)
class Sign:
    """One piece of evidence."""

    cause: Ending  # what it speaks for
    text: str  # what was reported, as text
    at_s: float  # when, on the link's clock
    time_s: float | None  # vehicle time when it began; None if unknown
    observed_s: float | None  # vehicle time when it was seen last; None if unknown

    def __str__(self) -> str:
        """For people."""
        return self.text if self.time_s is None else f"{self.text} (vehicle time {self.time_s:.1f} s)"


@dataclass(frozen=True, slots=True)
class Cause:
    """Reason for an event."""

    kind: Ending  # the name of it
    text: str  # a clause as text
    evidence: tuple[str, ...] = ()  # what it is concluded from


def cause_in(text: str, *, severity: int = Severity.WARNING) -> Ending | None:
    """The cause that a text of the vehicle names; None for unknown words, or an end that it reports."""
    words = text.lower()
    if _OVER.search(words) or (severity > Severity.WARNING and not _SURE.search(words)):
        return None
    return next((cause for cause, known in _WORDS if any(word in words for word in known)), None)


class Causes:
    """Collects evidence while a vehicle flies."""

    def __init__(self, client: Client, monitor: Monitor) -> None:
        self._client, self._monitor = client, monitor
        self._signs: deque[Sign] = deque(maxlen=WATCH.most_signs)
        self._lasting: dict[Ending, Sign] = {}
        self._before: m.GlobalPositionInt | None = None
        self._pilot: Sign | None = None

    def take_text(self, said: m.StatusText) -> None:
        """Take note of a text of the vehicle."""
        cause = cause_in(said.text, severity=said.severity)
        if cause is not None:
            name = Severity(said.severity).name.lower() if said.severity < len(Severity) else str(said.severity)
            self._note(cause, f'the vehicle reported ({name}): "{said.text}"')
        elif _OVER.search(said.text.lower()) and (over := _named(said.text)) is not None:
            self._signs = deque((sign for sign in self._signs if sign.cause is not over), maxlen=WATCH.most_signs)

    def take_event(self, event: m.Event) -> None:
        """Take note of an event of PX4."""
        if event.event_id == _PILOT_EVENT:
            self._pilot = self._sign(Ending.PILOT_TOOK_OVER, "event: a pilot took over with the sticks")
        position = _FAILSAFE_EVENTS.get(event.event_id)
        if position is not None and (known := _EVENT_CAUSES.get(event.arguments[position])) is not None:
            self._note(known[0], f"event: failsafe, caused by {known[1]}")

    def look(self) -> None:
        """Look at the latest state once."""
        status, ekf = self._monitor.latest(m.SysStatus), self._monitor.latest(m.EkfStatusReport)
        if status is not None:
            bad = status.sensors_present & status.sensors_enabled & ~status.sensors_healthy
            for bit, cause, text in _BITS:
                if bad & bit:
                    self._last(cause, text)
        if ekf is not None and self._client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT:
            if ekf.flags & EkfFlag.CONSTANT_POSITION or not ekf.flags & EkfFlag.POSITION_HORIZONTAL_ABSOLUTE:
                self._last(Ending.GPS_LOST, "EKF_STATUS_REPORT has no position")
            elif max(ekf.velocity_variance or 0.0, ekf.position_horizontal_variance or 0.0) >= WATCH.bad_variance:
                self._last(Ending.GPS_LOST, "EKF_STATUS_REPORT has a variance of 1 or more")
        self._look_for_jump()

    def recent(self, *, within_s: float, among: Collection[Ending] | None = None) -> Cause | None:
        """The most likely cause of a reaction, by the vehicle's own words and state; None without evidence.

        Args:
            within_s: how old evidence may be, in seconds of vehicle time where that is known, else of the link's clock.
            among: the causes that count; None for all.
        """
        signs = [sign for sign in (*self._signs, *self._lasting.values()) if self._age_s(sign) <= within_s]
        for cause, _ in _WORDS:
            found = [sign for sign in signs if sign.cause is cause and (among is None or cause in among)]
            if found:
                return Cause(cause, found[0].text, tuple(dict.fromkeys(str(sign) for sign in found)))
        return None

    def of_mode_change(self, incidents: Mapping[Ending, str], *, unanswered: str = "") -> Cause:
        """Reason for which the vehicle recently left the commanded mode.

        Args:
            incidents: present and recent incidents, with their reports.
            unanswered: sign that it is heard and does not answer, so that it may not hear us; empty while it answers.
        """
        state = self._client.vehicle.system_status
        found = self.recent(within_s=WATCH.sign_within_s)
        if found is not None and found.kind is not Ending.FAILSAFE:
            return found
        signs = () if found is None else found.evidence
        silent = self._client.clock.now() - self._monitor.gap_ended_at_s <= WATCH.sign_within_s + self._monitor.gap_s
        if silent and self._monitor.gap_s >= WATCH.failsafe_gap_s:
            text = f"the link was silent for {self._monitor.gap_s:.0f} s"
            return Cause(Ending.LINK_LOST, text, (text, *signs))
        for kind in _ACTED_ON:
            if kind in incidents:
                return Cause(kind, incidents[kind], (incidents[kind], *signs))
        if unanswered:
            return Cause(Ending.LINK_LOST, unanswered, (unanswered, *signs))
        if found is not None:
            return found
        if self._pilot is not None and self._age_s(self._pilot) <= WATCH.sign_within_s:
            return Cause(Ending.PILOT_TOOK_OVER, self._pilot.text, (str(self._pilot),))
        if state in _CRITICAL_STATES:
            text = f"the vehicle's heartbeat reports the state {_CRITICAL_STATES[state]}, but no reason was reported"
            return Cause(Ending.FAILSAFE, text, (text,))
        gaps = (f"the link was silent for {self._monitor.gap_s:.0f} s",) if silent else ()
        doubts = (*gaps, *(text for kind, text in incidents.items() if kind not in _NO_CAUSE))
        if doubts:
            return Cause(Ending.TAKEN_OVER, "the cause is unknown", doubts)
        text = "no failsafe was reported, so a pilot or another ground station changed the mode"
        return Cause(Ending.PILOT_TOOK_OVER, text, (text,))

    def _age_s(self, sign: Sign) -> float:
        """Since it was seen last; a simulated vehicle's time may pass a hundred times as fast as the link's."""
        now_s = self._monitor.time_s
        if now_s is None or sign.observed_s is None:
            return self._client.clock.now() - sign.at_s
        return now_s - sign.observed_s

    def _look_for_jump(self) -> None:
        before, here = self._before, self._monitor.latest(m.GlobalPositionInt)
        self._before = here
        if before is None or here is None or not 0.0 < here.time_boot_s - before.time_boot_s < 1.0:
            return
        moved_m = ground_distance_m(before.lat_deg, before.lon_deg, here.lat_deg, here.lon_deg)
        speed_m_s = max(math.hypot(p.velocity_north_m_s, p.velocity_east_m_s) for p in (before, here))
        jump_m = moved_m - 1.5 * speed_m_s * (here.time_boot_s - before.time_boot_s)
        if jump_m > WATCH.jump_m:
            self._note(Ending.GPS_LOST, f"the vehicle's position jumped by {jump_m:.0f} m")

    def _sign(self, cause: Ending, text: str) -> Sign:
        now_s = self._monitor.time_s
        return Sign(cause, text, self._client.clock.now(), now_s, now_s)

    def _note(self, cause: Ending, text: str) -> None:
        self._signs.append(self._sign(cause, text))

    def _last(self, cause: Ending, text: str) -> None:
        """Note a state that lasts: its beginning is kept, and that it is still so."""
        known, found = self._lasting.get(cause), self._sign(cause, text)
        lasts = known is not None and known.text == text and self._age_s(known) <= WATCH.sign_within_s
        self._lasting[cause] = replace(found, time_s=known.time_s) if lasts and known is not None else found


_ACTED_ON = (
    Ending.BATTERY_LOW, Ending.FENCE_BREACHED, Ending.GPS_LOST, Ending.POSITION_LOST, Ending.FALLING,
)  # fmt: skip
"""What autopilots act on by themselves, among what is watched here; gaps of the link are judged by their length."""
_NO_CAUSE = (Ending.BATTERY_LOW, Ending.LATE, Ending.HOLD_LOST, Ending.PHOTOS_MISSING)
"""What no autopilot reacts to by changing its mode."""


def _named(text: str) -> Ending | None:
    words = text.lower()
    return next((cause for cause, known in _WORDS if any(word in words for word in known)), None)
