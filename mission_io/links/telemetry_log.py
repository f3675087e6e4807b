"""Telemetry logs (``.tlog``): everything that a link receives and sends, in the format of ground stations.

Each frame follows the time of day at which it was sent or received: microseconds since 1970-01-01 UTC as an unsigned 64-bit
number, big-endian. Bytes between frames are left out. Where the lengths in a datagram add up, as in nearly every one,
checksums are left to the readers of the log.
"""

import contextlib
import os
from pathlib import Path
from typing import Final

from mission_io.clock import Clock, MonotonicClock, SystemClock, UnixClock
from mission_io.errors import LinkError
from mission_io.links.base import Closing, Link, WrappingLink, framing_of
from mission_io.wire.framing import FramingCounts, frames_by_length, frames_of

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
