"""Start, pause, go on, jump and follow: on the mock vehicle of both autopilots, and on vehicles that behave badly."""

import asyncio
import re
from pathlib import Path
from random import Random

import pytest

from mission_io import AsyncClient, Client, CommandRefusedError, Mission, MissionType, VehicleSilentError
from mission_io.autopilots.autopilot import ARDUPILOT, ARDUPILOT_PLANE, PX4, Autopilot, Mode, custom_mode
from mission_io.client.mission_control import ItemProgress, wait_for_mission
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.enums import CommandResult, MissionState
from mission_io.model.items import Command, Frame, GeoPoint, land, takeoff, waypoint
from mission_io.wire import messages as m
from tests.mission_io.vehicle import VehiclePeer, connected
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockVehicle

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "vehicle_calls.md"
HOME = GeoPoint(46.5, -7.25, 400.0)
MISSION = Mission(
    HOME,
    (
        takeoff(46.5, -7.25, 10.0, frame=Frame.ABOVE_HOME),
        waypoint(46.5004, -7.25, 12.0, frame=Frame.ABOVE_HOME),
        waypoint(46.5004, -7.2495, 12.0, frame=Frame.ABOVE_HOME),
        waypoint(46.5, -7.2495, 12.0, frame=Frame.ABOVE_HOME),
        land(46.5, -7.25, frame=Frame.ABOVE_HOME),
    ),
)


def mock_client(autopilot: Autopilot, loss: float = 0.0) -> tuple[Client, MockVehicle]:
    vehicle = MockVehicle(autopilot, HOME)
    link = SimulatedLink(InMemoryPeer(vehicle), rng=Random(3), conditions=Conditions(loss=loss, delay_s=0.002))
    client = Client(link)
    client.wait_for_vehicle(60.0)
    while not vehicle.ready:
        client.poll(1.0)
    assert client.upload_and_verify(MISSION).passed
    return client, vehicle


def take_off(client: Client, autopilot: Autopilot) -> None:
    if autopilot is ARDUPILOT:
        client.set_mode(custom_mode(ARDUPILOT, Mode.GUIDED))
    for _ in range(60):
        try:
            client.command(Command.COMPONENT_ARM_DISARM, 1.0)
            return
        except CommandRefusedError:
            client.poll(1.0)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda autopilot: autopilot.name)
def test_a_mission_is_flown_paused_gone_on_and_jumped(autopilot: Autopilot) -> None:
    first = 1 if autopilot is ARDUPILOT else 0
    client, vehicle = mock_client(autopilot, loss=0.1)
    take_off(client, autopilot)
    client.start_mission()
    for progress in client.follow_mission(until=lambda progress: progress.current == first + 1):
        assert progress.total in (None, 5)
    client.pause_mission()
    assert vehicle.mode is Mode.HOLD
    held = vehicle.body.point.position_m
    client.poll(0.0)
    client.resume_mission()
    assert vehicle.mode is Mode.MISSION
    assert held is not None
    report = client.set_current(first + 3)
    assert report.seq == first + 3 == vehicle.current_seq
    with pytest.raises(CommandRefusedError, match=r"DO_SET_MISSION_CURRENT \(224\) for item 77 with"):
        client.set_current(77)
    reported: list[ItemProgress] = []
    last = wait_for_mission(client, progress=reported.append)
    assert last.complete
    assert last == reported[-1]
    assert vehicle.body.on_ground


class Reports(VehiclePeer):
    """Reports its current item when asked; ``answers`` to DO_SET_MISSION_CURRENT, and ``works`` says what that changes."""

    def __init__(self, autopilot: Autopilot = ARDUPILOT) -> None:
        super().__init__(autopilot)
        self.seq = 2
        self.answer: CommandResult | None = CommandResult.ACCEPTED
        self.older_works = False
        self.goes_on_to: int | None = None
        self.works = True

    def on_message(self, received: m.Received, *_: object) -> None:
        match received.message:
            case m.CommandLong(command=Command.REQUEST_MESSAGE):
                self.outbox.append(m.MissionCurrent(self.seq))
            case m.CommandLong(command=Command.DO_SET_MISSION_CURRENT, params=params) if self.answer is not None:
                if self.answer is CommandResult.ACCEPTED and self.works:
                    self.seq = int(params[0]) if self.goes_on_to is None else self.goes_on_to
                self.outbox.append(m.CommandAck(224, self.answer, target_system=255, target_component=190))
            case m.MissionSetCurrent(seq=seq) if self.older_works:
                self.seq = seq

    def reported(self, kind: type[m.Message]) -> int:
        return sum(
            isinstance(r.message, kind) and getattr(r.message, "command", 224) == Command.DO_SET_MISSION_CURRENT
            for r in self.heard
        )


@pytest.mark.parametrize("loss", [0.0, 0.4])
@pytest.mark.parametrize("answer", [CommandResult.ACCEPTED, CommandResult.UNSUPPORTED, None])
def test_the_command_or_the_older_message(answer: CommandResult | None, loss: float) -> None:
    peer = Reports()
    peer.answer, peer.older_works = answer, answer is not CommandResult.ACCEPTED
    client = connected(peer, conditions=Conditions(loss=loss))
    assert client.set_current(5, timeout_s=30.0).seq == 5
    if loss == 0.0:
        tries = {CommandResult.ACCEPTED: (1, 0), CommandResult.UNSUPPORTED: (1, 1), None: (4, 1)}[answer]
        assert (peer.reported(m.CommandLong), peer.reported(m.MissionSetCurrent)) == tries


def test_a_command_at_the_wanted_place_is_carried_out_and_the_next_waypoint_counts() -> None:
    peer = Reports()
    peer.goes_on_to = 7
    assert connected(peer).set_current(5).seq == 7


def test_accepted_and_not_done_is_said() -> None:
    peer = Reports()
    peer.works = False
    with pytest.raises(
        VehicleSilentError,
        match="item 5 did not become the current item: vehicle 1 accepted the command but reports item 2",
    ):
        connected(peer).set_current(5)
    peer.answer = CommandResult.DENIED
    with pytest.raises(CommandRefusedError, match="DENIED") as caught:
        connected(peer).set_current(5)
    assert caught.value.command == 224
    with pytest.raises(VehicleSilentError, match="did not answer"):
        connected(VehiclePeer()).set_current(5, timeout_s=3.0)


def test_the_words_of_others_settle_nothing() -> None:
    class Meddled(Reports):
        def on_message(self, received: m.Received, now: float) -> None:
            if isinstance(received.message, m.CommandLong):
                self.outbox.append(m.CommandAck(224, CommandResult.DENIED, target_system=77))
            super().on_message(received, now)

    assert connected(Meddled()).set_current(5).seq == 5


@pytest.mark.parametrize(
    ("autopilot", "modes"), [(ARDUPILOT_PLANE, (10, 12)), (PX4, (4 << 16 | 4 << 24, 4 << 16 | 3 << 24))],
    ids=lambda value: getattr(value, "name", ""),
)  # fmt: skip
def test_modes_of_those_without_a_command(autopilot: Autopilot, modes: tuple[int, int]) -> None:
    class Obeys(VehiclePeer):
        def on_message(self, received: m.Received, *_: object) -> None:
            if isinstance(received.message, m.CommandLong):
                _, main, sub, *_ = received.message.params
                assert received.message.command == Command.DO_SET_MODE
                self.custom_mode = int(main) << 16 | int(sub) << 24 if self.autopilot is PX4 else int(main)
                self.outbox.append(m.CommandAck(received.message.command, CommandResult.ACCEPTED))

    peer = Obeys(autopilot)
    peer.vehicle_type = 1 if autopilot is ARDUPILOT_PLANE else 2
    client = connected(peer)
    client.start_mission()
    assert peer.custom_mode == modes[0]
    client.pause_mission()
    assert peer.custom_mode == modes[1]
    client.resume_mission()
    assert peer.custom_mode == modes[0]


def test_following_asks_who_does_not_tell_and_ends_when_the_heartbeat_does() -> None:
    class Quiet(Reports):
        def on_message(self, received: m.Received, now: float) -> None:
            super().on_message(received, now)
            self.seq = min(4, int(now) // 4)
            self.silent = now > 30.0

    with pytest.raises(VehicleSilentError, match="did not send a heartbeat for 5 s"):
        list(connected(Quiet()).follow_mission(silent_s=5.0))
    observed = [one.current for one in connected(Quiet()).follow_mission(until=lambda one: one.current == 4)]
    assert observed == [0, 1, 2, 3, 4]
    assert ItemProgress().after(m.MissionCurrent(3, 9, MissionState.COMPLETE)).complete


def test_under_asyncio() -> None:
    async def session() -> None:
        client, vehicle = mock_client(PX4)
        take_off(client, PX4)
        reported: list[ItemProgress] = []
        async with AsyncClient(client) as ground:
            await ground.start_mission()
            await ground.pause_mission()
            await ground.resume_mission()
            assert (await ground.set_current(3)).seq == 3
            last = await ground.follow_mission(reported.append)
            assert last.complete
            await asyncio.sleep(0)
            assert reported[-1] == last
        assert len(vehicle.missions.items(MissionType.MISSION)) == 5

    asyncio.run(session())


@pytest.mark.parametrize(
    ("heading", "autopilot", "wanted"),
    [
        ("## Fly the mission", PX4, "flies to item 2 of 5, reached 0\nwent on with item 3\n"),
        ("## Read and set parameters", PX4, "(name='RTL_RETURN_ALT', value=42.5, param_type=9"),
        ("## Replace a part", ARDUPILOT, "True\n"),
        ("## Find out whether", PX4, "fence=None, rally=None)\nFalse\n"),
    ],
    ids=["fly", "parameters", "part", "ids"],
)
def test_the_examples_of_the_page_run(
    heading: str, autopilot: Autopilot, wanted: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = PAGE.read_text()
    code = re.findall(r"```python\n(.*?)```", page[page.index(heading) :], re.DOTALL)[0]
    client, vehicle = mock_client(autopilot)
    monkeypatch.setattr("mission_io.open_link", lambda _: client.link)
    exec(compile(code, str(PAGE), "exec"), {})
    assert wanted in capsys.readouterr().out
    assert heading != "## Fly the mission" or vehicle.body.on_ground
