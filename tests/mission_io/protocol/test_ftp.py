from random import Random

import pytest

from mission_io.client.files import FileUploads
from mission_io.errors import FormatError, MisuseError, TransferCancelledError, TransferError, TransferSilentError
from mission_io.links.simulated import Conditions
from mission_io.protocol.ftp import (
    DATA_BYTES,
    MAX_FILE_BYTES,
    FtpError,
    FtpMessage,
    FtpOperation,
    FtpServer,
    crc32,
    path_bytes,
)
from mission_io.protocol.ftp_files import FtpUpload
from mission_io.protocol.ftp_transfer import FtpState
from mission_io.wire.messages import Received
from mission_io.wire.telemetry_messages import FileTransfer
from tests.mission_io.vehicle import VehiclePeer, connected

PATH = "/APM/TERRAIN/N47E008.DAT"


class KeepsFiles(VehiclePeer):
    """Answers MAVLink FTP; with ``restarts_at`` it forgets what is open after so many requests."""

    def __init__(self, *, restarts_at: int = 0, deaf_from: int = 1 << 40) -> None:
        super().__init__()
        self.files = FtpServer()
        self.requests = 0
        self.restarts_at, self.deaf_from = restarts_at, deaf_from
        self.requested: list[int] = []

    def on_message(self, received: Received, *_: object) -> None:
        if isinstance(received.message, FileTransfer):
            self.requests += 1
            self.requested.append(received.message.payload[3])
            if self.requests == self.restarts_at:
                self.files.restart()
            if self.requests < self.deaf_from:
                self.outbox += [FileTransfer(255, 190, p) for p in self.files.answer(received.message.payload)]


@pytest.mark.parametrize("size", [0, 1, 238, 239, 240, 478, 20_000])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_every_byte_comes_across(size: int, loss: float) -> None:
    peer = KeepsFiles()
    client = connected(peer, seed=size, conditions=Conditions(loss=loss))
    content = Random(size).randbytes(size)
    reported: list[tuple[int, int]] = []
    FileUploads(client).upload(PATH, content, progress=lambda done, total: reported.append((done, total)))
    assert peer.files.files[PATH] == content
    assert reported == sorted(reported)
    assert client.services == []


@pytest.mark.parametrize("seed", range(8))
def test_a_bad_link_changes_no_byte(seed: int) -> None:
    rng = Random(seed)
    conditions = Conditions(
        loss=rng.uniform(0.0, 0.4), duplication=rng.uniform(0.0, 0.2), corruption=rng.uniform(0.0, 0.1),
        delay_s=rng.uniform(0.001, 0.3), jitter_s=rng.uniform(0.0, 0.1),
    )  # fmt: skip
    peer = KeepsFiles(restarts_at=rng.choice([0, 3, 40, 90]))
    content = b"".join(rng.choice([bytes(239), rng.randbytes(239), rng.randbytes(5) + bytes(300)]) for _ in range(90))
    peer.files.files[PATH] = bytearray(rng.randbytes(50_000))  # an older, longer one
    FileUploads(connected(peer, seed=seed, conditions=conditions), window=rng.choice([1, 5, 32])).upload(PATH, content)
    assert peer.files.files[PATH] == content


def test_an_upload_goes_on_where_the_link_left_it() -> None:
    peer = KeepsFiles(deaf_from=60)
    client = connected(peer)
    uploads = FileUploads(client, silent_s=5.0)
    content = Random(4).randbytes(100 * DATA_BYTES)
    with pytest.raises(TransferSilentError, match=r"no answer for 5 s\) after \d+ of 23900 bytes"):
        uploads.upload(PATH, content)
    peer.deaf_from = 1 << 40
    peer.requested.clear()
    uploads.upload(PATH, content)
    assert peer.files.files[PATH] == content
    assert peer.requested.count(FtpOperation.WRITE_FILE) < 60  # 57 were across before
    assert FtpOperation.CREATE_FILE not in peer.requested


def test_other_content_does_not_go_on_with_the_old() -> None:
    peer = KeepsFiles(deaf_from=40)
    uploads = FileUploads(connected(peer), silent_s=5.0)
    with pytest.raises(TransferSilentError):
        uploads.upload(PATH, bytes(range(1, 240)) * 60)
    peer.deaf_from = 1 << 40
    content = Random(1).randbytes(60 * 239)
    uploads.upload(PATH, content)
    assert peer.files.files[PATH] == content


def test_a_byte_that_changed_on_the_way_is_found_by_the_crc_and_sent_again() -> None:
    class Forgets(FtpServer):
        spoiled = 0

        def answer(self, payload: bytes) -> list[bytes]:
            answers = super().answer(payload)
            if payload[3] == FtpOperation.WRITE_FILE and self.spoiled < self.often:
                self.spoiled += 1
                self.files[PATH][0] ^= 1
            return answers

        often = 1

    peer = KeepsFiles()
    peer.files = Forgets()
    content = Random(9).randbytes(3000)
    FileUploads(connected(peer)).upload(PATH, content)
    assert peer.files.files[PATH] == content
    peer.files.spoiled, peer.files.often = 0, 1001
    with pytest.raises(
        TransferError, match=r"arrived with a different CRC \(CRC [0-9a-f]{8} instead of [0-9a-f]{8} after 2 tries\)"
    ):
        FileUploads(connected(peer)).upload(PATH, Random(9).randbytes(239))


def test_refusals_are_said() -> None:
    class Full(FtpServer):
        def answer(self, payload: bytes) -> list[bytes]:
            requested = FtpMessage.decoded(payload)
            if requested.operation != FtpOperation.CREATE_FILE:
                return super().answer(payload)
            nak = FtpMessage(
                (requested.seq + 1) % 65536, FtpOperation.NAK, data=bytes([2, 28]), answers=requested.operation
            )
            return [nak.encoded()]

    peer = KeepsFiles()
    peer.files = Full()
    with pytest.raises(TransferError, match=r"CREATE_FILE: FAIL_ERRNO \(errno 28\)"):
        FileUploads(connected(peer)).upload(PATH, b"abc")


def test_a_file_that_somebody_left_open_is_closed_once() -> None:
    peer = KeepsFiles()
    peer.files.answer(FtpMessage(1, FtpOperation.CREATE_FILE, data=b"/other").encoded())
    FileUploads(connected(peer)).upload(PATH, b"abc")
    assert peer.files.files[PATH] == b"abc"


def test_stopping_ends_it() -> None:
    peer = KeepsFiles()
    with pytest.raises(TransferCancelledError, match="stopped after"):
        FileUploads(connected(peer)).upload(PATH, bytes(9000), stop=lambda: peer.requests > 10)


@pytest.mark.parametrize("seed", range(6))
def test_answers_of_a_hostile_vehicle_end_in_a_state_and_never_in_an_exception(seed: int) -> None:
    rng = Random(seed)
    upload = FtpUpload(PATH, rng.randbytes(5000), now=0.0, silent_s=20.0)
    now, honest = 0.0, FtpServer()
    while not upload.finished and now < 300.0:
        for message in upload.messages_to_send(now):
            kind = rng.random()
            if kind < 0.3:
                answers = honest.answer(message.encoded())
            elif kind < 0.6:
                answer = FtpMessage(
                    (message.seq + rng.choice([0, 1, 1, 1, 2])) % 65536, rng.choice([128, 129, 128, 7]), rng.randrange(256),
                    rng.randrange(1 << 32), rng.randbytes(rng.randrange(0, 20)), answers=rng.choice([message.operation, 7, 5]),
                )  # fmt: skip
                answers = [answer.encoded()]
            else:
                answers = [rng.randbytes(251)]
            for answer_bytes in answers:
                upload.receive(answer_bytes, now + 0.01)
        wake = upload.next_timer()
        now = now + 0.02 if wake is None else max(now + 0.02, wake)
    assert upload.finished or now >= 300.0
    if upload.state is FtpState.DONE:  # only by the right CRC
        assert upload.across_bytes == 5000


@pytest.mark.parametrize("seed", range(4))
def test_the_server_survives_anything(seed: int) -> None:
    rng = Random(seed)
    server = FtpServer({"/a": bytearray(b"x" * 700)})
    for _ in range(3000):
        request = FtpMessage(
            rng.randrange(65536), rng.randrange(18), rng.choice([0, 0, 1]), rng.choice([0, 239, 700, 1 << 20, (1 << 32) - 1]),
            rng.choice([b"/a", b"/b", b"", rng.randbytes(9)]), size=rng.choice([None, 0, 4, 239]),
        )  # fmt: skip
        payload = request.encoded() if rng.random() < 0.8 else rng.randbytes(251)
        for answer in server.answer(payload):
            assert len(answer) == 251
            assert FtpMessage.decoded(answer).operation in (FtpOperation.ACK, FtpOperation.NAK)
    assert sum(map(len, server.files.values())) < MAX_FILE_BYTES


def test_the_crc_is_that_of_the_autopilots() -> None:
    def bitwise(data: bytes) -> int:
        crc = 0
        for byte in data:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
        return crc

    for size in (0, 1, 5, 300):
        content = Random(size).randbytes(size)
        assert crc32(content) == bitwise(content)


@pytest.mark.parametrize("path", ["", "a" * 239, "a\0b"])
def test_impossible_paths_are_misuse(path: str) -> None:
    with pytest.raises(MisuseError, match="not a vehicle path"):
        path_bytes(path)


def test_payloads_round_trip_and_bad_ones_are_errors() -> None:
    rng = Random(1)
    for _ in range(200):
        message = FtpMessage(
            rng.randrange(65536), rng.choice(list(FtpOperation)), rng.randrange(256), rng.randrange(1 << 32),
            data := rng.randbytes(rng.randrange(240)), len(data), rng.randrange(256), rng.random() < 0.5,
        )  # fmt: skip
        assert FtpMessage.decoded(message.encoded()) == message
    with pytest.raises(FormatError, match="240 bytes of data"):
        FtpMessage.decoded(bytes([0, 0, 0, 0, 240, 0, 0, 0, 0, 0, 0, 0]) + bytes(239))
    with pytest.raises(MisuseError, match="the MAVLink FTP limit of 239"):
        FtpMessage(0, 7, data=bytes(240)).encoded()
    assert FtpMessage(0, FtpOperation.NAK, data=bytes([FtpError.FILE_EXISTS])).error_text == "FILE_EXISTS"
