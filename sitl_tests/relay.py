"""A relay between a vehicle and a ground station that loses datagrams by seed, and can be cut."""

import math
import threading
from random import Random
from types import TracebackType
from typing import Self

from mission_io.links.datagrams import UdpLink
from mission_io.links.opening import open_link
from mission_io.links.simulated import Conditions, LossyLink
from sitl_tests.meddler import Meddler

_TICK_S = 0.02


class Relay:
    """Passes datagrams on both ways in two threads; a context manager that ends them.

    Args:
        vehicle_url: where the vehicle is.
        seed: decides what is lost.
        conditions: what happens to datagrams, each way.
        meddler: speaks to the station, too, as if it were on board.

    Attributes:
        url: where a ground station finds the vehicle.
        sent: every datagram that went to the vehicle.
    """

    def __init__(
        self, vehicle_url: str, *, seed: int, conditions: Conditions | None = None, meddler: Meddler | None = None
    ) -> None:
        conditions = conditions if conditions is not None else Conditions()
        self._vehicle = LossyLink(open_link(vehicle_url), rng=Random(seed), conditions=conditions)
        self._station = UdpLink.listening()
        self.url = f"udpout://127.0.0.1:{self._station.local_port}"
        self.sent: list[bytes] = []
        self._meddler = meddler
        self._dark_until_s = -math.inf
        self._ended, self._cut = threading.Event(), threading.Event()
        self._threads = [
            threading.Thread(target=self._pass_down, name="relay to station", daemon=True),
            threading.Thread(target=self._pass_up, name="relay to vehicle", daemon=True),
        ]

    def cut_to_vehicle(self) -> None:
        """From now on nothing reaches the vehicle; the station still hears it."""
        self._cut.set()

    def go_dark(self, seconds: float) -> None:
        """Lose everything both ways for some seconds from now on."""
        self._dark_until_s = self._station.clock.now() + seconds

    @property
    def _is_dark(self) -> bool:
        return self._station.clock.now() < self._dark_until_s

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._vehicle.close()
        self._station.close()

    def _pass_down(self) -> None:
        while not self._ended.is_set():
            data = self._vehicle.receive(_TICK_S)
            if data is not None and not self._is_dark:
                self._station.send(data)
            if self._meddler is not None:
                for lie in self._meddler.datagrams(self._station.clock.now()):
                    self._station.send(lie)

    def _pass_up(self) -> None:
        while not self._ended.is_set():
            data = self._station.receive(_TICK_S)
            if data is not None and not self._cut.is_set() and not self._is_dark:
                self.sent.append(data)
                self._vehicle.send(data)
