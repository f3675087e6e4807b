"""Memory that ``uavcover plan --memory`` takes, against the limit that it was given.

Usage: .venv/bin/python scripts/bench/memory.py -o PAGE.md [--only NAME]

Each plan is made by the command in a process of its own, with few evaluations: a longer search takes no more. Memory is the
largest sum of what the command and its workers have of their own, and of the libraries that they share, sampled four times a
second. Areas are squares of the bundled heights around the middle of ridge-25km2, with its camera, or with a frame camera that
takes overlapping pictures. What is missing in the .csv beside the page is measured; run again after a stop, it goes on.
"""

import argparse
import dataclasses
import datetime
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import threading
from importlib import metadata
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from scripts.bench.planner import window
from scripts.options import Row, file_to_write, read_rows, write_rows
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import FrameCamera
from uavcover.new.quantities import memory_bytes
from uavcover.scenario.scenario_file import dump_scenario

CASES = (
    ("nadir", 5_000.0, 10.0, "2", "600MiB"),
    ("nadir", 5_000.0, 10.0, "2", "4GiB"),
    ("nadir", 10_000.0, 10.0, "2", "800MiB"),
    ("nadir", 10_000.0, 10.0, "2", "1GiB"),
    ("nadir", 10_000.0, 10.0, "local:2", "1600MiB"),
    ("nadir", 10_000.0, 10.0, "local:2", "4GiB"),
    ("frame", 5_000.0, 10.0, "2", "600MiB"),
    ("frame", 5_000.0, 5.0, "2", "1GiB"),
)
"""Camera, side of the square, cell, threads or scheduler, limit."""
COLUMNS = (
    "camera", "side_m", "cell_m", "workers", "limit", "parts", "at_a_time", "peak_mib", "peak_command_mib",
    "coverage", "date",
)  # fmt: skip
_EVALUATIONS = 400
_PAGES = re.compile(r"^Rss(Anon|File|Shmem):\s+(\d+) kB", re.MULTILINE)


class Watch:
    """Samples a process and its family until it is ended.

    Memory is what each process has of its own, and once what they have of files, such as libraries: the most that one of them
    has.

    Attributes:
        peak_mib: the largest sum so far.
        peak_first_mib: the largest of the process itself.
        first_cpu_s: processor time of the process itself, at the last sample.
        first_main_cpu_s: of it that of its main thread.
        cpu_s: of each process at the last sample of it, together.
    """

    def __init__(self, pid: int, *, every_s: float = 0.25) -> None:
        self.peak_mib = self.peak_first_mib = self.first_cpu_s = self.first_main_cpu_s = 0.0
        self._pid, self._every_s = pid, every_s
        self._over = threading.Event()
        self._cpu_s: dict[int, float] = {}
        self._thread = threading.Thread(target=self._sample, daemon=True)
        self._thread.start()

    @property
    def cpu_s(self) -> float:
        """See above."""
        return sum(self._cpu_s.values())

    def end(self) -> None:
        """No more samples."""
        self._over.set()
        self._thread.join()

    def _sample(self) -> None:
        while not self._over.wait(self._every_s):
            family = _family(self._pid)
            sizes = [_mib(each) for each in family]
            self.peak_mib = max(self.peak_mib, sum(own for own, _ in sizes) + max(of_files for _, of_files in sizes))
            self.peak_first_mib = max(self.peak_first_mib, sum(sizes[0]))
            for each in family:
                self._cpu_s[each] = _cpu_s(each) or self._cpu_s.get(each, 0.0)
            self.first_cpu_s = self._cpu_s[family[0]]
            self.first_main_cpu_s = _cpu_s(f"{family[0]}/task/{family[0]}") or self.first_main_cpu_s


def _mib(pid: int) -> tuple[float, float]:
    """What a process has of its own, and of files."""
    try:
        pages = {
            name: float(kib) / 1024.0
            for name, kib in _PAGES.findall(Path(f"/proc/{pid}/status").read_text(encoding="utf-8"))
        }
    except OSError:
        pages = {}
    return pages.get("Anon", 0.0) + pages.get("Shmem", 0.0), pages.get("File", 0.0)


def _cpu_s(pid: int | str) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _family(pid: int) -> list[int]:
    """A process, its children and theirs, whichever of its threads started them."""
    found = [pid]
    for each in found:
        for children in Path(f"/proc/{each}/task").glob("*/children"):
            try:
                found += [int(word) for word in children.read_text(encoding="ascii").split()]
            except OSError:
                continue
    return found


def scenario_of(camera: str, side_m: float, cell_m: float) -> Scenario:
    """A square of the ridge."""
    scenario = window(side_m, cell_m)
    if camera == "frame":
        sensor = FrameCamera(
            kind="frame-camera", fov_across_deg=73.0, fov_along_deg=53.0, range_m=300.0, mount="stabilised",
            forward_overlap=0.7, side_overlap=0.3,
        )  # fmt: skip
        scenario = dataclasses.replace(scenario, sensor=sensor)
    return scenario


def measured(camera: str, side_m: float, cell_m: float, workers: str, limit: str) -> dict[str, str]:
    """What one plan takes."""
    with tempfile.TemporaryDirectory() as folder:
        file, run = Path(folder) / "scenario.toml", Path(folder) / "run"
        file.write_text(dump_scenario(scenario_of(camera, side_m, cell_m)), encoding="utf-8")
        command = [sys.executable, "-m", "uavcover", "plan", str(file), "-o", str(run), "-v", "--memory", limit]
        command += ["--parts", "auto", "--evaluations", str(_EVALUATIONS), "--select", "coverage>=0.98"]
        command += ["--scheduler", workers] if workers.startswith("local") else ["--workers", workers]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        watch = Watch(process.pid)
        said, _ = process.communicate()
        watch.end()
        if process.returncode not in (0, 1):
            raise SystemExit(f"plan ended with exit code {process.returncode}: {said[-1000:]}")
        found = json.loads((run / "plan.json").read_text(encoding="utf-8"))["metrics"]
    parts = re.search(r"--memory: (\d+) parts?, (\d+) at a time", said)
    if parts is None:
        raise SystemExit(f"plan did not say how it divides the area: {said[-1000:]}")
    return {
        "parts": parts[1], "at_a_time": parts[2], "peak_mib": f"{watch.peak_mib:.0f}",
        "peak_command_mib": f"{watch.peak_first_mib:.0f}", "coverage": f"{found['coverage_of_coverable']:.4f}",
    }  # fmt: skip


def page(rows: list[Row]) -> str:
    """The table."""
    lines = [
        "# Memory of a plan",
        "",
        f"Command: `.venv/bin/python scripts/bench/memory.py`, {max(row['date'] for row in rows)}, uavcover "
        f"{metadata.version('uavcover')}, Python {platform.python_version()}. What is measured is said at the top of the script.",
        "",
        "| camera | area | cells | by | limit | parts | at a time | memory | of the limit | of it the command | coverage |",
        "|---|---:|---:|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        side_m, cell_m, peak = float(row["side_m"]), float(row["cell_m"]), float(row["peak_mib"])
        limit = memory_bytes(row["limit"], option="limit") / 2**20
        by = row["workers"] if row["workers"].startswith("local") else f"{row['workers']} threads"
        lines.append(
            f"| {row['camera']} | {side_m * side_m / 1e6:g} km² | {(side_m / cell_m) ** 2:,.0f} | {by} | {limit:,.0f} MiB "
            f"| {row['parts']} | {row['at_a_time']} | {peak:,.0f} MiB | {peak / limit:.0%} "
            f"| {float(row['peak_command_mib']):,.0f} MiB | {float(row['coverage']):.2%} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, required=True)
    parser.add_argument("--only", choices=sorted({case[0] for case in CASES}))
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = read_rows(table)
    for case in CASES:
        names = dict(zip(COLUMNS, (case[0], f"{case[1]:g}", f"{case[2]:g}", *case[3:]), strict=False))
        if arguments.only not in (None, case[0]) or any(names.items() <= row.items() for row in rows):
            continue
        rows.append({**names, **measured(*case), "date": datetime.date.today().isoformat()})
        write_rows(table, COLUMNS, rows)
        arguments.out.write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
