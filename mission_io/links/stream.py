"""Frames over a byte stream: finds them in what arrives, and sends each of them whole or not at all."""

import select
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from typing import ClassVar, Final, Protocol

from mission_io.clock import Clock, MonotonicClock
from mission_io.errors import LinkError
from mission_io.links.base import Closing
from mission_io.wire.framing import Framer, FramingCounts

QUIET_S: Final = 0.5
"""Silence after which an apparent start of a long frame is given up if frames wait after it."""

SEND_BUFFER_BYTES: Final = 65_536
"""What waits to be sent to a peer that does not take it; frames that find no room are lost."""


class OpenChannel(ABC):
    """Something open that bytes go through, without waiting.

    Attributes:
        name: Name of the stream, for messages to people.
        end: What it means that nothing can be read any more.
    """

    end: ClassVar[str]

    def __init__(self, name: str) -> None:
        self.name = name

    @abstractmethod
    def fileno(self) -> int:
        """Its number, to wait for it; negative when it is closed."""

    @abstractmethod
    def receive(self, size: int) -> bytes:
        """Bytes that have arrived; none at the end. Raises OSError: it has gone, BlockingIOError: nothing has arrived."""

    @abstractmethod
    def send(self, data: bytes) -> int:
        """Send what can be sent at once; how many bytes. Raises OSError as ``receive``."""

    @abstractmethod
    def close(self) -> None:
        """Let go of it; closing twice is fine."""

    def read(self, size: int) -> bytes:
        """Bytes that have arrived; none when there are none. Raises LinkError when the other end has gone."""
        try:
            data = self.receive(size)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None
        if not data:
            raise self._gone(self.end)
        return data

    def write(self, data: bytes) -> int:
        """Send the bytes that can be sent at once; returns their number. Raises LinkError when the other end has gone."""
        try:
            return self.send(data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise self._gone(error.strerror or str(error)) from None

    def _gone(self, why: str) -> LinkError:
        if self.fileno() < 0:
            return LinkError(f"the link to {self.name} is closed")
        self.close()
        return LinkError(f"the connection to {self.name} was lost: {why}; open the link again when it is available")


class FramedChannel:
    """Frames in and out of one channel."""

    def __init__(self, channel: OpenChannel, clock: Clock) -> None:
        self.channel = channel
        self._clock = clock
        self._framer = Framer()
        self._waiting = bytearray()
        self._last_byte_s = clock.now()
        self.dropped_frames = 0

    @property
    def framing(self) -> FramingCounts:
        """Bytes that were no frame."""
        return self._framer.counts

    @property
    def has_to_send(self) -> bool:
        """Whether something waits until the channel takes it."""
        return bool(self._waiting)

    @property
    def quiet_at_s(self) -> float | None:
        """When to call ``frames_when_quiet`` if nothing arrives until then; None for not at all."""
        return self._last_byte_s + QUIET_S if self._framer.unfinished_bytes else None

    def take(self) -> list[bytes]:
        """The frames that are complete now; reads once."""
        data = self.channel.read(65_536)
        if data:
            self._last_byte_s = self._clock.now()
        return [frame.data for frame in self._framer.feed(data)]

    def frames_when_quiet(self) -> list[bytes]:
        """The frames behind one that does not end, when it has been quiet for ``QUIET_S``."""
        due = self.quiet_at_s
        if due is None or self._clock.now() < due:
            return []
        self._last_byte_s = self._clock.now()
        return [frame.data for frame in self._framer.end_if_frames_wait()]

    def put(self, frame: bytes) -> None:
        """Send a frame, part of it now and the rest later; without room for it, none of it."""
        self.flush()
        if len(self._waiting) + len(frame) > SEND_BUFFER_BYTES:
            self.dropped_frames += 1
            return
        self._waiting += frame
        self.flush()

    def flush(self) -> None:
        """Send waiting bytes, as far as possible without waiting."""
        while self._waiting:
            sent = self.channel.write(bytes(self._waiting))
            if sent == 0:
                return
            del self._waiting[:sent]


class ChannelLink(Closing):
    """A link over one channel for as long as that lasts; a context manager.

    When the other end goes away that is one LinkError; what had arrived before is delivered first.
    """

    def __init__(self, channel: OpenChannel, clock: Clock | None = None) -> None:
        self._clock = clock if clock is not None else MonotonicClock()
        self._framed = FramedChannel(channel, self._clock)
        self._frames: deque[bytes] = deque()

    @property
    def clock(self) -> Clock:
        """The operating system's monotonic clock."""
        return self._clock

    @property
    def framing(self) -> FramingCounts:
        """Bytes that were no frame."""
        return self._framed.framing

    @property
    def dropped_frames(self) -> int:
        """Frames that were not sent because the other end took nothing for too long."""
        return self._framed.dropped_frames

    def send(self, data: bytes) -> None:
        """Send a frame. Raises LinkError: the other end has gone, or the link is closed."""
        self._framed.put(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next frame, or None after ``timeout_s`` seconds.

        Raises:
            LinkError: the other end has gone, or the link is closed.
        """
        framed = self._framed
        deadline = self._clock.now() + timeout_s
        while not self._frames:
            wake = deadline if framed.quiet_at_s is None else min(deadline, framed.quiet_at_s)
            channel = framed.channel
            readable, writable = wait_for([channel], [channel] if framed.has_to_send else [], wake - self._clock.now())
            if writable:
                framed.flush()
            if readable:
                self._frames.extend(framed.take())
            else:
                self._frames.extend(framed.frames_when_quiet())
                if not self._frames and self._clock.now() >= deadline:
                    return None
        return self._frames.popleft()

    def close(self) -> None:
        """Let go of the channel; closing twice is fine."""
        self._framed.channel.close()


class _Open(Protocol):
    def fileno(self) -> int: ...


def wait_for(readers: Sequence[_Open], writers: Iterable[_Open], timeout_s: float) -> tuple[list[_Open], list[_Open]]:
    """Those that can be read and those that can be written, after at most ``timeout_s`` seconds.

    Raises:
        LinkError: one of them is closed.
    """
    try:
        readable, writable, _ = select.select(readers, list(writers), [], max(0.0, timeout_s))
    except (OSError, ValueError):
        raise LinkError("the link is closed") from None
    return readable, writable
