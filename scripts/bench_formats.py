"""Measure codecs and formats: messages a second, and files of 50,000 items, against pymavlink and MAVSDK in the same run.

Usage: .venv/bin/python scripts/bench_formats.py [-o docs/results/formats.md] [--items 50000] [--rounds 5]

Rivals take turns, round by round, so that what else the machine does meets all of them; the best round of each counts, in
processor time of this process (all contests run in one thread of it).
"""

import argparse
import datetime
import importlib.metadata
import itertools
import os
import platform
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mavsdk
from mavsdk.plugins.mission_raw import MissionRaw
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as dialect

from mission_io.autopilots.autopilot import PX4
from mission_io.formats import csv, plan, wpl
from mission_io.links.opening import UdpLink
from mission_io.model.areas import Fence, RallyPoints
from mission_io.model.items import Frame, GeoPoint, Mission, MissionType, waypoint
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from mission_io.wire.mission_items import message_from_item
from scripts.options import file_to_write

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.mission_io.real_vehicle import flying_on  # noqa: E402
from tests.mission_io.vehicle import VehiclePeer  # noqa: E402

_MESSAGES = 5_000

Contest = Mapping[str, Callable[[], object]]
OURS = "mission_io"


def seconds_of(contest: Contest, rounds: int) -> dict[str, float]:
    """The best processor time of each rival, in turns: what else the machine does would drown the wall clock."""
    best = dict.fromkeys(contest, float("inf"))
    for _, (name, call) in itertools.product(range(rounds), contest.items()):
        start = time.process_time()
        call()
        best[name] = min(best[name], time.process_time() - start)
    return best


def mission_of(count: int) -> Mission:
    """Waypoints at random places of one degree."""
    rng = random.Random(1)
    places = ((33.0 + rng.random(), -98.0 + rng.random(), round(rng.uniform(10.0, 100.0), 3)) for _ in range(count))
    home = GeoPoint(33.21875, -98.1234567, 345.678)
    return Mission(home, tuple(waypoint(*place, frame=Frame.ABOVE_HOME) for place in places))


def codec_contests() -> dict[str, Contest]:
    """Mission items and positions to bytes and back."""
    to = {"mission_type": MissionType.MISSION, "target_system": 1, "target_component": 1}
    items = [message_from_item(item, n, **to) for n, item in enumerate(mission_of(_MESSAGES).items)]  # type: ignore[arg-type]
    positions = [
        m.GlobalPositionInt(0.1 * n, 33.2 + 1e-7 * n, -98.1, 400.0, 50.0, 1.0, 2.0, 0.1, 90.0) for n in range(_MESSAGES)
    ]
    contests: dict[str, Contest] = {}
    for name, ours in (("MISSION_ITEM_INT", items), ("GLOBAL_POSITION_INT", positions)):
        sender = Codec(system_id=1, component_id=1)
        datagrams = [sender.encode(message) for message in ours]
        theirs = [dialect.MAVLink(None).parse_buffer(data)[0] for data in datagrams]
        contests[f"{name} out"] = {OURS: _encoder(ours), "pymavlink": _pymavlink_encoder(theirs)}
        contests[f"{name} in"] = {
            OURS: _decoder(datagrams),
            "pymavlink parse_buffer": _pymavlink_decoder(datagrams),
            "pymavlink parse_char": _pymavlink_char_decoder(datagrams),
        }
    return contests


def _encoder(messages: list[Any]) -> Callable[[], object]:
    def encode() -> None:
        codec = Codec(system_id=1, component_id=1)
        for message in messages:
            codec.encode(message)

    return encode


def _pymavlink_encoder(messages: list[Any]) -> Callable[[], object]:
    """Each message is made anew from its values, as ours are frozen values already, then packed."""
    values = [(type(message), [getattr(message, name) for name in message.fieldnames]) for message in messages]

    def encode() -> None:
        link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        for kind, fields in values:
            kind(*fields).pack(link)

    return encode


def _decoder(datagrams: list[bytes]) -> Callable[[], object]:
    def decode() -> None:
        codec = Codec(system_id=255, component_id=190)
        read = sum(len(codec.decode(data)) for data in datagrams)
        if read != len(datagrams):
            raise RuntimeError(f"{read} of {len(datagrams)} messages were read")

    return decode


def _pymavlink_decoder(datagrams: list[bytes]) -> Callable[[], object]:
    def decode() -> None:
        link = dialect.MAVLink(None)
        link.robust_parsing = True
        for data in datagrams:
            link.parse_buffer(data)

    return decode


def _pymavlink_char_decoder(datagrams: list[bytes]) -> Callable[[], object]:
    def decode() -> None:
        link = dialect.MAVLink(None)
        link.robust_parsing = True
        for data in datagrams:
            for number in range(len(data)):
                link.parse_char(data[number : number + 1])

    return decode


@contextmanager
def mavsdk_importer() -> Iterator[MissionRaw]:
    """MAVSDK's importers go by the vehicle that is connected, so one of ours is."""
    mavsdk.log_subscribe(lambda *_: True)
    link = UdpLink.listening()
    ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    ground.add_any_connection(f"udpout://127.0.0.1:{link.local_port}")
    with flying_on(link, VehiclePeer(PX4)):
        system = ground.first_autopilot(30.0)
        if system is None:
            raise RuntimeError("MAVSDK did not find the vehicle of the tests")
        raw = MissionRaw(system)
        yield raw
        raw.destroy()
        ground.destroy()


def format_contests(mission: Mission, folder: Path, raw: MissionRaw) -> dict[str, Contest]:
    """Files of many items out and in. MAVSDK has no writers, pymavlink no ``.plan``."""
    count = len(mission.items)
    waypoints = wpl.write_mission(mission)
    whole = plan.PlanFile(mission, Fence(), RallyPoints(), mav_autopilot=PX4.mav_autopilot)
    plan_text, csv_text = plan.write(whole), csv.write_mission(mission)
    path, other = folder / "mission.waypoints", folder / "other.waypoints"
    path.write_text(waypoints, newline="")
    loaded = mavwp.MAVWPLoader()
    loaded.load(str(path))

    def read_ours() -> None:
        _check(len(wpl.read(path.read_text()).items), count)

    def read_pymavlink() -> None:
        _check(mavwp.MAVWPLoader().load(str(path)), count + 1)

    def read_mavsdk() -> None:
        _check(len(raw.import_mission_planner_mission_from_string(path.read_text()).mission_items), count + 1)

    def read_plan_mavsdk() -> None:
        _check(len(raw.import_qgroundcontrol_mission_from_string(plan_text).mission_items), count)

    return {
        f"`.waypoints` of {count} items written": {
            OURS: lambda: other.write_text(wpl.write_mission(mission), newline=""),
            "pymavlink (6 decimals)": lambda: loaded.save(str(other)),
        },
        f"`.waypoints` of {count} items read": {OURS: read_ours, "pymavlink": read_pymavlink, "MAVSDK": read_mavsdk},
        f"`.plan` of {count} items written": {OURS: lambda: plan.write(whole)},
        f"`.plan` of {count} items read": {
            OURS: lambda: _check(len(plan.read(plan_text).mission.items), count),
            "MAVSDK": read_plan_mavsdk,
        },
        f"CSV of {count} items written": {OURS: lambda: csv.write_mission(mission)},
        f"CSV of {count} items read": {OURS: lambda: csv.read_mission(csv_text)},
    }


def _check(count: int, wanted: int) -> None:
    if count != wanted:
        raise RuntimeError(f"{count} items were read, {wanted} are in the file")


def rows_of(contests: Mapping[str, Contest], rounds: int, per_run: int | None) -> list[str]:
    """Lines of the table: ours, each rival, and how many times faster than it ours is."""
    lines = []
    for name, contest in contests.items():
        best = seconds_of(contest, rounds)
        ours_s = best[OURS]

        def shown(seconds: float) -> str:
            return f"{seconds:.3f} s" if per_run is None else f"{per_run / seconds / 1000.0:.1f} k/s"

        rivals = [f"{rival}: {shown(s)} (x {s / ours_s:.2f})" for rival, s in best.items() if rival != OURS]
        lines.append(f"| {name} | {shown(ours_s)} | {'; '.join(rivals) or '-'} |")
        print(lines[-1], flush=True)
    return lines


def main() -> int:
    """Run all contests and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=file_to_write, help="Markdown file")
    parser.add_argument("--items", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    lines = rows_of(codec_contests(), options.rounds, _MESSAGES)
    with mavsdk_importer() as raw, tempfile.TemporaryDirectory() as folder:
        lines += rows_of(format_contests(mission_of(options.items), Path(folder), raw), options.rounds, None)
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("pymavlink", "mavsdk"))
    load = "/".join(f"{value:.1f}" for value in os.getloadavg())
    where = (
        f"{platform.machine()}, {os.cpu_count()} cores, CPython {platform.python_version()}, load {load}, {versions}"
    )
    head = [
        "# Codecs and formats",
        "",
        f"`scripts/bench_formats.py --items {options.items} --rounds {options.rounds}`,"
        f" {datetime.datetime.now(datetime.UTC):%Y-%m-%d}; {where}.",
        "Processor time, best of the rounds, rivals in turns; *x* is the rival's time over ours: above 1, ours is faster.",
        "",
        "| what | mission_io | others |",
        "|---|---|---|",
    ]
    if options.output:
        options.output.write_text("\n".join([*head, *lines]) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
