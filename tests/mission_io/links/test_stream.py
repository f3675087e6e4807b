"""Links over byte channels, on a fake channel and a clock that stands still."""

import os
from collections.abc import Iterator

import pytest

from mission_io.errors import LinkError
from mission_io.links.datagrams import StreamLink
from mission_io.links.simulated import ManualClock
from mission_io.links.stream import QUIET_S, SEND_BUFFER_BYTES, ChannelLink, FramedChannel, OpenChannel
from mission_io.wire.codec import Codec, FramingCounts
from mission_io.wire.messages import StatusText
from tests.mission_io.links.streams import PATIENCE_S, frames, received


class PipeChannel(OpenChannel):
    """A pipe to read from; what is written is taken ``room`` bytes at a time."""

    end = "the pipe has gone"

    def __init__(self) -> None:
        super().__init__("pipe")
        self.reading, self.writing = os.pipe()
        os.set_blocking(self.reading, False)
        self.written = bytearray()
        self.room = 10**9

    def fileno(self) -> int:
        return self.reading

    def receive(self, size: int) -> bytes:
        return os.read(self.reading, size)

    def send(self, data: bytes) -> int:
        taken = min(len(data), self.room)
        self.written += data[:taken]
        self.room -= taken
        return taken

    def close(self) -> None:
        for handle in (self.reading, self.writing):
            if handle >= 0:
                os.close(handle)
        self.reading = self.writing = -1


@pytest.fixture
def channel() -> Iterator[PipeChannel]:
    pipe = PipeChannel()
    yield pipe
    pipe.close()


def test_frames_cut_anywhere_arrive_whole_and_one_by_one(channel: PipeChannel) -> None:
    sent = frames(20)
    stream = b"garbage" + b"".join(sent)
    link = ChannelLink(channel)
    found = []
    for start in range(0, len(stream), 7):
        os.write(channel.writing, stream[start : start + 7])
        while (frame := link.receive(0.0)) is not None:
            found.append(frame)
    assert found == sent
    assert link.framing == FramingCounts(7, 0, 0)
    assert isinstance(link, StreamLink)


def test_what_has_arrived_comes_before_the_error_that_the_other_end_has_gone(channel: PipeChannel) -> None:
    sent = frames(3)
    os.write(channel.writing, b"".join(sent))
    os.close(channel.writing)
    channel.writing = -1
    link = ChannelLink(channel)
    assert received(link, 3) == sent
    with pytest.raises(LinkError, match="the pipe has gone"):
        link.receive(PATIENCE_S)


def test_frames_behind_a_beginning_that_never_ends_come_when_it_is_quiet(channel: PipeChannel) -> None:
    clock = ManualClock()
    framed = FramedChannel(channel, clock)
    beginning = Codec(system_id=1, component_id=1).encode(StatusText(1, "x" * 50))[:12]
    assert framed.quiet_at_s is None
    os.write(channel.writing, beginning + frames(1)[0])
    assert framed.take() == []
    assert framed.quiet_at_s == QUIET_S
    clock.advance_to(QUIET_S - 0.01)
    assert framed.frames_when_quiet() == []
    clock.advance_to(QUIET_S)
    assert framed.frames_when_quiet() == frames(1)
    assert framed.frames_when_quiet() == []
    assert framed.framing == FramingCounts(12, 1, 1)


def test_a_link_waits_no_longer_than_it_must_for_a_beginning_that_never_ends(channel: PipeChannel) -> None:
    beginning = Codec(system_id=1, component_id=1).encode(StatusText(1, "x" * 50))[:12]
    os.write(channel.writing, beginning + frames(1)[0])
    link = ChannelLink(channel)
    started = link.clock.now()
    assert link.receive(PATIENCE_S) == frames(1)[0]
    assert link.clock.now() - started < PATIENCE_S / 2


def test_a_frame_that_is_only_slow_is_not_given_up(channel: PipeChannel) -> None:
    clock = ManualClock()
    framed = FramedChannel(channel, clock)
    (frame,) = frames(1)
    os.write(channel.writing, frame[:8])
    assert framed.take() == []
    clock.advance_to(100.0)
    assert framed.frames_when_quiet() == []
    os.write(channel.writing, frame[8:])
    assert framed.take() == [frame]


def test_a_frame_goes_out_whole_though_in_parts(channel: PipeChannel) -> None:
    link = ChannelLink(channel)
    one, two = frames(2)
    channel.room = 5
    link.send(one)
    assert channel.written == one[:5]
    channel.room = 10**9
    link.send(two)
    assert channel.written == one + two


def test_what_waits_goes_out_while_receiving() -> None:
    channel = PipeChannel()
    link = ChannelLink(channel)
    (frame,) = frames(1)
    os.close(channel.reading)
    channel.reading = os.open(os.devnull, os.O_RDWR)  # always ready for both
    channel.room = 5
    link.send(frame)
    channel.room = 10**9
    with pytest.raises(LinkError, match="has gone"):
        link.receive(PATIENCE_S)
    assert channel.written == frame
    link.close()


def test_a_peer_that_takes_nothing_loses_whole_frames_and_the_count_says_so(channel: PipeChannel) -> None:
    channel.room = 0
    link = ChannelLink(channel)
    (frame,) = frames(1)
    fits = SEND_BUFFER_BYTES // len(frame)
    for _ in range(fits + 3):
        link.send(frame)
    assert link.dropped_frames == 3
    channel.room = 10**9
    link.send(frame)
    assert channel.written == frame * (fits + 1)


def test_a_closed_link_is_an_error_and_closing_twice_is_none(channel: PipeChannel) -> None:
    with ChannelLink(channel) as link:
        assert link.receive(0.0) is None
        link.close()
        with pytest.raises(LinkError, match="the link is closed"):
            link.receive(0.0)
