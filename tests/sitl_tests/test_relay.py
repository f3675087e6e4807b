import time

from mission_io.links.datagrams import UdpLink
from mission_io.links.opening import open_link
from mission_io.links.simulated import Conditions
from sitl_tests.relay import Relay

WATCHDOG_S = 10.0


def received_until(link, wanted: bytes) -> list[bytes]:
    got = []
    deadline = time.monotonic() + WATCHDOG_S
    while time.monotonic() < deadline:
        data = link.receive(0.1)
        if data is not None:
            got.append(data)
        if data == wanted:
            return got
    raise AssertionError(f"{wanted!r} did not come, only {got}")


def relayed(count: int, *, seed: int, loss: float) -> list[bytes]:
    got = []
    conditions = Conditions(loss=loss)
    with (
        UdpLink.listening() as vehicle,
        Relay(f"udpout://127.0.0.1:{vehicle.local_port}", seed=seed, conditions=conditions) as relay,
    ):
        station = open_link(relay.url)
        for n in range(count):
            station.send(b"%d" % n)
            data = vehicle.receive(0.05)
            if data is not None:
                got.append(data)
        station.close()
    return got


def test_what_is_not_lost_goes_through_both_ways():
    with UdpLink.listening() as vehicle, Relay(f"udpout://127.0.0.1:{vehicle.local_port}", seed=1) as relay:
        station = open_link(relay.url)
        station.send(b"up")
        received_until(vehicle, b"up")
        vehicle.send(b"down")
        assert received_until(station, b"down") == [b"down"]
        relay.cut_to_vehicle()
        station.send(b"lost")
        vehicle.send(b"still heard")
        received_until(station, b"still heard")
        assert vehicle.receive(0.1) is None
        station.close()


def test_about_as_much_is_lost_as_was_asked():
    got = relayed(40, seed=3, loss=0.5)
    assert 8 <= len(got) <= 32
