"""The interface of a link, as the rest of the package sees it."""

from typing import Protocol, runtime_checkable

from mission_io.clock import Clock
from mission_io.wire.framing import FramingCounts


class Link(Protocol):
    """Carries datagrams, unreliably. Its time-outs are measured by its own clock."""

    @property
    def clock(self) -> Clock:
        """The clock that ``receive`` waits by; simulated links have their own."""
        ...

    def send(self, data: bytes) -> None:
        """Send one datagram, which may get lost silently."""
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none arrived within ``timeout_s`` seconds."""
        ...

    def close(self) -> None:
        """Release the port; may be called twice."""
        ...


@runtime_checkable
class PeerLink(Protocol):
    """A link with several peers that can be restricted to one."""

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Communicate with this sender's address only."""
        ...

    def let_go(self) -> None:
        """Communicate with everybody again."""
        ...


class WrappingLink:
    """Base of links that wrap another one.

    Args:
        link: the one inside.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    @property
    def clock(self) -> Clock:
        """The clock of the link inside."""
        return self._link.clock

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Communicate with this sender's address only, if the inner link can."""
        if isinstance(self._link, PeerLink):
            self._link.keep_to(system_id, component_id)

    def let_go(self) -> None:
        """Communicate with everybody again."""
        if isinstance(self._link, PeerLink):
            self._link.let_go()

    def close(self) -> None:
        """Close the link inside."""
        self._link.close()


@runtime_checkable
class StreamLink(Protocol):
    """A link that splits a byte stream into frames itself, and therefore counts the garbage."""

    @property
    def framing(self) -> FramingCounts:
        """Counts of bytes that were no frames."""
        ...
