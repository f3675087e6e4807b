"""Compare pymavlink's parser with ours: speed, hostile bytes, memory, signatures.

    python scripts/bench/mavlink_parsers.py [--messages 20000]

Both get the same bytes: as datagrams, where both begin each one anew, and as one stream in pieces of 100 bytes. Beside each good
frame stands a bad one. Found are the good messages; a flood is lost for a parser that finds few of them.
"""

import argparse
import random
import time
import tracemalloc
from collections.abc import Callable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mission_io.wire import messages as m
from mission_io.wire.codec import Codec, Framer, mavlink2_frame
from mission_io.wire.signing import Signing, SigningKey, SystemClock, UnsavedTimestamps

Parser = Callable[[bytes], int]
"""Takes bytes and says how many messages were complete with them."""
KEY = bytes(range(32))


def ours(*, stream: bool, key: bytes | None = None) -> Parser:
    """Our codec, or for a stream its framer."""
    framer = Framer()
    if stream:
        return lambda data: len(framer.feed(data))
    codec = Codec(system_id=255, component_id=190, signing=None if key is None else signing(key))
    return lambda data: len(codec.decode(data))


def theirs(*, stream: bool, key: bytes | None = None) -> Parser:
    """The parser of pymavlink, with errors as messages instead of exceptions."""
    parser = dialect.MAVLink(None)
    parser.robust_parsing = True
    parser.signing.secret_key = key

    def take(data: bytes) -> int:
        if not stream:
            parser.buf, parser.buf_index = bytearray(), 0
        return sum(
            not one.get_type().startswith(("BAD_DATA", "UNKNOWN")) for one in parser.parse_buffer(bytearray(data)) or []
        )

    return take


def signing(key: bytes) -> Signing:
    """Signs from now on."""
    return Signing(SigningKey(key), clock=SystemClock(), store=UnsavedTimestamps())


def good(count: int, key: bytes | None = None) -> list[bytes]:
    """Frames of a usual telemetry stream."""
    codec = Codec(system_id=1, component_id=1, signing=None if key is None else signing(key))
    kinds: Sequence[m.Message] = (
        m.Heartbeat(3, 2),
        m.GlobalPositionInt(1.5, 47.0, 8.0, 500.0, 20.0, 1.0, 2.0, 0.0, 90.0),
        m.Attitude(1.5, 0.01, 0.02, 0.03, 0.0, 0.0, 0.0),
        m.ParamValue("WPNAV_SPEED", 500.0),
        m.MissionItemInt(255, 190, 3, 6, 16, (0.0, 0.0, 0.0, 0.0), 470000000, 80000000, 30.0),
    )
    return [codec.encode(kinds[number % len(kinds)]) for number in range(count)]


def floods(rng: random.Random) -> dict[str, Callable[[bytes], bytes]]:
    """The bad bytes that precede a good frame, by what they are."""
    return {
        "nothing": lambda _: b"",
        "random bytes": lambda _: rng.randbytes(200),
        "beginnings of frames": lambda _: b"\xfd\xff" * 100,
        "cut frames": lambda frame: frame[: rng.randrange(1, len(frame))],
        "one byte changed": lambda frame: bytes([*frame[:-4], frame[-4] ^ 1, *frame[-3:]]),
        "heartbeats of 255 bytes": lambda _: mavlink2_frame(0, bytes(255), seq=0, system_id=9, component_id=9),
    }


def measure(take: Parser, pieces: Sequence[bytes]) -> str:
    """Messages found, exceptions, seconds and peak memory."""
    found = raised = 0
    tracemalloc.start()
    began = time.perf_counter()
    for data in pieces:
        try:
            found += take(data)
        except Exception:  # whatever it raises is counted
            raised += 1
    seconds, peak = time.perf_counter() - began, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return f"{found:7} found {raised:6} raised {seconds:7.2f} s {peak / 1e6:7.2f} MB"


def main() -> None:
    """Prints one row a parser and flood."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--messages", type=int, default=20_000)
    count: int = options.parse_args().messages
    parsers = {"ours": ours, "pymavlink": theirs}
    for name, make in parsers.items():
        take, frames = make(stream=False), good(count)
        began = time.perf_counter()
        for frame in frames:
            take(frame)
        print(f"{name:9} {count / (time.perf_counter() - began):9,.0f} good messages a second")
    for flood, spoil in floods(random.Random(1)).items():
        frames = good(count)
        pieces = [part for frame in frames for part in (spoil(frame), frame) if part]
        together = b"".join(pieces)
        for name, make in parsers.items():
            print(f"{name:9} datagrams {flood:30} {measure(make(stream=False), pieces)}")
            parts = [together[at : at + 100] for at in range(0, len(together), 100)]
            print(f"{name:9} stream    {flood:30} {measure(make(stream=True), parts)}")
    signed = good(count, KEY)
    forged = bytes(
        [*signed[0][:-12], *b"\xff" * 6, *signed[0][-6:]]
    )  # the last possible time, and a signature that is none
    for name, make in parsers.items():
        print(
            f"{name:9} datagrams {'signed, after one forged frame':30} {measure(make(stream=False, key=KEY), [forged, *signed])}"
        )


if __name__ == "__main__":
    main()
