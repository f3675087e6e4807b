from collections.abc import Callable
from random import Random

import pytest

from mission_io.client.files import FileDownloads
from mission_io.errors import FormatError, MisuseError, TransferCancelledError, TransferError, TransferSilentError
from mission_io.formats.wpl import dat_path, read_mission_dat, write_mission_dat
from mission_io.links.simulated import Conditions
from mission_io.model.items import Frame, MissionItem, MissionType
from mission_io.protocol.ftp import DATA_BYTES, FtpError, FtpMessage, FtpOperation, FtpServer
from mission_io.protocol.ftp_files import FtpDownload
from mission_io.protocol.ftp_transfer import FtpListing, FtpState
from mission_io.wire.codec import Codec
from mission_io.wire.messages import message_from_item
from tests.mission_io.protocol.ftp_transfers import download_s, line_s, upload_s
from tests.mission_io.protocol.test_ftp import KeepsFiles
from tests.mission_io.vehicle import connected

PATH = "/APM/LOGS/00000007.BIN"


class Meddling(FtpServer):
    """A server whose answers to an operation are changed: ``change`` gets the answers, and what was asked."""

    def __init__(
        self,
        content: bytes,
        operation: FtpOperation,
        change: Callable[[FtpMessage, list[FtpMessage]], list[FtpMessage]],
    ) -> None:
        super().__init__({PATH: bytearray(content)})
        self._operation, self._change = operation, change

    def answer(self, payload: bytes) -> list[bytes]:
        requested = FtpMessage.decoded(payload)
        answers = super().answer(payload)
        if requested.operation != self._operation:
            return answers
        return [
            answer.encoded() for answer in self._change(requested, [FtpMessage.decoded(answer) for answer in answers])
        ]


def keeping(content: bytes, *, burst: int = 64, **peer: int) -> KeepsFiles:
    vehicle = KeepsFiles(**peer)
    vehicle.files = FtpServer({PATH: bytearray(content)}, burst=burst)
    return vehicle


def read_one_by_one(server: FtpServer, path: str) -> bytes:
    """The naive twin: one read after the other on a link that loses nothing."""
    server.answer(FtpMessage(1, FtpOperation.OPEN_FILE_RO, data=path.encode()).encoded())
    content, seq = b"", 2
    while True:
        request = FtpMessage(seq, FtpOperation.READ_FILE, offset=len(content), size=DATA_BYTES)
        answer = FtpMessage.decoded(server.answer(request.encoded())[0])
        if answer.error is not None:
            return content
        content, seq = content + answer.data, seq + 1


@pytest.mark.parametrize("size", [0, 1, 238, 239, 240, 478, 64 * 239, 20_000])
@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
def test_every_byte_comes_back(size: int, loss: float) -> None:
    content = Random(size).randbytes(size)
    peer = keeping(content)
    client = connected(peer, seed=size, conditions=Conditions(loss=loss))
    reported: list[tuple[int, int]] = []
    got = FileDownloads(client).download(PATH, progress=lambda done, total: reported.append((done, total)))
    assert got == content == read_one_by_one(FtpServer({PATH: bytearray(content)}), PATH)
    assert reported == sorted(reported)
    assert client.services == []


@pytest.mark.parametrize("seed", range(10))
def test_a_bad_link_changes_no_byte(seed: int) -> None:
    rng = Random(seed)
    conditions = Conditions(
        loss=rng.uniform(0.0, 0.4), duplication=rng.uniform(0.0, 0.2), corruption=rng.uniform(0.0, 0.1),
        delay_s=rng.uniform(0.001, 0.3), jitter_s=rng.uniform(0.0, 0.1),
    )  # fmt: skip
    content = rng.randbytes(rng.randrange(60 * 239, 90 * 239))
    peer = keeping(content, burst=rng.choice([1, 8, 64, 500]), restarts_at=rng.choice([0, 2, 3, 6, 40]))
    downloads = FileDownloads(connected(peer, seed=seed, conditions=conditions), window=rng.choice([1, 5, 32]))
    assert downloads.download(PATH) == content


@pytest.mark.parametrize("deaf_from", [3, 4, 6, 9])
def test_a_download_goes_on_where_the_link_left_it(deaf_from: int) -> None:
    content = Random(4).randbytes(100 * DATA_BYTES)
    peer = keeping(content, burst=16, deaf_from=deaf_from)
    downloads = FileDownloads(connected(peer), silent_s=5.0)
    with pytest.raises(TransferSilentError, match=r"no new data for 5 s\) after \d+ of 23900 bytes"):
        downloads.download(PATH)
    had = peer.requested.count(FtpOperation.BURST_READ_FILE)
    peer.deaf_from = 1 << 40
    peer.requested.clear()
    assert downloads.download(PATH) == content
    assert had
    assert peer.requested.count(FtpOperation.BURST_READ_FILE) <= 7 - (deaf_from - 2)  # 7 bursts are the whole


def test_a_file_that_was_replaced_in_between_is_read_anew() -> None:
    peer = keeping(bytes(range(1, 240)) * 60, burst=8, deaf_from=5)
    downloads = FileDownloads(connected(peer), silent_s=5.0)
    with pytest.raises(TransferSilentError):
        downloads.download(PATH)
    peer.deaf_from = 1 << 40
    for size in (60 * 239, 70 * 239 + 3):  # as large as before, and larger
        content = Random(size).randbytes(size)
        peer.files.files[PATH][:] = content
        assert downloads.download(PATH) == content


@pytest.mark.parametrize(
    ("real", "announced"), [(0, 1 << 20), (1, 1 << 20), (239, 240), (700, 1 << 20), (64 * 239, 1 << 20)]
)
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_file_may_end_before_the_announced_size(real: int, announced: int, loss: float) -> None:
    """ArduPilot announces 1 MB for a mission."""
    content = Random(real).randbytes(real)

    def larger(_: FtpMessage, answers: list[FtpMessage]) -> list[FtpMessage]:
        return [
            FtpMessage(a.seq, a.operation, a.session, data=announced.to_bytes(4, "little"), answers=a.answers)
            for a in answers
        ]

    peer = KeepsFiles()
    peer.files = Meddling(content, FtpOperation.OPEN_FILE_RO, larger)
    assert FileDownloads(connected(peer, seed=real, conditions=Conditions(loss=loss))).download(PATH) == content


@pytest.mark.parametrize("error", [FtpError.UNKNOWN_COMMAND, FtpError.END_OF_FILE])
def test_a_vehicle_without_bursts_is_read_one_by_one(error: FtpError) -> None:
    def refuse(requested: FtpMessage, _: list[FtpMessage]) -> list[FtpMessage]:
        nak = FtpMessage(
            (requested.seq + 1) % 65536, FtpOperation.NAK, data=bytes([error]), answers=requested.operation
        )
        return [nak]

    content = Random(2).randbytes(30 * 239 + 7)
    peer = KeepsFiles()
    peer.files = Meddling(content, FtpOperation.BURST_READ_FILE, refuse)
    assert FileDownloads(connected(peer)).download(PATH) == content


def _changed(a: FtpMessage, **fields: object) -> FtpMessage:
    known: dict[str, object] = {
        "seq": a.seq, "operation": a.operation, "session": a.session, "offset": a.offset, "data": a.data,
        "answers": a.answers, "burst_complete": a.burst_complete,
    }  # fmt: skip
    return FtpMessage(**(known | fields))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("operation", "change", "telling"),
    [
        (FtpOperation.OPEN_FILE_RO, lambda _, a: [_changed(a[0], data=b"\xff" * 4)], "announces 4294967295 bytes"),
        (FtpOperation.OPEN_FILE_RO, lambda _, a: [_changed(a[0], data=b"\1")], "an answer of 1 bytes instead of 4"),
        (FtpOperation.OPEN_FILE_RO, lambda _, a: [_changed(a[0], operation=129, data=b"\2\x0d")], r"errno 13"),
        (FtpOperation.CALC_FILE_CRC32, lambda _, a: [_changed(a[0], data=b"1234")], r"a different CRC .* after 2 tries"),
        (FtpOperation.CALC_FILE_CRC32, lambda _, a: [_changed(a[0], data=b"")], "CALC_FILE_CRC32: an answer of 0 bytes"),
        (FtpOperation.CALC_FILE_CRC32, lambda _, a: [_changed(a[0], operation=129, data=b"\7")], "UNKNOWN_COMMAND"),
        (FtpOperation.BURST_READ_FILE, lambda _, a: [_changed(b, session=9) for b in a], r"\(no new data for 5 s\)"),
        (FtpOperation.BURST_READ_FILE, lambda _, a: [_changed(b, offset=1 << 31) for b in a], r"\(no new data for 5 s\)"),
        (FtpOperation.BURST_READ_FILE, lambda _, a: [_changed(a[0], burst_complete=False)] * 40, None),
        (FtpOperation.BURST_READ_FILE, lambda _, a: [_changed(a[0], data=a[0].data[:9]), *a[1:]], None),
        (FtpOperation.BURST_READ_FILE, lambda _, a: [_changed(a[0], operation=129, data=b"\4")], r"INVALID_SESSION, 9 times"),
        (FtpOperation.BURST_READ_FILE, lambda _, a: [_changed(a[0], operation=129, data=b"\1")], "byte 0: FAIL"),
    ],
)  # fmt: skip
def test_nonsense_is_one_clear_line_or_does_no_harm(
    operation: FtpOperation,
    change: Callable[[FtpMessage, list[FtpMessage]], list[FtpMessage]],
    telling: str | None,
) -> None:
    content = Random(3).randbytes(20 * 239)
    peer = KeepsFiles()
    peer.files = Meddling(content, operation, change)
    downloads = FileDownloads(connected(peer), silent_s=5.0)
    if telling is None:
        assert downloads.download(PATH) == content
        return
    with pytest.raises(TransferError, match=telling) as raised:
        downloads.download(PATH)
    assert "\n" not in str(raised.value)


def test_a_missing_file_is_said_and_stopping_ends_it() -> None:
    peer = keeping(bytes(90_000), burst=8)
    downloads = FileDownloads(connected(peer))
    with pytest.raises(TransferError, match=r"nowhere: refused .OPEN_FILE_RO: FILE_NOT_FOUND"):
        downloads.download("/nowhere")
    with pytest.raises(TransferCancelledError, match=r"stopped after \d+ of 90000 bytes"):
        downloads.download(PATH, stop=lambda: peer.requests > 5)
    with pytest.raises(MisuseError, match="not a vehicle path"):
        downloads.download("")
    with pytest.raises(MisuseError, match="must be greater"):
        FileDownloads(connected(peer), window=0)


@pytest.mark.parametrize("seed", range(12))
def test_answers_of_a_hostile_vehicle_end_in_a_state_and_keep_no_more_than_was_announced(seed: int) -> None:
    rng = Random(seed)
    content = rng.randbytes(5000)
    download = FtpDownload(PATH, now=0.0, silent_s=20.0, most_bytes=9000)
    now, honest = 0.0, FtpServer({PATH: bytearray(content)})
    while not download.finished and now < 3000.0:
        for message in download.messages_to_send(now):
            kind = rng.random()
            if kind < 0.5:
                answers = honest.answer(message.encoded())
            elif kind < 0.8:
                answer = FtpMessage(
                    (message.seq + rng.choice([0, 1, 1, 1, 2])) % 65536, rng.choice([128, 128, 128, 129, 7]),
                    rng.choice([0, 0, 0, 9]),
                    rng.choice([0, 239, 478, 4780, 5019, 7, 1 << 31]), rng.randbytes(rng.choice([0, 1, 4, 20, 239])),
                    answers=rng.choice([message.operation, 15, 5]),
                )  # fmt: skip
                answers = [answer.encoded()] * rng.choice([1, 3])
            else:
                answers = [rng.randbytes(251)]
            rng.shuffle(answers)
            for answer_bytes in answers:
                download.receive(answer_bytes, now + 0.01)
        assert download.across_bytes == len(download.content) <= 9000
        wake = download.next_timer()
        now = now + 0.02 if wake is None else max(now + 0.02, wake)
    assert download.finished
    if download.state is FtpState.DONE:  # only by a CRC, which a liar may make up
        assert download.why == ""


def test_a_folder_is_listed_page_by_page() -> None:
    rng = Random(1)
    files = {f"/APM/LOGS/{number:08d}.BIN": bytearray(rng.randrange(500)) for number in range(60)}
    files["/APM/LOGS/old/x"] = bytearray()
    files["/APM/ä.txt"] = bytearray(5)
    peer = KeepsFiles()
    peer.files = FtpServer(files)
    downloads = FileDownloads(connected(peer, conditions=Conditions(loss=0.3, duplication=0.1)))
    listed = downloads.entries("/APM/LOGS/")
    assert [(entry.name, entry.size_bytes) for entry in listed] == [
        ("old", None), *((name[10:], len(content)) for name, content in files.items() if "BIN" in name),
    ]  # fmt: skip
    assert [(entry.name, entry.is_folder) for entry in downloads.entries("/APM")] == [("LOGS", True), ("ä.txt", False)]
    assert [entry.name for entry in downloads.entries("/")] == ["APM"]
    with pytest.raises(TransferError, match=r"list of /nowhere/: refused .LIST_DIRECTORY: FILE_NOT_FOUND"):
        downloads.entries("/nowhere/")
    peer.deaf_from = 0
    with pytest.raises(TransferSilentError, match="no answer for 30 s"):
        downloads.entries("/")


@pytest.mark.parametrize(
    ("page", "telling"),
    [
        (lambda _: b"Fa\t1\0", "'a' repeatedly"),
        (lambda offset: b"".join(b"F%d\t1\0" % (offset + i) for i in range(20)), "more than 20000 entries"),
        (lambda _: b"Xa\0", "not a valid folder entry"),
        (lambda _: b"Fa\tmany\0", "not a valid folder entry"),
        (lambda _: b"F\t1\0", "not a valid folder entry"),
    ],
)
def test_nonsense_lists_are_refused(page: Callable[[int], bytes], telling: str) -> None:
    listing = FtpListing("/", now=0.0)
    now = 0.0
    while not listing.finished:
        for requested in listing.messages_to_send(now):
            answer = FtpMessage(
                (requested.seq + 1) % 65536, FtpOperation.ACK, data=page(requested.offset), answers=requested.operation
            )
            listing.receive(answer.encoded(), now + 0.01)
        now += 0.02
    assert telling in listing.why


def _items(rng: Random, count: int) -> list[MissionItem]:
    return [
        MissionItem(
            rng.choice([16, 22, 178]), rng.choice([Frame.AMSL, Frame.ABOVE_HOME, Frame.ABOVE_TERRAIN]),
            (float(rng.randrange(9)), 0.5, -3.0, 0.0), rng.randrange(-900_000_000, 900_000_000) / 1e7,
            rng.randrange(-1_800_000_000, 1_800_000_000) / 1e7, rng.randrange(-400, 40_000) / 4.0, rng.random() < 0.9,
        )
        for _ in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_a_mission_as_one_file_equals_the_download_item_by_item(seed: int) -> None:
    rng = Random(seed)
    peer = KeepsFiles()
    client = connected(peer, seed=seed, conditions=Conditions(loss=0.1 * seed))
    client.upload(MissionType.MISSION, _items(rng, rng.choice([1, 7, 120])))
    items = client.download(MissionType.MISSION)
    path = dat_path(MissionType.MISSION)
    peer.files.files[path] = bytearray(write_mission_dat(items, MissionType.MISSION))
    assert FileDownloads(client).mission_items(MissionType.MISSION) == list(items)
    assert len(peer.files.files[path]) == 10 + 38 * len(items)


def test_an_item_of_the_file_is_the_payload_of_its_message() -> None:
    item = _items(Random(5), 1)[0]
    message = message_from_item(item, 0, mission_type=MissionType.RALLY, target_system=0, target_component=0)
    frame = Codec(system_id=1, component_id=1).encode(message)
    file = write_mission_dat([item], MissionType.RALLY)
    assert file[:10] == bytes([0x3D, 0x76, 2, 0, 0, 0, 0, 0, 1, 0])
    assert file[10 : 10 + frame[1]] == frame[10 : 10 + frame[1]]  # MAVLink 2 leaves zeros at the end away


@pytest.mark.parametrize(
    ("spoil", "telling"),
    [
        (lambda file: file[:9], "9 bytes, but the header of an ArduPilot list"),
        (lambda file: b"\0" + file[1:], "begins with 0x7600 instead of 0x763d"),
        (lambda file: file[:2] + b"\1" + file[3:], "list of type 1, not 0"),
        (lambda file: file[:6] + b"\3" + file[7:], "begins at item 3"),
        (
            lambda file: file[:8] + b"\xff" + file[9:],
            r"the header announces 255 items \(9690 bytes\), but 114 bytes follow",
        ),
        (lambda file: file[:-1], r"the header announces 3 items \(114 bytes\), but 113 bytes follow"),
        (lambda file: file + b"\0", r"the header announces 3 items \(114 bytes\), but 115 bytes follow"),
        (lambda file: file[:44] + b"\xc8" + file[45:], "item 0"),
    ],
)
def test_other_files_are_no_mission(spoil: Callable[[bytes], bytes], telling: str) -> None:
    file = write_mission_dat(_items(Random(1), 3), MissionType.MISSION)
    with pytest.raises(FormatError, match=telling):
        read_mission_dat(spoil(file), MissionType.MISSION)


@pytest.mark.parametrize(("transfer_s", "most"), [(upload_s, 1.16), (download_s, 1.1)])
def test_a_lossy_line_is_used_for_little_but_what_is_missing(
    transfer_s: Callable[..., tuple[float, float]], most: float
) -> None:
    """At 30 % loss both ways, sending again what was not answered would take 2.04 times the frames; 1.43 are needed."""
    content = Random(3).randbytes(600_000)
    _, sent = transfer_s(content, loss=0.3, window=256, bytes_per_s=250_000.0, seed=3)
    assert sent < most * line_s(len(content), loss=0.3, bytes_per_s=1.0)
