import json
import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.autopilots.mission_lists import MissionList, wire_items
from mission_io.client.client import Client
from mission_io.client.connection import Connection
from mission_io.errors import (
    FormatError,
    MisuseError,
    TransferError,
    TransferInterrupted,
    TransferSilentError,
    VehicleHolds,
    VehicleSilentError,
)
from mission_io.links.simulated import Conditions, ManualClock
from mission_io.model.enums import MissionResult, ModeFlag
from mission_io.model.items import (
    Fence,
    FencePolygon,
    Frame,
    LatLon,
    Mission,
    MissionType,
    waypoint,
)
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Heartbeat
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, RALLY
from tests.mission_io.vehicle import VehiclePeer, connected

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


@BOTH
@pytest.mark.parametrize("content", [MISSION, FENCE, RALLY], ids=["mission", "fence", "rally"])
def test_upload_read_back_and_compare(autopilot: Autopilot, content: MissionList) -> None:
    client = connected(VehiclePeer(autopilot))
    result = client.upload_and_verify(content)
    assert result.passed, result.differences
    document = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert document["passed"] is True
    assert len(document["sent"]) == len(document["received"])
    assert all(difference["why"] for difference in document["differences"])
    back = client.download_list(result.mission_type)
    assert type(back) is type(content)


def test_what_was_planned_comes_back_from_px4_unchanged_but_for_32_bits() -> None:
    client = connected(VehiclePeer(PX4))
    result = client.upload_and_verify(Mission(HOME, (waypoint(46.5, -7.25, 40.123, frame=Frame.ABOVE_HOME),)))
    assert {(d.field, d.why) for d in result.differences} == {("alt_m", "MAVLink carries this number in 32 bits")}


def test_progress_counts_up_to_all() -> None:
    steps: list[tuple[int, int]] = []
    client = connected(VehiclePeer(PX4))
    client.upload(MissionType.MISSION, MISSION.items, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(n, 8) for n in range(9)]
    steps.clear()
    client.download(MissionType.MISSION, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(n, 8) for n in range(9)]


def test_no_vehicle_is_an_error_that_says_so_in_time() -> None:
    peer = VehiclePeer()
    peer.silent = True
    with pytest.raises(VehicleSilentError, match="no vehicle sent a heartbeat within 60 s"):
        connected(peer)


def test_another_system_is_not_the_one_that_was_asked_for() -> None:
    client = connected(VehiclePeer())
    with pytest.raises(
        VehicleSilentError, match=r"system ID 7 sent a heartbeat within 3 s; received heartbeats from \[1\]"
    ):
        client.wait_for_vehicle(3.0, system_id=7)
    with pytest.raises(MisuseError, match="wait_for_vehicle first"):
        client.upload(MissionType.MISSION, ())


def test_a_ground_station_is_no_vehicle() -> None:
    peer = VehiclePeer()
    peer.outbox = [m.Heartbeat(8, 6)]
    client = connected(peer)
    assert client.vehicle.mav_autopilot == 3
    assert client.vehicle.autopilot is ARDUPILOT


def test_heartbeats_go_out_once_a_second_and_age_is_known() -> None:
    peer = VehiclePeer()
    client = connected(peer)
    peer.heard.clear()
    end = client.clock.now() + 10.0
    while client.clock.now() < end:
        client.poll(end - client.clock.now())
    assert len([r for r in peer.heard if isinstance(r.message, m.Heartbeat)]) in (9, 10, 11)
    assert client.heartbeat_age_s < 1.5
    peer.silent = True
    client.poll(5.0)
    assert client.poll(5.0) == []
    assert client.heartbeat_age_s > 5.0


@pytest.mark.parametrize(("autopilot", "holds"), [(ARDUPILOT, "mixed"), (PX4, "unchanged")], ids=["ArduPilot", "PX4"])
def test_a_vehicle_that_stops_in_the_middle(autopilot: Autopilot, holds: VehicleHolds) -> None:
    class Stops(VehiclePeer):
        def on_message(self, received: m.Received, *_: object) -> None:
            self.silent = isinstance(received.message, m.MissionItemInt) and received.message.seq == 2

    client = connected(Stops(autopilot))
    with pytest.raises(TransferSilentError, match="stopped answering after 2 of 30 items") as caught:
        client.upload(MissionType.MISSION, (*MISSION.items[:1], *(MISSION.items[2],) * 29))
    assert caught.value.vehicle_holds == holds
    assert isinstance(caught.value, VehicleSilentError)


def test_a_vehicle_that_never_answers_the_count() -> None:
    class Deaf(VehiclePeer):
        def receive_datagram(self, *_: object) -> None:
            pass

    for autopilot, holds in ((ARDUPILOT, "unknown"), (PX4, "unchanged")):
        client = connected(Deaf(autopilot))
        with pytest.raises(TransferSilentError) as caught:
            client.upload(MissionType.MISSION, MISSION.items)
        assert caught.value.vehicle_holds == holds
        with pytest.raises(TransferSilentError, match="download of the fence"):
            client.download(MissionType.FENCE)
        with pytest.raises(TransferSilentError, match="clearing the rally points"):
            client.clear(MissionType.RALLY)


def test_a_vehicle_that_asks_the_time_is_answered_and_nobody_else() -> None:
    peer = VehiclePeer()
    client = connected(peer)
    peer.heard.clear()
    peer.outbox = [m.TimeSync(0, 7_000_000_001), m.TimeSync(5, 6_000_000_000)]  # a question, and an answer to nobody
    client.poll(0.5)
    peer.codec = Codec(system_id=1, component_id=158)  # its companion computer
    peer.outbox = [m.TimeSync(0, 8_000_000_000)]
    client.poll(0.5)
    (answer,) = [received.message for received in peer.heard if isinstance(received.message, m.TimeSync)]
    assert answer.requested_ns == 7_000_000_001
    assert 0 < answer.answered_ns <= client.clock.now() * 1e9


def swallow(peer: VehiclePeer, drop: Callable[[object], bool]) -> None:
    """Take out what the server wants to send, as a radio would."""
    original = peer.server.messages_to_send
    peer.server.messages_to_send = lambda now: [it for it in original(now) if not drop(it)]  # type: ignore[method-assign]


def test_everything_was_sent_but_the_vehicle_does_not_hold_it() -> None:
    class Forgets(VehiclePeer):
        def on_message(self, *_: object) -> None:
            for event in self.server.events():
                if event.reason == "uploaded":
                    self.server.set_items(MissionType.MISSION, event.items[:-1])

    peer = Forgets(PX4)
    swallow(peer, lambda it: isinstance(it, m.MissionAck) and it.result == MissionResult.ACCEPTED)
    client = connected(peer)
    with pytest.raises(TransferError, match="differs from the uploaded list") as caught:
        client.upload(MissionType.MISSION, MISSION.items)
    assert caught.value.vehicle_holds == "unknown"
    assert len(caught.value.held_items or ()) == 7
    result = connected(Forgets(PX4)).upload_and_verify(MISSION)
    assert not result.passed
    assert [d.field for d in result.differences if not d.acceptable] == ["count"]


def test_px4_gives_back_the_list_of_before_once() -> None:
    class Stale(VehiclePeer):
        stale = True

        def on_message(self, received: m.Received, *_: object) -> None:
            if self.server.events():
                self.fresh = self.server.items(MissionType.MISSION)
                self.server.set_items(MissionType.MISSION, ())
            elif isinstance(received.message, m.MissionAck) and self.stale:
                self.stale = False
                self.server.set_items(MissionType.MISSION, self.fresh)

    assert connected(Stale(PX4)).upload_and_verify(MISSION).passed


def test_refused_before_anything_is_sent() -> None:
    peer = VehiclePeer(PX4)
    client = connected(peer)
    bad = replace(MISSION, items=(*MISSION.items, waypoint(91.0, -7.0, 20.0, frame=Frame.ABOVE_TERRAIN)))
    with pytest.raises(MisuseError, match=r"mission was not sent: item 8, frame: .* \(and 1 more\)"):
        client.upload_and_verify(bad)
    assert not [r for r in peer.heard if isinstance(r.message, m.MissionCount)]
    with pytest.raises(FormatError, match="2 vertices"):
        client.upload_and_verify(Fence((FencePolygon((LatLon(1.0, 2.0), LatLon(2.0, 3.0))),)))


class WithCard(VehiclePeer):
    """An ArduPilot that keeps its mission on a memory card, or one that does not say so when ``size_kb`` is None."""

    def __init__(self, autopilot: Autopilot = ARDUPILOT, *, size_kb: float | None, capacity: int = 650) -> None:
        super().__init__(autopilot, capacity=capacity)
        self.size_kb = size_kb

    def on_message(self, received: m.Received, now: float) -> None:
        super().on_message(received, now)
        if isinstance(received.message, m.ParamRequestRead) and self.size_kb is not None:
            self.outbox.append(m.ParamValue(received.message.name, self.size_kb))

    def requested_for(self) -> list[str]:
        """The parameters that were asked for."""
        return [r.message.name for r in self.heard if isinstance(r.message, m.ParamRequestRead)]


def _long_mission(count: int) -> Mission:
    positions = (waypoint(46.5 + i * 1e-5, -7.25, 40.0, frame=Frame.ABOVE_HOME) for i in range(count))
    return Mission(HOME, tuple(positions))


@pytest.mark.parametrize(("size_kb", "limit"), [(64.0, 4368), (12.0, 818), (1.0, 68), (0.0, None), (math.nan, None)])
def test_a_vehicle_with_a_memory_card_tells_how_many_items_it_takes(size_kb: float, limit: int | None) -> None:
    peer = WithCard(size_kb=size_kb)
    assert connected(peer).ask_item_limit() == limit
    assert peer.requested_for() == ["BRD_SD_MISSION"]


def test_px4_is_not_asked_what_it_does_not_tell() -> None:
    peer = WithCard(PX4, size_kb=64.0)
    assert connected(peer).ask_item_limit() is None
    assert peer.requested_for() == []


def test_a_mission_longer_than_usual_is_sent_to_a_vehicle_that_takes_it() -> None:
    peer = WithCard(size_kb=64.0, capacity=4368)
    assert connected(peer).upload_and_verify(_long_mission(699)).passed
    assert len(peer.server.items(MissionType.MISSION)) == 700


@pytest.mark.parametrize(("size_kb", "limit"), [(None, 650), (0.0, 650), (10.0, 682)])
def test_a_mission_too_long_for_the_vehicle_is_not_sent(size_kb: float | None, limit: int) -> None:
    peer = WithCard(size_kb=size_kb)
    client = connected(peer)
    begun_at = client.clock.now()
    with pytest.raises(MisuseError, match=f"the list: 700 items exceed the ArduPilot limit of {limit}; split"):
        client.upload_and_verify(_long_mission(699))
    assert client.clock.now() - begun_at < 3.5
    assert not [r for r in peer.heard if isinstance(r.message, m.MissionCount)]


def test_a_mission_of_usual_length_waits_for_no_parameter() -> None:
    peer = WithCard(size_kb=None)
    assert connected(peer).upload_and_verify(_long_mission(649)).passed
    assert peer.requested_for() == []


def test_emptying_a_px4_that_is_busy_takes_until_it_is_free() -> None:
    """PX4 does not answer while somebody's download is unfinished; 5.3 s after its last word it is free again."""
    peer = VehiclePeer(PX4)
    peer.server.set_items(MissionType.MISSION, wire_items(MISSION, PX4))
    client = connected(peer)
    begun_at = client.clock.now()
    peer.server.receive(m.Received(m.MissionRequestList(1, 1), 254, 190), begun_at)
    client.clear(MissionType.MISSION)
    assert peer.server.items(MissionType.MISSION) == ()
    assert 5.0 < client.clock.now() - begun_at < 8.0


def test_just_booted_ardupilot_is_waited_for() -> None:
    client = connected(VehiclePeer(ARDUPILOT, booted_at=0.0))
    client.upload(MissionType.MISSION, MISSION.items)
    assert client.clock.now() > 2.0


def test_an_armed_vehicle_is_left_alone_unless_it_is_meant() -> None:
    peer = VehiclePeer(PX4)
    peer.base_mode = ModeFlag.SAFETY_ARMED
    client = connected(peer)
    assert client.vehicle.armed
    for call in (client.clear, lambda t: client.upload(t, MISSION.items)):
        with pytest.raises(MisuseError, match="is armed"):
            call(MissionType.MISSION)
    client.upload(MissionType.MISSION, MISSION.items, in_flight=True)
    client.clear(MissionType.MISSION, in_flight=True)


def test_a_vehicle_that_asks_for_ever_is_given_up() -> None:
    class Stuck(VehiclePeer):
        def receive_datagram(self, *_: object) -> None:
            self.outbox.append(m.MissionRequestInt(255, 190, 0))

    with pytest.raises(TransferError, match="makes no progress"):
        connected(Stuck(PX4), conditions=Conditions(delay_s=0.2)).upload(MissionType.MISSION, MISSION.items)


def test_interrupting_tells_the_vehicle() -> None:
    def stop(done: int, total: int) -> None:
        if done == 3 < total:
            raise KeyboardInterrupt

    peer = VehiclePeer(PX4)
    client = connected(peer)
    with pytest.raises(KeyboardInterrupt) as caught:
        client.upload(MissionType.MISSION, MISSION.items, progress=stop)
    assert isinstance(caught.value, TransferInterrupted)
    assert (caught.value.outcome.vehicle_holds, caught.value.outcome.held_items) == ("unchanged", ())
    assert "the client cancelled the transfer" in str(caught.value)
    client.poll(0.5)
    acks = [r.message for r in peer.heard if isinstance(r.message, m.MissionAck)]
    assert acks[0].result == MissionResult.OPERATION_CANCELLED
    assert peer.server.next_timer() is None


def test_a_listener_sees_everything_and_the_client_closes_its_link() -> None:
    observed: list[float] = []
    base = connected(VehiclePeer(PX4))
    with Client(base.link, listener=lambda _, now: observed.append(now)) as client:
        client.wait_for_vehicle(5.0)
        client.upload(MissionType.MISSION, MISSION.items)
    assert len(observed) > 8
    with pytest.raises(Exception, match="closed"):
        client.poll(0.1)


READING_S = 0.004
"""How long a busy machine takes for a datagram."""


class Flood:
    """Always has a datagram; reading one takes its time."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.sent = 0
        self._vehicle = Codec(system_id=1, component_id=1)

    def send(self, data: bytes) -> None:
        del data
        self.sent += 1

    def receive(self, timeout_s: float) -> bytes | None:
        del timeout_s
        self.clock.advance_to(self.clock.now() + READING_S)
        return self._vehicle.encode(Heartbeat(3, 2))

    def close(self) -> None:
        """Nothing to let go of."""


def test_a_vehicle_that_sends_faster_than_we_read_does_not_keep_poll_for_ever() -> None:
    link = Flood()
    connection = Connection(link)
    connection.wait_for_vehicle()
    began_s, read = link.clock.now(), 0
    while link.clock.now() - began_s < 10.0:
        messages = connection.poll(0.0)
        assert 1 < len(messages) <= 27, "what is here for a tenth of a second"
        read += len(messages)
    assert read * READING_S > 9.9, "nothing is left lying"
    assert link.sent in (10, 11, 12), "heartbeats go out"
