"""A transfer of 500 items while somebody floods the link with garbage: `python scripts/bench_flood.py --seconds 60 [-o FILE.md]`.

A process sends garbage to the client's UDP port on 127.0.0.1, so many megabytes a second, from the port of the vehicle itself;
500 items are uploaded, read back and compared again and again until the time is up. What counts: every transfer arrives, and the
client's memory (resident set, after the first transfer) grows by less than 10 MB. The garbage is of four kinds, in turn:
random bytes, the first bytes of frames, frames with a wrong checksum, and good frames of another sender.
"""

import argparse
import multiprocessing
import os
import random
import resource
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mission_io import PX4, Address, Client, MissionIoError, MissionServer, MissionType
from mission_io.links.opening import UdpLink
from mission_io.model.items import Frame, MissionItem, waypoint
from mission_io.wire.codec import Codec
from mission_io.wire.messages import Attitude, Heartbeat
from scripts.options import file_to_write

HOST = "127.0.0.1"
LONGEST_S = 600.0
DATAGRAM_BYTES = 1400
KINDS = ("random bytes", "beginnings of frames", "wrong checksums", "frames of another sender")


def garbage(kind: str, rng: random.Random) -> bytes:
    """One datagram of a kind."""
    stranger = Codec(system_id=77, component_id=1)
    if kind == "random bytes":
        return rng.randbytes(DATAGRAM_BYTES)
    if kind == "beginnings of frames":
        return (b"\xfd\xff\x00\x00" + rng.randbytes(3) + b"\x1e\x00\x00") * (DATAGRAM_BYTES // 10)
    frames = b"".join(stranger.encode(Attitude(rng.random(), 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)) for _ in range(30))
    if kind == "frames of another sender":
        return frames
    spoiled = bytearray(frames)
    spoiled[20::38] = bytes(byte ^ 0x55 for byte in spoiled[20::38])
    return bytes(spoiled)


def flood(sock: socket.socket, ground: tuple[str, int], rate_mb_s: float, seconds: float, sent: Any) -> None:
    """Send garbage at a rate from the vehicle's own socket, until the time is up."""
    rng = random.Random(5)
    pool = [[garbage(kind, rng) for _ in range(16)] for kind in KINDS]
    start, total, number = time.monotonic(), 0, 0
    while (elapsed := time.monotonic() - start) < seconds:
        if total > elapsed * rate_mb_s * 1e6:
            time.sleep(0.001)
            continue
        data = pool[number // 64 % len(pool)][number % 16]
        number += 1
        try:
            total += sock.sendto(data, ground)
        except OSError:
            time.sleep(0.001)
        sent.value = total


def serve(port_told: Any, started: Any, sent: Any, rate_mb_s: float, seconds: float) -> None:
    """A PX4's mission protocol on a port; when told to, another process floods from the same port."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind((HOST, 0))
    sock.settimeout(0.02)
    port_told.value = sock.getsockname()[1]
    server, codec = MissionServer(PX4, local=Address(1, 1)), Codec(system_id=1, component_id=1)
    ground, beat_at, flooder = None, 0.0, None
    end = time.monotonic() + seconds + 120.0
    while time.monotonic() < end:
        try:
            data, ground = sock.recvfrom(65535)
        except TimeoutError:
            data = b""
        if started.value and flooder is None and ground is not None:
            flooder = os.fork()
            if flooder == 0:
                flood(sock, ground, rate_mb_s, seconds, sent)
                os._exit(0)
        now = time.monotonic()
        for received in codec.decode(data):
            server.receive(received, now)
        messages = list(server.messages_to_send(now))
        if now >= beat_at:
            beat_at = now + 0.5
            messages.append(Heartbeat(12, 2, system_status=3))
        if ground is not None:
            for message in messages:
                sock.sendto(codec.encode(message), ground)


def items(number: int) -> tuple[MissionItem, ...]:
    """500 items, others for each number."""
    return tuple(
        waypoint(46.0 + n * 1e-4, -7.0 - n * 2e-4 - number * 1e-5, 50.0 + n % 90, frame=Frame.ABOVE_HOME)
        for n in range(500)
    )


def resident_mb() -> float:
    """Memory of this process now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> int:
    """Run it and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help=f"how long to flood, at most {LONGEST_S:g}")
    parser.add_argument("--rate", type=float, default=10.0, help="megabytes of garbage a second")
    parser.add_argument("-o", "--output", type=file_to_write, help="append the row to this file")
    options = parser.parse_args()
    seconds: float = options.seconds
    if not 0.0 < seconds <= LONGEST_S:
        parser.error(f"--seconds {seconds:g}: give more than 0 and at most {LONGEST_S:g}")
    context = multiprocessing.get_context("spawn")
    port_told, started, sent = context.Value("i", 0), context.Value("i", 0), context.Value("q", 0)
    vehicle = context.Process(target=serve, args=(port_told, started, sent, options.rate, seconds), daemon=True)
    vehicle.start()
    while not port_told.value:
        time.sleep(0.05)
    link = UdpLink.connecting(HOST, port_told.value)
    client = Client(link)
    stop_beats = beats(link)
    client.wait_for_vehicle(30.0)
    stop_beats()
    client.upload(MissionType.MISSION, items(0))
    before_mb = resident_mb()
    started.value = 1
    start, end, done, times = time.monotonic(), time.monotonic() + seconds, 0, []
    most_mb = before_mb
    try:
        while time.monotonic() < end:
            begin = time.monotonic()
            wanted = items(done + 1)
            client.upload(MissionType.MISSION, wanted)
            held = client.download(MissionType.MISSION)
            if [(i.lat_deg, i.lon_deg) for i in held] != [(round(i.lat_deg, 7), round(i.lon_deg, 7)) for i in wanted]:
                print("the list that was read back is another one", file=sys.stderr)
                return 1
            done += 1
            times.append(time.monotonic() - begin)
            most_mb = max(most_mb, resident_mb())
    except MissionIoError as error:
        print(f"after {done} transfers: {error}", file=sys.stderr)
        return 1
    finally:
        vehicle.kill()
    took_s, grown_mb = time.monotonic() - start, most_mb - before_mb
    rate = sent.value / 1e6 / min(seconds, took_s)
    counts = client.statistics
    row = (
        f"| {rate:.1f} MB/s for {min(seconds, took_s):.0f} s | {done} of {done} | {sorted(times)[len(times) // 2]:.1f} s, "
        f"{max(times):.1f} s | {before_mb:.1f} MB | {grown_mb:+.1f} MB | {counts.garbage_bytes / 1e6:.0f} MB |"
    )
    head = (
        "| garbage sent | 500 items up, down and compared | median, slowest | memory before | grown at most | garbage read |\n"
        "|---|---|---|---|---|---|"
    )
    print(head + "\n" + row)
    if options.output is not None:
        options.output.write_text(head + "\n" + row + "\n")
    return 0 if grown_mb < 10.0 and done else 1


def beats(link: UdpLink) -> Callable[[], None]:
    """Heartbeats until the vehicle knows this place; returns what ends them."""
    ended = threading.Event()
    codec = Codec(system_id=255, component_id=190)

    def run() -> None:
        while not ended.wait(0.2):
            link.send(codec.encode(Heartbeat(8, 6)))

    threading.Thread(target=run, daemon=True).start()
    return ended.set


if __name__ == "__main__":
    sys.exit(main())
