"""The flight logs that a vehicle keeps: listed and downloaded over the same link; lost pieces are requested again."""

from collections.abc import Callable

from mission_io.client.connection import Connection
from mission_io.errors import TransferSilentError, VehicleSilentError
from mission_io.wire.messages import LogData, LogEntry, LogRequestData, LogRequestEnd, LogRequestList, Received

_LIST_AGAIN_S = 1.0
_QUIET_S = 0.5
"""After this long without new bytes, missing ones are requested again."""
_PIECE_BYTES = 90 * 256


def list_flight_logs(connection: Connection, *, timeout_s: float = 10.0) -> tuple[LogEntry, ...]:
    """List the vehicle's logs in the order of their numbers.

    Raises:
        VehicleSilentError: the list was not complete within ``timeout_s`` seconds.
    """
    to = connection.vehicle
    found: dict[int, LogEntry] = {}

    def is_whole(received: Received) -> bool:
        entry = received.message
        if isinstance(entry, LogEntry):
            if entry.log_count == 0:
                return True
            found[entry.log_id] = entry
            return len(found) >= entry.log_count
        return False

    connection.wait_until(
        is_whole,
        timeout_s=timeout_s,
        what="its list of logs",
        again=lambda _: connection.send(LogRequestList(to.system_id, to.component_id)),
        again_s=_LIST_AGAIN_S,
    )
    return tuple(found[number] for number in sorted(found))


def download_flight_log(
    connection: Connection,
    entry: LogEntry,
    *,
    progress: Callable[[int, int], None] | None = None,
    timeout_s: float = 30.0,
) -> bytes:
    """Download the bytes of a log.

    Args:
        connection: With the vehicle.
        entry: One of ``list_flight_logs``.
        progress: Called with the bytes received and the total.
        timeout_s: Longest time for a piece of 23,040 bytes, which takes 4 s at 57,600 baud.

    Raises:
        TransferSilentError: a piece took longer; the message says how much had arrived.
    """
    content = bytearray()
    try:
        while len(content) < entry.size_bytes:
            content += _piece(connection, entry, len(content), timeout_s)
            if progress is not None:
                progress(len(content), entry.size_bytes)
    except VehicleSilentError:
        raise TransferSilentError(
            f"log {entry.log_id}: vehicle {connection.vehicle.system_id} fell silent after {len(content)} of "
            f"{entry.size_bytes} bytes",
            vehicle_holds="unchanged",
        ) from None
    finally:
        to = connection.vehicle
        connection.send(LogRequestEnd(to.system_id, to.component_id))
    return bytes(content)


def _piece(connection: Connection, entry: LogEntry, start: int, timeout_s: float) -> bytes:
    """Some bytes from ``start`` on, without gaps."""
    size = min(_PIECE_BYTES, entry.size_bytes - start)
    parts: dict[int, bytes] = {}
    whole_to = start
    heard_at = connection.clock.now()

    def ask() -> None:
        nonlocal heard_at
        heard_at = connection.clock.now()
        to = connection.vehicle
        wanted = start + size - whole_to
        connection.send(LogRequestData(to.system_id, to.component_id, entry.log_id, whole_to, wanted))

    def is_new(data: LogData) -> bool:
        return bool(data.content) and start <= data.offset_bytes < start + size and data.offset_bytes not in parts

    def is_whole(received: Received) -> bool:
        nonlocal heard_at, whole_to
        data = received.message
        if isinstance(data, LogData) and data.log_id == entry.log_id and is_new(data):
            parts[data.offset_bytes] = data.content
            heard_at = connection.clock.now()
            while whole_to in parts:
                whole_to += len(parts[whole_to])
            return whole_to >= start + size
        if connection.clock.now() - heard_at > _QUIET_S:
            ask()
        return False

    ask()
    connection.wait_until(is_whole, timeout_s=timeout_s, what=f"log {entry.log_id}")
    whole = bytearray()
    while len(whole) < size:
        whole += parts[start + len(whole)]
    return bytes(whole[:size])
