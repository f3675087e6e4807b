"""Signing, against pymavlink's own in both directions, and the key's files."""

import hashlib
import os
import random
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as pymavlink

from mission_io.errors import LinkError, MisuseError
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Heartbeat, MissionItemReached
from mission_io.wire.signing import (
    EPOCH_UNIX_S,
    NEW_STREAM_TICKS,
    TICKS_PER_S,
    Signing,
    SigningKey,
    TimestampFile,
    TimestampStore,
    UnsavedTimestamps,
)
from mission_io.wire.telemetry_messages import RadioStatus

KEY = SigningKey.from_passphrase("correct horse")
NOW_S = 1_790_000_000.0
NOW_TICKS = int((NOW_S - EPOCH_UNIX_S) * TICKS_PER_S)


class WallClock:
    def __init__(self, unix_s: float = NOW_S) -> None:
        self.time_s = unix_s

    def unix_s(self) -> float:
        return self.time_s


def signing(
    key: SigningKey = KEY, *, clock: WallClock | None = None, store: TimestampStore | None = None, link_id: int = 0
) -> Signing:
    return Signing(key, clock=clock or WallClock(), store=store or UnsavedTimestamps(), link_id=link_id)


def codec(system_id: int = 1, with_signing: Signing | None = None) -> Codec:
    return Codec(system_id=system_id, component_id=1, signing=with_signing)


def their_peer(key: SigningKey = KEY, *, timestamp: int = NOW_TICKS, link_id: int = 0) -> pymavlink.MAVLink:
    peer = pymavlink.MAVLink(None, 7, 1)
    peer.signing.secret_key, peer.signing.sign_outgoing = key.secret, True
    peer.signing.timestamp, peer.signing.link_id = timestamp, link_id
    return peer


def theirs(peer: pymavlink.MAVLink) -> bytes:
    return bytes(pymavlink.MAVLink_heartbeat_message(2, 3, 128, 5, 4, 3).pack(peer))


def refused(reader: Codec) -> tuple[int, int, int]:
    return reader.statistics.unsigned, reader.statistics.forged, reader.statistics.replayed


def timestamp_of(frame: bytes) -> int:
    return int.from_bytes(frame[-12:-6], "little")


# Against pymavlink.


def test_pymavlink_believes_what_we_sign_and_only_with_the_same_key() -> None:
    sender = codec(with_signing=signing(link_id=5))
    reader, stranger = their_peer(), their_peer(SigningKey.from_passphrase("another"))
    for number in range(300):
        frame = sender.encode(MissionItemReached(number))
        message = reader.decode(bytearray(frame))
        assert (message.get_signed(), message.get_link_id(), message.seq) == (True, 5, number)
        with pytest.raises(pymavlink.MAVError, match="Invalid signature"):
            stranger.decode(bytearray(frame))
    assert reader.signing.goodsig_count == 300
    with pytest.raises(pymavlink.MAVError, match="Invalid signature"):
        reader.decode(bytearray(frame))


def test_we_believe_what_pymavlink_signs_and_only_with_the_same_key() -> None:
    reader, peer = codec(with_signing=signing()), their_peer(link_id=9)
    for _ in range(300):
        assert reader.decode(theirs(peer))[0].system_id == 7
    assert refused(reader) == (0, 0, 0)
    assert reader.decode(theirs(their_peer(SigningKey.from_passphrase("another")))) == []
    assert refused(reader) == (0, 1, 0)


def test_the_passphrase_makes_the_key_that_pymavlinks_tools_make() -> None:
    assert KEY.secret == hashlib.new("sha256", b"correct horse").digest()


# What is refused.


def test_unsigned_is_refused_once_there_is_a_key_except_from_radios() -> None:
    reader = codec(with_signing=signing())
    plain = codec(51)
    assert reader.decode(plain.encode(Heartbeat(3, 2))) == []
    status = RadioStatus(180, 175, 98, 40, 41)
    assert [r.message for r in reader.decode(plain.encode(status))] == [status]
    old_radio = pymavlink.MAVLink_radio_message(1, 2, 3, 4, 5, 6, 7).pack(pymavlink.MAVLink(None, 51, 68))
    assert reader.decode(bytes(old_radio)) == []
    mavlink_1 = pymavlink.MAVLink_heartbeat_message(2, 3, 128, 5, 4, 3).pack(
        pymavlink.MAVLink(None, 9, 1), force_mavlink1=True
    )
    assert reader.decode(bytes(mavlink_1)) == []
    assert (refused(reader), reader.statistics.other_kinds) == ((2, 0, 0), 1)


def test_a_radio_status_with_a_wrong_signature_is_refused() -> None:
    reader = codec(with_signing=signing())
    forged = codec(51, signing(SigningKey.from_passphrase("another")))
    assert reader.decode(forged.encode(RadioStatus(1, 2, 3, 4, 5))) == []
    assert refused(reader) == (0, 1, 0)


def test_a_replay_is_refused_for_each_sender_and_link_by_itself() -> None:
    reader = codec(with_signing=signing())
    frames = {link: theirs(their_peer(link_id=link)) for link in (0, 1)}
    assert [len(reader.decode(frames[link])) for link in (0, 1, 0, 1)] == [1, 1, 0, 0]
    assert refused(reader) == (0, 0, 2)
    later, earlier = (theirs(their_peer(timestamp=NOW_TICKS + ahead)) for ahead in (10, 5))
    assert [len(reader.decode(frame)) for frame in (later, earlier)] == [1, 0]
    assert refused(reader) == (0, 0, 3)


@pytest.mark.parametrize(("behind", "heard"), [(NEW_STREAM_TICKS, 1), (NEW_STREAM_TICKS + 1, 0), (-(10**9), 1)])
def test_a_new_sender_may_be_a_minute_behind(behind: int, heard: int) -> None:
    reader = codec(with_signing=signing())
    assert len(reader.decode(theirs(their_peer(timestamp=NOW_TICKS - behind)))) == heard


def test_a_forged_timestamp_does_not_lock_the_true_sender_out() -> None:
    reader, peer = codec(with_signing=signing()), their_peer()
    forged = bytearray(theirs(their_peer(SigningKey.from_passphrase("another"), timestamp=NOW_TICKS + 10**9)))
    assert reader.decode(bytes(forged)) == []
    assert len(reader.decode(theirs(peer))) == 1
    assert timestamp_of(codec(with_signing=reader.signing).encode(Heartbeat(3, 2))) < NOW_TICKS + 10**6


def test_any_changed_bit_is_refused_or_no_frame() -> None:
    frame = theirs(their_peer())
    rng = random.Random(3)
    for position in range(len(frame)):
        changed = bytearray(frame)
        changed[position] ^= 1 << rng.randrange(8)
        assert codec(with_signing=signing()).decode(bytes(changed)) == []


def test_without_a_key_signed_messages_are_read() -> None:
    assert len(codec(9).decode(theirs(their_peer()))) == 1


# Timestamps.


def test_timestamps_follow_the_clock_and_never_repeat_when_it_stands_or_goes_back() -> None:
    clock = WallClock()
    sender = codec(with_signing=signing(clock=clock))

    def next_timestamp() -> int:
        return timestamp_of(sender.encode(Heartbeat(3, 2)))

    assert [next_timestamp(), next_timestamp()] == [NOW_TICKS, NOW_TICKS + 1]
    clock.time_s += 1.0
    assert next_timestamp() == NOW_TICKS + TICKS_PER_S
    clock.time_s = 0.0
    assert next_timestamp() == NOW_TICKS + TICKS_PER_S + 1


def test_we_go_on_from_the_newest_timestamp_that_we_believed() -> None:
    end = codec(with_signing=signing())
    end.decode(theirs(their_peer(timestamp=NOW_TICKS + 12345)))
    assert timestamp_of(end.encode(Heartbeat(3, 2))) == NOW_TICKS + 12346


def test_timestamps_that_are_used_up_are_an_error() -> None:
    end = codec(with_signing=signing())
    end.decode(theirs(their_peer(timestamp=2**48 - 2)))
    assert timestamp_of(end.encode(Heartbeat(3, 2))) == 2**48 - 1
    with pytest.raises(MisuseError, match="no signing timestamps are left"):
        end.encode(Heartbeat(3, 2))


@pytest.mark.parametrize("crashed", [True, False])
def test_a_restart_with_a_clock_that_went_back_does_not_use_a_timestamp_again(tmp_path: Path, crashed: bool) -> None:
    store = TimestampFile(private(tmp_path / "key", b"correct horse\n"))
    first = signing(store=store)
    last = [timestamp_of(codec(with_signing=first).encode(Heartbeat(3, 2))) for _ in range(5)][-1]
    if not crashed:
        first.close()
        first.close()
        assert store.read() == last
    again = signing(store=TimestampFile(tmp_path / "key"), clock=WallClock(0.0))
    next_one = timestamp_of(codec(with_signing=again).encode(Heartbeat(3, 2)))
    assert last < next_one <= last + 6 * TICKS_PER_S
    assert (next_one == last + 1) == (not crashed)


def test_the_disk_is_written_every_few_seconds_and_not_for_every_message() -> None:
    class CountingStore(UnsavedTimestamps):
        writes = 0

        def raise_to(self, timestamp: int) -> None:
            self.writes += 1
            super().raise_to(timestamp)

    store, clock = CountingStore(), WallClock()
    sender = codec(with_signing=signing(store=store, clock=clock))
    for _ in range(1000):
        clock.time_s += 0.1
        last = timestamp_of(sender.encode(Heartbeat(3, 2)))
        assert last <= store.read()
    assert 15 < store.writes < 25
    sender.signing.close()  # type: ignore[union-attr]
    assert store.read() == last


def test_another_program_with_the_same_key_is_not_undone(tmp_path: Path) -> None:
    path = private(tmp_path / "key", b"correct horse\n")
    ours = signing(store=TimestampFile(path))
    codec(with_signing=ours).encode(Heartbeat(3, 2))
    TimestampFile(path).raise_to(NOW_TICKS * 2)
    ours.close()
    assert TimestampFile(path).read() == NOW_TICKS * 2
    TimestampFile(path).raise_to(5)
    assert TimestampFile(path).read() == NOW_TICKS * 2
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["key", "key.timestamp"]
    assert (tmp_path / "key.timestamp").stat().st_mode & 0o077 == 0


def test_unsaved_timestamps_settle_only_what_they_hold() -> None:
    store = UnsavedTimestamps()
    store.raise_to(10)
    store.raise_to(4)
    store.settle(9, 1)
    assert store.read() == 10
    store.settle(10, 7)
    assert store.read() == 7


@pytest.mark.parametrize("text", ["", "x", "-1", "12 13", str(2**48), "é"])
def test_a_timestamp_file_that_holds_no_timestamp_is_an_error(tmp_path: Path, text: str) -> None:
    store = TimestampFile(private(tmp_path / "key", b"correct horse\n"))
    store.path.write_text(text)
    with pytest.raises(LinkError, match=r"key\.timestamp"):
        signing(store=store)


def test_a_timestamp_that_cannot_be_written_is_an_error_before_anything_is_signed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(handle: int) -> None:
        del handle
        raise OSError(28, "No space left on device")

    store = TimestampFile(private(tmp_path / "key", b"correct horse\n"))
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LinkError, match=r"cannot write the signing timestamp .*: No space left"):
        codec(with_signing=signing(store=store)).encode(Heartbeat(3, 2))
    assert [entry.name for entry in tmp_path.iterdir()] == ["key"]
    monkeypatch.setattr("tempfile.mkstemp", lambda **_: full(0))
    with pytest.raises(LinkError, match="No space left"):
        store.raise_to(9)
    (tmp_path / "key").unlink()
    with pytest.raises(LinkError, match="cannot lock"):
        store.raise_to(9)


# Keys.


def private(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    path.chmod(0o600)
    return path


RAW = bytes(range(200, 232))


@pytest.mark.parametrize(
    ("content", "secret"),
    [
        (RAW, RAW),
        (RAW.hex().encode(), RAW),
        (RAW.hex().upper().encode() + b"\r\n", RAW),
        (b"correct horse", KEY.secret),
        (b"correct horse\n", KEY.secret),
        ("Überflug\n".encode(), hashlib.sha256("Überflug".encode()).digest()),
        (b"k" * 32 + b"\n", hashlib.sha256(b"k" * 32).digest()),
        (bytes(32), bytes(32)),
        (b"line\nline" + bytes(range(23)), b"line\nline" + bytes(range(23))),
    ],
)
def test_a_key_file_holds_bytes_digits_or_a_passphrase(tmp_path: Path, content: bytes, secret: bytes) -> None:
    path = private(tmp_path / "key", content)
    key = SigningKey.from_file(str(path))
    assert (key.secret, key.path) == (secret, path)
    assert secret.hex() not in repr(key)
    assert str(path) in repr(key)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"", "is empty"),
        (b"\n", "is empty"),
        (b"k" * 32, "can be a key or a passphrase; end a passphrase with a line break"),
        (RAW + b"\n", "have 32 bytes, 64 hexadecimal digits, or a"),
        (b"two\nlines\n", "have 32 bytes"),
        (b"x" * 5000, "more than 4096 bytes"),
    ],
)
def test_a_file_that_holds_no_key_is_refused(tmp_path: Path, content: bytes, what: str) -> None:
    with pytest.raises(MisuseError, match=what):
        SigningKey.from_file(private(tmp_path / "key", content))


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620, 0o601])
def test_a_key_that_others_may_read_or_write_is_refused(tmp_path: Path, mode: int) -> None:
    path = private(tmp_path / "key", b"correct horse\n")
    path.chmod(mode)
    with pytest.raises(MisuseError, match=rf"\(mode {mode:o}\); run: chmod 600 {path}"):
        SigningKey.from_file(path)


def test_a_key_that_is_not_there_or_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MisuseError, match=r"cannot read the signing key .*: No such file"):
        SigningKey.from_file(tmp_path / "key")
    with pytest.raises(MisuseError, match="this is not a file"):
        SigningKey.from_file(tmp_path)


def test_impossible_keys_and_links_are_refused() -> None:
    with pytest.raises(MisuseError, match="has 32 bytes, but this one has 5"):
        SigningKey(b"short")
    with pytest.raises(MisuseError, match="passphrase is empty"):
        SigningKey.from_passphrase("")
    with pytest.raises(MisuseError, match="link_id must be between 0 and 255, not 256"):
        signing(link_id=256)
    assert repr(KEY) == "SigningKey(path=None)"
