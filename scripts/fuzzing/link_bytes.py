"""The bytes of a link: frames, messages and what reads these further."""

from mission_io.errors import FormatError
from mission_io.model.items import MissionType
from mission_io.protocol.ftp import FtpMessage
from mission_io.wire import messages as wire
from mission_io.wire.codec import Codec
from mission_io.wire.framing import LARGEST_FRAME, Framer
from mission_io.wire.mission_items import item_from_message, message_from_item
from scripts.fuzzing.target import Target, check, of_latin


def try_codec(text: str) -> None:
    """Bytes off a link, as one datagram and as a stream in pieces; the text is the bytes as Latin-1."""
    data = text.encode("latin-1")
    whole, pieces = Framer(), Framer()
    frames = [*whole.feed(data), *whole.end()]
    step = 1 + len(data) % 37
    found = [frame for at in range(0, len(data), step) for frame in pieces.feed(data[at : at + step])]
    check(pieces.unfinished_bytes < LARGEST_FRAME, "little is kept")
    check([*found, *pieces.end()] == frames, "the frames do not depend on the pieces")
    counted = whole.counts.garbage_bytes + sum(len(frame.data) for frame in frames)
    check(counted == len(data), "every byte is in a frame or garbage")
    ground, sender = Codec(system_id=255, component_id=190), Codec(system_id=1, component_id=1)
    for received in ground.decode(data):
        again = sender.encode(received.message)
        back = Codec(system_id=255, component_id=190).decode(again)
        check(len(back) == 1 and repr(back[0].message) == repr(received.message), "a message survives sending")
        _try_message(received.message)


def _try_message(message: wire.Message) -> None:
    """A message of the wire in the hands of what reads it further."""
    if isinstance(message, wire.FileTransfer):
        FtpMessage.answer(message.payload)
    if isinstance(message, wire.MissionItemInt | wire.MissionItemFloat):
        try:
            item = item_from_message(message)
        except FormatError:
            return
        if isinstance(message, wire.MissionItemInt):
            again = message_from_item(item, 1, mission_type=MissionType.MISSION, target_system=1, target_component=1)
            check((again.x, again.y) == (message.x, message.y), "a place survives")


def _wire_seeds() -> list[str]:
    ground = Codec(system_id=255, component_id=190)
    old = Codec(system_id=1, component_id=1)
    old.version = 1
    item = wire.MissionItemInt(1, 1, 3, 6, 16, (1.0, 0.0, 0.0, float("nan")), 332191234, -981240001, 60.25)
    sent = [
        wire.Heartbeat(3, 2, system_status=4), wire.MissionCount(1, 1, 40), item, wire.MissionRequestInt(255, 190, 3),
        wire.MissionAck(255, 190, 0), wire.ParamValue("RTL_ALT", 1500.0, 9, 1200, 7), wire.StatusText(6, "a line"),
        wire.FileTransfer(1, 1, bytes(251)), wire.LogData(1, 90, 90, (7,) * 90), wire.CommandLong(1, 1, 400, (1.0,) * 7),
    ]  # fmt: skip
    frames = [ground.encode(message) for message in sent]
    frames += [old.encode(message) for message in (sent[0], sent[5], sent[9])]
    return [b"".join(frames).decode("latin-1"), *(frame.decode("latin-1") for frame in frames)]


def targets() -> dict[str, Target]:
    """By name."""
    return {"codec": of_latin(try_codec, _wire_seeds())}
