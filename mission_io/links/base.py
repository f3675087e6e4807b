"""The interface of a link, as the rest of the package sees it."""

from typing import Protocol, runtime_checkable

from mission_io.clock import Clock
from mission_io.wire.framing import FramingCounts


class Link(Protocol):
    """Carries datagrams, unreliably. Its clock is the one that its time-outs are measured with."""

    @property
    def clock(self) -> Clock:
        """The clock that ``receive`` waits by; simulated links have their own."""
        ...

    def send(self, data: bytes) -> None:
        """Send one datagram; it may get lost without a word."""
        ...

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None when none came within ``timeout_s`` seconds."""
        ...

    def close(self) -> None:
        """Let go of the port; closing twice is fine."""
        ...


@runtime_checkable
class PeerLink(Protocol):
    """A link on which others than the vehicle may speak, too, and that can be told to hear it alone."""

    def keep_to(self, system_id: int, component_id: int) -> None:
        """Hear and speak to this sender's place only."""
        ...

    def let_go(self) -> None:
        """Hear everybody again."""
        ...


class WrappingLink:
    """What links that stand around another one pass on to it.

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
        """Hear and speak to this sender's place only, where the link inside can."""
        if isinstance(self._link, PeerLink):
            self._link.keep_to(system_id, component_id)

    def let_go(self) -> None:
        """Hear everybody again."""
        if isinstance(self._link, PeerLink):
            self._link.let_go()

    def close(self) -> None:
        """Close the link inside."""
        self._link.close()


@runtime_checkable
class StreamLink(Protocol):
    """A link that cuts a stream of bytes into frames itself, and so is the one that sees the garbage."""

    @property
    def framing(self) -> FramingCounts:
        """What of the stream was no frame."""
        ...
