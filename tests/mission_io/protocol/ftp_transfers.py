"""How long a transfer by MAVLink FTP takes on a simulated link, compared with the time that the line needs.

The line's time is that of the frames that have to be sent: those of the file, each as often as loss makes it necessary at
the least, 1 / (1 - loss), at the line's rate. Loss is the same both ways, so that of 30 % of the pieces across the answer is
lost, too; every frame and answer in excess counts. A download's vehicle sends 500 pieces in a burst, as
ArduPilot does. The clock is simulated: results are the same on every machine."""

import math
import random

from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.protocol.ftp import DATA_BYTES, FtpServer
from mission_io.protocol.ftp_files import FtpDownload, FtpUpload
from mission_io.protocol.ftp_transfer import FtpState
from mission_io.wire.codec import Codec
from mission_io.wire.telemetry_messages import FileTransfer

_DELAY_S = 0.01
_BURST = 500
_PATH = "/APM/TERRAIN/N47E008.DAT"


class _Vehicle:
    """The other end: a server and its codec."""

    def __init__(self) -> None:
        self.server = FtpServer(burst=_BURST)
        self.sent = 0
        self._codec = Codec(system_id=1, component_id=1)
        self._out: list[bytes] = []

    def receive_datagram(self, data: bytes, *_: object) -> None:
        """Answer what arrives."""
        for received in self._codec.decode(data):
            if isinstance(received.message, FileTransfer):
                for payload in self.server.answer(received.message.payload):
                    self._out.append(self._codec.encode(FileTransfer(255, 190, payload)))

    def datagrams_to_send(self, *_: object) -> list[bytes]:
        """The answers."""
        out, self._out = self._out, []
        self.sent += sum(map(len, out))
        return out

    def next_timer(self) -> float | None:
        """It never begins to speak."""
        return None


def upload_s(content: bytes, *, loss: float, window: int, bytes_per_s: float, seed: int) -> tuple[float, float]:
    """Simulated seconds of an upload, and bytes sent in all.

    Raises:
        SystemExit: it failed, or other bytes arrived.
    """
    vehicle, link = _vehicle_and_link(loss=loss, bytes_per_s=bytes_per_s, seed=seed)
    upload = FtpUpload(_PATH, content, now=link.clock.now(), window=window)
    sent = _carry(upload, link)
    if upload.state is not FtpState.DONE or vehicle.server.files[upload.path] != content:
        raise SystemExit(f"failed: {upload.state.value} {upload.why}")
    return link.clock.now(), sent


def download_s(content: bytes, *, loss: float, window: int, bytes_per_s: float, seed: int) -> tuple[float, float]:
    """Simulated seconds of a download, and bytes that the vehicle sent.

    Raises:
        SystemExit: it failed, or other bytes arrived.
    """
    vehicle, link = _vehicle_and_link(loss=loss, bytes_per_s=bytes_per_s, seed=seed)
    vehicle.server.files[_PATH] = bytearray(content)
    download = FtpDownload(_PATH, now=link.clock.now(), window=window)
    _carry(download, link)
    if download.state is not FtpState.DONE or download.content != content:
        raise SystemExit(f"failed: {download.state.value} {download.why}")
    return link.clock.now(), vehicle.sent


def _vehicle_and_link(*, loss: float, bytes_per_s: float, seed: int) -> tuple[_Vehicle, SimulatedLink]:
    vehicle = _Vehicle()
    conditions = Conditions(loss=loss, delay_s=_DELAY_S, bytes_per_s=bytes_per_s)
    return vehicle, SimulatedLink(vehicle, rng=random.Random(seed), conditions=conditions)


def _carry(transfer: FtpUpload | FtpDownload, link: SimulatedLink) -> int:
    """Run a transfer to its end; bytes sent."""
    codec = Codec(system_id=255, component_id=190)
    sent = 0
    while not transfer.finished:
        now = link.clock.now()
        for message in transfer.messages_to_send(now):
            frame = codec.encode(FileTransfer(1, 1, message.encoded()))
            sent += len(frame)
            link.send(frame)
        wake = transfer.next_timer()
        data = link.receive(max(0.0, (wake if wake is not None else now) - now))
        for received in codec.decode(data or b""):
            if isinstance(received.message, FileTransfer):
                transfer.receive(received.message.payload, link.clock.now())
    return sent


def line_s(size: int, *, loss: float, bytes_per_s: float) -> float:
    """The time that the frames of a file need at the least."""
    frame = len(Codec(system_id=255, component_id=190).encode(FileTransfer(1, 1, b"\1" * 251)))
    return math.ceil(size / DATA_BYTES) * frame / (1.0 - loss) / bytes_per_s
