"""A relay between a ground station and a vehicle that sees every datagram go by."""

import select
import socket
import threading
from collections.abc import Callable
from typing import Self

MISSION_ITEM_INT = 73


class Relay:
    """Passes datagrams on in both directions until ``on_item`` says stop; it is told the number of mission items so far.

    Attributes:
        port: where the ground station speaks to.
    """

    def __init__(self, vehicle_port: int, on_item: Callable[[int], None]) -> None:
        self._ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._ground.bind(("127.0.0.1", 0))
        self._vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle.connect(("127.0.0.1", vehicle_port))
        self._ground.setblocking(False)
        self._vehicle.setblocking(False)  # select may tell of an error that a send has taken in between
        self.port: int = self._ground.getsockname()[1]
        self._on_item = on_item
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._ground.close()
        self._vehicle.close()

    def _run(self) -> None:
        ground, items = None, 0
        while not self._stop.is_set():
            for ready in select.select([self._ground, self._vehicle], [], [], 0.05)[0]:
                try:
                    data, position = ready.recvfrom(65535)
                    if ready is self._ground:
                        ground = position
                        if data[0] == 0xFD and int.from_bytes(data[7:10], "little") == MISSION_ITEM_INT:
                            items += 1
                            self._on_item(items)
                        self._vehicle.send(data)
                    elif ground is not None:
                        self._ground.sendto(data, ground)
                except (ConnectionError, BlockingIOError):
                    continue  # the vehicle is gone
