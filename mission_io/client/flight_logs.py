"""The flight logs of a vehicle: listed and downloaded over the same link; only lost parts are repeated.

A vehicle sends one stretch of a log at a time (LOG_REQUEST_DATA, LOG_DATA), and a new request replaces the one before. The rest
of the log is requested first; when it runs dry, each gap in turn.
"""

from collections.abc import Callable

from mission_io.client.connection import Connection, Progress, Stop
from mission_io.errors import TransferCancelledError, TransferSilentError
from mission_io.protocol.timing import CALLS, FILES
from mission_io.wire.messages import (
    LOG_DATA_BYTES,
    Address,
    LogData,
    LogEntry,
    LogRequestData,
    LogRequestEnd,
    LogRequestList,
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


def list_flight_logs(connection: Connection, *, timeout_s: float = 10.0) -> tuple[LogEntry, ...]:
    """List the vehicle's logs in the order of their numbers. Lost entries are requested again.

    Raises:
        VehicleSilentError: the list was not complete within ``timeout_s`` seconds.
    """
    found: dict[int, LogEntry] = {}
    none = LogEntry(0, 0, 0, 0, 0)
    latest = none

    def is_whole(received: Received) -> bool:
        nonlocal latest
        entry = received.message
        if isinstance(entry, LogEntry):
            latest = entry
            if entry.log_count == 0:
                return True
            found[entry.log_id] = entry
            return len(found) >= entry.log_count
        return False

    def ask(_: int) -> None:
        numbers = range(latest.last_log_id - latest.log_count + 1, latest.last_log_id + 1)
        missing = [number for number in numbers if number not in found] if found else []
        first, last = (missing[0], missing[-1]) if missing and missing[0] >= 0 else (0, 65535)
        connection.send(LogRequestList(*connection.vehicle.address, first, last))

    connection.wait_until(is_whole, timeout_s=timeout_s, what="its list of logs", again=ask, again_s=CALLS.list_again_s)
    return tuple(found[number] for number in sorted(found))


class FlightLogDownloads:
    """Downloads logs of a connection's vehicle; an interrupted one continues where it stopped.

    Args:
        connection: With the vehicle.
        silent_s: Time without new bytes after which a download is given up.
    """

    def __init__(self, connection: Connection, *, silent_s: float = 30.0) -> None:
        self._connection, self._silent_s = connection, silent_s
        self._unfinished: dict[int, LogDownload] = {}

    def download(self, entry: LogEntry, *, progress: Progress | None = None, stop: Stop | None = None) -> bytes:
        """Download the bytes of a log; after an error, the same call continues where it stopped.

        Args:
            entry: One of ``list_flight_logs``.
            progress: Called with the bytes received and the total.
            stop: Polled; True ends it.

        Raises:
            TransferSilentError: no new bytes for ``silent_s`` seconds; the message says how much had arrived.
            TransferCancelledError: ``stop`` returned True.
        """
        connection = self._connection
        download = LogDownload(
            entry, vehicle=connection.vehicle.address, now=connection.clock.now(), silent_s=self._silent_s,
            resume=self._unfinished.pop(entry.log_id, None),
        )  # fmt: skip
        if not download.whole:
            self._unfinished[entry.log_id] = download
        connection.run(download, download.counts, progress=progress, stop=stop)
        if download.whole:
            self._unfinished.pop(entry.log_id, None)
            return download.content
        here, total = download.counts()
        who = f"log {entry.log_id}: vehicle {connection.vehicle.system_id}"
        if download.cancelled:
            raise TransferCancelledError(
                f"log {entry.log_id}: stopped after {here} of {total} bytes", vehicle_holds="unchanged"
            )
        raise TransferSilentError(f"{who} stopped answering after {here} of {total} bytes", vehicle_holds="unchanged")


def download_flight_log(
    connection: Connection,
    entry: LogEntry,
    *,
    progress: Callable[[int, int], None] | None = None,
    timeout_s: float = 30.0,
) -> bytes:
    """Download the bytes of a log once; see ``FlightLogDownloads`` for one that continues after an error.

    Args:
        connection: With the vehicle.
        entry: One of ``list_flight_logs``.
        progress: Called with the bytes received and the total.
        timeout_s: Time without new bytes after which it is given up.

    Raises:
        TransferSilentError: the vehicle fell silent; the message says how much had arrived.
    """
    return FlightLogDownloads(connection, silent_s=timeout_s).download(entry, progress=progress)
