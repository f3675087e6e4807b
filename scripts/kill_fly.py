"""Kill ``uavcover fly`` at random moments of its flight, and look at what it leaves behind.

Usage: .venv/bin/python scripts/kill_fly.py [-o docs/results/killed_flights.md] [--kills 20] [--seed 0] [--speed 40] [--run RUN]

A route is planned once (or taken from ``--run``). For each kill a copy of its run folder is uploaded to a mock vehicle in a
process of its own and flown by ``uavcover fly`` in another, which gets SIGKILL when the vehicle has flown a random share of the
planned flight time. Between the two stands a relay that writes down when each position of the vehicle went by: what was lost is
counted against that, in seconds of real time before the kill, not against what uavcover says of itself. Then ``uavcover verify``
has to judge ``track.csv`` and ``flight.rrd``, and ``uavcover inspect --text`` to read the recording.

Exit 1 when a file of any flight cannot be read, or has lost what was older than a second.
"""

import argparse
import csv
import datetime
import json
import math
import os
import platform
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Self

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

from scripts.options import file_to_write, run_folder
from uavcover.errors import UavcoverError
from uavcover.model.track import ReadTrack
from uavcover.recording.reader import read_recorded_track_with_warnings
from uavcover.vehicle.track_file import read_track_with_warnings

SCENARIO, EVALUATIONS = "jacksboro", 40
ALLOWED_S, WATCHDOG_S = 1.0, 120.0


@dataclass(frozen=True, slots=True)
class Position:
    """A position that the vehicle sent: its own time, and when it went by (``time.monotonic``)."""

    vehicle_ms: int
    passed_s: float


@dataclass(frozen=True, slots=True)
class Killed:
    """What one killed flight left, a row of the table.

    Attributes:
        moment: share of the planned flight time after which it was killed.
        flown_s: vehicle time between the first sample of the track and the last position before the kill.
        sent: positions that went by between the two.
        in_track: how many of them are in ``track.csv``.
        track_lost_s: age at the kill of the oldest one after the track's last sample; 0 when none is lost.
        cut_line: whether the last line was cut off.
        in_recording: how many are in ``flight.rrd``.
        recording_lost_s: as ``track_lost_s``.
        verify_track: exit code of ``uavcover verify RUN``.
        verify_recording: of ``uavcover verify RUN --log RUN/flight.rrd``.
        inspect: of ``uavcover inspect RUN --text``.
    """

    moment: float
    flown_s: float
    sent: int
    in_track: int
    track_lost_s: float
    cut_line: bool
    in_recording: int
    recording_lost_s: float
    verify_track: int
    verify_recording: int
    inspect: int

    @property
    def good(self) -> bool:
        """Whether everything can be read and nothing older than a second is lost.

        A recording that is younger than that may have no track to judge yet.
        """
        judged = self.verify_recording in {0, 1} or self.in_recording == 0
        lost_s = max(self.track_lost_s, self.recording_lost_s)
        return lost_s <= ALLOWED_S and self.verify_track in {0, 1} and judged and self.inspect == 0


class Relay:
    """Passes datagrams on between the ground station and the vehicle, and writes down the vehicle's positions.

    Args:
        vehicle_port: where the vehicle listens.

    Attributes:
        port: where the ground station speaks to.
        positions: those that went by so far, each time once.
    """

    def __init__(self, vehicle_port: int) -> None:
        self._ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._ground.bind(("127.0.0.1", 0))
        self._vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle.connect(("127.0.0.1", vehicle_port))
        self._ground.setblocking(False)
        self._vehicle.setblocking(False)  # select may tell of an error that a send has taken in between
        self.port: int = self._ground.getsockname()[1]
        self.positions: list[Position] = []
        self._parser = ardupilotmega.MAVLink(None)
        self._parser.robust_parsing = True
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._ground.close()
        self._vehicle.close()

    def _run(self) -> None:
        place = None
        while not self._stop.is_set():
            for ready in select.select([self._ground, self._vehicle], [], [], 0.05)[0]:
                try:
                    data, sender = ready.recvfrom(65535)
                    if ready is self._ground:
                        place = sender
                        self._vehicle.send(data)
                    elif place is not None:
                        self._ground.sendto(data, place)
                        self._write_down(data)
                except (ConnectionError, BlockingIOError):
                    continue  # the other side is gone

    def _write_down(self, data: bytes) -> None:
        passed_s = time.monotonic()
        for message in self._parser.parse_buffer(data) or ():
            newest_ms = self.positions[-1].vehicle_ms if self.positions else -1
            if message.get_type() == "GLOBAL_POSITION_INT" and message.time_boot_ms > newest_ms:
                self.positions.append(Position(message.time_boot_ms, passed_s))


def command(*arguments: object) -> list[str]:
    """A command of uavcover for a process of its own."""
    return [sys.executable, "-m", "uavcover", *map(str, arguments)]


@contextmanager
def started(arguments: list[str], output: int) -> Iterator[subprocess.Popen[str]]:
    """A process that is gone at the end, whatever happens."""
    process = subprocess.Popen(arguments, stdout=output, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def exit_code(*arguments: object) -> int:
    """How a command of uavcover ends; what a crash says goes to stderr."""
    done = subprocess.run(command(*arguments), capture_output=True, text=True, timeout=WATCHDOG_S, check=False)
    if done.returncode not in {0, 1} or "Traceback" in done.stderr:
        print(done.stderr, file=sys.stderr)
    return done.returncode if "Traceback" not in done.stderr else -1


def fly_until(run: Path, *, moment: float, speed: float) -> tuple[list[Position], float]:
    """Fly a run and kill ``fly``; the positions that went by, and when it was killed.

    Raises:
        RuntimeError: the flight ended by itself, or the moment never came.
    """
    planned_ms = 1000.0 * json.loads((run / "plan.json").read_text())["metrics"]["flight_time_s"]
    listen = command("mock-vehicle", "--listen", "udpin://127.0.0.1:0", "--speed", speed, "--json")
    with started(listen, subprocess.PIPE) as vehicle:
        assert vehicle.stdout is not None
        with Relay(json.loads(vehicle.stdout.readline())["port"]) as relay:
            url = f"udpout://127.0.0.1:{relay.port}"
            if exit_code("plan-upload", run, "--to", url, "-q") != 0:
                raise RuntimeError(f"{run}: the mission could not be uploaded")
            with started(command("fly", run, "--to", url, "-q"), subprocess.DEVNULL) as flight:
                first_ms: int | None = None
                until_s = time.monotonic() + WATCHDOG_S
                while first_ms is None or relay.positions[-1].vehicle_ms - first_ms < moment * planned_ms:
                    if flight.poll() is not None or time.monotonic() > until_s:
                        raise RuntimeError(f"{run}: the flight ended with {flight.poll()} before it could be killed")
                    if first_ms is None and (run / "track.csv").exists():
                        first_ms = relay.positions[-1].vehicle_ms
                    time.sleep(0.001)
                killed_s = time.monotonic()
                flight.kill()
                flight.wait()
            return [p for p in relay.positions if p.passed_s <= killed_s], killed_s


def lost_s(sent: Sequence[Position], kept_ms: Sequence[int], killed_s: float) -> float:
    """Age at the kill of the oldest position after the last one that was kept."""
    last_ms = max(kept_ms, default=-math.inf)
    return max((killed_s - p.passed_s for p in sent if p.vehicle_ms > last_ms), default=0.0)


def vehicle_ms(read: ReadTrack) -> list[int]:
    """The times of a track's samples."""
    return [int(ms) for ms in np.rint(1000.0 * read.track.time_s)]


def measure(planned: Path, run: Path, *, moment: float, speed: float) -> Killed:
    """Kill one flight, and look."""
    shutil.copytree(planned, run)
    positions, killed_s = fly_until(run, moment=moment, speed=speed)
    track = read_track_with_warnings(run / "track.csv")
    in_track = vehicle_ms(track)
    try:
        in_recording = vehicle_ms(read_recorded_track_with_warnings(run / "flight.rrd"))
    except UavcoverError as error:
        print(error, file=sys.stderr)
        in_recording = []
    sent = [p for p in positions if p.vehicle_ms >= in_track[0]]
    return Killed(
        moment=round(moment, 3),
        flown_s=round((sent[-1].vehicle_ms - in_track[0]) / 1000.0, 3),
        sent=len(sent),
        in_track=len(in_track),
        track_lost_s=round(lost_s(sent, in_track, killed_s), 4),
        cut_line=bool(track.warnings),
        in_recording=len(in_recording),
        recording_lost_s=round(lost_s(sent, in_recording, killed_s), 4),
        verify_track=exit_code("verify", run, "-q"),
        verify_recording=exit_code("verify", run, "--log", run / "flight.rrd", "-q"),
        inspect=exit_code("inspect", run, "--text", "-q"),
    )


def summary(rows: Sequence[Killed]) -> str:
    """The result in words."""
    return (
        f"After {sum(row.good for row in rows)} of {len(rows)} kills both files could be read and judged and had everything that "
        f"was older than {ALLOWED_S:g} s. Lost at most, in seconds of real time before the kill: "
        f"{max(row.track_lost_s for row in rows):.3f} s of `track.csv`, {max(row.recording_lost_s for row in rows):.2f} s of "
        f"`flight.rrd`. A last line was cut off in {sum(row.cut_line for row in rows)} tracks."
    )


def write_results(out: Path, rows: Sequence[Killed], *, kills: int, seed: int, speed: float) -> None:
    """The Markdown page, and the .csv beside it."""
    names = [field.name for field in fields(Killed)]
    with out.with_suffix(".csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(
            [[*names, "good"], *([*astuple(row), row.good] for row in rows)]
        )
    lines = [
        "# Killed flights, measured",
        "",
        f"Command: `.venv/bin/python scripts/kill_fly.py --kills {kills} --seed {seed} --speed {speed:g}`, "
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, Python "
        f"{platform.python_version()}, rerun-sdk {metadata.version('rerun-sdk')}, {os.cpu_count()} cores "
        f"({platform.machine()}). Scenario {SCENARIO}, {EVALUATIONS} evaluations; what is done is said at the top of the script.",
        "",
        summary(rows),
        "",
        "Exit codes of `verify` are 1 where they should be: a flight that was cut off has not covered the area. A recording "
        "that has no sample yet, of a flight killed in its first half second, is refused with one line (2); the track is judged.",
        "",
        "| moment | flown, s | positions sent | in track.csv | lost, s | in flight.rrd | lost, s | verify | verify .rrd | "
        "inspect | good |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|",
    ]
    lines += [
        f"| {row.moment:.3f} | {row.flown_s:.1f} | {row.sent} | {row.in_track} | {row.track_lost_s:.4f} | {row.in_recording} | "
        f"{row.recording_lost_s:.3f} | {row.verify_track} | {row.verify_recording} | {row.inspect} | "
        f"{'yes' if row.good else 'NO'} |"
        for row in rows
    ]
    out.write_text("\n".join(lines) + "\n")


def main() -> int:
    """Kill, measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--speed", type=float, default=40.0, help="vehicle seconds per second")
    parser.add_argument("--run", type=run_folder, help="run folder with a plan; default: it is planned")
    arguments = parser.parse_args()
    moments = np.random.default_rng(arguments.seed).uniform(0.0, 0.95, arguments.kills)
    with tempfile.TemporaryDirectory() as folder:
        planned = arguments.run or Path(folder) / "planned"
        if arguments.run is None and exit_code("plan", SCENARIO, "--evaluations", EVALUATIONS, "-o", planned) != 0:
            raise RuntimeError("no plan")
        rows: list[Killed] = []
        for number, moment in enumerate(moments.tolist()):
            rows.append(measure(planned, Path(folder) / f"run_{number}", moment=moment, speed=arguments.speed))
            print(rows[-1], flush=True)
    print(summary(rows))
    if arguments.out is not None:
        write_results(arguments.out, rows, kills=arguments.kills, seed=arguments.seed, speed=arguments.speed)
    return 0 if all(row.good for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
