"""The interface of a link as the rest of the package sees it, its clock, and links around another one that log all they carry.

In a telemetry log (``.tlog``), the format of ground stations, each frame follows the time of day at which it was sent or
received: microseconds since 1970-01-01 UTC as an unsigned 64-bit number, big-endian. Bytes between frames are left out. Where the
lengths in a datagram add up, as in nearly every one, checksums are left to the readers of the log.
"""

import contextlib
import os
import socket
import time
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self, runtime_checkable

from mission_io.errors import LinkError
from mission_io.wire.framing import FramingCounts, frames_by_length, frames_of
from mission_io.wire.signing import SystemClock, UnixClock

DEFAULT_HOST: Final = "127.0.0.1"
DEFAULT_BAUD: Final = 57_600
"""What telemetry radios come with; a flight controller's own USB takes any."""


class Clock(Protocol):
    """Seconds from an arbitrary start that never go back."""

    def now(self) -> float:
        """The present time in seconds."""
        ...


class MonotonicClock:
    """The operating system's monotonic clock."""

    def now(self) -> float:
        """The present time in seconds; only differences mean something."""
        return time.monotonic()


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


FLUSH_S: Final = 0.2
"""What was written reaches the operating system at least so often: a killed process loses no more."""


class TelemetryLogWriter(Closing):
    """Writes one log. A context manager.

    A log that cannot be written any more, for instance because the disk is full, is no reason to let go of a vehicle: it ends
    there, and ``error`` says why.

    Args:
        path: the file; one that is there is replaced.
        clock: the time of day; None takes the operating system's.
        flush_clock: times the flushes; None takes the monotonic clock.

    Attributes:
        path: where the file is.
        frames: how many are in it.
        error: why the log ended early; None as long as it goes on.

    Raises:
        LinkError: the file cannot be made.
    """

    def __init__(self, path: Path, *, clock: UnixClock | None = None, flush_clock: Clock | None = None) -> None:
        self.path = path
        self.frames = 0
        self.error: str | None = None
        self._clock = clock if clock is not None else SystemClock()
        self._flush_clock = flush_clock if flush_clock is not None else MonotonicClock()
        self._flushed_s = self._flush_clock.now()
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise LinkError(f"{path}: the telemetry log cannot be written: {error.strerror}") from None

    def write(self, data: bytes) -> None:
        """Write the frames in a datagram, as of now."""
        if self.error is not None:
            return
        frames = frames_by_length(data) or [frame.data for frame in frames_of(data)]
        stamp = round(self._clock.unix_s() * 1e6).to_bytes(8, "big")
        try:
            for frame in frames:
                self._file.write(stamp + frame)
            self.frames += len(frames)
            self._flush()
        except (OSError, ValueError) as error:
            self._give_up(error)

    def keep_up(self) -> None:
        """Let what was written reach the operating system, when it is time; to be called while nothing arrives."""
        if self.error is None:
            try:
                self._flush()
            except (OSError, ValueError) as error:
                self._give_up(error)

    def move_to(self, path: Path) -> None:
        """Give the file another name, and go on in it."""
        if self.error is not None:
            return
        try:
            self._file.close()  # some systems do not rename an open file
            os.replace(self.path, path)
            self.path = path
            self._file = path.open("ab")
        except OSError as error:
            self._give_up(error)

    def close(self) -> None:
        """Close the file; closing twice is fine."""
        try:
            self._file.close()
        except OSError as error:
            self._give_up(error)

    def _flush(self) -> None:
        if (now := self._flush_clock.now()) - self._flushed_s >= FLUSH_S:
            self._flushed_s = now
            self._file.flush()

    def _give_up(self, error: OSError | ValueError) -> None:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        self.error = f"{self.path}: the telemetry log ends after {self.frames} frames: {reason}"
        with contextlib.suppress(OSError):
            self._file.close()


class LoggedLink(WrappingLink):
    """A :class:`~mission_io.links.base.Link` that writes its datagrams into a log, from ``log_to`` on."""

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self._log: TelemetryLogWriter | None = None

    def log_to(self, log: TelemetryLogWriter | None) -> None:
        """Write all that is heard and sent from here on into a log, or no longer into any."""
        self._log = log

    @property
    def framing(self) -> FramingCounts:
        """Bytes of a stream that were no frame; none for a link of datagrams."""
        return framing_of(self._link)

    def send(self, data: bytes) -> None:
        """Send one datagram."""
        self._link.send(data)
        if self._log is not None:
            self._log.write(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram, or None after ``timeout_s`` seconds."""
        data = self._link.receive(timeout_s)
        if self._log is not None:
            if data is None:
                self._log.keep_up()
            else:
                self._log.write(data)
        return data
