"""What a link is to everything above it."""

from typing import Protocol, runtime_checkable

from mission_io.clock import Clock
from mission_io.framing import FramingCounts


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
class StreamLink(Protocol):
    """A link that cuts a stream of bytes into frames itself, and so is the one that sees the garbage."""

    @property
    def framing(self) -> FramingCounts:
        """What of the stream was no frame."""
        ...
