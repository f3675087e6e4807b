"""The tests' vehicle on a real link of this machine, in a thread."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from mission_io.links.datagrams import Link
from tests.mission_io.vehicle import VehiclePeer


@contextmanager
def flying_on(link: Link, peer: VehiclePeer) -> Iterator[VehiclePeer]:
    """Run a vehicle on a link until the block ends."""
    stop = threading.Event()

    def loop() -> None:
        while not stop.is_set():
            for data in peer.datagrams_to_send(time.monotonic()):
                link.send(data)
            timer = peer.next_timer()
            wait = 0.02 if timer is None else min(0.02, max(0.0, timer - time.monotonic()))
            data_in = link.receive(wait)
            if data_in is not None:
                peer.receive_datagram(data_in, time.monotonic())

    thread = threading.Thread(target=loop, daemon=True)
    thread.start()
    try:
        yield peer
    finally:
        stop.set()
        thread.join(60.0)
        link.close()
