"""The mission as the mock vehicle flies it: which item is current, what was reached, what it says of that."""

from typing import TYPE_CHECKING

from mission_io import messages as m
from mission_io.enums import MissionState
from mission_io.items import Frame
from uavcover.flight.mock.faults import FaultKind
from uavcover.flight.mock.itinerary import mission_steps
from uavcover.flight.modes import Mode

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle

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
