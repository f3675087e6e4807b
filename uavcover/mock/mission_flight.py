"""The lists that the mock vehicle holds, and its mission as it flies it.

The lists that the mock vehicle holds, behind the vehicle's side of the mission protocol, in the right clock.

The mission as the mock vehicle flies it: which item is current, what was reached, what it says of that.
"""

import zlib
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from mission_io.autopilots.autopilot import Autopilot
from mission_io.model.enums import AutopilotId, MissionResult, MissionState
from mission_io.model.items import Frame, GeoPoint, MissionItem, MissionType
from mission_io.protocol.exchange import Address
from mission_io.protocol.server import ListChanged, MissionServer
from mission_io.protocol.tables import ServerState
from mission_io.wire import messages as m
from uavcover.mock.faults import FaultKind
from uavcover.mock.itinerary import mission_steps
from uavcover.vehicle.modes import Mode

if TYPE_CHECKING:
    from uavcover.mock.vehicle import MockVehicle

_STALE_S = 0.1
"""For so long after an upload a stale read-back gives out the list before."""


class MissionStore:
    """Mission, fence and rally points, and the conversations about them.

    Args:
        autopilot: whose way with them.
        local: the vehicle's address.
        seconds_per_s: seconds of the clock that transfers wait in, per second of vehicle time.
        stale_read_back: share of the uploads after which the previous list is given out for 0.1 s.
        rng: decides which.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        *,
        local: Address,
        seconds_per_s: float,
        stale_read_back: float,
        rng: np.random.Generator,
    ) -> None:
        self._autopilot, self._local, self._scale = autopilot, local, seconds_per_s
        self._stale_read_back, self._rng = stale_read_back, rng
        self._server = self._booted(0.0)
        self._held_back: list[tuple[float, MissionType, tuple[MissionItem, ...]]] = []
        self._before: dict[MissionType, tuple[MissionItem, ...]] = {}
        self._numbered: tuple[MissionItem, ...] = ()
        self._mission_id = 0

    def _booted(self, vehicle_s: float) -> MissionServer:
        # Booting takes vehicle time, whatever clock transfers wait in.
        refusal_s = self._autopilot.boot_refusal_s
        booted_at = (vehicle_s + refusal_s) * self._scale - refusal_s
        return MissionServer(self._autopilot, local=self._local, booted_at=booted_at)

    def items(self, mission_type: MissionType) -> tuple[MissionItem, ...]:
        """What the vehicle holds and flies by, as it is on the wire."""
        for _, held_back, items in self._held_back:
            if held_back is mission_type:
                return items
        return self._server.items(mission_type)

    @property
    def mission_id(self) -> int:
        """PX4's number of the mission that it holds, another one for another mission; 0 for none, as ArduPilot tells."""
        items = self.items(MissionType.MISSION)
        if self._autopilot.home_in_item_0 or not items:
            return 0
        if items != self._numbered:
            self._numbered, self._mission_id = items, zlib.crc32(repr(items).encode())
        return self._mission_id

    def replace(self, mission_type: MissionType, items: Iterable[MissionItem]) -> None:
        """Put another list into the vehicle from its own side."""
        self._server.set_items(mission_type, items)

    def set_home(self, home: GeoPoint) -> None:
        """Say where home is, for an autopilot that keeps it in item 0."""
        self._server.home = home

    def reboot(self, vehicle_s: float) -> None:
        """Forget every conversation and keep the lists: they are in permanent memory."""
        kept = {mission_type: self.items(mission_type) for mission_type in MissionType}
        self._held_back.clear()
        self._server = self._booted(vehicle_s)
        for mission_type, items in kept.items():
            self._server.set_items(mission_type, items)

    def receive(self, received: m.Received, vehicle_s: float, *, flying: bool) -> list[m.Message]:
        """Take a message, and return what to answer at once."""
        message = received.message
        ardupilot = self._autopilot.mav_autopilot == AutopilotId.ARDUPILOT
        if flying and ardupilot and isinstance(message, m.MissionClearAll):
            to = (received.system_id, received.component_id)
            return [m.MissionAck(*to, MissionResult.ERROR, message.mission_type)]
        if self._stale_read_back:
            self._before = {mission_type: self._server.items(mission_type) for mission_type in MissionType}
        self._server.receive(received, vehicle_s * self._scale)
        return []

    def messages_to_send(self, vehicle_s: float) -> list[m.Message]:
        """Everything that has to be sent by now."""
        if self._held_back and self._server.state is not ServerState.SENDING:
            for due in [entry for entry in self._held_back if entry[0] <= vehicle_s]:
                self._held_back.remove(due)
                self._server.set_items(due[1], due[2])
        return self._server.messages_to_send(vehicle_s * self._scale)

    def events(self, vehicle_s: float) -> list[ListChanged]:
        """What changed since the last call."""
        events = self._server.events()
        for event in events:
            stale = event.reason == "uploaded" and self._rng.random() < self._stale_read_back
            if self._stale_read_back and stale:
                self._held_back.append((vehicle_s + _STALE_S, event.mission_type, event.items))
                self._server.set_items(event.mission_type, self._before[event.mission_type])
        return events


_REPEAT_S = 1.0
_REPORT_S = 0.1
_CRITICAL = 2


class MissionFlight:
    """Following the mission that the vehicle holds.

    Attributes:
        state: what it does with its mission.
        current_seq: number of the item on the wire that it flies to.
    """

    def __init__(self, vehicle: "MockVehicle") -> None:
        self._vehicle = vehicle
        self.state = MissionState.NOT_STARTED
        self.current_seq = 0
        self._reached: int | None = None
        self._reports_due: list[float] = []

    @property
    def first_seq(self) -> int:
        """Number on the wire of the first item to be flown."""
        return 1 if self._vehicle.autopilot.home_in_item_0 else 0

    @property
    def there_is_one(self) -> bool:
        """Whether there is anything to be flown."""
        return len(self._vehicle.mission_items) > self.first_seq

    @property
    def needs_terrain(self) -> bool:
        """Whether an item names a height above a ground that the vehicle does not know."""
        feed = self._vehicle.terrain
        if feed is None:
            return False
        return any(
            feed.height_amsl_m(item.lat_deg, item.lon_deg) is None
            for item in self._vehicle.mission_items[self.first_seq :]
            if item.frame is Frame.ABOVE_TERRAIN and item.has_position
        )

    def rewind(self) -> None:
        """Before the first item again."""
        self.current_seq, self.state = self.first_seq, MissionState.NOT_STARTED
        self._reached, self._reports_due = None, []

    def pause(self) -> None:
        """Leave the mission where it is."""
        if self.state is MissionState.ACTIVE:
            self.state = MissionState.PAUSED

    def start(self) -> None:
        """Fly the mission from the current item on."""
        vehicle = self._vehicle
        if self.needs_terrain:
            vehicle.say(_CRITICAL, "Failsafe: Terrain data missing")
            vehicle.set_mode(Mode.RETURN)
            return
        self.current_seq = max(self.current_seq, self.first_seq)
        steps = mission_steps(
            vehicle.mission_items,
            self.current_seq,
            place=vehicle.place,
            settings=vehicle.settings,
            speeds=vehicle.speeds,
            home_m=vehicle.body.home_m,
        )
        self.state = MissionState.ACTIVE
        vehicle.follow(steps)
        vehicle.body.itinerary.stuck = vehicle.faults.is_going_on(FaultKind.STUCK)
        vehicle.tell(m.MissionCurrent)

    def go_to(self, seq: int) -> bool:
        """Make another item the current one; False for one that does not exist."""
        if not self.first_seq <= seq < len(self._vehicle.mission_items):
            return False
        self.current_seq = seq
        if self.state is MissionState.COMPLETE:
            self.state = MissionState.PAUSED
        return True

    def changed(self) -> None:
        """Go on with another mission than before."""
        vehicle = self._vehicle
        if vehicle.flying and vehicle.mode is Mode.MISSION:
            if vehicle.is_ardupilot:
                vehicle.say(_CRITICAL, "Auto mission changed, restarted command")
            self.start()
        elif not vehicle.flying or not vehicle.autopilot.home_in_item_0:
            self.current_seq, self.state = 0, MissionState.NOT_STARTED
        self._reached, self._reports_due = None, []
        vehicle.tell(m.MissionCurrent)

    def go_on(self, now: float) -> None:
        """Tell which items were reached, and which one is current."""
        if self._reports_due and now >= self._reports_due[0] and self._reached is not None:
            self._reports_due.pop(0)
            self._vehicle.say_reached(self._reached)
        if self.state is not MissionState.ACTIVE:
            return
        vehicle, itinerary = self._vehicle, self._vehicle.body.itinerary
        while itinerary.completed:
            self._item_reached(itinerary.completed.pop(0), now)
        step = itinerary.step
        if step is None:
            self._complete()
        elif step.seq is not None and step.seq != self.current_seq:
            self.current_seq = step.seq
            vehicle.speeds = step.speeds
            vehicle.tell(m.MissionCurrent)

    def landed(self, now: float) -> None:
        """The ground was reached: the end of a mission whose last item is a landing."""
        step = self._vehicle.body.itinerary.step
        if self.state is MissionState.ACTIVE and step is not None and step.seq is not None:
            self._item_reached(step.seq, now)
            self._complete()

    def _item_reached(self, seq: int, now: float) -> None:
        if self._vehicle.is_ardupilot:
            self._vehicle.say_reached(seq)
            return
        # PX4 looks at intervals and repeats itself: what was passed in between is never told.
        self._reached = seq
        self._reports_due = [now + _REPORT_S, now + _REPORT_S + _REPEAT_S]

    def _complete(self) -> None:
        self.state = MissionState.COMPLETE
        self._vehicle.tell(m.MissionCurrent)
