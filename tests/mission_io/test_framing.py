import itertools
import random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as pymavlink

from mission_io.errors import MisuseError
from mission_io.wire import codec
from mission_io.wire.codec import LARGEST_FRAME, Codec, Framer, FramingCounts, mavlink1_frame, mavlink2_frame
from mission_io.wire.message_table import checksum
from mission_io.wire.messages import Heartbeat, StatusText, WireFrame
from tests.mission_io.test_codec import SAMPLES


def frames_of(count: int) -> list[bytes]:
    sender = Codec(system_id=1, component_id=1)
    return [sender.encode(SAMPLES[number % len(SAMPLES)]) for number in range(count)]


BEAT = Codec(system_id=1, component_id=1).encode(Heartbeat(3, 2))

MAVLINK_1 = pymavlink.MAVLink_heartbeat_message(2, 3, 128, 5, 4, 3).pack(
    pymavlink.MAVLink(None, 9, 1), force_mavlink1=True
)

valid = st.sampled_from([*frames_of(len(SAMPLES)), bytes(MAVLINK_1)])
cut_off = st.builds(lambda frame, size: frame[: size % len(frame)], valid, st.integers(0, 300))
damaged = st.builds(
    lambda frame, at, bit: bytes(b ^ (1 << bit) if i == at % len(frame) else b for i, b in enumerate(frame)),
    valid,
    st.integers(0, 300),
    st.integers(0, 7),
)
magic_garbage = st.lists(st.sampled_from([0xFD, 0xFE, 0, 1, 9, 33, 255]), max_size=40).map(bytes)
streams = st.lists(st.one_of(valid, cut_off, damaged, st.binary(max_size=40), magic_garbage), max_size=12)


def in_pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    positions = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(positions)]


@settings(derandomize=True, max_examples=400, deadline=None)
@given(streams, st.lists(st.integers(0, 2000), max_size=20))
@example([BEAT[:7], BEAT, b"\xfd", BEAT], [3, 8, 30])
@pytest.mark.no_cover
def test_any_cutting_of_any_stream_gives_the_same_frames_and_the_same_counts(
    parts: list[bytes], cuts: list[int]
) -> None:
    data = b"".join(parts)
    whole, cut, single = Framer(), Framer(), Framer()
    expected = [*whole.feed(data), *whole.end()]
    pieces = [frame for piece in in_pieces(data, cuts) for frame in cut.feed(piece)]
    singles = [frame for byte in data for frame in single.feed(bytes([byte]))]
    assert [*pieces, *cut.end()] == [*singles, *single.end()] == expected
    assert whole.counts == cut.counts == single.counts
    assert whole.counts.garbage_bytes + sum(len(frame.data) for frame in expected) == len(data)


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.lists(st.binary(max_size=80), max_size=8))
def test_garbage_never_raises_and_is_never_kept_for_long(pieces: list[bytes]) -> None:
    framer = Framer()
    for piece in pieces:
        framer.feed(piece)
        assert framer.unfinished_bytes < LARGEST_FRAME
    framer.end()
    assert framer.unfinished_bytes == 0


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(st.one_of(valid, st.binary(max_size=30).map(lambda b: b.replace(b"\xfd", b"").replace(b"\xfe", b"")))))
def test_every_good_frame_between_garbage_is_found_in_order_and_pymavlink_reads_each(parts: list[bytes]) -> None:
    framer = Framer()
    good = [part for part in parts if part[:1] in (b"\xfd", b"\xfe")]
    assert [frame.data for frame in framer.feed(b"".join(parts))] == good
    for data in good:
        (message,) = pymavlink.MAVLink(None).parse_buffer(bytearray(data))
        assert not message.get_type().startswith("BAD")


def test_the_parts_of_a_frame() -> None:
    (two,) = Framer().feed(mavlink2_frame(0, bytes(range(1, 10)), seq=7, system_id=3, component_id=4))
    assert two[:6] == (2, 7, 3, 4, 0, bytes(range(1, 10)))
    (one,) = Framer().feed(bytes(MAVLINK_1))
    assert one[:5] == (1, 0, 9, 1, 0)
    assert (len(one.payload), one.signature, one.data) == (9, b"", bytes(MAVLINK_1))
    signed = mavlink2_frame(0, b"\x01", seq=0, system_id=3, component_id=4, flags=1) + bytes(range(13))
    (frame,) = Framer().feed(signed)
    assert (frame.signature, frame.data) == (bytes(range(13)), signed)
    assert isinstance(frame, WireFrame)


def test_frames_are_built_as_pymavlink_builds_them() -> None:
    theirs = pymavlink.MAVLink(None, 9, 1)
    theirs.seq = 200
    message = pymavlink.MAVLink_heartbeat_message(2, 3, 128, 5, 4, 0)
    for build, force in ((mavlink1_frame, True), (mavlink2_frame, False)):
        payload = message.unpacker.pack(5, 2, 3, 128, 4, 0)
        assert build(0, payload, seq=200, system_id=9, component_id=1) == message.pack(theirs, force_mavlink1=force)
    assert mavlink2_frame(46, b"\0\0", seq=0, system_id=1, component_id=1)[1] == 1


def test_mavlink_1_ends_at_message_255() -> None:
    with pytest.raises(MisuseError, match="message 436 does not exist in MAVLink 1"):
        mavlink1_frame(436, b"", seq=0, system_id=1, component_id=1)


def test_a_wrong_checksum_a_cut_off_frame_and_garbage_are_counted_apart() -> None:
    framer = Framer()
    wrong = BEAT[:-1] + bytes([BEAT[-1] ^ 1])
    assert len(framer.feed(wrong + BEAT + b"garbage" + BEAT + BEAT[:10])) == 2
    assert framer.counts == FramingCounts(len(wrong) + 7, 1, 0)
    assert framer.unfinished_bytes == 10
    assert framer.end() == []
    assert framer.counts == FramingCounts(len(wrong) + 17, 1, 1)
    assert framer.counts + FramingCounts(1, 2, 3) == FramingCounts(len(wrong) + 18, 3, 4)


@pytest.mark.parametrize(
    ("header", "why"),
    [
        (b"\xfd\x09\x02\x00\x00\x01\x01\x00\x00\x00", "an unknown incompatibility flag"),
        (b"\xfd\x09\x00\x00\x00\x01\x01\xff\xff\xff", "an unknown message"),
        (b"\xfe\x0a\x00\x01\x01\x00", "longer than the message is in MAVLink 1"),
        (b"\xfe\x09\x00\x01\x01\xff", "an unknown message"),
    ],
)
def test_what_cannot_be_a_frame_does_not_hold_back_the_next_one(header: bytes, why: str) -> None:
    framer = Framer()
    assert [frame.data for frame in framer.feed(header + BEAT)] == [BEAT], why


def test_a_newer_peers_longer_message_is_read_as_far_as_it_is_known() -> None:
    longer = mavlink2_frame(46, b"\x05\x00\x07\x08", seq=0, system_id=1, component_id=1)
    (received,) = Codec(system_id=9, component_id=1).decode(longer)
    assert received.message.seq == 5  # type: ignore[union-attr]


def test_frames_behind_one_that_does_not_end_come_when_the_stream_goes_quiet() -> None:
    framer = Framer()
    beginning = b"\xfd\xff" + Codec(system_id=1, component_id=1).encode(StatusText(1, "a"))[2:10]
    assert framer.feed(beginning + BEAT) == []
    assert [frame.data for frame in framer.end_if_frames_wait()] == [BEAT]
    assert framer.counts == FramingCounts(len(beginning), 0, 1)
    assert framer.feed(BEAT[:5]) == framer.end_if_frames_wait() == []
    assert [frame.data for frame in framer.feed(BEAT[5:])] == [BEAT]


@pytest.mark.parametrize(
    "pattern",
    [
        b"\xfd",
        b"\xfe",
        b"\xfe\xff\x00\x01\x01\x00",
        b"\xfd\xff\x00\x00\x00\x01\x01\xfd\x00\x00",
        b"\xfe\x36\xfd\x00\xfe\xfd",
    ],
)
def test_the_work_for_the_worst_garbage_grows_with_its_size_and_no_faster(
    pattern: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    work = 0

    def counting(data: bytes) -> int:
        nonlocal work
        work += len(data)
        return checksum(data)

    monkeypatch.setattr(codec, "checksum", counting)
    totals = []
    for size in (10_000, 40_000):
        work, framer = 0, Framer()
        data = (pattern * (size // len(pattern) + 1))[:size]
        for start in range(0, size, 100):
            framer.feed(data[start : start + 100])
        assert work <= LARGEST_FRAME * size
        totals.append(work)
    assert totals[1] <= 4.2 * totals[0]


def test_a_stream_of_damaged_bytes_loses_only_what_was_damaged() -> None:
    rng, frames = random.Random(4), frames_of(2000)
    hurt = {rng.randrange(2000) for _ in range(100)}
    stream = b"".join(
        bytes([*frame[:3], frame[3] ^ 0x55, *frame[4:]]) if number in hurt else frame
        for number, frame in enumerate(frames)
    )
    found = {frame.data for frame in Framer().feed(stream)}
    lost = [number for number, frame in enumerate(frames) if number not in hurt and frame not in found]
    assert lost == []
