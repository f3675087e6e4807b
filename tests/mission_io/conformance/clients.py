"""Our client, and what a link in front of it makes of it: clients with one fault each."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from mission_io.client.client import Client
from mission_io.conformance.case import sample
from mission_io.conformance.client_case import ClientCase, Operation, as_float
from mission_io.links.datagrams import Link, WrappingLink
from mission_io.model.items import MissionType
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec

ITEMS = (m.MissionItemInt, m.MissionItemFloat)


def begun(case: ClientCase) -> Callable[[Client], None]:
    """Begins what a case is about, as a user of our client does."""
    mission_type = case.mission_type if case.mission_type is not None else MissionType.MISSION

    def call(client: Client) -> None:
        done: list[int] = []
        match case.operation:
            case Operation.UPLOAD:
                client.upload(mission_type, sample(mission_type, 7, first=30))
            case Operation.EMPTY:
                client.upload(mission_type, ())
            case Operation.CANCEL_UPLOAD:
                items = sample(mission_type, 7, first=30)
                client.upload(mission_type, items, progress=lambda n, _: done.append(n), stop=lambda: done[-1:] >= [3])
            case Operation.DOWNLOAD:
                client.download(mission_type)
            case Operation.CANCEL_DOWNLOAD:
                client.download(mission_type, progress=lambda n, _: done.append(n), stop=lambda: done[-1:] >= [1])
            case Operation.CLEAR:
                client.clear(mission_type)
            case Operation.SET_CURRENT:
                client.set_current(2)

    return call


class FaultyClient(WrappingLink):
    """Changes what the client sends and hears; ``sends`` and ``hears`` give the messages that go on in its place."""

    def __init__(
        self,
        link: Link,
        *,
        sends: Callable[["FaultyClient", Any], Sequence[m.Message]] | None = None,
        hears: Callable[["FaultyClient", Any, int], Sequence[m.Message]] | None = None,
    ) -> None:
        super().__init__(link)
        self._sends, self._hears = sends, hears
        self._in = Codec(system_id=9, component_id=9)
        self._out, self._as_vehicle = Codec(system_id=255, component_id=190), Codec(system_id=1, component_id=1)
        self._outward = Codec(system_id=9, component_id=9)
        self.seen: Counter[Any] = Counter()

    def send(self, data: bytes) -> None:
        if self._sends is None:
            self._link.send(data)
            return
        for received in self._outward.decode(data):
            for message in self._sends(self, received.message):
                self._link.send(self._out.encode(message))

    def receive(self, timeout_s: float) -> bytes | None:
        data = self._link.receive(timeout_s)
        if data is None or self._hears is None:
            return data
        return b"".join(
            self._as_vehicle.encode(message)
            for received in self._in.decode(data)
            for message in self._hears(self, received.message, received.system_id)
        )


Mutant = Callable[[Link], Link]


def sending(rewrite: Callable[[FaultyClient, Any], Any]) -> Mutant:
    """A client that sends ``rewrite(link, message)`` in place of a message; None is nothing."""
    return lambda link: FaultyClient(link, sends=lambda c, it: [x] if (x := rewrite(c, it)) is not None else [])


def sending_also(kinds: Any, extra: Callable[[Any], m.Message]) -> Mutant:
    return lambda link: FaultyClient(link, sends=lambda _, it: [it, extra(it)] if isinstance(it, kinds) else [it])


def _once(client: FaultyClient, message: Any) -> Any:
    """Nothing a second time."""
    if not hasattr(message, "target_system"):
        return message
    sets = isinstance(message, m.MissionSetCurrent) or (isinstance(message, m.CommandLong) and message.command == 224)
    key = "sets the current item" if sets else message
    client.seen[key] += 1
    return message if client.seen[key] == 1 else None


def _goes_away(client: FaultyClient, message: Any) -> Any:
    """Only two messages to the vehicle."""
    client.seen["sent"] += hasattr(message, "target_system")
    return message if client.seen["sent"] <= 2 else None


def _swallows_errors(_: FaultyClient, message: Any, system_id: int) -> Sequence[m.Message]:
    return [] if isinstance(message, m.MissionAck) and message.result else [message]


def _believes_all(_: FaultyClient, message: Any, system_id: int) -> Sequence[m.Message]:
    """Takes everything for its own: other vehicles, other stations, other lists."""
    if not hasattr(message, "mission_type"):
        return [message] if system_id == 1 else []
    return [replace(message, target_system=255, target_component=190, mission_type=0)]


NO_REPEATS = sending(_once)
GOES_AWAY = sending(_goes_away)
IGNORES_ERRORS: Mutant = lambda link: FaultyClient(link, hears=_swallows_errors)  # noqa: E731
BELIEVES_ALL: Mutant = lambda link: FaultyClient(link, hears=_believes_all)  # noqa: E731
FLOATS = sending(lambda _, it: as_float(it))
OTHER_LIST = sending(lambda _, it: replace(it, mission_type=(it.mission_type + 1) % 3) if isinstance(it, ITEMS) else it)
FLOAT_FRAMES = sending(lambda _, it: replace(it, frame=3) if isinstance(it, m.MissionItemInt) else it)
BEYOND = sending_also(ITEMS, lambda it: replace(it, seq=60000))
STRANGE_ITEMS = sending_also(ITEMS, lambda it: replace(it, mission_type=(it.mission_type + 1) % 3))
NO_CANCEL = sending(lambda _, it: None if isinstance(it, m.MissionAck) and it.result == 15 else it)
NO_THANKS = sending(lambda _, it: None if isinstance(it, m.MissionAck) and it.result == 0 else it)
OLD_REQUESTS = sending(
    lambda _, it: (
        m.MissionRequest(it.target_system, it.target_component, it.seq, it.mission_type)
        if isinstance(it, m.MissionRequestInt)
        else it
    )
)
WRONG_ITEM = sending(lambda _, it: replace(it, seq=(it.seq + 1) % 4) if isinstance(it, m.MissionRequestInt) else it)
AHEAD: Mutant = lambda link: link  # noqa: E731 - our client as it is: it sends an item ahead


def chattering(case: ClientCase) -> Callable[[Client], None]:
    """Does what it should, and never stops."""

    def call(client: Client) -> None:
        try:
            begun(case)(client)
        finally:
            until = client.clock.now() + 150.0
            vehicle = client.vehicle
            mission_type = case.mission_type or 0
            while client.clock.now() < until:
                client.send(m.MissionCount(vehicle.system_id, vehicle.component_id, 3, mission_type))
                pause = client.clock.now() + 2.0
                while client.clock.now() < pause:
                    client.poll(pause - client.clock.now())

    return call


MUTANTS: dict[str, Mutant] = {
    **{f"upload-{which}": OTHER_LIST for which in ("mission", "fence", "rally")},
    "upload-int-frames": FLOAT_FRAMES,
    "upload-only-asked": AHEAD,
    "upload-count-lost": NO_REPEATS,
    "upload-items-lost": NO_REPEATS,
    **{
        f"upload-{which}": GOES_AWAY
        for which in ("requests-lost", "slow", "twice", "lossy", "ack-late", "asked-out-of-order", "id", "other-list-ack")
    },
    "upload-old-requests": FLOATS,
    "upload-asked-beyond": BEYOND,
    "upload-other-list-request": STRANGE_ITEMS,
    "upload-other-station-ack": BELIEVES_ALL,
    "upload-other-vehicle-ack": BELIEVES_ALL,
    "upload-other-vehicle-request": BEYOND,
    "upload-cancel": NO_CANCEL,
    "download-cancel": NO_CANCEL,
    **{f"download-{which}": WRONG_ITEM for which in ("mission", "fence", "rally")},
    "download-int-requests": OLD_REQUESTS,
    **{
        f"download-{which}": NO_REPEATS
        for which in (
            "list-lost", "items-lost", "second-item-lost", "out-of-order", "other-list", "other-station", "other-vehicle",
        )
    },
    **{f"download-{which}": GOES_AWAY for which in ("twice", "slow", "lossy", "float-items", "id")},
    "download-empty": NO_THANKS,
    "clear-lost": NO_REPEATS,
    "clear-other-list-ack": NO_REPEATS,
    "current-lost": NO_REPEATS,
    "current-wrong": NO_REPEATS,
}  # fmt: skip
"""For each case whose judge looks at more than an end and a word: a client that must not pass it."""
