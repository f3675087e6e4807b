"""Plan large areas in one piece and in parts, and compare them with the tuned boustrophedon cut into sorties the same way.

Usage: .venv/bin/python scripts/bench/large.py -o PAGE.md [--only 5000:2] [--per-km2 400]

Squares of the bundled heights around the middle of ridge-25km2, cells of 10 m, its camera, limits and vehicle, home in the
middle, 98 % of what can be seen. Each plan is made by `uavcover plan` in a process of its own, in so many evaluations for each
square kilometre, with two threads. Its processor time and its largest resident memory are those of that process, compiled code
loaded. The tuned boustrophedon is the quickest mission of a scan over six directions, two heights, eight distances and two
insets that sees as much; a plan has another one, with the fewest lines along the long side, and plans are compared with the
quicker one. The bound on length is that of `plan --bounds`. What is missing in the .csv beside the page is measured; run again
after a stop, it goes on.
"""

import argparse
import csv
import datetime
import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from scripts.bench.planner import window
from scripts.options import file_to_write, one_of
from uavcover.extras.bounds.bounds import lattice_parts, least_path_length_m, price_ground
from uavcover.missions.objectives import judge_member
from uavcover.planner.baselines.boustrophedon import RETURNING, boustrophedons
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.site_maps import judging_map, planning_map

REQUIRED = 0.98
CELL_M = 10.0
WAYS = {
    1000.0: ("1", "boustrophedon", "bound"),
    3160.0: ("1", "boustrophedon", "bound"),
    5000.0: ("1", "auto", "2", "3", "4", "9", "boustrophedon", "bound"),
    7000.0: ("auto", "2"),
    10000.0: ("auto", "4", "boustrophedon", "bound"),
}
"""For each side of a square, into how many parts it is divided."""
COLUMNS = (
    "side_m", "way", "coverage", "mission_s", "route_s", "length_m", "waypoints", "sorties", "evaluations", "cpu_s", "peak_mib",
    "rival_s", "date",
)  # fmt: skip
_BOUND_S = 1200.0
"""About so long a bound may take."""
_TRIED = 12
"""So many boustrophedons of the scan are judged on the area's own cells, the quickest on the planner's first."""

Row = dict[str, str]


def planned(side_m: float, parts: str, evaluations: int) -> Row:
    """A plan by the command, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        file, run = Path(folder) / "scenario.toml", Path(folder) / "run"
        file.write_text(dump_scenario(window(side_m, CELL_M)), encoding="utf-8")
        command = [sys.executable, "-m", "uavcover", "plan", str(file), "-o", str(run), "--parts", parts, "-q"]
        command += ["--evaluations", str(evaluations), "--select", f"coverage>={REQUIRED}", "--workers", "2"]
        process = subprocess.Popen(command)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode not in (0, 1):
            raise SystemExit(f"{side_m:g} m, {parts}: plan ended with exit code {process.returncode}")
        document = json.loads((run / "plan.json").read_text(encoding="utf-8"))
    found = document["metrics"]
    lines = [each for each in document["baselines"] if each["name"] == "boustrophedon-tuned"]
    rivals = [
        each["mission_time_s"]
        for each in lines
        if each["coverage_of_coverable"] >= REQUIRED and each["violation"] <= 0.0
    ]
    values = {
        "coverage": found["coverage_of_coverable"], "mission_s": found["mission_time_s"], "route_s": found["flight_time_s"],
        "length_m": found["path_length_m"], "waypoints": found["waypoint_count"], "sorties": len(document["sorties"]),
        "evaluations": evaluations, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_mib": usage.ru_maxrss / 1024,
        "rival_s": min(rivals, default=""),
    }  # fmt: skip
    return {key: str(value) for key, value in values.items()}


def boustrophedon(side_m: float) -> Row:
    """The quickest of the scan that sees as much as is asked for."""
    site = load_site(window(side_m, CELL_M))
    coarse, fine = planning_map(site), judging_map(site)
    required = REQUIRED * coarse.fraction(coarse.coverable)
    tried = [each for each in boustrophedons(coarse) if each.violation <= 0.0 and each.name != RETURNING]
    tried.sort(key=lambda each: (max(0.0, required + float(each.objectives[0])), float(each.objectives[2])))
    judged = [judge_member(fine, each.route, each.name, margin_m=0.0).metrics for each in tried[:_TRIED]]
    enough = [each for each in judged if each.coverage_of_coverable >= REQUIRED]
    best = min(enough, key=lambda each: each.time_s)
    values = {
        "coverage": best.coverage_of_coverable, "mission_s": best.mission_time_s, "route_s": best.flight_time_s,
        "length_m": best.path_length_m, "waypoints": best.waypoint_count,
    }  # fmt: skip
    return {key: str(value) for key, value in values.items()}


def bound(side_m: float) -> Row:
    """The length that no path is shorter than which sees as much."""
    coverage = judging_map(load_site(window(side_m, CELL_M)))
    begin_s = time.process_time()
    least_m, parts = least_path_length_m(coverage, REQUIRED), lattice_parts(coverage, _BOUND_S)
    priced = None if parts is None else price_ground(coverage, REQUIRED, parts=parts)
    if priced is not None:
        least_m = max(least_m, priced.least_length_m(REQUIRED))
    return {"length_m": str(least_m), "cpu_s": str(time.process_time() - begin_s)}


def page(rows: list[Row], per_km2: int) -> str:
    """The table."""
    lines = [
        "# Large areas",
        "",
        f"Command: `.venv/bin/python scripts/bench/large.py --per-km2 {per_km2}`, {max(row['date'] for row in rows)}, uavcover "
        f"{metadata.version('uavcover')}. What is measured is said at the top of the script; times are of a machine with "
        "other work.",
        "",
        "| area | way | coverage | mission | against the boustrophedon | route | length | over the bound | waypoints | sorties "
        "| evaluations | processor time | memory |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    rivals: dict[str, float] = {}
    for row in rows:
        known = row["mission_s"] if row["way"] == "boustrophedon" else row["rival_s"]
        if known:
            rivals[row["side_m"]] = min(float(known), rivals.get(row["side_m"], float(known)))
    bounds = {row["side_m"]: float(row["length_m"]) for row in rows if row["way"] == "bound"}
    for row in rows:
        km2 = (float(row["side_m"]) / 1000.0) ** 2
        way = {"1": "one piece", "boustrophedon": "tuned boustrophedon", "auto": "auto"}.get(
            row["way"], f"{row['way']} parts"
        )
        length_m, work = float(row["length_m"]), f"{float(row['cpu_s']):.0f} s" if row["cpu_s"] else ""
        if row["way"] == "bound":
            lines.append(
                f"| {km2:g} km² | no path is shorter | {100 * REQUIRED:g} % | | | | {length_m / 1e3:.1f} km | | | | | {work} | |"
            )
            continue
        over = f"+{100.0 * (length_m / bounds[row['side_m']] - 1.0):.1f} %" if row["side_m"] in bounds else ""
        mission_s = float(row["mission_s"])
        rival = rivals.get(row["side_m"])
        against = (
            "" if rival is None or row["way"] == "boustrophedon" else f"{100.0 * (mission_s / rival - 1.0):+.1f} %"
        )
        memory = f"{float(row['peak_mib']):.0f} MiB" if row["peak_mib"] else ""
        lines.append(
            f"| {km2:g} km² | {way} | {100.0 * float(row['coverage']):.2f} % | {mission_s:.0f} s | {against} "
            f"| {float(row['route_s']):.0f} s | {length_m / 1e3:.1f} km | {over} | {row['waypoints']} | {row['sorties']} "
            f"| {row['evaluations']} | {work} | {memory} |"
        )
    lines += [
        "",
        "One seed each. Route is the time along the lines; mission adds the ways from home and back of every sortie. "
        + "; ".join(f"{(float(side) / 1000.0) ** 2:g} km² are compared with {rivals[side]:.0f} s" for side in rivals)
        + ". No path that sees as much is shorter than the bound, as one flight without ways from home and back: flights that "
        "see something on their ways have longer routes and shorter missions.",
    ]
    return "\n".join(lines) + "\n"


def in_order(row: Row) -> tuple[float, int, int]:
    """By area, way and evaluations."""
    side_m = float(row["side_m"])
    return side_m, WAYS[side_m].index(row["way"]), int(row["evaluations"] or 0)


def main() -> None:
    """Measure what is missing."""
    names = [f"{side_m:g}{way}" for side_m, ways in WAYS.items() for way in ("", *(f":{each}" for each in ways))]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, required=True)
    parser.add_argument("--only", type=one_of(names), help="SIDE_M or SIDE_M:WAY")
    parser.add_argument("--per-km2", type=int, default=400)
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows: list[Row] = list(csv.DictReader(table.open(encoding="utf-8"))) if table.exists() else []
    done = {(row["side_m"], row["way"], row["evaluations"]) for row in rows}
    for side_m, ways in WAYS.items():
        for way in ways:
            name = f"{side_m:g}", way
            evaluations = max(1000, round(arguments.per_km2 * side_m * side_m / 1e6))
            key = *name, "" if way in ("boustrophedon", "bound") else str(evaluations)
            if key in done or arguments.only not in (None, name[0], ":".join(name)):
                continue
            makers = {"boustrophedon": boustrophedon, "bound": bound}
            found = makers[way](side_m) if way in makers else planned(side_m, way, evaluations)
            head = {"side_m": name[0], "way": way, "date": datetime.date.today().isoformat()}
            rows.append({**dict.fromkeys(COLUMNS, ""), **head, **found})
            rows.sort(key=in_order)
            with table.open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows)
            arguments.out.write_text(page(rows, arguments.per_km2), encoding="utf-8")


if __name__ == "__main__":
    main()
