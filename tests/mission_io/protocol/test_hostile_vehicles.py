"""Whatever a vehicle does, every transfer ends: within its stated time, with few messages, with a named error or rightly."""

from collections.abc import Iterable

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.errors import TransferError, TransferSilentError
from mission_io.model.items import MissionType
from mission_io.protocol.timing import TRANSFERS, Timing, longest_times
from mission_io.wire import messages as m
from tests.mission_io.protocol.attacks import CALLS, attack
from tests.mission_io.protocol.hostile import TRICKS, HostileVehicle, SlowVehicle, valid_items
from tests.mission_io.protocol.two_sides import BOTH, held
from tests.mission_io.vehicle import VehiclePeer, connected

SEEDS = 100


@pytest.mark.parametrize(
    "seed", [*range(30), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(30, SEEDS))]
)
@pytest.mark.no_cover
def test_every_call_ends_in_time(seed: int) -> None:
    """Each seed with one autopilot and one list; scripts/attack/hostile_vehicles.py does all of them."""
    autopilot, mission_type = (ARDUPILOT, PX4)[seed // 3 % 2], MissionType(seed % 3)
    for call in CALLS:
        result = attack(seed, autopilot, mission_type, call)
        assert result.error or result.correct, result
        assert result.time_s <= result.bound_s, result
        assert result.sent <= result.most_messages, result


def test_every_trick_is_the_first_of_several_seeds() -> None:
    firsts = [type(HostileVehicle(PX4, seed, MissionType.MISSION, held=0).tricks[0]) for seed in range(SEEDS)]
    assert set(firsts) == set(TRICKS)
    assert min(firsts.count(trick) for trick in TRICKS) >= 5


@BOTH
@pytest.mark.parametrize("answer_s", [0.4, 5.0, 14.0])
def test_a_vehicle_that_is_slow_and_gets_on_is_waited_for(autopilot: Autopilot, answer_s: float) -> None:
    client = connected(SlowVehicle(autopilot, answer_s))  # type: ignore[arg-type]
    items = valid_items(30, MissionType.RALLY)
    began_at = client.clock.now()
    client.upload(MissionType.RALLY, items)
    assert 9 * answer_s < client.clock.now() - began_at < longest_times(Timing(), 30).upload_s
    peer = SlowVehicle(autopilot, answer_s)
    peer.server.set_items(MissionType.RALLY, items)
    assert len(connected(peer).download(MissionType.RALLY)) == 30  # type: ignore[arg-type]


class ErrorForItem2(VehiclePeer):
    """Has an ERROR in place of item 2."""

    def instead(self, message: m.Message, *_: object) -> Iterable[m.Message] | None:
        requested = isinstance(message, m.MissionRequestInt) and message.seq == 2
        return [m.MissionAck(255, 190, 1)] if requested else None


class AnotherCountEachTime(VehiclePeer):
    """Names a larger list each time that it is asked."""

    count = 10

    def on_message(self, received: m.Received, *_: object) -> None:
        if isinstance(received.message, m.MissionRequestList):
            self.count += 1
            self.outbox += [m.MissionCount(255, 190, self.count), m.MissionCount(255, 190, self.count + 1)]


@BOTH
@pytest.mark.parametrize(
    ("kind", "says"),
    [
        (ErrorForItem2, "refused with ERROR after [23] of 9"),
        (AnotherCountEachTime, "repeatedly changes the number of items"),
    ],
)
def test_a_download_that_cannot_end_ends_at_once_and_asks_seldom(
    kind: type[VehiclePeer], says: str, autopilot: Autopilot
) -> None:
    """An item answered with ERROR, or a count that changes, once took 21,260 list requests in three hours."""
    peer = kind(autopilot)
    peer.server.set_items(MissionType.MISSION, valid_items(9, MissionType.MISSION))
    client = connected(peer)
    began_at = client.clock.now()
    with pytest.raises(TransferError, match=says):
        client.download(MissionType.MISSION)
    assert client.clock.now() - began_at < 5.0
    assert len([r for r in peer.heard if isinstance(r.message, m.MissionRequestList)]) <= TRANSFERS.restarts


class LoopsOverThree(VehiclePeer):
    """Asks 0, 1, 2, 0, 1, 2 as fast as the link is, until it is told to stop."""

    stopped = False

    def instead(self, message: m.Message, *_: object) -> Iterable[m.Message] | None:
        self.stopped |= isinstance(message, m.MissionAck) and message.result == 15
        if isinstance(message, m.MissionCount):
            return [m.MissionRequestInt(255, 190, 0)]
        return [m.MissionRequestInt(255, 190, (message.seq + 1) % 3)] if isinstance(message, m.MissionItemInt) else None


@BOTH
def test_an_upload_that_goes_round_ends_is_cancelled_and_tells_what_is_held(autopilot: Autopilot) -> None:
    """It once took 1.19 million messages."""
    peer = LoopsOverThree(autopilot)
    peer.server.set_items(MissionType.MISSION, valid_items(4, MissionType.MISSION))
    with pytest.raises(TransferError, match=r"makes no progress for 60 s after 2 of 9 items; .* \(4 items") as caught:
        connected(peer).upload(MissionType.MISSION, valid_items(9, MissionType.MISSION))
    assert peer.stopped
    assert len(caught.value.held_items or ()) == len(held(peer)) == 4
    assert len(peer.heard) < 1500


@BOTH
def test_an_early_acknowledgement_fails_at_once(autopilot: Autopilot) -> None:
    class AcksItem1(VehiclePeer):
        def instead(self, message: m.Message, *_: object) -> Iterable[m.Message] | None:
            early = isinstance(message, m.MissionItemInt) and message.seq >= 1
            return [m.MissionAck(255, 190, 0)] if early else None

    client = connected(AcksItem1(autopilot))
    began_at = client.clock.now()
    with pytest.raises(TransferError, match="accepted the list before it had requested every item"):
        client.upload(MissionType.MISSION, valid_items(9, MissionType.MISSION))
    assert client.clock.now() - began_at < (
        10.0 if autopilot is ARDUPILOT else 8.0
    )  # the vehicle's own time-out is 8 or 5 s


def test_a_vehicle_that_only_beats_is_silent_after_its_time() -> None:
    class Deaf(VehiclePeer):
        def receive_datagram(self, *_: object) -> None:
            pass

    client = connected(Deaf(PX4))
    began_at = client.clock.now()
    with pytest.raises(TransferSilentError):
        client.download(MissionType.FENCE)
    assert client.clock.now() - began_at == pytest.approx(Timing().give_up_s, abs=0.01)


def test_longest_times_grow_with_the_list() -> None:
    assert longest_times(Timing(), 0).stuck_s == pytest.approx(60.0 + TRANSFERS.restarts * 0.5 + 2.5)
    short, long = longest_times(Timing(), 10), longest_times(Timing(), 100)
    assert short.stuck_s < short.clear_s < short.verified_upload_s < long.upload_s < long.verified_upload_s
    assert longest_times(Timing(no_progress_s=5.0), 10).download_s < short.download_s / 4.0
