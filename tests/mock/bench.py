"""A mock vehicle on a bench: its time, what it is told, and what it says."""

from collections.abc import Iterable

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot, Mode
from mission_io.model.enums import CommandResult, MissionResult
from mission_io.model.items import Command, Frame, MissionItem, MissionType, takeoff, waypoint
from mission_io.wire import messages as m
from mission_io.wire.messages import item_from_message, message_from_item
from tests.flight.scene import HOME, above_home, mock_vehicle
from uavcover.flight.orders import custom_mode


class Bench:
    """A vehicle, its time, and what it has said."""

    def __init__(self, autopilot: Autopilot = ARDUPILOT, **options) -> None:
        self.vehicle = mock_vehicle(autopilot, **options)
        self.now = 0.0
        self.said: list[m.Message] = []

    def run(self, seconds: float) -> None:
        self.now += seconds
        self.vehicle.advance(self.now)
        self.said.extend(self.vehicle.outgoing())

    def send(self, message: m.Message, component_id: int = 190) -> list[m.Message]:
        self.vehicle.receive(m.Received(message, 255, component_id), self.now)
        answer = self.vehicle.outgoing()
        self.said.extend(answer)
        return answer

    def command(self, command: int, *params: float) -> CommandResult:
        padded = (*params, *(0.0,) * (7 - len(params)))
        answers = [a for a in self.send(m.CommandLong(1, 1, command, padded)) if isinstance(a, m.CommandAck)]
        assert len(answers) == 1
        assert (answers[0].command, answers[0].target_system, answers[0].target_component) == (command, 255, 190)
        return CommandResult(answers[0].result)

    def set_mode(self, mode: Mode) -> CommandResult:
        number = custom_mode(self.vehicle.autopilot, mode)
        if self.vehicle.autopilot is PX4:
            return self.command(Command.DO_SET_MODE, 1.0, number >> 16 & 0xFF, number >> 24)
        return self.command(Command.DO_SET_MODE, 1.0, number)

    def load(self, *items: MissionItem) -> None:
        """Put a mission into the vehicle by the protocol."""
        autopilot = self.vehicle.autopilot
        wired = list(items)
        if autopilot.home_in_item_0:
            wired.insert(0, MissionItem(Command.NAV_WAYPOINT, Frame.AMSL))
        answers = self.send(m.MissionCount(1, 1, len(wired)))
        while answers and isinstance(answers[-1], m.MissionRequest | m.MissionRequestInt):
            seq = answers[-1].seq
            answers = [
                a
                for a in self.send(
                    message_from_item(
                        wired[seq], seq, mission_type=MissionType.MISSION, target_system=1, target_component=1
                    )
                )
                if not isinstance(a, m.MissionCurrent)
            ]
        assert isinstance(answers[-1], m.MissionAck)
        assert answers[-1].result == MissionResult.ACCEPTED

    def count(self, count: int, mission_type: MissionType = MissionType.MISSION) -> m.Message:
        """Announce an upload; what is answered to it."""
        return self._answer(m.MissionCount(1, 1, count, mission_type))

    def send_item(self, seq: int, item: MissionItem, mission_type: MissionType = MissionType.MISSION) -> m.Message:
        return self._answer(
            message_from_item(item, seq, mission_type=mission_type, target_system=1, target_component=1)
        )

    def send_raw_item(self, seq: int, *, frame: int = 3, command: int = 16, autocontinue: int = 1) -> m.Message:
        item = m.MissionItemInt(
            1, 1, seq, frame, command, (0.0,) * 4, 365000000, -842000000, 30.0, autocontinue=autocontinue
        )
        return self._answer(item)

    def raw_item(self, seq: int) -> m.MissionItemInt:
        """An item as it comes back, in messages."""
        self.send(m.MissionRequestList(1, 1))
        for n in range(seq + 1):
            item = self._answer(m.MissionRequestInt(1, 1, n))
        assert isinstance(item, m.MissionItemInt)
        return item

    def upload(self, items: Iterable[MissionItem], mission_type: MissionType = MissionType.MISSION) -> None:
        """Put a list into the vehicle as it is."""
        items = list(items)
        answer = self.count(len(items), mission_type)
        for seq, item in enumerate(items):
            assert isinstance(answer, m.MissionRequest | m.MissionRequestInt)
            answer = self.send_item(seq, item, mission_type)
        assert isinstance(answer, m.MissionAck)
        assert answer.result == MissionResult.ACCEPTED

    def download(self, mission_type: MissionType = MissionType.MISSION) -> list[MissionItem]:
        """What the vehicle gives out."""
        count = self._answer(m.MissionRequestList(1, 1, mission_type))
        assert isinstance(count, m.MissionCount)
        return [
            item_from_message(self._answer(m.MissionRequestInt(1, 1, seq, mission_type))) for seq in range(count.count)
        ]

    def acknowledge(self) -> None:
        """End a download."""
        self.send(m.MissionAck(1, 1, MissionResult.ACCEPTED))

    def _answer(self, message: m.Message) -> m.Message:
        """The one answer of the mission protocol to a message."""
        [answer] = [
            a
            for a in self.send(message)
            if type(a).__name__.startswith("Mission") and a is not None and not isinstance(a, m.MissionCurrent)
        ]
        return answer

    def take_off(self, *items: MissionItem) -> None:
        """Arm and fly the mission up to a height of 20 m; with items, one of a take-off and these."""
        if items:
            self.load(*up_there(*items))
        first = self.vehicle.autopilot is ARDUPILOT
        assert self.set_mode(Mode.GUIDED if first else Mode.MISSION) is CommandResult.ACCEPTED
        assert self.command(Command.COMPONENT_ARM_DISARM, 1.0) is CommandResult.ACCEPTED
        if first:
            assert self.set_mode(Mode.MISSION) is CommandResult.ACCEPTED
            assert self.command(Command.MISSION_START) is CommandResult.ACCEPTED
        deadline = self.now + 60.0
        while self.up_m < 18.0:
            self.run(0.5)
            assert self.now < deadline

    @property
    def up_m(self) -> float:
        return self.vehicle.body.point.position_m[2]

    def heard(self, kind):
        return [message for message in self.said if isinstance(message, kind)]


def ready(autopilot: Autopilot = ARDUPILOT, **options) -> Bench:
    bench = Bench(autopilot, **options)
    bench.run(3.0)
    return bench


def up_there(*more: MissionItem) -> tuple[MissionItem, ...]:
    return (takeoff(HOME.lat_deg, HOME.lon_deg, 20.0, frame=Frame.ABOVE_HOME), *more)


def go(east: float, north: float, up: float, **options) -> MissionItem:
    return waypoint(*above_home((east, north, up)), frame=Frame.ABOVE_HOME, **options)
