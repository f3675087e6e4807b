"""Whether what is known of a vehicle is newer than the last gap in what is heard of it.

While nothing is heard, a failsafe, a pilot or another ground station can take the vehicle over. What arrives first after a gap
may have waited in a buffer and be older than the gap. So the vehicle is asked for its time, with a number of our own (TIMESYNC):
only what arrives after the answer counts. Until mode, armed state, landed state and mission item are heard again, nothing is
known, and nothing may be commanded.
"""

from collections.abc import Mapping
from types import MappingProxyType

from mission_io.wire import messages as m
from uavcover.vehicle.client import VehicleClient
from uavcover.vehicle.monitor import Monitor

_OLD_BEAT_S = 3.5
"""A mode that was reported longer ago is not known: heartbeats come once a second, and three may be lost."""
_ASK_S = 0.25
_UNANSWERED_S = 10.0
"""A vehicle that never answers the question for its time is believed after this time without another gap."""
_KINDS: Mapping[type[m.Message], str] = MappingProxyType(
    {m.ExtendedSysState: "EXTENDED_SYS_STATE", m.MissionCurrent: "MISSION_CURRENT"}
)
_AGREEING_BEATS = 2


class Evidence:
    """Asks for fresh evidence after each gap, and says whether it is there.

    A gap is a silence of the vehicle, or a pause of this process: both show as time between two messages.

    Args:
        client: talks to the vehicle.
        monitor: hears what the client hears.
    """

    def __init__(self, client: VehicleClient, monitor: Monitor) -> None:
        self._client, self._monitor = client, monitor
        self._gap_ended_s = monitor.gap_ended_at_s
        self._asked: set[int] = set()
        self._ask_at_s = self._gap_ended_s
        self._proved_at_s: float | None = self._gap_ended_s
        self._complete = True
        self._unknown_since_s: float | None = None

    @property
    def current(self) -> bool:
        """Whether mode, armed state, landed state and mission item are known since the last gap."""
        now, monitor = self._client.clock.now(), self._monitor
        silent = monitor.has_gap(now) or self._client.heartbeat_age_s > _OLD_BEAT_S
        return not silent and self._gap_ended_s == monitor.gap_ended_at_s and self._complete

    @property
    def unknown_s(self) -> float:
        """For how long the vehicle has been heard, and what it does has not been known; 0 while nothing is heard."""
        return 0.0 if self._unknown_since_s is None else self._client.clock.now() - self._unknown_since_s

    @property
    def missing(self) -> str:
        """What has to be heard before the vehicle's state is known."""
        if self._client.heartbeat_age_s > _OLD_BEAT_S:
            return "a heartbeat"
        if self._proved_at_s is None:
            return "an answer to our question for its time"
        proved_at_s = self._proved_at_s
        lacking = [name for kind, name in _KINDS.items() if self._monitor.arrived_at_s(kind) < proved_at_s]
        return " and ".join(lacking) or "two heartbeats that agree"

    def look(self) -> None:
        """Ask for fresh evidence where it is needed, and take what has come; called whenever messages were received."""
        self._look()
        now = self._client.clock.now()
        if self.current or self._monitor.has_gap(now):
            self._unknown_since_s = None
        elif self._unknown_since_s is None:
            self._unknown_since_s = now

    def _look(self) -> None:
        now, monitor = self._client.clock.now(), self._monitor
        if monitor.gap_ended_at_s > self._gap_ended_s:
            self._gap_ended_s = self._ask_at_s = monitor.gap_ended_at_s
            self._proved_at_s, self._complete = None, False
            self._asked.clear()
        if self._complete or monitor.has_gap(now):
            return
        if self._proved_at_s is None:
            self._proved_at_s = self._proof(now)
        if self._proved_at_s is None:
            if now >= self._ask_at_s:
                self._ask_at_s = now + _ASK_S
                number = round(now * 1e9) or 1
                self._asked.add(number)
                self._client.send(m.TimeSync(answered_ns=0, asked_ns=number))
            return
        beats = [beat for arrived_s, beat in monitor.beats if arrived_s >= self._proved_at_s]
        agree = len(beats) >= _AGREEING_BEATS and len({(b.armed, b.custom_mode) for b in beats[-_AGREEING_BEATS:]}) == 1
        self._complete = agree and all(monitor.arrived_at_s(kind) >= self._proved_at_s for kind in _KINDS)

    def _proof(self, now: float) -> float | None:
        """When the first answer to a question since the gap arrived; now, after a while, where the vehicle answers none."""
        for arrived_s, answer in self._monitor.time_answers:
            if answer.asked_ns in self._asked:
                return arrived_s
        return now if now - self._gap_ended_s > _UNANSWERED_S else None
