"""Vehicles with one fault each: for every case one that must not pass it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mission_io.conformance.case import sample
from mission_io.conformance.client_case import Said, as_float
from mission_io.conformance.fake_vehicle import BY_THE_GUIDE, FakeVehicle
from mission_io.model.enums import MissionResult
from mission_io.model.items import GeoPoint, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.wire import messages as m

ITEMS = (m.MissionItemInt, m.MissionItemFloat)
REQUESTS = (m.MissionRequest, m.MissionRequestInt)
MISSION = MissionType.MISSION
FOREVER_S = 1e6


class Faulty(FakeVehicle):
    """A vehicle by the guide, except for what is changed.

    ``hears`` gets each message that arrived, and gives those that the vehicle takes in its place; ``says`` likewise what goes
    out. Other arguments change the autopilot.
    """

    def __init__(
        self,
        *,
        hears: Callable[[Any, m.Received], Sequence[m.Received]] | None = None,
        says: Callable[[Any, m.Message], Sequence[m.Message]] | None = None,
        **changes: Any,
    ) -> None:
        self._hears, self._says = hears, says
        self.seen: Counter[Any] = Counter()
        super().__init__([])
        lists = {t: self.server.items(t) for t in MissionType}
        self.server = MissionServer(replace(BY_THE_GUIDE, **changes), local=self.address)
        for mission_type, items in lists.items():
            self.server.set_items(mission_type, items)

    @property
    def incoming(self) -> Any:
        return self.server._incoming

    def _receive(self, received: m.Received, now: float) -> None:
        for taken in [received] if self._hears is None else self._hears(self, received):
            super()._receive(taken, now)

    def _say(self, said: Said, now: float) -> None:
        for message in [said.message] if self._says is None else self._says(self, said.message):
            super()._say(replace(said, message=message), now)


def hearing(**changes: Any) -> Callable[[Callable[[Any, Any], Any]], Callable[[], Faulty]]:
    """A vehicle that hears ``rewrite(vehicle, message)`` in place of a message; None is nothing."""

    def made(rewrite: Callable[[Any, Any], Any]) -> Callable[[], Faulty]:
        def hears(vehicle: Any, received: m.Received) -> Sequence[m.Received]:
            changed = rewrite(vehicle, received.message)
            return [] if changed is None else [replace(received, message=changed)]

        return lambda: Faulty(hears=hears, **changes)

    return made


def saying(rewrite: Callable[[Any, Any], Any]) -> Callable[[], Faulty]:
    """A vehicle that says ``rewrite(vehicle, message)``; None is nothing."""
    return lambda: Faulty(says=lambda v, it: [c] if (c := rewrite(v, it)) is not None else [])


def changed(**changes: Any) -> Callable[[], Faulty]:
    return lambda: Faulty(**changes)


def hears(kinds: Any, rewrite: Callable[[Any, Any], Any], **changes: Any) -> Callable[[], Faulty]:
    return hearing(**changes)(lambda v, it: rewrite(v, it) if isinstance(it, kinds) else it)


def says(kinds: Any, rewrite: Callable[[Any, Any], Any]) -> Callable[[], Faulty]:
    return saying(lambda v, it: rewrite(v, it) if isinstance(it, kinds) else it)


def emptying(kinds: Any, when: Callable[[Any, Any], bool]) -> Callable[[], Faulty]:
    """A vehicle that drops its mission when it hears something."""

    def rewrite(vehicle: Any, message: Any) -> Any:
        if when(vehicle, message):
            vehicle.server.set_items(MISSION, ())
        return message

    return hears(kinds, rewrite)


def _as_next(v: Any, it: Any) -> Any:
    return it if v.incoming is None else replace(it, seq=len(v.incoming.items))


def _first_only(v: Any, it: Any) -> Any:
    """Hears only the first COUNT."""
    v.seen["count"] += 1
    return it if v.seen["count"] == 1 else None


def _cancelled_by(v: Any, it: Any) -> Any:
    return m.MissionAck(it.target_system, it.target_component, MissionResult.ERROR, it.mission_type)


def _after_ack(change: Callable[[Any], None]) -> Callable[[], Faulty]:
    """Changes its lists when it accepts an upload."""

    def rewrite(vehicle: Any, message: Any) -> Any:
        if message.result == MissionResult.ACCEPTED and message.mission_type == MISSION:
            change(vehicle)
        return message

    return says(m.MissionAck, rewrite)


def _keeps_the_tail(v: Any) -> None:
    v.server.set_items(MISSION, (*v.server.items(MISSION)[:3], *sample(MISSION, 7)[3:]))


def _only_acked(v: Any, it: Any) -> Any:
    """Acknowledged, and nothing else."""
    v._say(Said(m.MissionAck(255, 190, MissionResult.ACCEPTED, it.mission_type)), v.now)


class Timed(Faulty):
    """Knows the time when it hears something."""

    now = 0.0

    def receive_datagram(self, data: bytes, now: float) -> None:
        self.now = now
        super().receive_datagram(data, now)


def acks_only(kinds: Any, when: Callable[[Any], bool]) -> Callable[[], Faulty]:
    """Acknowledges something without doing it."""

    def hears_it(vehicle: Any, received: m.Received) -> Sequence[m.Received]:
        if isinstance(received.message, kinds) and when(received.message):
            _only_acked(vehicle, received.message)
            return []
        return [received]

    return lambda: Timed(hears=hears_it)


def _senders(rewrite: Callable[[Any, m.Received], Sequence[m.Received]], **changes: Any) -> Callable[[], Faulty]:
    return lambda: Faulty(hears=rewrite, **changes)


def _anybody_uploads(v: Any, r: m.Received) -> Sequence[m.Received]:
    if isinstance(r.message, m.MissionCount) and r.system_id != 255:
        stop = m.MissionAck(1, 1, MissionResult.ERROR, MISSION)
        return [m.Received(stop, 255, 190), r]
    return [r]


def _anybodys_items(v: Any, r: m.Received) -> Sequence[m.Received]:
    return [replace(r, system_id=255)] if isinstance(r.message, ITEMS) else [r]


def _deaf_after_other_list(v: Any, r: m.Received) -> Sequence[m.Received]:
    if isinstance(r.message, m.MissionRequestList) and r.system_id != 255:
        v.seen["other"] += 1
    return [] if v.seen["other"] and isinstance(r.message, REQUESTS) and r.system_id == 255 else [r]


def _list_until_ack(v: Any, it: Any) -> Any:
    if isinstance(it, m.MissionAck):
        v.seen.clear()
        return it
    v.seen["list"] += 1
    return it if v.seen["list"] == 1 else None


def _other_at_second_time(v: Any, it: Any) -> Any:
    v.seen[it.mission_type, it.seq] += 1
    return replace(it, z=it.z + 1.0) if v.seen[it.mission_type, it.seq] % 2 == 0 else it


class Impatient(Timed):
    """Serves no item that is asked for more than a second after the one before."""

    def _receive(self, received: m.Received, now: float) -> None:
        if isinstance(received.message, m.MissionRequestList):
            self.seen["last"] = 0
        if isinstance(received.message, REQUESTS):
            last, self.seen["last"] = self.seen["last"], now  # type: ignore[assignment]
            if last and now - last > 1.0:
                self.seen["last"] = last
                return
        super()._receive(received, now)


def _with_home() -> Faulty:
    vehicle = Faulty(home_in_item_0=True)
    vehicle.server.home = GeoPoint(46.0, 7.0, 400.0)
    return vehicle


def _each(name: str, mutant: Callable[[], Faulty]) -> dict[str, Callable[[], Faulty]]:
    return {f"{name}-{which}": mutant for which in ("mission", "fence", "rally")}


NOT_ATOMIC: Any = {"atomic": frozenset()}
NEVER_STOPPED: Any = {"stopped_by": frozenset({MissionResult.OPERATION_CANCELLED})}

MUTANTS: dict[str, Callable[[], Faulty]] = {
    **_each("upload-in-order", says(REQUESTS, lambda v, it: replace(it, seq=it.seq + 1))),
    **_each("upload-silence", changed(**NOT_ATOMIC)),
    "upload-shorter": _after_ack(_keeps_the_tail),
    "upload-100": _after_ack(lambda v: v.server.set_items(MISSION, v.server.items(MISSION)[:50])),
    "upload-first-item": _with_home,
    "upload-int-requests": changed(legacy_requests=True),
    "upload-item-lost": changed(rerequest_s=FOREVER_S, give_up_s=FOREVER_S),
    "upload-second-item-lost": changed(rerequest_s=FOREVER_S, give_up_s=FOREVER_S),
    "upload-after-silence": hears(m.MissionCount, _first_only),
    "upload-items-twice": hears(ITEMS, _as_next),
    "upload-out-of-order": changed(wrong_sequence_result=MissionResult.INVALID_SEQUENCE),
    "upload-beyond-count": hears(ITEMS, _as_next),
    "upload-count-twice": acks_only(m.MissionCount, lambda it: True),
    "upload-count-late": hears(m.MissionCount, lambda v, it: it if v.incoming is None else _cancelled_by(v, it)),
    "upload-last-item-again": emptying(ITEMS, lambda v, it: v.incoming is None),
    "upload-slow": changed(give_up_s=1.0),
    "upload-float-items": hears(m.MissionItemFloat, lambda v, it: replace(it, x=it.x * 1.1)),
    **_each("upload-cancelled", changed(**NOT_ATOMIC)),
    **{f"upload-stopped-by-{name}": changed(**NEVER_STOPPED) for name in ("ERROR", "UNSUPPORTED", "INVALID", "DENIED")},
    "upload-bad-item": changed(**NOT_ATOMIC),
    "upload-too-many": emptying(m.MissionCount, lambda v, it: it.count > 1000),
    **_each("upload-empty", acks_only(m.MissionCount, lambda it: it.count == 0)),
    "upload-second-station": _senders(_anybody_uploads),
    "upload-foreign-items": _senders(_anybodys_items),
    "upload-other-list": hears(ITEMS, lambda v, it: replace(it, mission_type=0)),
    "upload-other-target": hears(m.MissionCount, lambda v, it: replace(it, target_system=1)),
    "upload-strange-type": hears(m.MissionCount, lambda v, it: replace(it, mission_type=it.mission_type % 7)),
    "upload-nonsense": emptying(ITEMS, lambda v, it: v.incoming is None),
    "upload-lists-apart": _after_ack(lambda v: v.server.set_items(MissionType.FENCE, ())),
    **_each("download-in-order", says(m.MissionCount, lambda v, it: replace(it, count=max(0, it.count - 1)))),
    **_each("download-empty", says(m.MissionCount, lambda v, it: replace(it, count=it.count or 2))),
    "download-int-items": says(m.MissionItemInt, lambda v, it: as_float(it)),
    "download-int-frames": changed(returns_int_frames=False),
    "download-list-twice": hears((m.MissionRequestList, m.MissionAck), _list_until_ack),
    "download-item-twice": says(m.MissionItemInt, _other_at_second_time),
    "download-beyond-count": hears(m.MissionRequestInt, lambda v, it: replace(it, seq=it.seq % 4)),
    "download-skipping": hears(m.MissionRequestInt, lambda v, it: replace(it, seq=0) if it.seq == 2 else it),
    "download-abandoned": changed(download_blocks_s=FOREVER_S),
    "download-cancelled": hears(
        m.MissionAck,
        lambda v, it: None if it.result == MissionResult.OPERATION_CANCELLED else it,
        download_blocks_s=30.0,
    ),
    "download-slow": Impatient,
    "download-second-station": _senders(_deaf_after_other_list),
    "download-other-target": hears(m.MissionRequestList, lambda v, it: replace(it, target_system=1)),
    "download-strange-type": hears(m.MissionRequestList, lambda v, it: replace(it, mission_type=it.mission_type % 7)),
    **_each("clear", acks_only(m.MissionClearAll, lambda it: True)),
    "clear-alone": hears(m.MissionClearAll, lambda v, it: replace(it, mission_type=255)),
    "clear-all": hears(m.MissionClearAll, lambda v, it: replace(it, mission_type=0)),
    "current-set": hears(m.MissionSetCurrent, lambda v, it: None),
    "current-beyond": says(m.StatusText, lambda v, it: None),
    "current-streamed": says(m.MissionCurrent, lambda v, it: None),
    "ids-agree": says(m.MissionCount, lambda v, it: replace(it, opaque_id=it.opaque_id + 1)),
    "ids-differ": says(m.MissionAck, lambda v, it: replace(it, opaque_id=7)),
    "capabilities": says(m.AutopilotVersion, lambda v, it: replace(it, capabilities=0)),
}


class _RefusesEmptyClear(Faulty):
    """Answers ERROR when a list is emptied that is empty."""

    def _say(self, said: Said, now: float) -> None:
        message = said.message
        if isinstance(message, m.MissionAck) and self.seen["empty"]:
            said = replace(said, message=replace(message, result=MissionResult.ERROR))
        super()._say(said, now)

    def _receive(self, received: m.Received, now: float) -> None:
        if isinstance(received.message, m.MissionClearAll):
            self.seen["empty"] = int(not self.server.items(MISSION))
        super()._receive(received, now)


class _OldRequestsAsFloat(Faulty):
    """Answers MISSION_REQUEST with MISSION_ITEM."""

    def _receive(self, received: m.Received, now: float) -> None:
        self.seen["old"] = int(isinstance(received.message, m.MissionRequest))
        super()._receive(received, now)

    def _say(self, said: Said, now: float) -> None:
        super()._say(replace(said, message=as_float(said.message)) if self.seen["old"] else said, now)


MUTANTS["clear-twice"] = _RefusesEmptyClear
MUTANTS["download-old-request"] = _OldRequestsAsFloat
