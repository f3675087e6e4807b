"""What the vehicle has said so far, whoever was waiting for it."""

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import TypeVar

from mission_io import messages as m
from mission_io.client import Client
from mission_io.enums import MissionResult, MissionState
from mission_io.items import MissionType
from mission_io.link import Link, open_link
from mission_io.protocol.exchange import Address, Timing
from uavcover.flight.ground_contact import GroundContact
from uavcover.flight.texts import TextAssembler
from uavcover.flight.vehicle_clock import VehicleClock

MessageT = TypeVar("MessageT", bound=m.Message)


_DOUBT_S = 1.0
"""So long positions whose stamps are doubted count as coming; on the link's clock."""


class Monitor:
    """Listens to everything that arrives, also while a command or a transfer is going on.

    It is given to the client when that is made: ``Client(link, listener=monitor)``, or see :func:`open_vehicle`.

    Attributes:
        on_position: called with each position of the vehicle.
        texts: lines for the pilot that nobody has taken yet.
        other_texts: lines of other components of its system, each with the component's number.
        ground: what tells whether it stands on the ground.
        position_at_s: when the latest position arrived, on the link's clock.
        heard_at_s: when anything of the vehicle arrived last, on the link's clock; infinitely long ago before the first.
        counts: how many messages of each kind arrived.
        reached: the highest mission item that the vehicle said it reached.
        uploads_taken: how often it thanked somebody for a mission, us or another ground station.
    """

    def __init__(self) -> None:
        self.on_position: Callable[[m.GlobalPositionInt], None] | None = None
        self.texts: deque[m.StatusText] = deque(maxlen=1000)
        self.other_texts: deque[tuple[int, m.StatusText]] = deque(maxlen=100)
        self.ground = GroundContact()
        self.position_at_s: float | None = None
        self.heard_at_s = -math.inf
        self.counts: Counter[type[m.Message]] = Counter()
        self.reached = -1
        self.uploads_taken = 0
        self._assembler = TextAssembler()
        self._other_assemblers: dict[int, TextAssembler] = {}
        self._time = VehicleClock()
        self._doubted_since_s: float | None = None
        self._doubted: list[m.Message] = []
        self._vehicle: Address | None = None
        self._latest: dict[type, m.Message] = {}

    def listen_to(self, vehicle: Address) -> None:
        """Look only at this autopilot from here on, and forget what was heard of another one.

        Other components of its system (a companion computer, a gimbal) do not speak for the vehicle, whatever they say.
        """
        if self._vehicle != vehicle:
            self._latest.clear()
            self.ground.forget()
            self._time.begin()
            self._doubted.clear()
        self._vehicle = vehicle

    @property
    def time_s(self) -> float | None:
        """The vehicle's latest time, seconds since it was switched on; None while it is not known."""
        return self._time.time_s

    @property
    def restarted(self) -> bool:
        """Whether the vehicle's time went back: it was switched off and on."""
        return self._time.restarted

    def begin(self) -> None:
        """Begin a flight: what was said of an older one, and the vehicle's time then, count no more."""
        self._time.begin()
        self._doubted.clear()
        self.reached = -1
        self.forget(m.MissionCurrent)

    def latest(self, kind: type[MessageT]) -> MessageT | None:
        """The latest message of a kind."""
        message = self._latest.get(kind)
        return message if isinstance(message, kind) else None

    def forget(self, kind: type[m.Message]) -> None:
        """Wait for a fresh message of a kind: the latest one speaks of something that is over."""
        self._latest.pop(kind, None)

    def silence_s(self, now: float) -> float:
        """How long nothing of the vehicle arrived, at ``now`` on the link's clock."""
        return now - self.heard_at_s

    @property
    def current_seq(self) -> int:
        """The mission item that is being flown to; -1 while it is not known."""
        current = self.latest(m.MissionCurrent)
        return -1 if current is None else current.seq

    @property
    def mission_complete(self) -> bool:
        """Whether the vehicle says that its mission is done."""
        current = self.latest(m.MissionCurrent)
        return current is not None and current.state == MissionState.COMPLETE

    @property
    def on_ground(self) -> bool | None:
        """Whether the vehicle stands on the ground, by its word, height and motion; see :class:`GroundContact`."""
        return self.ground.on_ground(self.time_s)

    def __call__(self, received: m.Received, now: float) -> None:
        """Take a message that arrived at ``now`` on the link's clock."""
        if self._vehicle is None or received.system_id != self._vehicle.system_id:
            return
        if received.component_id != self._vehicle.component_id:
            self._take_other(received)
            return
        message = received.message
        self.heard_at_s = now
        if not isinstance(message, m.GlobalPositionInt | m.Attitude | m.SystemTime):
            self._take(message, now)
        elif self._believes(message.time_boot_s, now):
            # What this message proves came before it, and nothing of it is lost.
            for earlier in [*self._doubted[len(self._doubted) - self._time.proven :], message]:
                self._take(earlier, now)
            self._doubted.clear()
        else:
            self._doubt(message, now)

    def _take(self, message: m.Message, now: float) -> None:
        """Take a message of the vehicle that is believed."""
        if isinstance(message, m.GlobalPositionInt):
            self._doubted_since_s = None
        self.counts[type(message)] += 1
        self._latest[type(message)] = message
        match message:
            case m.GlobalPositionInt():
                self.position_at_s = now
                self.ground.take_position(message)
                if self.on_position is not None:
                    self.on_position(message)
            case m.MissionAck(result=MissionResult.ACCEPTED, mission_type=MissionType.MISSION):
                self.uploads_taken += 1
            case m.ExtendedSysState():
                self.ground.take_word(message.landed_state, self.time_s)
            case m.MissionItemReached():
                self.reached = max(self.reached, message.seq)
            case m.StatusText():
                self.texts.extend(self._assembler.take(message))

    def _believes(self, stamp_s: float, now: float) -> bool:
        """Whether a message's time stamp is believed; what was said before a restart is over."""
        restarted = self._time.restarted
        believed = self._time.take(stamp_s, now)
        if self._time.restarted and not restarted:
            self._latest.clear()
            self.ground.forget()
        return believed

    def _doubt(self, message: m.Message, now: float) -> None:
        """Keep a message until its stamp is proven; a position counts as come meanwhile, for a moment."""
        self._doubted = [*self._doubted, message][-self._time.doubted :] if self._time.doubted else []
        if not isinstance(message, m.GlobalPositionInt):
            return
        if self._doubted_since_s is None:
            self._doubted_since_s = now
        if now - self._doubted_since_s <= _DOUBT_S:
            self.position_at_s = now

    def _take_other(self, received: m.Received) -> None:
        """What another component of the vehicle's system says is shown to the pilot, and decides nothing."""
        said = received.message
        if isinstance(said, m.StatusText):
            assembler = self._other_assemblers.setdefault(received.component_id, TextAssembler())
            self.other_texts.extend((received.component_id, text) for text in assembler.take(said))


def open_vehicle(link: Link | str, *, timing: Timing | None = None) -> tuple[Client, Monitor]:
    """A client on a link or a link's URL, with a monitor that hears everything it hears.

    Raises:
        mission_io.errors.MisuseError: a URL that is not understood.
        mission_io.errors.LinkError: the link cannot be opened.
    """
    monitor = Monitor()
    return Client(open_link(link) if isinstance(link, str) else link, timing=timing, listener=monitor), monitor
