"""Plan large areas by Dask with one and two workers: time, memory, and what it would take with more workers.

Usage: .venv/bin/python scripts/bench_cluster.py [-o docs/results/cluster.md] [--only 100km2-10m:2]

`100km2-10m` is the square of 10 km of the bundled heights of scripts/bench_large.py, with its camera and home. `1000km2-30m`
and `10000km2-30m` are squares of generated terrain (seeded octaves of smooth noise, 900 m of relief, pixels of 90 m) with
cells of 30 m, seen by a nadir camera from 300 to 600 m above ground, without a home. Each plan is made by `uavcover plan
--scheduler local:N` in a process of its own. Processor time is of the command and all its workers. Memory is the largest
sum of what the command and its workers have of their own, and of the files that they share, sampled four times a second. A
plan that somebody kills (SIGKILL) is begun again here, and goes on from its folder under --keep; its figures are of all attempts.

Simulated: the times of the tasks of each round as measured, given to so many workers, the next one to who is free first; plus
the processor time of the command's main thread, which nobody shares. Its other threads do what goes on beside the search: Dask's
loops, and lines to compare with. What is measured already is not measured again.
"""

import argparse
import datetime
import heapq
import json
import os
import re
import signal
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.bench_planner import window
from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import file_to_write, one_of
from scripts.watched import Watch
from uavcover.scenario.scenario_file import dump_scenario

CASES = {"100km2-10m": (4, 40_000), "1000km2-30m": (8, 8_000), "10000km2-30m": (40, 40_000)}
"""Parts and evaluations of each area."""
WORKERS = (2, 1)
SIMULATED = (1, 2, 4, 8, 16, 32, 64)
ASKED = 0.98
COLUMNS = (
    "area", "workers", "parts", "evaluations", "coverage", "length_m", "time_s", "waypoints", "lines_coverage", "lines_length_m",
    "lines_time_s", "kills", "wall_s", "cpu_s", "command_cpu_s", "main_cpu_s", "task_cpu_s", "search_cpu_s", "peak_mib",
    "peak_command_mib", "task_bytes", "answer_bytes", "shared_bytes", "load", "date",
)  # fmt: skip
_PIXEL_M = 90.0
_TASK = re.compile(r"\w+: task of (\d+) bytes, answer of (\d+), ([0-9.]+) s of processor time")
_ROUND = re.compile(r"(\w+): (\d+) tasks, with (\d+) bytes for each worker")


def generated(side_m: float, folder: Path) -> str:
    """A scenario on generated terrain, and its elevation file beside it."""
    import rasterio
    from rasterio.transform import from_origin
    from scipy.ndimage import zoom

    rng = np.random.default_rng(18)
    count = round(side_m / _PIXEL_M) + 60
    heights = np.zeros((count, count))
    for octave in range(6):
        coarse = rng.normal(size=(2 ** (octave + 2) + 1,) * 2)
        heights += (
            zoom(coarse, count / coarse.shape[0], order=3, grid_mode=True, mode="nearest")[:count, :count] / 1.9**octave
        )
    heights = 400.0 + 900.0 * (heights - heights.min()) / np.ptp(heights)
    west, north = 500_000.0 - 0.5 * count * _PIXEL_M, 5_100_000.0 + 0.5 * count * _PIXEL_M
    with rasterio.open(
        folder / "ground.tif", "w", driver="GTiff", width=count, height=count, count=1, dtype="float32", crs="EPSG:32633",
        transform=from_origin(west, north, _PIXEL_M, _PIXEL_M), compress="deflate",
    ) as file:  # fmt: skip
        file.write(heights.astype("float32"), 1)
    half = 0.5 * side_m
    return f"""
name = "generated-{side_m / 1000:.0f}km"
select = "coverage>={ASKED}"
[origin]
lat_deg = 46.05
lon_deg = 15.0
alt_amsl_m = 800.0
[area]
polygon_east_north_m = [[{-half}, {-half}], [{half}, {-half}], [{half}, {half}], [{-half}, {half}]]
cell_size_m = 30.0
[terrain]
kind = "raster"
file = "ground.tif"
vertical_datum = "EGM96"
[sensor]
kind = "nadir-camera"
fov_deg = 70.0
range_m = 900.0
sample_spacing_m = 60.0
[limits]
min_height_agl_m = 300.0
max_height_agl_m = 600.0
[vehicle]
cruise_speed_m_s = 30.0
[planner]
algorithm = "memetic"
"""


def scenario_of(area: str, folder: Path) -> Path:
    """Its file."""
    file = folder / "scenario.toml"
    if area == "100km2-10m":
        file.write_text(dump_scenario(window(10_000.0, 10.0)), encoding="utf-8")
    else:
        file.write_text(generated({"1000km2-30m": 31_620.0, "10000km2-30m": 100_000.0}[area], folder), encoding="utf-8")
    return file


def planned(area: str, workers: int, keep: Path) -> tuple[Row, list[list[float]]]:
    """A plan by the command, and the times of its tasks by rounds."""
    parts, evaluations = CASES[area]
    folder = keep / f"{area}-{workers}"
    folder.mkdir(parents=True, exist_ok=True)
    scenario, log = scenario_of(area, folder), folder / "log.txt"
    command = [sys.executable, "-m", "uavcover", "plan", str(scenario), "-o", str(folder / "run"), "-v", "--force"]
    command += ["--parts", str(parts), "--evaluations", str(evaluations), "--select", f"coverage>={ASKED}"]
    command += ["--scheduler", f"local:{workers}", "--memory", "4GiB"]
    total: dict[str, float] = dict.fromkeys(
        ("wall_s", "cpu_s", "command_cpu_s", "main_cpu_s", "peak_mib", "peak_command_mib"), 0.0
    )
    kills, began = 0, folder / "began.json"
    if began.exists():
        total, kills = json.loads(began.read_text(encoding="utf-8"))
    while True:
        begin = time.monotonic()
        with log.open("ab") as told:
            process = subprocess.Popen(command, stdout=told, stderr=told)
            watch = Watch(process.pid)
            process.wait()
            watch.end()
        for key, value in (
            ("wall_s", time.monotonic() - begin),
            ("cpu_s", watch.cpu_s),
            ("command_cpu_s", watch.first_cpu_s),
            ("main_cpu_s", watch.first_main_cpu_s),
        ):
            total[key] += value
        for key, value in (("peak_mib", watch.peak_mib), ("peak_command_mib", watch.peak_first_mib)):
            total[key] = max(total[key], value)
        if process.returncode != -signal.SIGKILL:
            break
        kills += 1
        began.write_text(json.dumps([total, kills]), encoding="utf-8")
    if process.returncode not in (0, 1):
        raise SystemExit(f"{area}, {workers} workers: plan ended with exit code {process.returncode}; see {log}")
    document = json.loads((folder / "run" / "plan.json").read_text(encoding="utf-8"))
    found, lines = (
        document["metrics"],
        next(each for each in document["baselines"] if each["name"] == "boustrophedon-tuned"),
    )
    rounds = read_rounds(log.read_text(encoding="utf-8"))
    searched = [task for round_ in rounds if round_.what == "search" for task in round_.tasks]
    every = [task for round_ in rounds for task in round_.tasks]
    values = {
        "parts": parts, "evaluations": evaluations, "coverage": found["coverage_of_coverable"],
        "length_m": found["path_length_m"], "time_s": found["flight_time_s"], "waypoints": found["waypoint_count"],
        "lines_coverage": lines["coverage_of_coverable"], "lines_length_m": lines["path_length_m"],
        "lines_time_s": lines["flight_time_s"], "kills": kills, **total, "load": os.getloadavg()[2],
        "task_cpu_s": sum(task.cpu_s for task in every), "search_cpu_s": sum(task.cpu_s for task in searched),
        "task_bytes": max(task.sent for task in every), "answer_bytes": max(task.answered for task in every),
        "shared_bytes": max(round_.shared for round_ in rounds),
    }  # fmt: skip
    times = [[task.cpu_s for task in round_.tasks] for round_ in rounds]
    return {key: str(value) for key, value in values.items()}, times


class Task(NamedTuple):
    """What ``-v`` says of a task."""

    sent: int
    answered: int
    cpu_s: float


class Round(NamedTuple):
    """Tasks that are done at the same time."""

    what: str
    shared: int
    tasks: list[Task]


def read_rounds(told: str) -> list[Round]:
    """The rounds of a plan from what ``-v`` says; one that a kill divided is one, and what was judged again counts once."""
    rounds: list[Round] = []
    place = 0
    for line in told.splitlines():
        if line.startswith("planning "):
            place = 0
        elif begun := _ROUND.search(line):
            if place == len(rounds):
                rounds.append(Round(begun[1], int(begun[3]), []))
            elif begun[1] != "search":
                rounds[place].tasks.clear()
            place += 1
        elif done := _TASK.search(line):
            rounds[place - 1].tasks.append(Task(int(done[1]), int(done[2]), float(done[3])))
    return rounds


def makespan_s(times_s: list[float], workers: int) -> float:
    """Tasks in their order, the next one to who is free first."""
    free = [0.0] * workers
    for each in times_s:
        heapq.heapreplace(free, free[0] + each)
    return max(free)


def page(rows: list[Row], tasks: dict[str, list[list[float]]]) -> str:
    """The tables."""
    lines = [
        "# Large areas by Dask",
        "",
        f"Command: `.venv/bin/python scripts/bench_cluster.py`, {max(row['date'] for row in rows)}, uavcover "
        f"{metadata.version('uavcover')}, Dask {metadata.version('distributed')}, 2 cores with much other work: wall time says "
        "little, processor time more. What is measured is said at the top of the script.",
        "",
        "| area | workers | parts | evaluations | kills | coverage | length | time | waypoints | wall time | processor time "
        "| of it tasks | of it the command | its main thread | memory | of it the command |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        times = (f"{float(row[key]):.0f} s" for key in ("wall_s", "cpu_s", "task_cpu_s", "command_cpu_s", "main_cpu_s"))
        lines.append(
            f"| {row['area']} | {row['workers']} | {row['parts']} | {row['evaluations']} | {row['kills']} "
            f"| {100.0 * float(row['coverage']):.2f} % | {float(row['length_m']) / 1000.0:.0f} km | {float(row['time_s']):.0f} s "
            f"| {row['waypoints']} | {' | '.join(times)} | {float(row['peak_mib']):.0f} MiB "
            f"| {float(row['peak_command_mib']):.0f} MiB |"
        )
    lines += ["", "The tuned boustrophedon (the fewest lines along one side) on the same ground:", ""]
    lines += ["| area | coverage | length | time | our length | our time |", "|---|---:|---:|---:|---:|---:|"]
    for row in rows:
        if row["workers"] == "2":
            ratios = (100.0 * (float(row[key]) / float(row[f"lines_{key}"]) - 1.0) for key in ("length_m", "time_s"))
            lines.append(
                f"| {row['area']} | {100.0 * float(row['lines_coverage']):.2f} % "
                f"| {float(row['lines_length_m']) / 1000.0:.0f} km | {float(row['lines_time_s']):.0f} s | "
                + " | ".join(f"{each:+.1f} %" for each in ratios)
                + " |"
            )
    walls = {(row["area"], row["workers"]): float(row["wall_s"]) for row in rows}
    for area, workers in walls:
        if workers == "2" and (area, "1") in walls:
            ratio = walls[area, "1"] / walls[area, "2"]
            loads = " and ".join(f"{float(row['load']):.1f}" for row in rows if row["area"] == area)
            lines += [
                "",
                f"Measured for {area}: two workers were {ratio:.2f} times as fast as one, by the wall, on two cores with other "
                f"work (load average {loads}).",
            ]
    lines += ["", "What a worker is given (here in a file that they share), and what each task sends, at most:", ""]
    lines += ["| area | for each worker, once | a task | its answer |", "|---|---:|---:|---:|"]
    for row in rows:
        if row["workers"] == "2":
            sizes = (int(row[key]) / 1024.0 for key in ("shared_bytes", "task_bytes", "answer_bytes"))
            lines.append(f"| {row['area']} | " + " | ".join(f"{size:.0f} KiB" for size in sizes) + " |")
    lines += [
        "",
        "**Simulated** from the measured task times (no such machines were used): the search takes so long with so many workers, "
        "and is so many times as fast as with one.",
        "",
        "| area | " + " | ".join(f"{count}" for count in SIMULATED) + " |",
        "|---|" + "---:|" * len(SIMULATED),
    ]
    for row in rows:
        if (rounds := tasks.get(f"{row['area']}:{row['workers']}")) and row["workers"] == "2":
            alone_s = float(row["main_cpu_s"])
            all_s = [alone_s + sum(makespan_s(each, count) for each in rounds) for count in SIMULATED]
            lines.append(
                f"| {row['area']} | " + " | ".join(f"{each:.0f} s ({all_s[0] / each:.1f})" for each in all_s) + " |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is missing."""
    names = [*CASES, *(f"{area}:{workers}" for area in CASES for workers in WORKERS)]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/cluster.md"))
    parser.add_argument("--only", type=one_of(names), help="AREA or AREA:WORKERS")
    parser.add_argument("--keep", type=Path, default=Path("build/bench_cluster"))
    arguments = parser.parse_args()
    table, times = arguments.out.with_suffix(".csv"), arguments.out.with_suffix(".tasks.json")
    rows = read_rows(table)
    tasks: dict[str, list[list[float]]] = json.loads(times.read_text(encoding="utf-8")) if times.exists() else {}
    done = {(row["area"], row["workers"]) for row in rows}
    for area in CASES:
        for workers in WORKERS:
            name = f"{area}:{workers}"
            if (area, str(workers)) in done or arguments.only not in (None, area, name):
                continue
            found, tasks[name] = planned(area, workers, arguments.keep)
            head = {"area": area, "workers": str(workers), "date": datetime.date.today().isoformat()}
            rows.append({**head, **found})
            rows.sort(key=lambda row: (list(CASES).index(row["area"]), -int(row["workers"])))
            write_rows(table, COLUMNS, rows)
            times.write_text(json.dumps(tasks) + "\n", encoding="utf-8")
    if rows:
        arguments.out.write_text(page(rows, tasks), encoding="utf-8")


if __name__ == "__main__":
    main()
