"""Whether knowledge of a vehicle is newer than the last gap in its messages.

While nothing is heard, a failsafe, a pilot or another ground station can take the vehicle over. What arrives first after a gap
may have waited in a buffer and be older than the gap. So we request the vehicle's time, with a number of our own (TIMESYNC):
only what arrives after the answer counts. Until mode, armed state, landed state and mission item are heard again, nothing is
known, and nothing may be commanded.

A link can fall behind without a gap: every second something arrives, and all of it is old. So the question is asked once a
second all the time. Where an answer takes longer than the link needs at its best, what arrives with it is as old, and nothing is
known either.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType

from mission_io.wire import messages as m
from uavcover.flight.client import VehicleClient
from uavcover.flight.monitor import Monitor
from uavcover.flight.tuning import EVIDENCE

_KINDS: Mapping[type[m.Message], str] = MappingProxyType(
    {m.ExtendedSysState: "EXTENDED_SYS_STATE", m.MissionCurrent: "MISSION_CURRENT"}
)


class Evidence:
    """Request fresh evidence after each gap, and report its arrival.

    A gap is a silence of the vehicle, or a pause of this process: both show as time between two messages.
    """

    def __init__(self, client: VehicleClient, monitor: Monitor) -> None:
        self._client, self._monitor = client, monitor
        self._gap_ended_s = monitor.gap_ended_at_s
        self._asked_s: dict[int, float] = {}
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
            since_gap = (arrived_s for arrived_s, asked_s in answers if asked_s >= self._gap_ended_s)
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
        self._asked_s[number] = now
        while len(self._asked_s) > EVIDENCE.remembered:
            del self._asked_s[next(iter(self._asked_s))]
        overdue = self._proved_at_s is None or self._behind
        self._ask_at_s = now + (EVIDENCE.ask_again_s if overdue else EVIDENCE.ask_s)
        self._client.send(m.TimeSync(answered_ns=0, asked_ns=number))

    def _take_answers(self) -> list[tuple[float, float]]:
        """The answers to questions of ours since the last look: when each arrived, and when it was requested."""
        answers = []
        while self._monitor.time_answers:
            arrived_s, answer = self._monitor.time_answers.popleft()
            asked_s = self._asked_s.get(answer.asked_ns)
            if asked_s is not None:
                answers.append((arrived_s, asked_s))
                self._latest_s, self._answered_at_s = arrived_s - asked_s, arrived_s
                self._shortest_s = min(self._shortest_s, self._latest_s)
        return answers
