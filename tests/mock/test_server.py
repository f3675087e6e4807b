"""The mock vehicle over real UDP on 127.0.0.1: in a thread, and as a process of its own."""

import contextlib
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from random import Random

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.errors import VehicleSilentError
from mission_io.links.datagrams import UdpLink
from mission_io.links.opening import open_link
from mission_io.model.items import Frame, Mission, MissionType, waypoint
from mission_io.protocol.timing import Timing
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from tests.flight.scene import HOME, mission, plan_for, return_mission
from uavcover.errors import InputError, VehicleError
from uavcover.flight.fly import fly
from uavcover.flight.monitor import open_vehicle
from uavcover.flight.orders import OnBreach, Orders, Precautions
from uavcover.mock.server import BackgroundMock, InMemoryPeer, MockServer, TcpPort, mock_endpoint, run
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.track import Ending

SPEED = 40.0
WATCHDOG_S = 120.0

PROCESS = """
import sys
from mission_io.autopilots.autopilot import PX4
from mission_io.model.items import GeoPoint
from uavcover.mock.server import run
from uavcover.mock.vehicle import MockConfig, MockVehicle
home = GeoPoint(*map(float, sys.argv[1:4]))
speed = float(sys.argv[4])
run("udpin://127.0.0.1:0", MockVehicle(PX4, home, MockConfig(speed=speed)), speed=speed,
    on_bound=lambda port: print(port, flush=True))
"""


@contextlib.contextmanager
def mock_process(speed: float = SPEED) -> Iterator[tuple[subprocess.Popen[str], int]]:
    home = [repr(value) for value in (HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)]
    with subprocess.Popen(
        [sys.executable, "-c", PROCESS, *home, repr(speed)], stdout=subprocess.PIPE, text=True
    ) as process:
        watchdog = threading.Timer(WATCHDOG_S, process.kill)
        watchdog.start()
        try:
            assert process.stdout is not None
            yield process, int(process.stdout.readline())
        finally:
            watchdog.cancel()
            process.kill()


def test_a_process_of_its_own_is_flown_and_ends_cleanly():
    with mock_process() as (process, port):
        client, monitor = open_vehicle(f"udpout://127.0.0.1:{port}")
        samples = []
        with client:
            client.wait_for_vehicle()
            assert client.upload_and_verify(mission()).passed
            outcome = fly(
                client,
                monitor,
                plan_for(mission()),
                Orders(
                    on_sample=samples.append, on_event=lambda _: None, precautions=Precautions(on_breach=OnBreach.TELL)
                ),
                plan_return=return_mission,
            )
        assert outcome.ending is Ending.LANDED
        assert outcome.sample_count == len(samples) > 500
        process.send_signal(signal.SIGTERM)
        assert process.wait(WATCHDOG_S) == 0


def test_a_process_that_is_stopped_in_the_middle_of_an_upload_is_an_error():
    with mock_process(speed=1.0) as (process, port):
        timing = Timing(give_up_s=1.0, stall_s=1.0)
        with Client(open_link(f"udpout://127.0.0.1:{port}"), timing=timing) as client:
            client.wait_for_vehicle()
            items = [waypoint(36.5, -84.2 + n * 1e-6, 50.0, frame=Frame.ABOVE_HOME) for n in range(400)]

            def stop_halfway(done: int, total: int) -> None:
                if done >= total // 2 and process.poll() is None:
                    process.kill()
                    process.wait()

            with pytest.raises(VehicleSilentError, match=r"after 20\d of 400 items"):
                client.upload(MissionType.MISSION, items, progress=stop_halfway)


def background(speed: float = SPEED, autopilot=PX4, **options):
    return BackgroundMock(MockVehicle(autopilot, HOME, MockConfig(speed=speed)), speed=speed, **options)


def test_the_url_mock_starts_a_vehicle_that_ends_with_its_link():
    endpoint = mock_endpoint(lambda: MockVehicle(PX4, HOME, MockConfig(speed=SPEED)), speed=SPEED)
    before = set(threading.enumerate())
    client, _ = open_vehicle(open_link("mock:", schemes={"mock": endpoint}))
    with client:
        assert client.wait_for_vehicle().autopilot is PX4
        (vehicle,) = set(threading.enumerate()) - before
        assert vehicle.is_alive()
    assert not vehicle.is_alive()


def test_several_ground_stations_hear_the_vehicle_and_each_gets_its_own_answers():
    with background() as mock:
        url = f"udpout://127.0.0.1:{mock.port}"
        with Client(open_link(url), system_id=255) as one, Client(open_link(url), system_id=254) as two:
            one.wait_for_vehicle()
            two.wait_for_vehicle()
            assert one.upload_and_verify(Mission(HOME, mission().items)).passed
            assert len(two.download(MissionType.MISSION)) == len(mission().items)
            for client in (one, two):
                assert client.request_message(m.HomePosition).alt_amsl_m == HOME.alt_amsl_m
            heard = [r.message for r in one.poll(0.5)]
            assert not [x for x in heard if isinstance(x, m.MissionItemInt)]


def test_loss_is_by_seed_and_survived():
    with background(loss=0.2, seed=3) as mock, Client(open_link(f"udpout://127.0.0.1:{mock.port}")) as client:
        client.wait_for_vehicle()
        assert client.upload_and_verify(mission()).passed


def test_a_vehicle_can_speak_first():
    with UdpLink.listening() as link:
        vehicle = MockVehicle(PX4, HOME, MockConfig(speed=SPEED))
        server = MockServer(vehicle, speed=SPEED, greet=("127.0.0.1", link.local_port))
        stop = threading.Event()
        thread = threading.Thread(target=server.serve, args=(stop.is_set,))
        thread.start()
        try:
            assert Client(link).wait_for_vehicle().system_id == 1
        finally:
            stop.set()
            thread.join()
            server.close()


def test_the_vehicles_time_is_held_back_after_a_pause():
    vehicle = MockVehicle(PX4, HOME, MockConfig(speed=10.0))
    peer = InMemoryPeer(vehicle, speed=10.0)
    peer.datagrams_to_send(1.0)
    assert vehicle.time_s == pytest.approx(10.0)
    peer.hold_time(6.0)
    peer.datagrams_to_send(6.1)
    assert vehicle.time_s == pytest.approx(11.0)


def test_places_that_have_spoken_are_not_remembered_without_end():
    vehicle = MockVehicle(PX4, HOME)
    peer = InMemoryPeer(vehicle)
    hello = Codec(system_id=255, component_id=190).encode(m.Heartbeat(8, 6))
    for position in range(100):
        peer.receive_from(position, hello, 0.0)  # type: ignore[arg-type]
    assert len({position for position, _ in peer.datagrams(2.0)}) == 16


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": 0.0}, "speed: must be greater than 0, not 0.0"),
        ({"loss": 1.0}, "loss: must be at least 0 and below 1, not 1.0"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        MockServer(MockVehicle(PX4, HOME), **options)


def test_a_port_that_is_taken_is_an_error():
    with background() as mock, pytest.raises(VehicleError, match=f"cannot listen on UDP 127.0.0.1:{mock.port}"):
        MockServer(MockVehicle(PX4, HOME), port=mock.port)
    with (
        MockServer(MockVehicle(PX4, HOME), kind=TcpPort) as server,
        pytest.raises(VehicleError, match="is the port in use"),
    ):
        MockServer(MockVehicle(PX4, HOME), kind=TcpPort, port=server.port)


def test_over_tcp_it_talks_to_whoever_connects_and_forgets_who_has_gone():
    vehicle = MockVehicle(PX4, HOME, MockConfig(speed=SPEED))
    server = MockServer(vehicle, kind=TcpPort, speed=SPEED)
    stop = threading.Event()
    thread = threading.Thread(target=server.serve, args=(stop.is_set,))
    thread.start()
    url = f"tcp://127.0.0.1:{server.port}"
    try:
        with Client(open_link(url)) as one, Client(open_link(url), system_id=254) as two:
            for client in (one, two):
                client.wait_for_vehicle()
            assert one.upload_and_verify(mission()).passed
        with Client(open_link(url)) as later:
            later.wait_for_vehicle()
            assert len(later.download(MissionType.MISSION)) == len(mission().items)
    finally:
        stop.set()
        thread.join()
        server.close()


def test_only_udp_and_incoming_tcp_are_listened_on():
    with pytest.raises(InputError, match="use udpin://HOST:PORT or tcpin://HOST:PORT"):
        run("tcp:127.0.0.1:5760", MockVehicle(PX4, HOME))


def test_run_ends_on_a_signal_and_puts_the_handlers_back():
    before = signal.getsignal(signal.SIGTERM)
    ports = []

    def bound(port: int) -> None:
        ports.append(port)
        signal.raise_signal(signal.SIGTERM)

    for url in ("udpin://127.0.0.1:0", "udpout://127.0.0.1:14999", "tcpin://127.0.0.1:0"):
        run(url, MockVehicle(PX4, HOME), loss=Random(1).random() * 0.1, on_bound=bound)
    assert all(port > 0 for port in ports)
    assert signal.getsignal(signal.SIGTERM) is before
