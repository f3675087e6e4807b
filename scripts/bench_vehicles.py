"""Measure many mock vehicles at once: each a process of its own, in the air, at ten times real time, heard by a ground station.

Usage: .venv/bin/python scripts/bench_vehicles.py [-o docs/results/vehicles.md] [--vehicles 1,5,10,20,40] [--speed 10]
                                                 [--seconds 20] [--autopilot px4]

This script starts ``uavcover mock-vehicle`` so many times, uploads a mission of an hour to each over UDP, arms and starts it,
and listens for ``--seconds`` of real time. "reached" is vehicle time by wall time, over all vehicles and of the slowest; "CPU" is
processor time of the vehicles' processes during that, by wall time ("share of a core") and by vehicle time; "memory" is what
a vehicle's process has alone, plus its share of what it has in common (PSS). The listener's own processor time is beside it:
it is a ground station's, not the vehicles'. Linux only: it reads /proc.
"""

import argparse
import contextlib
import csv
import datetime
import json
import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from importlib import metadata
from pathlib import Path

from mission_io.client.client import Client
from mission_io.links.opening import UdpLink
from mission_io.model.items import Command, Frame, GeoPoint, Mission, takeoff, waypoint
from mission_io.wire import messages as m
from scripts.options import file_to_write, whole_numbers
from uavcover.routes.mission_compiler import AUTOPILOTS
from uavcover.vehicle.modes import Mode, custom_mode

HOME = GeoPoint(36.3, -84.2, 400.0)
LEGS, LEG_DEG = 60, 0.006
"""There and back over 670 m: an hour at 10 m/s."""
TICKS_S = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Row:
    """What was measured with one number of vehicles."""

    vehicles: int
    speed_asked: float
    speed_reached: float
    speed_slowest: float
    cpu_share_per_vehicle: float
    cpu_ms_per_vehicle_s: float
    cpu_cores_vehicles: float
    cpu_cores_listener: float
    memory_mb_per_vehicle: float
    messages_per_s: float


@dataclass(slots=True)
class Flying:
    """A vehicle in the air."""

    pid: int
    client: Client
    link: UdpLink


def hour_long() -> Mission:
    """There and back, at 60 m above home."""
    legs = [
        waypoint(HOME.lat_deg + LEG_DEG * (n % 2 == 0), HOME.lon_deg + 1e-4 * n, 60.0, frame=Frame.ABOVE_HOME)
        for n in range(LEGS)
    ]
    return Mission(HOME, (takeoff(HOME.lat_deg, HOME.lon_deg, 60.0, frame=Frame.ABOVE_HOME), *legs))


@contextlib.contextmanager
def vehicle_process(autopilot: str, speed: float) -> Iterator[subprocess.Popen[str]]:
    """A vehicle in a process of its own, which tells its port."""
    home = f"{HOME.lat_deg},{HOME.lon_deg},{HOME.alt_amsl_m}"
    arguments = ["--listen", "udpin://127.0.0.1:0", "--json", "--autopilot", autopilot, "--endurance", "36000"]
    command = [sys.executable, "-m", "uavcover", "mock-vehicle", *arguments, "--home", home, "--speed", f"{speed:g}"]
    command += ["--gust", "1", "--wind", "4", "-q"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def port_of(process: subprocess.Popen[str]) -> int:
    """The port that a vehicle says it has bound."""
    if process.stdout is None:
        raise RuntimeError("the vehicle has no output")
    return int(json.loads(process.stdout.readline())["port"])


def take_off(client: Client) -> None:
    """Upload the mission and start it."""
    vehicle = client.wait_for_vehicle(60.0)
    autopilot = vehicle.autopilot
    client.upload_and_verify(hour_long())
    home = client.request_message(m.HomePosition, timeout_s=30.0)  # it is known once the vehicle's checks pass
    if home.alt_amsl_m != HOME.alt_amsl_m:
        raise RuntimeError(f"home is at {home.alt_amsl_m} m")
    first = Mode.MISSION if autopilot is AUTOPILOTS["px4"] else Mode.GUIDED
    client.set_mode(custom_mode(autopilot, first))
    client.command(Command.COMPONENT_ARM_DISARM, 1.0, timeout_s=30.0)
    if first is Mode.GUIDED:
        client.set_mode(custom_mode(autopilot, Mode.MISSION))
        client.command(Command.MISSION_START)


def measure(count: int, *, autopilot: str, speed: float, seconds: float) -> Row:
    """Fly so many vehicles and listen to them."""
    with contextlib.ExitStack() as stack:
        flying: list[Flying] = []
        processes = [stack.enter_context(vehicle_process(autopilot, speed)) for _ in range(count)]
        for process in processes:
            link = UdpLink.connecting("127.0.0.1", port_of(process))
            client = stack.enter_context(Client(link))
            take_off(client)
            flying.append(Flying(process.pid, client, link))
        listen(flying, until=time.monotonic() + 1.0)  # what has waited since the first one took off
        time_before, cpu_before = [vehicle_time_s(one) for one in flying], [cpu_s(one.pid) for one in flying]
        own_before, wall_before = own_cpu_s(), time.monotonic()
        frames = listen(flying, until=wall_before + seconds)
        wall_s, own_s = time.monotonic() - wall_before, own_cpu_s() - own_before
        used = [cpu_s(one.pid) - before for one, before in zip(flying, cpu_before, strict=True)]
        flown = [vehicle_time_s(one) - before for one, before in zip(flying, time_before, strict=True)]
        asked_s = time.monotonic() - wall_before  # asking for the times takes a moment itself
        memory_mb = sum(pss_mb(one.pid) for one in flying) / count
    return Row(
        count, speed, sum(flown) / count / asked_s, min(flown) / asked_s, sum(used) / count / wall_s,
        1000.0 * sum(used) * asked_s / wall_s / sum(flown), sum(used) / wall_s, own_s / wall_s, memory_mb, frames / wall_s,
    )  # fmt: skip


def listen(flying: list[Flying], *, until: float) -> int:
    """Take what the vehicles send and count the messages, looking at all of them every 20 ms."""
    count = 0
    while time.monotonic() < until:
        for one in flying:
            while (datagram := one.link.receive(0.0)) is not None:
                count += frames_in(datagram)
        time.sleep(0.02)
    return count


def frames_in(datagram: bytes) -> int:
    """How many MAVLink 2 frames follow each other in a datagram."""
    count = at = 0
    while at < len(datagram):
        at += 12 + datagram[at + 1]
        count += 1
    return count


def vehicle_time_s(one: Flying) -> float:
    """The vehicle's own time."""
    return one.client.request_message(m.SystemTime, timeout_s=30.0).time_boot_s


def cpu_s(pid: int) -> float:
    """Processor time of a process, user and system (fields 14 and 15 of /proc/PID/stat)."""
    after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(after_name[11]) + int(after_name[12])) * TICKS_S


def own_cpu_s() -> float:
    """Processor time of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def pss_mb(pid: int) -> float:
    """Proportional set size of a process."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1024.0
    raise RuntimeError(f"/proc/{pid}/smaps_rollup has no Pss")


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it")
    parser.add_argument(
        "--vehicles", type=whole_numbers, default="1,5,10,20,40", help="how many at once, one measurement each"
    )
    parser.add_argument("--speed", type=float, default=10.0, help="vehicle seconds per second")
    parser.add_argument("--seconds", type=float, default=20.0, help="how long to listen")
    parser.add_argument("--autopilot", choices=["ardupilot", "px4"], default="px4")
    given = parser.parse_args()
    rows: list[Row] = []
    for count in given.vehicles:
        rows.append(measure(count, autopilot=given.autopilot, speed=given.speed, seconds=given.seconds))
        print(rows[-1], flush=True)
        if given.out is not None:
            save(given.out, rows, seconds=given.seconds, autopilot=given.autopilot)


def save(out: Path, rows: list[Row], *, seconds: float, autopilot: str) -> None:
    """What there is so far, as Markdown and beside it as CSV."""
    head = [
        "# Many mock vehicles at once, measured",
        "",
        f"Command: `.venv/bin/python scripts/bench_vehicles.py -o {out}`, {datetime.date.today().isoformat()}, "
        f"uavcover {metadata.version('uavcover')}, Python {platform.python_version()}, {os.cpu_count()} cores "
        f"({platform.machine()}), shared with other work (load average {os.getloadavg()[2]:.0f}). {autopilot} in wind with "
        f"gusts, {seconds:g} s of real time each; what is measured is said at the top of the script.",
        "",
        "| vehicles | speed asked | reached | slowest | CPU per vehicle, share of a core | CPU per vehicle second, ms | "
        "CPU of all, cores | listener, cores | memory per vehicle, MB | messages/s |",
        "|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    body = [
        f"| {r.vehicles} | {r.speed_asked:g} | {r.speed_reached:.2f} | {r.speed_slowest:.2f} | {r.cpu_share_per_vehicle:.3f} | "
        f"{r.cpu_ms_per_vehicle_s:.2f} | {r.cpu_cores_vehicles:.2f} | {r.cpu_cores_listener:.2f} | "
        f"{r.memory_mb_per_vehicle:.0f} | {r.messages_per_s:.0f} |"
        for r in rows
    ]  # fmt: skip
    out.write_text("\n".join(head + body) + "\n")
    with out.with_suffix(".csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([[f.name for f in fields(Row)], *(astuple(r) for r in rows)])


if __name__ == "__main__":
    main()
