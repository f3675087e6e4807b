"""Vehicles with one fault each: for every case one that must not pass it."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mission_io.conformance.fake_vehicle import BY_THE_GUIDE, FakeVehicle
from mission_io.conformance.samples import sample
from mission_io.conformance.tricks import Said, as_float
from mission_io.model.enums import MissionResult
from mission_io.model.items import GeoPoint, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.wire.messages import (
    AutopilotVersion,
    Message,
    MissionAck,
    MissionClearAll,
    MissionCount,
    MissionCurrent,
    MissionItemFloat,
    MissionItemInt,
    MissionRequest,
    MissionRequestInt,
    MissionRequestList,
    MissionSetCurrent,
    Received,
    StatusText,
)

ITEMS = (MissionItemInt, MissionItemFloat)
REQUESTS = (MissionRequest, MissionRequestInt)
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
        hears: Callable[[Any, Received], Sequence[Received]] | None = None,
        says: Callable[[Any, Message], Sequence[Message]] | None = None,
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

    def _receive(self, received: Received, now: float) -> None:
        for taken in [received] if self._hears is None else self._hears(self, received):
            super()._receive(taken, now)

    def _say(self, said: Said, now: float) -> None:
        for message in [said.message] if self._says is None else self._says(self, said.message):
            super()._say(replace(said, message=message), now)


def hearing(**changes: Any) -> Callable[[Callable[[Any, Any], Any]], Callable[[], Faulty]]:
    """A vehicle that hears ``rewrite(vehicle, message)`` in place of a message; None is nothing."""

    def made(rewrite: Callable[[Any, Any], Any]) -> Callable[[], Faulty]:
        def hears(vehicle: Any, received: Received) -> Sequence[Received]:
            changed = rewrite(vehicle, received.message)
            return [] if changed is None else [replace(received, message=changed)]

        return lambda: Faulty(hears=hears, **changes)

    return made


def saying(rewrite: Callable[[Any, Any], Any]) -> Callable[[], Faulty]:
    """A vehicle that says ``rewrite(vehicle, message)``; None is nothing."""
    return lambda: Faulty(says=lambda v, m: [c] if (c := rewrite(v, m)) is not None else [])


def changed(**changes: Any) -> Callable[[], Faulty]:
    return lambda: Faulty(**changes)


def hears(kinds: Any, rewrite: Callable[[Any, Any], Any], **changes: Any) -> Callable[[], Faulty]:
    return hearing(**changes)(lambda v, m: rewrite(v, m) if isinstance(m, kinds) else m)


def says(kinds: Any, rewrite: Callable[[Any, Any], Any]) -> Callable[[], Faulty]:
    return saying(lambda v, m: rewrite(v, m) if isinstance(m, kinds) else m)


def emptying(kinds: Any, when: Callable[[Any, Any], bool]) -> Callable[[], Faulty]:
    """A vehicle that drops its mission when it hears something."""

    def rewrite(vehicle: Any, message: Any) -> Any:
        if when(vehicle, message):
            vehicle.server.set_items(MISSION, ())
        return message

    return hears(kinds, rewrite)


def _as_next(v: Any, m: Any) -> Any:
    return m if v.incoming is None else replace(m, seq=len(v.incoming.items))


def _first_only(v: Any, m: Any) -> Any:
    """Hears only the first COUNT."""
    v.seen["count"] += 1
    return m if v.seen["count"] == 1 else None


def _cancelled_by(v: Any, m: Any) -> Any:
    return MissionAck(m.target_system, m.target_component, MissionResult.ERROR, m.mission_type)


def _after_ack(change: Callable[[Any], None]) -> Callable[[], Faulty]:
    """Changes its lists when it accepts an upload."""

    def rewrite(vehicle: Any, message: Any) -> Any:
        if message.result == MissionResult.ACCEPTED and message.mission_type == MISSION:
            change(vehicle)
        return message

    return says(MissionAck, rewrite)


def _keeps_the_tail(v: Any) -> None:
    v.server.set_items(MISSION, (*v.server.items(MISSION)[:3], *sample(MISSION, 7)[3:]))


def _only_acked(v: Any, m: Any) -> Any:
    """Acknowledged, and nothing else."""
    v._say(Said(MissionAck(255, 190, MissionResult.ACCEPTED, m.mission_type)), v.now)


class Timed(Faulty):
    """Knows the time when it hears something."""

    now = 0.0

    def receive_datagram(self, data: bytes, now: float) -> None:
        self.now = now
        super().receive_datagram(data, now)


def acks_only(kinds: Any, when: Callable[[Any], bool]) -> Callable[[], Faulty]:
    """Acknowledges something without doing it."""

    def hears_it(vehicle: Any, received: Received) -> Sequence[Received]:
        if isinstance(received.message, kinds) and when(received.message):
            _only_acked(vehicle, received.message)
            return []
        return [received]

    return lambda: Timed(hears=hears_it)


def _senders(rewrite: Callable[[Any, Received], Sequence[Received]], **changes: Any) -> Callable[[], Faulty]:
    return lambda: Faulty(hears=rewrite, **changes)


def _anybody_uploads(v: Any, r: Received) -> Sequence[Received]:
    if isinstance(r.message, MissionCount) and r.system_id != 255:
        stop = MissionAck(1, 1, MissionResult.ERROR, MISSION)
        return [Received(stop, 255, 190), r]
    return [r]


def _anybodys_items(v: Any, r: Received) -> Sequence[Received]:
    return [replace(r, system_id=255)] if isinstance(r.message, ITEMS) else [r]


def _deaf_after_other_list(v: Any, r: Received) -> Sequence[Received]:
    if isinstance(r.message, MissionRequestList) and r.system_id != 255:
        v.seen["other"] += 1
    return [] if v.seen["other"] and isinstance(r.message, REQUESTS) and r.system_id == 255 else [r]


def _list_until_ack(v: Any, m: Any) -> Any:
    if isinstance(m, MissionAck):
        v.seen.clear()
        return m
    v.seen["list"] += 1
    return m if v.seen["list"] == 1 else None


def _other_at_second_time(v: Any, m: Any) -> Any:
    v.seen[m.mission_type, m.seq] += 1
    return replace(m, z=m.z + 1.0) if v.seen[m.mission_type, m.seq] % 2 == 0 else m


class Impatient(Timed):
    """Serves no item that is asked for more than a second after the one before."""

    def _receive(self, received: Received, now: float) -> None:
        if isinstance(received.message, MissionRequestList):
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
    **_each("upload-in-order", says(REQUESTS, lambda v, m: replace(m, seq=m.seq + 1))),
    **_each("upload-silence", changed(**NOT_ATOMIC)),
    "upload-shorter": _after_ack(_keeps_the_tail),
    "upload-100": _after_ack(lambda v: v.server.set_items(MISSION, v.server.items(MISSION)[:50])),
    "upload-first-item": _with_home,
    "upload-int-requests": changed(legacy_requests=True),
    "upload-item-lost": changed(rerequest_s=FOREVER_S, give_up_s=FOREVER_S),
    "upload-second-item-lost": changed(rerequest_s=FOREVER_S, give_up_s=FOREVER_S),
    "upload-after-silence": hears(MissionCount, _first_only),
    "upload-items-twice": hears(ITEMS, _as_next),
    "upload-out-of-order": changed(wrong_sequence_result=MissionResult.INVALID_SEQUENCE),
    "upload-beyond-count": hears(ITEMS, _as_next),
    "upload-count-twice": acks_only(MissionCount, lambda m: True),
    "upload-count-late": hears(MissionCount, lambda v, m: m if v.incoming is None else _cancelled_by(v, m)),
    "upload-last-item-again": emptying(ITEMS, lambda v, m: v.incoming is None),
    "upload-slow": changed(give_up_s=1.0),
    "upload-float-items": hears(MissionItemFloat, lambda v, m: replace(m, x=m.x * 1.1)),
    **_each("upload-cancelled", changed(**NOT_ATOMIC)),
    **{f"upload-stopped-by-{name}": changed(**NEVER_STOPPED) for name in ("ERROR", "UNSUPPORTED", "INVALID", "DENIED")},
    "upload-bad-item": changed(**NOT_ATOMIC),
    "upload-too-many": emptying(MissionCount, lambda v, m: m.count > 1000),
    **_each("upload-empty", acks_only(MissionCount, lambda m: m.count == 0)),
    "upload-second-station": _senders(_anybody_uploads),
    "upload-foreign-items": _senders(_anybodys_items),
    "upload-other-list": hears(ITEMS, lambda v, m: replace(m, mission_type=0)),
    "upload-other-target": hears(MissionCount, lambda v, m: replace(m, target_system=1)),
    "upload-strange-type": hears(MissionCount, lambda v, m: replace(m, mission_type=m.mission_type % 7)),
    "upload-nonsense": emptying(ITEMS, lambda v, m: v.incoming is None),
    "upload-lists-apart": _after_ack(lambda v: v.server.set_items(MissionType.FENCE, ())),
    **_each("download-in-order", says(MissionCount, lambda v, m: replace(m, count=max(0, m.count - 1)))),
    **_each("download-empty", says(MissionCount, lambda v, m: replace(m, count=m.count or 2))),
    "download-int-items": says(MissionItemInt, lambda v, m: as_float(m)),
    "download-int-frames": changed(returns_int_frames=False),
    "download-list-twice": hears((MissionRequestList, MissionAck), _list_until_ack),
    "download-item-twice": says(MissionItemInt, _other_at_second_time),
    "download-beyond-count": hears(MissionRequestInt, lambda v, m: replace(m, seq=m.seq % 4)),
    "download-skipping": hears(MissionRequestInt, lambda v, m: replace(m, seq=0) if m.seq == 2 else m),
    "download-abandoned": changed(download_blocks_s=FOREVER_S),
    "download-cancelled": hears(
        MissionAck, lambda v, m: None if m.result == MissionResult.OPERATION_CANCELLED else m, download_blocks_s=30.0
    ),
    "download-slow": Impatient,
    "download-second-station": _senders(_deaf_after_other_list),
    "download-other-target": hears(MissionRequestList, lambda v, m: replace(m, target_system=1)),
    "download-strange-type": hears(MissionRequestList, lambda v, m: replace(m, mission_type=m.mission_type % 7)),
    **_each("clear", acks_only(MissionClearAll, lambda m: True)),
    "clear-alone": hears(MissionClearAll, lambda v, m: replace(m, mission_type=255)),
    "clear-all": hears(MissionClearAll, lambda v, m: replace(m, mission_type=0)),
    "current-set": hears(MissionSetCurrent, lambda v, m: None),
    "current-beyond": says(StatusText, lambda v, m: None),
    "current-streamed": says(MissionCurrent, lambda v, m: None),
    "ids-agree": says(MissionCount, lambda v, m: replace(m, opaque_id=m.opaque_id + 1)),
    "ids-differ": says(MissionAck, lambda v, m: replace(m, opaque_id=7)),
    "capabilities": says(AutopilotVersion, lambda v, m: replace(m, capabilities=0)),
}


class _RefusesEmptyClear(Faulty):
    """Answers ERROR when a list is emptied that is empty."""

    def _say(self, said: Said, now: float) -> None:
        message = said.message
        if isinstance(message, MissionAck) and self.seen["empty"]:
            said = replace(said, message=replace(message, result=MissionResult.ERROR))
        super()._say(said, now)

    def _receive(self, received: Received, now: float) -> None:
        if isinstance(received.message, MissionClearAll):
            self.seen["empty"] = int(not self.server.items(MISSION))
        super()._receive(received, now)


class _OldRequestsAsFloat(Faulty):
    """Answers MISSION_REQUEST with MISSION_ITEM."""

    def _receive(self, received: Received, now: float) -> None:
        self.seen["old"] = int(isinstance(received.message, MissionRequest))
        super()._receive(received, now)

    def _say(self, said: Said, now: float) -> None:
        super()._say(replace(said, message=as_float(said.message)) if self.seen["old"] else said, now)


MUTANTS["clear-twice"] = _RefusesEmptyClear
MUTANTS["download-old-request"] = _OldRequestsAsFloat
