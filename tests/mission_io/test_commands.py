import random

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.client import commands
from mission_io.client.client import Client
from mission_io.errors import CommandRefusedError, MisuseError, VehicleSilentError
from mission_io.links.simulated import Conditions
from mission_io.model.enums import CommandResult
from mission_io.model.items import Command
from mission_io.wire import messages as m
from mission_io.wire.messages import float32
from tests.mission_io.vehicle import VehiclePeer, connected


class Obeys(VehiclePeer):
    """Answers each command with the next of ``results``; the last one for ever."""

    results = (CommandResult.ACCEPTED,)
    mode_works = True

    def on_message(self, received: m.Received, now: float) -> None:
        message = received.message
        if isinstance(message, m.CommandLong | m.CommandInt):
            result, *rest = self.results
            self.results = tuple(rest) or self.results
            self.outbox.append(m.CommandAck(message.command, result, target_system=255, target_component=190))
            if message.command == Command.DO_SET_MODE and self.mode_works:
                assert isinstance(message, m.CommandLong)
                _, main, sub, *_ = message.params
                self.custom_mode = int(main) if self.autopilot is ARDUPILOT else int(main) << 16 | int(sub) << 24
                self._beat_at = now + 0.3
            if message.command == Command.REQUEST_MESSAGE:
                self.outbox.append(m.HomePosition(46.5, -7.25, 512.0))
        elif isinstance(message, m.ParamRequestRead):
            self.outbox.append(m.ParamValue(message.name, 1.5))
        elif isinstance(message, m.ParamSet):
            self.outbox.append(m.ParamValue("OTHER", 0.0))
            self.outbox.append(m.ParamValue(message.name, min(float32(message.value), 100.0)))

    def commands_heard(self) -> list[m.CommandLong]:
        return [r.message for r in self.heard if isinstance(r.message, m.CommandLong)]


def test_a_command_is_sent_and_answered() -> None:
    peer = Obeys()
    ack = connected(peer).command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert ack.result == CommandResult.ACCEPTED
    assert peer.commands_heard() == [m.CommandLong(1, 1, 400, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))]


def test_silence_is_answered_with_the_command_again_and_a_higher_confirmation() -> None:
    class Deaf(Obeys):
        def on_message(self, received: m.Received, now: float) -> None:
            pass

    peer = Deaf()
    with pytest.raises(VehicleSilentError, match=r"answer to command MISSION_START \(300\) within 2 s"):
        connected(peer).command(Command.MISSION_START, timeout_s=2.0)
    assert [message.confirmation for message in peer.commands_heard()] == [0, 1, 2, 3]


@pytest.mark.parametrize("seed", range(20))
def test_commands_get_through_a_lossy_link(seed: int) -> None:
    connected(Obeys(), seed=seed, conditions=Conditions(loss=0.3)).command(Command.MISSION_START, timeout_s=20.0)


def test_in_progress_is_waited_for_without_asking_again() -> None:
    class Slow(Obeys):
        results = (CommandResult.IN_PROGRESS,)

        def datagrams_to_send(self, now: float) -> list[bytes]:
            if now > 5.0 and self.results:
                self.results = ()
                self.outbox.append(m.CommandAck(Command.NAV_TAKEOFF, CommandResult.ACCEPTED))
            return super().datagrams_to_send(now)

    peer = Slow()
    client = connected(peer)
    client.command(Command.NAV_TAKEOFF)
    assert client.clock.now() > 5.0
    assert len(peer.commands_heard()) == 1


def test_a_refusal_is_an_error_with_its_name() -> None:
    peer = Obeys()
    peer.results = (CommandResult.TEMPORARILY_REJECTED,)
    with pytest.raises(CommandRefusedError, match=r"COMPONENT_ARM_DISARM \(400\) with TEMPORARILY_REJECTED") as caught:
        connected(peer).command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert (caught.value.command, caught.value.result) == (400, 1)
    assert caught.value.result_name == "TEMPORARILY_REJECTED"


def test_answers_to_others_and_to_other_commands_are_not_ours() -> None:
    class Chatty(Obeys):
        def on_message(self, received: m.Received, now: float) -> None:
            if isinstance(received.message, m.CommandLong):
                self.outbox += [
                    m.CommandAck(received.message.command, CommandResult.DENIED, target_system=254),
                    m.CommandAck(999, CommandResult.DENIED),
                ]
            super().on_message(received, now)

    connected(Chatty()).command(1234)


def test_names() -> None:
    assert commands.name_of(1234) == "1234"
    assert commands.name_of_result(77) == "77"


def test_a_command_has_seven_parameters() -> None:
    with pytest.raises(MisuseError, match="8 parameters"):
        connected(Obeys()).command(1, *[0.0] * 8)


@pytest.mark.parametrize(("autopilot", "mode"), [(ARDUPILOT, 3), (PX4, 4 << 16 | 4 << 24)], ids=["ArduPilot", "PX4"])
def test_a_mode_is_set_when_the_heartbeat_shows_it(autopilot: object, mode: int) -> None:
    peer = Obeys(autopilot)  # type: ignore[arg-type]
    client = connected(peer)
    client.set_mode(mode)
    assert client.vehicle.custom_mode == mode
    client.set_mode(mode)
    peer.mode_works = False
    with pytest.raises(VehicleSilentError, match="heartbeat in mode 5"):
        client.set_mode(5, timeout_s=2.0)


def test_message_intervals_are_asked_for_in_microseconds() -> None:
    peer = Obeys()
    connected(peer).request_message_interval(m.GlobalPositionInt, 0.2)
    assert peer.commands_heard()[0].params[:2] == (33.0, 200000.0)


def test_one_message_is_asked_for_and_comes() -> None:
    peer = Obeys()
    client = connected(peer)
    assert client.request_message(m.HomePosition) == m.HomePosition(46.5, -7.25, 512.0)
    with pytest.raises(VehicleSilentError, match="a GlobalPositionInt within 1 s"):
        client.request_message(m.GlobalPositionInt, timeout_s=1.0)


def test_parameters_are_read_and_set() -> None:
    client: Client = connected(Obeys(), conditions=Conditions(loss=0.2), seed=random.Random(1).randrange(100))
    assert client.read_parameter("WPNAV_SPEED").value == 1.5
    assert client.set_parameter("FENCE_ALT_MAX", 0.1).value == float32(0.1)
    with pytest.raises(MisuseError, match="FENCE_ALT_MAX was set to 120, but is 100"):
        client.set_parameter("FENCE_ALT_MAX", 120.0)
