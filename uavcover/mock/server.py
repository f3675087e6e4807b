"""Serve the mock vehicle on a port: as a process (``run``), or in a thread for the URL ``mock:``."""

import logging
import signal
import threading
import time
from collections.abc import Callable
from random import Random
from types import FrameType
from typing import Self

from mission_io.links.base import Closing, Link
from mission_io.links.opening import LinkUrl, parse_link_url
from mission_io.links.udp import UdpLink
from uavcover.errors import InputError
from uavcover.mock.behaviour import LINK
from uavcover.mock.ports import MockPeer, Place, Port, TcpPort, UdpPort
from uavcover.mock.vehicle import MockVehicle

_log = logging.getLogger(__name__)


class MockServer(Closing):
    """Serves one vehicle on one port in real time times ``speed``; a context manager that lets go of the port.

    Raises:
        VehicleError: the port cannot be bound.
    """

    def __init__(
        self,
        vehicle: MockVehicle,  # the vehicle, made with the same ``speed``
        *,
        host: str = "127.0.0.1",  # address to bind
        port: int = 0,  # port to bind; 0 is any free one, see ``port``
        kind: Callable[[str, int], Port] = UdpPort,  # UDP, or TCP
        speed: float = 1.0,  # vehicle seconds per second
        loss: float = 0.0,  # share of the datagrams that are lost, each way
        rng: Random | None = None,  # decides which datagrams
        greet: Place | None = None,  # an address that receives messages before it has sent any, or none
    ) -> None:
        if not speed > 0.0:
            raise InputError(f"speed: must be greater than 0, not {speed}")
        if not 0.0 <= loss < 1.0:
            raise InputError(f"loss: must be at least 0 and below 1, not {loss}")
        self._port = kind(host, port)
        self._loss, self._rng = loss, rng if rng is not None else Random(0)
        self._now = time.monotonic()
        self._peer: MockPeer[Place] = MockPeer(vehicle, speed=speed, origin_s=self._now, paced=speed > 1.0)
        if greet is not None:
            self._peer.greet(greet)
        self._said_slow = False

    @property
    def port(self) -> int:
        """The port that was bound."""
        return self._port.number

    def serve(self, stopped: Callable[[], bool]) -> None:
        """Fly and answer until ``stopped`` is true."""
        while not stopped():
            self._port.wait(LINK.tick_s)
            now = time.monotonic()
            if now - self._now > LINK.longest_tick_s:
                self._peer.hold_time(now - LINK.longest_tick_s)
                if not self._said_slow:
                    self._said_slow = True
                    _log.info("this machine is too slow for the requested speed, so the vehicle's time runs slower")
            self._now = now
            for place in self._port.newcomers():
                self._peer.greet(place)
            for place, data in self._port.take():
                if not self._lost():
                    self._peer.receive_from(place, data, now)
            for place, datagram in self._peer.datagrams(now):
                if not self._lost():
                    self._port.send(place, datagram)

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()

    def _lost(self) -> bool:
        return self._loss > 0.0 and self._rng.random() < self._loss


def run(
    # ``udpin://HOST:PORT`` answers every sender, port 0 is any; ``udpout://HOST:PORT`` also speaks first;
    # ``tcpin://HOST:PORT`` talks to every connection
    url: str,
    vehicle: MockVehicle,  # the vehicle, made with the same ``speed``
    *,
    speed: float = 1.0,  # vehicle seconds per second
    loss: float = 0.0,  # share of the datagrams that get lost, each way
    seed: int = 0,  # of the loss
    on_bound: Callable[[int], None] | None = None,  # called with the port once it is bound
    ended: Callable[[], bool] = lambda: False,  # asked a hundred times a second
) -> None:
    """Be a vehicle until SIGTERM or SIGINT, or until ``ended`` is true. To be called in the main thread of its process.

    Raises:
        InputError: a URL that is none of these, or a speed or loss out of range.
        VehicleError: the port cannot be bound.
        mission_io.errors.MisuseError: a URL that is not understood.
    """
    place = parse_link_url(url)
    if place.scheme not in ("udpin", "udpout", "tcpin"):
        raise InputError(
            f"{url!r}: the mock vehicle cannot listen at this URL; use udpin://HOST:PORT or tcpin://HOST:PORT"
        )
    stop = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        stop.set()

    inward = place.scheme != "udpout"
    server = MockServer(
        vehicle,
        host=place.host if inward else "0.0.0.0" if place.host not in ("127.0.0.1", "localhost") else "127.0.0.1",
        port=place.port if inward else 0,
        kind=TcpPort if place.scheme == "tcpin" else UdpPort,
        speed=speed,
        loss=loss,
        rng=Random(seed),
        greet=None if inward else (place.host, place.port),
    )
    before = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        with server:
            if on_bound is not None:
                on_bound(server.port)
            server.serve(lambda: stop.is_set() or ended())
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class BackgroundMock(Closing):
    """A mock vehicle in a thread, on a free port of 127.0.0.1; a context manager that ends it."""

    def __init__(self, vehicle: MockVehicle, *, speed: float = 1.0, loss: float = 0.0, seed: int = 0) -> None:
        self._server = MockServer(vehicle, speed=speed, loss=loss, rng=Random(seed))
        self._stop = threading.Event()
        self.port = self._server.port
        self._thread = threading.Thread(
            target=self._server.serve, args=(self._stop.is_set,), name="mock vehicle", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """End the thread and let go of the port; closing twice is fine."""
        self._stop.set()
        self._thread.join()
        self._server.close()


class _MockLink(UdpLink):
    """A UDP link to a mock vehicle of its own, which ends with it."""

    _background: BackgroundMock | None = None

    @classmethod
    def starting(cls, background: BackgroundMock) -> Self:
        """A link to a vehicle that was just started."""
        link = cls.connecting("127.0.0.1", background.port)
        link._background = background
        return link

    def close(self) -> None:
        """Let go of the port and end the vehicle."""
        super().close()
        if self._background is not None:
            self._background.close()


def mock_endpoint(make_vehicle: Callable[[], MockVehicle], *, speed: float) -> Callable[[LinkUrl], Link]:
    """The opener of ``mock:`` for ``open_link``: each link starts its own vehicle, which ends with it.

    Args:
        make_vehicle: makes the vehicle, with the same ``speed``.
        speed: vehicle seconds per second.
    """

    def open_mock(_: LinkUrl) -> Link:
        return _MockLink.starting(BackgroundMock(make_vehicle(), speed=speed))

    return open_mock
