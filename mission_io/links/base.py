"""The interface of a link, as the rest of the package sees it."""

import socket
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Final, Protocol, Self, runtime_checkable

from mission_io.clock import Clock
from mission_io.errors import LinkError
from mission_io.wire.framing import FramingCounts

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_BAUD: Final = 57_600
"""What telemetry radios come with; a flight controller's own USB takes any."""


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


class Closing(ABC):
    """Something open; a context manager that closes it."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @abstractmethod
    def close(self) -> None:
        """Let go of it; may be called twice."""


def port_of(sock: socket.socket) -> int:
    """The port that a socket is bound to. Raises LinkError: it is closed."""
    try:
        port: int = sock.getsockname()[1]
    except OSError as error:
        raise LinkError(f"the link is closed: {error}") from None
    return port


class WrappingLink:
    """Base of links that wrap another one."""

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


def framing_of(link: Link) -> FramingCounts:
    """Counts of bytes of a stream that were no frames; none for a link of datagrams."""
    return link.framing if isinstance(link, StreamLink) else FramingCounts()
