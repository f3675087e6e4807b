"""The flight logs of a vehicle: listed and downloaded over the same link; only lost parts are repeated."""

from collections.abc import Callable

from mission_io.client.connection import Connection
from mission_io.client.running import Progress, Stop, run
from mission_io.errors import TransferCancelledError, TransferSilentError
from mission_io.protocol.log_download import LogDownload
from mission_io.protocol.timing import CALLS
from mission_io.wire.messages import LogEntry, LogRequestList, Received


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
        run(connection, download, download.counts, progress=progress, stop=stop)
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
