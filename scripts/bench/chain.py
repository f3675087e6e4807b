"""Measure the chain: coverage evaluations against the naive twin, upload of 1,000 items, stages and memory of the demo.

Usage: .venv/bin/python scripts/bench/chain.py [-o PAGE.md]

Ratios are measured side by side in one run; the machine and the date are written beside them.
"""

import argparse
import csv
import datetime
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import numpy as np

from mission_io import PX4, wire_items
from mission_io.client.client import Client
from mission_io.links.opening import open_link
from mission_io.model.items import Frame, GeoPoint, Mission, MissionType, waypoint
from scripts.options import file_to_write
from uavcover.mock.server import BackgroundMock
from uavcover.mock.vehicle import MockVehicle
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.naive.coverage import first_observed as naive_first_observed  # noqa: E402

Row = tuple[str, str, str]


def best_s(call: Callable[[], object], repeat: int) -> float:
    """Shortest of several runs: the machine's noise only ever adds."""
    times = []
    for _ in range(repeat):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def coverage_rows() -> list[Row]:
    """Coverage evaluations a second, kernel and naive twin on the same looks."""
    site = load_site("jacksboro")
    coverage = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    looks = coverage.observations(fly_layout(site, plain_boustrophedon(site)).waypoints_m)
    coverage.observed_by(looks)
    fast_s = best_s(lambda: coverage.observed_by(looks), 20)
    every = max(1, len(looks) // 3)
    few = LevelObservations(looks.positions_m[::every].copy(), looks.headings[::every].copy())
    naive_s = best_s(
        lambda: naive_first_observed(
            site.ground.surface, coverage.sight, coverage.grid.cells, few.positions_m, few.headings
        ),
        1,
    )
    few_s = best_s(lambda: coverage.observed_by(few), 20)
    return [
        ("coverage of a whole route, jacksboro, 10 m cells", f"{1 / fast_s:.0f} a second", f"{len(looks)} looks"),
        (
            "kernel against the naive twin, same looks",
            f"{naive_s / few_s:.0f} times faster",
            f"{len(few)} looks, one core",
        ),
    ]


def upload_rows() -> list[Row]:
    """Upload and read-back of 1,000 items over UDP on loopback."""
    home = GeoPoint(36.4762, -84.2160, 485.0)
    items = tuple(
        waypoint(home.lat_deg + 1e-5 * k, home.lon_deg - 2e-5 * k, 50.0, frame=Frame.ABOVE_HOME) for k in range(1000)
    )
    mission = Mission(home, items)
    with (
        BackgroundMock(MockVehicle(PX4, home)) as mock,
        Client(open_link(f"udpout://127.0.0.1:{mock.port}")) as client,
    ):
        client.wait_for_vehicle()
        wire = wire_items(mission, PX4)
        upload_s = best_s(lambda: client.upload(MissionType.MISSION, wire), 3)
        both_s = best_s(lambda: client.upload_and_verify(mission), 3)
    return [
        (
            "upload of 1,000 items over UDP loopback",
            f"{upload_s:.2f} s",
            "best of 3, vehicle in a thread of this process",
        ),
        ("upload, read-back and comparison of them", f"{both_s:.2f} s", "best of 3"),
    ]


def demo_rows(folder: Path) -> list[Row]:
    """Stage times and peak memory of the demo, with a cold and a warm kernel cache."""
    rows: list[Row] = []
    cache = folder / "numba-cache"
    for label in ("cold", "warm"):
        run = folder / f"demo-{label}"
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "uavcover", "demo", "-o", str(run), "-q"],
            env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
            cwd=folder,
        )
        peak = PeakMemory(process.pid)
        code = process.wait()
        wall_s = time.perf_counter() - started
        peak.stop()
        if code != 0:
            raise SystemExit(f"the demo ended with exit code {code}")
        stages = json.loads((run / "run.json").read_text())["stages"]
        detail = ", ".join(f"{name} {stage['wall_s']:.1f} s" for name, stage in stages.items())
        rows.append((f"demo, {label} kernel cache", f"{wall_s:.1f} s", detail))
        rows.append(
            (f"peak memory of the demo, {label}", f"{peak.largest_mib:.0f} MiB", "planner and mock vehicle together")
        )
    return rows


class PeakMemory:
    """Watches the resident memory of a process and its children (Linux: /proc)."""

    def __init__(self, pid: int) -> None:
        self.largest_mib = 0.0
        self._pid = pid
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()

    def stop(self) -> None:
        """End watching."""
        self._ended.set()
        self._thread.join()
        children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0
        self.largest_mib = max(self.largest_mib, children)

    def _watch(self) -> None:
        while not self._ended.wait(0.1):
            total = sum(_resident_mib(pid) for pid in [self._pid, *_children(self._pid)])
            self.largest_mib = max(self.largest_mib, total)


def _children(pid: int) -> list[int]:
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    return [int(child) for child in text.split()]


def _resident_mib(pid: int) -> float:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError, ValueError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it")
    out = parser.parse_args().out
    rows = coverage_rows() + upload_rows()
    with tempfile.TemporaryDirectory() as folder:
        rows += demo_rows(Path(folder))
    lines = [
        "| what | measured | detail |",
        "|---|---|---|",
        *(f"| {what} | {measured} | {detail} |" for what, measured, detail in rows),
    ]
    print("\n".join(lines))
    if out is not None:
        head = [
            "# The chain, measured",
            "",
            f"Command: `.venv/bin/python scripts/bench/chain.py -o {out}`, {datetime.date.today().isoformat()}, "
            f"uavcover {metadata.version('uavcover')}, Python {platform.python_version()}, numpy {np.__version__}, "
            f"{os.cpu_count()} cores ({platform.machine()}), shared with other work.",
            "",
        ]
        out.write_text("\n".join(head + lines) + "\n")
        with out.with_suffix(".csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([("what", "measured", "detail"), *rows])


if __name__ == "__main__":
    main()
