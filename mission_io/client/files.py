"""Files and flight logs of a vehicle: several pending requests, and interrupted transfers continue."""

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from mission_io.autopilots.mission_lists import MissionList
from mission_io.client.client import Client
from mission_io.client.connection import Connection, Progress, Stop
from mission_io.client.transfer_outcome import ReadBack
from mission_io.errors import (
    FormatError,
    MisuseError,
    TransferCancelledError,
    TransferError,
    TransferSilentError,
    VehicleHolds,
)
from mission_io.formats.wpl import dat_path, read_mission_dat, write_mission_dat
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.ftp_files import FtpDownload, FtpUpload
from mission_io.protocol.ftp_transfer import FtpEntry, FtpListing, FtpState, FtpTransfer
from mission_io.protocol.timing import CALLS, FILES
from mission_io.wire import messages as m
from mission_io.wire.messages import Address, Message, Received

TransferT = TypeVar("TransferT", bound=FtpTransfer)


class _Files(Generic[TransferT]):
    """Carries transfers one at a time, and keeps the interrupted ones."""

    def __init__(self, client: Client, *, window: int = CALLS.ardupilot_window, silent_s: float = 30.0) -> None:
        if window < 1 or not silent_s > 0.0:
            raise MisuseError(f"window and silent_s must be greater than 0, not {window} and {silent_s}")
        self._client, self._window, self._silent_s = client, window, silent_s
        self._unfinished: dict[str, TransferT] = {}

    def _carry(
        self,
        transfer: FtpTransfer,
        name: str,
        done: Callable[[], tuple[int, int]],
        *,
        progress: Progress | None = None,
        stop: Stop | None = None,
    ) -> None:
        """Run a transfer to its end.

        Raises:
            TransferCancelledError: ``stop`` returned True.
        """
        client = self._client
        pump = _Pump(transfer, client.vehicle.address)
        client.services.append(pump)
        reported = (-1, -1)
        try:
            while not transfer.finished:
                if stop is not None and stop():
                    across, total = done()
                    raise TransferCancelledError(
                        f"{name}: stopped after {across} of {total} bytes", vehicle_holds="unknown"
                    )
                wake = transfer.next_timer()
                client.poll(0.0 if wake is None else min(1.0, max(0.0, wake - client.clock.now())))
                if progress is not None and done() != reported:
                    reported = done()
                    progress(*reported)
        finally:
            client.services.remove(pump)

    def _check_done(self, transfer: FtpTransfer, name: str, how_far: str, vehicle_holds: VehicleHolds) -> None:
        """Nothing for a transfer that is done; the error for another end."""
        if transfer.state is FtpState.DONE:
            return
        kind = TransferSilentError if transfer.state is FtpState.SILENT else TransferError
        text = f"{name}: {transfer.state.value} ({transfer.why}){how_far}{self._client.signing_advice()}"
        raise kind(text, vehicle_holds=vehicle_holds)


class _Pump:
    """A transfer as a service of a connection."""

    def __init__(self, transfer: FtpTransfer, to: Address) -> None:
        self._transfer, self._to = transfer, to

    def receive(self, received: Received, now: float) -> None:
        """Take an answer of the vehicle."""
        if isinstance(received.message, m.FileTransfer) and received.sender == self._to:
            self._transfer.receive(received.message.payload, now)

    def messages_to_send(self, now: float) -> list[m.FileTransfer]:
        """The requests that are due."""
        return [m.FileTransfer(*self._to, message.encoded()) for message in self._transfer.messages_to_send(now)]

    def next_timer(self) -> float | None:
        """When the next is due."""
        return self._transfer.next_timer()


class FileUploads(_Files[FtpUpload]):
    """Uploads files to the vehicle of a client; an interrupted one continues where it stopped.

    Args:
        client: Connected.
        window: Requests on the way at once.
        silent_s: Silence after which an upload is given up.
    """

    def upload(self, path: str, content: bytes, *, progress: Progress | None = None, stop: Stop | None = None) -> None:
        """Upload a file and compare its CRC; after an error, the same call continues where it stopped.

        Args:
            path: Where the vehicle keeps it; the folder exists there.
            content: Its bytes.
            progress: Called with the bytes that are across, and the total.
            stop: Polled; True leaves the upload as it is.

        Raises:
            TransferSilentError: the vehicle stopped answering.
            TransferCancelledError: ``stop`` returned True.
            TransferError: the vehicle refused, or what arrived has another CRC.
        """
        upload = FtpUpload(
            path, content, now=self._client.clock.now(), window=self._window, silent_s=self._silent_s,
            resume=self._unfinished.get(path),
        )  # fmt: skip
        self._unfinished[path] = upload
        self._run(upload, progress, stop)
        del self._unfinished[path]

    def upload_list(
        self,
        content: MissionList,
        *,
        progress: Progress | None = None,
        stop: Stop | None = None,
        in_flight: bool = False,
    ) -> ReadBack:
        """Upload one of ArduPilot's lists as one file, read it back item by item and compare.

        ArduPilot takes the list when the file is closed and never says that it refused an item: a mission ends there then,
        with the old one gone. Only reading back shows it, and ``Client.upload_and_verify`` says which item and why.

        Args:
            content: The list that the vehicle should hold.
            progress: Called with the bytes that are across, and the total.
            stop: Polled; True leaves the upload as it is.
            in_flight: Allow an upload to an armed vehicle.

        Raises:
            MisuseError: the autopilot has no lists as files, or as for ``Client.upload_and_verify``; nothing was sent.
            TransferError: as for ``upload`` and ``Client.download``.
        """
        client = self._client
        if not client.vehicle.autopilot.lists_as_files:
            raise MisuseError(f"{client.vehicle.autopilot.name} does not provide its lists as files; nothing was sent")

        def carry(mission_type: MissionType, items: Sequence[MissionItem]) -> None:
            upload = FtpUpload(
                dat_path(mission_type), write_mission_dat(items, mission_type), now=client.clock.now(),
                window=self._window, silent_s=self._silent_s, readable=False,
            )  # fmt: skip
            self._run(upload, progress, stop)

        return client.upload_and_verify(content, stop=stop, in_flight=in_flight, carry=carry)

    def _run(self, upload: FtpUpload, progress: Progress | None, stop: Stop | None) -> None:
        name, size = f"upload of {upload.path}", len(upload.content)
        self._carry(upload, name, lambda: (upload.across_bytes, size), progress=progress, stop=stop)
        self._check_done(upload, name, f" after {upload.across_bytes} of {size} bytes", "unknown")


class FileDownloads(_Files[FtpDownload]):
    """Lists folders of a client's vehicle and downloads files; an interrupted download continues where it stopped.

    Args:
        client: Connected.
        window: Single reads on the way at once.
        silent_s: Time without new data after which a download is given up.
    """

    def entries(self, path: str) -> list[FtpEntry]:
        """Entries of a folder: folders first, by name.

        Raises:
            TransferSilentError: the vehicle stopped answering.
            TransferError: the vehicle refused, or its answers make no sense.
        """
        listing = FtpListing(path, now=self._client.clock.now(), silent_s=self._silent_s)
        self._carry(listing, f"list of {path}", lambda: (0, 0))
        self._check_done(listing, f"list of {path}", "", "unchanged")
        return listing.entries

    def download(self, path: str, *, progress: Progress | None = None, stop: Stop | None = None) -> bytes:
        """Download a file and compare its CRC; after an error, the same call continues where it stopped.

        Args:
            path: Where the vehicle keeps it.
            progress: Called with the bytes that are here, and the total as the vehicle announces it.
            stop: Polled; True leaves the download as it is.

        Raises:
            TransferSilentError: nothing new came.
            TransferCancelledError: ``stop`` returned True.
            TransferError: the vehicle refused, or what arrived has another CRC.
        """
        download = FtpDownload(
            path, now=self._client.clock.now(), window=self._window, silent_s=self._silent_s,
            resume=self._unfinished.get(path),
        )  # fmt: skip
        self._unfinished[path] = download
        name = f"download of {path}"
        self._carry(download, name, lambda: (download.across_bytes, download.total_bytes), progress=progress, stop=stop)
        if download.state in (FtpState.DONE, FtpState.DIFFERS):
            del self._unfinished[path]
        how_far = f" after {download.across_bytes} of {download.total_bytes} bytes"
        self._check_done(download, name, how_far, "unchanged")
        return download.content

    def mission_items(self, mission_type: MissionType, *, progress: Progress | None = None) -> list[MissionItem]:
        """One of ArduPilot's lists, downloaded as one file; the same items as ``Client.download`` gives.

        Raises:
            FormatError: the file is not a valid mission file.
            TransferError: as for ``download``; other autopilots have no such file.
        """
        path = dat_path(mission_type)
        content = self.download(path, progress=progress)
        try:
            return read_mission_dat(content, mission_type)
        except FormatError as error:
            raise FormatError(error.what, where=error.where or path, advice=error.advice) from None


# Flight logs: listed and downloaded over the same link; only lost parts are repeated.
#
# A vehicle sends one stretch of a log at a time (LOG_REQUEST_DATA, LOG_DATA), and a new request replaces the one before. The
# rest of the log is requested first; when it runs dry, each gap in turn.

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
        entry: m.LogEntry,  # the log
        *,
        vehicle: Address,  # whose it is
        now: float,  # the present time in seconds
        silent_s: float,  # time without new bytes after which it gives up
        # a download of the same log that gave up: its bytes are not requested again
        resume: "LogDownload | None" = None,
    ) -> None:
        self.entry, self.silent, self.cancelled = entry, False, False
        self._vehicle, self._silent_s = vehicle, silent_s
        self._bytes = bytearray(entry.size_bytes)
        self._here = bytearray(-(-entry.size_bytes // m.LOG_DATA_BYTES))
        """For each piece of 90 bytes 1 when it is here."""
        self._here_bytes = 0
        if resume is not None and (resume.entry.log_id, resume.entry.size_bytes) == (entry.log_id, entry.size_bytes):
            self._bytes, self._here, self._here_bytes = resume._bytes, resume._here, resume._here_bytes
        self._first_gap = self._here.find(0)
        self._new_at = now
        self._requested_to: int | None = None
        self._requested_at = now
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
        if not isinstance(data, m.LogData) or data.log_id != self.entry.log_id or received.sender != self._vehicle:
            return
        piece, odd = divmod(data.offset_bytes, m.LOG_DATA_BYTES)
        expected = min(m.LOG_DATA_BYTES, self.entry.size_bytes - data.offset_bytes)
        if odd or piece >= len(self._here) or self._here[piece]:
            return
        if not expected <= data.count <= m.LOG_DATA_BYTES:  # no piece has more
            return
        self._bytes[data.offset_bytes : data.offset_bytes + expected] = data.content[:expected]
        self._here[piece] = 1
        self._here_bytes += expected
        self._new_at = now
        if piece == self._first_gap:
            self._first_gap = self._here.find(0, piece)
        if self._requested_to is not None and (self._first_gap < 0 or self._first_gap >= self._requested_to):
            self._requested_to = None  # the stretch is complete: request the next at once

    def messages_to_send(self, now: float) -> list[Message]:
        """Messages due at ``now``."""
        if not self._over and now >= self._new_at + self._silent_s:
            self.silent = True
        if self._over:
            done, self._ended = self._ended, True
            return [] if done else [m.LogRequestEnd(*self._vehicle)]
        if self._requested_to is not None and now < self._quiet_until:
            return []
        end = self._here.find(1, self._first_gap)
        end = min(len(self._here) if end < 0 else end, self._first_gap + _MOST_BYTES // m.LOG_DATA_BYTES)
        self._requested_to, self._requested_at = end, now
        start_bytes = self._first_gap * m.LOG_DATA_BYTES
        wanted = min(end * m.LOG_DATA_BYTES, self.entry.size_bytes) - start_bytes
        return [m.LogRequestData(*self._vehicle, self.entry.log_id, start_bytes, wanted)]

    @property
    def _quiet_until(self) -> float:
        return max(self._new_at, self._requested_at) + FILES.quiet_s

    def next_timer(self) -> float | None:
        """Time of the next call without a message; None if it needs none."""
        if self.finished:
            return None
        if self._over or self._requested_to is None:
            return self._new_at
        return min(self._quiet_until, self._new_at + self._silent_s)


def list_flight_logs(connection: Connection, *, timeout_s: float = 10.0) -> tuple[m.LogEntry, ...]:
    """List the vehicle's logs in the order of their numbers. Lost entries are requested again.

    Raises:
        VehicleSilentError: the list was not complete within ``timeout_s`` seconds.
    """
    found: dict[int, m.LogEntry] = {}
    none = m.LogEntry(0, 0, 0, 0, 0)
    latest = none

    def is_whole(received: Received) -> bool:
        nonlocal latest
        entry = received.message
        if isinstance(entry, m.LogEntry):
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
        connection.send(m.LogRequestList(*connection.vehicle.address, first, last))

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

    def download(self, entry: m.LogEntry, *, progress: Progress | None = None, stop: Stop | None = None) -> bytes:
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
            resume=self._unfinished.get(entry.log_id),
        )  # fmt: skip
        self._unfinished[entry.log_id] = download
        connection.run(download, download.counts, progress=progress, stop=stop)
        if download.whole:
            del self._unfinished[entry.log_id]
            return download.content
        here, total = download.counts()
        log, how_far = f"log {entry.log_id}", f"after {here} of {total} bytes"
        if download.cancelled:
            raise TransferCancelledError(f"{log}: stopped {how_far}", vehicle_holds="unchanged")
        who = f"{log}: vehicle {connection.vehicle.system_id}"
        raise TransferSilentError(f"{who} stopped answering {how_far}", vehicle_holds="unchanged")
