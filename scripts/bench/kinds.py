"""Plan terrains of many kinds for many sensors, and check what the plans claim by code that shares nothing with them.

Usage: .venv/bin/python scripts/bench/kinds.py -o PAGE.md [--seeds 3] [--evaluations 400]
       [--only TERRAIN[:SENSOR]] [--fly 20] [--runs DIR [--recompute]]

The terrains and sensors are those of tests/terrain_kinds.py. Of every plan
- the coverage is recomputed from plan.json, the scenario and the elevation file alone (tests/naive/plan_coverage.py), on 100,000
  cells at least, of half the size or smaller, each at a random place of its square;
- the heights above ground are recomputed along every leg (tests/naive/file_ground.py);
- the time of the mission, from the ground at home to the ground at home, is compared with that of the best simple lines: every
  direction in steps of 15 degrees, three heights, ten distances between lines and three insets, and the planner's own baselines,
  of those that see as much on cells of half the size.

With --fly that many plans of the first seed, spread evenly, are flown by a mock vehicle on a simulated clock, and the flown track
is judged. Each finished plan is a row of the .csv beside the page; run again after a stop, it goes on with what is missing. With
--recompute no plan is made: the coverage of those that are kept in DIR is recomputed.
"""

import argparse
import csv
import datetime
import json
import math
import os
import platform
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from importlib import metadata
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

import uavcover as uc
from scripts.options import file_to_write, first_and_second
from tests.falsifying.honest_run import Field
from tests.naive.file_ground import FileGround, leg_ranges_m, plan_points
from tests.naive.plan_coverage import coverage_of
from tests.terrain_kinds import KINDS, SENSORS, write_scenario
from uavcover.errors import UavcoverError
from uavcover.missions.objectives import judge_member
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import (
    evaluated,
    fly_layout,
    long_side_angle_rad,
    regular_layout,
    width_across_m,
)
from uavcover.planner.baselines.initial_routes import fly_rows, scanned_rows
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import finer_map, judging_map

_LEG_STEP_M = 2.0
_EQUAL = 0.0005
"""Coverages that differ by no more are equal."""

_MOST_NODES = 40
_FEWEST_CELLS = 100_000
_HEIGHT_TOLERANCE_M = 0.05


@dataclass(frozen=True, slots=True)
class Row:
    """One plan of the table.

    Attributes:
        terrain: which kind.
        sensor: which kind.
        seed: of the search.
        asked: share of what can be seen.
        claimed: coverage of the whole area by plan.json.
        recomputed: the same by the check.
        of_coverable: by plan.json.
        met: whether the plan says that it reached what was asked.
        waypoints: how many.
        mission_s: time from the ground to the ground.
        made_by: what found the route.
        lines_s: time of the best simple lines that see as much; NaN where none do.
        out_of_band_m: by how much the plan leaves its band of heights anywhere.
        flown: coverage of the flight's track; NaN when it was not flown.
        ending: of the flight, or why there is no plan.
        cpu_s: processor time of planning.
    """

    terrain: str
    sensor: str
    seed: int
    asked: float
    claimed: float
    recomputed: float
    of_coverable: float
    met: bool
    waypoints: int
    mission_s: float
    made_by: str
    lines_s: float
    out_of_band_m: float
    flown: float
    ending: str
    cpu_s: float


def simple_lines(site: Site) -> list[Route]:
    """Parallel lines in every direction, or rows of nodes where the sensor looks from waypoints."""
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    if not site.scenario.sensor.looks_along_path:
        return [fly_rows(site, layout) for layout in scanned_rows(site, most_nodes=_MOST_NODES)]
    routes = []
    for turn in range(12):
        angle = long_side_angle_rad(site.area) + turn * math.pi / 12
        for fraction in (0.5, 0.75, 0.95):
            height_m = low + fraction * (high - low)
            strip_m = 2.0 * max(site.scenario.sensor.half_width_m(height_m), site.scenario.area.cell_size_m)
            counts = {max(1, round(more * width_across_m(site, angle) / strip_m)) for more in np.linspace(0.7, 1.9, 10)}
            for lines in sorted(counts):
                for inset in (0.0, 0.4, 0.8):
                    layout = regular_layout(
                        angle_rad=angle, lines=lines, height_agl_m=height_m, inset=inset,
                        tolerance_m=min(10.0, 0.45 * (high - low)),
                    )  # fmt: skip
                    routes.append(fly_layout(site, layout))
    return routes


def best_lines_s(site: Site, plan: uc.Plan) -> float:
    """Time of the quickest simple lines, or baseline of the plan, that see as much as the plan's choice; NaN for none."""
    coarse, fine = judging_map(site), finer_map(site)
    assert fine is not None

    def observed(route: Route) -> float:
        return fine.fraction_of_coverable(fine.observed(route.waypoints_m))

    asked = observed(plan.chosen.route) - _EQUAL
    found = [(b.route, b.metrics.mission_time_s or math.inf) for b in plan.baselines if b.violation <= 0.0]
    lines = evaluated(coarse, "lines", simple_lines(site), None)
    coverable = coarse.fraction(coarse.coverable)
    for each in sorted(lines, key=lambda b: float(b.objectives[2])):
        if (
            each.violation <= 0.0
            and -float(each.objectives[0]) >= (asked - 0.02) * coverable
            and observed(each.route) >= asked
        ):
            member = judge_member(coarse, each.route, "lines", margin_m=0.0)
            found.append((each.route, member.metrics.mission_time_s or math.inf))
            break
    return min((time_s for route, time_s in found if observed(route) >= asked), default=math.nan)


def out_of_band_m(folder: Path, run: Path) -> float:
    """By how much the legs of a plan leave the band of the scenario, 0 for nowhere."""
    limits = tomllib.loads((folder / "scenario.toml").read_text())["limits"]
    ranges = leg_ranges_m(FileGround(folder / "dem.tif").height_m, plan_points(run / "plan.json"), step_m=_LEG_STEP_M)
    low, high = float(ranges[:, 0].min(initial=math.inf)), float(ranges[:, 1].max(initial=-math.inf))
    return max(0.0, limits["min_height_agl_m"] - low, high - limits["max_height_agl_m"])


def fly(site: Site, run: Path) -> tuple[float, str]:
    """Coverage of the flown track, or of those of all sorties; how they ended, and what the verdict says against them."""
    folder = RunFolder(run)
    autopilot = site.scenario.vehicle.autopilot
    endings = [Field(site=site, autopilot=autopilot).fly(each).ending.key for each in folder.sorties() or [folder]]
    report = uc.verify(run).report
    against = [*report.reasons, *report.doubts]
    return report.coverage_fraction, "; ".join([" ".join(dict.fromkeys(endings)), *against])


def folder_of(runs: Path, terrain: str, sensor: str) -> Path:
    """Where the files and plans of a case are kept."""
    return runs / f"{terrain} {sensor}".replace(" ", "_")


def recomputed_coverage(folder: Path, run: Path) -> float:
    """What a plan covers, by the check."""
    scenario = tomllib.loads((folder / "scenario.toml").read_text())
    waypoints = json.loads((run / "plan.json").read_text())["waypoints"]
    fraction, _ = coverage_of(scenario, folder, waypoints, fewest_cells=_FEWEST_CELLS)
    return float(fraction)


def _words(error: UavcoverError, folder: Path) -> str:
    return " ".join(str(error).replace(str(folder), "").split())[:160]


def measure(folder: Path, terrain: str, sensor: str, seed: int, *, evaluations: int, flown: bool) -> Row:
    """One plan as a row."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario_file = write_scenario(folder, terrain, sensor)
    return measure_file(scenario_file, terrain, sensor, seed, evaluations=evaluations, flown=flown)


def measure_file(scenario_file: Path, terrain: str, sensor: str, seed: int, *, evaluations: int, flown: bool) -> Row:
    """One plan of a scenario whose elevation file has true metres, as a row."""
    folder, scenario = scenario_file.parent, tomllib.loads(scenario_file.read_text())
    site, run = uc.load_site(str(scenario_file)), folder / f"run-{seed}"
    asked = float(scenario["select"].removeprefix("coverage>="))
    begin = time.process_time()
    try:
        plan = uc.plan(site, out=run, evaluations=evaluations, seed=seed, force=True)
    except UavcoverError as error:
        words = _words(error, folder)
        nan = math.nan
        return Row(terrain, sensor, seed, asked, nan, nan, nan, False, 0, nan, "", nan, nan, nan, words,
                   time.process_time() - begin)  # fmt: skip
    cpu_s = time.process_time() - begin
    metrics = plan.chosen.metrics
    recomputed = recomputed_coverage(folder, run)
    flight = math.nan, ""
    if flown:
        try:
            flight = fly(site, run)
        except UavcoverError as error:
            flight = math.nan, _words(error, folder)
    return Row(
        terrain=terrain, sensor=sensor, seed=seed, asked=asked, claimed=metrics.coverage_fraction, recomputed=recomputed,
        of_coverable=metrics.coverage_of_coverable, met=plan.rule_met, waypoints=metrics.waypoint_count,
        mission_s=metrics.mission_time_s or math.nan, made_by=plan.chosen.origin, lines_s=best_lines_s(site, plan),
        out_of_band_m=out_of_band_m(folder, run), flown=flight[0], ending=flight[1], cpu_s=cpu_s,
    )  # fmt: skip


def read_rows(path: Path) -> list[Row]:
    """The rows of a table."""
    if not path.is_file():
        return []
    readers = {str: str, int: int, float: float, bool: lambda text: text == "True"}
    with path.open(newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    return [Row(**{each.name: readers[each.type](line[each.name]) for each in fields(Row)}) for line in lines]  # type: ignore[index]


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """The rows as a table that :func:`read_rows` reads."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [each.name for each in fields(Row)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(row) for row in rows)


def said_of(command: str) -> str:
    """How a page was made, by a script and its options."""
    return (
        f"Command: `.venv/bin/python scripts/{command}`, {datetime.date.today().isoformat()}, uavcover "
        f"{metadata.version('uavcover')}, Python {platform.python_version()}, {os.cpu_count()} cores. What is planned and how "
        "it is checked is said at the top of the script."
    )


def summary(rows: Sequence[Row]) -> list[str]:
    """What the rows say, in words."""
    planned = [row for row in rows if not math.isnan(row.claimed)]
    if not planned:
        return [f"- 0 of {len(rows)} were planned."]
    off = [abs(row.claimed - row.recomputed) for row in planned]
    against = [row.mission_s / row.lines_s for row in planned if not math.isnan(row.lines_s)]
    flown = [row.flown - row.claimed for row in planned if not math.isnan(row.flown)]
    lines = [
        f"- {len(planned)} of {len(rows)} were planned, {sum(row.met for row in planned)} of them reach what was asked.",
        f"- Claims and recomputation differ by {100 * np.median(off):.2f} points in the middle and {100 * max(off):.2f} at most; "
        f"{sum(each <= 0.002 for each in off)} of {len(off)} by no more than 0.2.",
        f"- {sum(row.out_of_band_m > _HEIGHT_TOLERANCE_M for row in planned)} plans leave their band of heights.",
    ]
    if against:
        lines.append(
            f"- Against the best simple lines that see as much: {100 * (np.median(against) - 1):+.0f} % time in the middle, "
            f"{100 * (max(against) - 1):+.1f} % at worst; for {len(planned) - len(against)} plans no lines see as much."
        )
    if flown:
        lines.append(
            f"- {len(flown)} were flown by the mock vehicle: coverage against planned {100 * min(flown):+.2f} points at worst."
        )
    return lines


def write(out: Path, rows: Sequence[Row], *, seeds: int, evaluations: int, flights: int) -> None:
    """The page, and the table beside it."""
    write_rows(out.with_suffix(".csv"), rows)
    lines = [
        "# Terrains of many kinds",
        "",
        said_of(f"bench/kinds.py --seeds {seeds} --evaluations {evaluations} --fly {flights}"),
        "",
        *summary(rows),
        "",
        "| terrain | sensor | seed | asked | claimed | recomputed | waypoints | mission | best lines | flown | made by |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---|",
    ]  # fmt: skip
    for r in rows:
        best = "none" if math.isnan(r.lines_s) else f"{r.lines_s:.0f} s"
        flown = "" if math.isnan(r.flown) else f"{100 * r.flown:.2f} %"
        by = f"{r.made_by or r.ending}{'' if r.met else ' (not reached)'}"
        lines.append(
            f"| {r.terrain} | {r.sensor} | {r.seed} | {100 * r.asked:g} % of coverable | {100 * r.claimed:.2f} % | "
            f"{100 * r.recomputed:.2f} % | {r.waypoints} | {r.mission_s:.0f} s | {best} | {flown} | {by} |"
        )
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan, check, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, required=True)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--evaluations", type=int, default=400)
    parser.add_argument("--only", type=first_and_second(KINDS, SENSORS), default="", metavar="TERRAIN[:SENSOR]")
    parser.add_argument("--fly", type=int, default=20, metavar="N")
    parser.add_argument("--runs", type=Path, metavar="DIR", help="keep the run folders here")
    parser.add_argument("--recompute", action="store_true")
    chosen = parser.parse_args(arguments)
    wanted_terrain, wanted_sensor = chosen.only
    cases = [(t, s) for t in KINDS for s in SENSORS]
    to_fly = {cases[round(k)] for k in np.linspace(0, len(cases) - 1, chosen.fly)} if chosen.fly else set()
    rows = read_rows(chosen.out.with_suffix(".csv"))
    if chosen.recompute:
        if chosen.runs is None:
            parser.error("--recompute needs --runs DIR, the folder in which --runs kept the plans")
        for row in rows:
            plan = folder_of(chosen.runs, row.terrain, row.sensor) / f"run-{row.seed}" / "plan.json"
            if not plan.is_file():
                parser.error(
                    f"--runs {chosen.runs}: no {plan.relative_to(chosen.runs)} in it; keep the plans with --runs first"
                )
        for number, row in enumerate(rows):
            folder = folder_of(chosen.runs, row.terrain, row.sensor)
            rows[number] = replace(row, recomputed=recomputed_coverage(folder, folder / f"run-{row.seed}"))
            write(chosen.out, rows, seeds=chosen.seeds, evaluations=chosen.evaluations, flights=chosen.fly)
        return 0
    done = {(row.terrain, row.sensor, row.seed) for row in rows}
    with tempfile.TemporaryDirectory() as temporary:
        runs = chosen.runs or Path(temporary)
        for seed in range(1, chosen.seeds + 1):
            for terrain, sensor in cases:
                if (
                    (terrain, sensor, seed) in done
                    or wanted_terrain not in ("", terrain)
                    or wanted_sensor not in ("", sensor)
                ):
                    continue
                row = measure(
                    folder_of(runs, terrain, sensor), terrain, sensor, seed, evaluations=chosen.evaluations,
                    flown=seed == 1 and (terrain, sensor) in to_fly,
                )  # fmt: skip
                print(row, flush=True)
                rows.append(row)
                write(chosen.out, rows, seeds=chosen.seeds, evaluations=chosen.evaluations, flights=chosen.fly)
    return 0


if __name__ == "__main__":
    sys.exit(main())
