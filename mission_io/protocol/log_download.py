"""Download of a log (LOG_REQUEST_DATA, LOG_DATA) as a state machine: only lost parts are repeated.

A vehicle sends one stretch at a time, and a new request replaces the one before. The rest of the log is requested first;
when it runs dry, each gap in turn.
"""

from mission_io.protocol.timing import FILES
from mission_io.wire.messages import (
    LOG_DATA_BYTES,
    Address,
    LogData,
    LogEntry,
    LogRequestData,
    LogRequestEnd,
    Message,
    Received,
)

_MOST_BYTES = 90 * 4096
"""Of one request: a vehicle may not send more than it can drop halfway."""


class LogDownload:
    """One log on its way from a vehicle; sans-IO.

    Attributes:
        silent: Whether it gave up.
        cancelled: Whether this side stopped it.
    """

    def __init__(
        self,
        entry: LogEntry,  # the log
        *,
        vehicle: Address,  # whose it is
        now: float,  # the present time in seconds
        silent_s: float = 30.0,  # time without new bytes after which it gives up
        # a download of the same log that gave up: its bytes are not requested again
        resume: "LogDownload | None" = None,
    ) -> None:
        self.entry, self.silent, self.cancelled = entry, False, False
        self._vehicle, self._silent_s = vehicle, silent_s
        self._bytes = bytearray(entry.size_bytes)
        self._here = bytearray(-(-entry.size_bytes // LOG_DATA_BYTES))
        """For each piece of 90 bytes 1 when it is here."""
        self._here_bytes = 0
        if resume is not None and (resume.entry.log_id, resume.entry.size_bytes) == (entry.log_id, entry.size_bytes):
            self._bytes, self._here, self._here_bytes = resume._bytes, resume._here, resume._here_bytes
        self._first_gap = self._here.find(0)
        self._new_at = now
        self._asked_to: int | None = None
        self._asked_at = now
        self._ended = False

    @property
    def finished(self) -> bool:
        """Whether it is over, and the vehicle has received its end."""
        return self._over and self._ended

    @property
    def _over(self) -> bool:
        return self._first_gap < 0 or self.silent or self.cancelled

    @property
    def whole(self) -> bool:
        """Whether every byte is here."""
        return self._first_gap < 0

    @property
    def content(self) -> bytes:
        """The bytes; zeros where some are missing."""
        return bytes(self._bytes)

    def counts(self) -> tuple[int, int]:
        """Number of received bytes, and of all bytes."""
        return self._here_bytes, self.entry.size_bytes

    def cancel(self, now: float) -> None:
        """Stop; the vehicle receives LOG_REQUEST_END."""
        del now
        self.cancelled = True

    def receive(self, received: Received, now: float) -> None:
        """Take a message; those about anything else have no effect."""
        data = received.message
        if not isinstance(data, LogData) or data.log_id != self.entry.log_id:
            return
        if received.sender != self._vehicle:
            return
        piece, odd = divmod(data.offset_bytes, LOG_DATA_BYTES)
        expected = min(LOG_DATA_BYTES, self.entry.size_bytes - data.offset_bytes)
        if odd or piece >= len(self._here) or self._here[piece]:
            return
        if not expected <= data.count <= LOG_DATA_BYTES:  # no piece has more
            return
        self._bytes[data.offset_bytes : data.offset_bytes + expected] = data.content[:expected]
        self._here[piece] = 1
        self._here_bytes += expected
        self._new_at = now
        if piece == self._first_gap:
            self._first_gap = self._here.find(0, piece)
        if self._asked_to is not None and (self._first_gap < 0 or self._first_gap >= self._asked_to):
            self._asked_to = None  # the stretch is whole: ask for the next at once

    def messages_to_send(self, now: float) -> list[Message]:
        """Messages due at ``now``."""
        if not self._over and now >= self._new_at + self._silent_s:
            self.silent = True
        if self._over:
            done, self._ended = self._ended, True
            return [] if done else [LogRequestEnd(*self._vehicle)]
        if self._asked_to is not None and now < self._quiet_until:
            return []
        end = self._here.find(1, self._first_gap)
        end = min(len(self._here) if end < 0 else end, self._first_gap + _MOST_BYTES // LOG_DATA_BYTES)
        self._asked_to, self._asked_at = end, now
        start_bytes = self._first_gap * LOG_DATA_BYTES
        wanted = min(end * LOG_DATA_BYTES, self.entry.size_bytes) - start_bytes
        return [LogRequestData(*self._vehicle, self.entry.log_id, start_bytes, wanted)]

    @property
    def _quiet_until(self) -> float:
        return max(self._new_at, self._asked_at) + FILES.quiet_s

    def next_timer(self) -> float | None:
        """When it wants to be asked again; None when it is over."""
        if self.finished:
            return None
        if self._over or self._asked_to is None:
            return self._new_at
        return min(self._quiet_until, self._new_at + self._silent_s)
