"""Files of a vehicle over MAVLink FTP: sent and read with a window, resumed, and compared by their CRC."""

from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from mission_io.autopilots.mission_lists import MissionList
from mission_io.client.client import Client
from mission_io.client.transfer_outcome import ReadBack
from mission_io.errors import (
    FormatError,
    MisuseError,
    TransferCancelledError,
    TransferError,
    TransferSilentError,
    VehicleHolds,
)
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.ftp_files import FtpDownload, FtpUpload
from mission_io.protocol.ftp_transfer import FtpEntry, FtpListing, FtpState, FtpTransfer
from mission_io.protocol.timing import CALLS
from mission_io.wire.messages import Address, FileTransfer, Received
from mission_io.wire.mission_items import dat_path, read_mission_dat, write_mission_dat

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
        progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
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
        if isinstance(received.message, FileTransfer) and received.sender == self._to:
            self._transfer.receive(received.message.payload, now)

    def messages_to_send(self, now: float) -> list[FileTransfer]:
        """The requests that are due."""
        return [FileTransfer(*self._to, message.encoded()) for message in self._transfer.messages_to_send(now)]

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

    def upload(
        self,
        path: str,
        content: bytes,
        *,
        progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
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
        progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
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

    def _run(
        self, upload: FtpUpload, progress: Callable[[int, int], None] | None, stop: Callable[[], bool] | None
    ) -> None:
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

    def download(
        self,
        path: str,
        *,
        progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> bytes:
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

    def mission_items(
        self, mission_type: MissionType, *, progress: Callable[[int, int], None] | None = None
    ) -> list[MissionItem]:
        """One of ArduPilot's lists, downloaded as one file; the same items as ``Client.download`` gives.

        Raises:
            FormatError: the file is not what it should be.
            TransferError: as for ``download``; other autopilots have no such file.
        """
        path = dat_path(mission_type)
        content = self.download(path, progress=progress)
        try:
            return read_mission_dat(content, mission_type)
        except FormatError as error:
            raise FormatError(error.what, where=error.where or path, advice=error.advice) from None
