"""What the tests of TCP and serial links share: frames to send, and receiving until so many came."""

from mission_io.links.datagrams import Link
from mission_io.wire.codec import Codec
from mission_io.wire.messages import MissionItemReached

PATIENCE_S = 10.0
"""Only a broken test waits for so long."""


def frames(count: int, *, system_id: int = 1) -> list[bytes]:
    sender = Codec(system_id=system_id, component_id=1)
    return [sender.encode(MissionItemReached(number)) for number in range(count)]


def received(link: Link, count: int) -> list[bytes]:
    found = []
    while len(found) < count:
        data = link.receive(PATIENCE_S)
        assert data is not None
        found.append(data)
    return found
