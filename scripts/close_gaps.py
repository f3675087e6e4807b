"""Fly with missing legs, close the gaps, verify both tracks as one flight: ten seeds on the bundled terrain.

Usage: .venv/bin/python scripts/close_gaps.py [-o docs/results/closing_gaps.md] [--seeds 10]

The scenario is planned once. For each seed a fifth of the legs is not recorded (chosen at random: the camera was off, or the
log is lost); the gap mission is planned for what is missing, once up to the coverage that was planned and once for everything,
compiled and flown by the mock vehicle in wind. Both tracks are then verified as one flight. Lengths are those of the whole
missions, ways there and home included. Rows that are in the .csv already are kept, so a run that was ended goes on. On a machine
that is too busy for a vehicle in real time a flight is begun again, up to four times.
"""

import argparse
import csv
import datetime
import os
import platform
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path

import numpy as np

from scripts.options import file_to_write
from uavcover.errors import VehicleError
from uavcover.judging.phases import PlannedRoute
from uavcover.model.track import Track, TrackSample
from uavcover.routes.mission_compiler import CompiledMission
from uavcover.run.close_gaps import plan_gap_mission
from uavcover.run.judge import judge_tracks
from uavcover.run.mission import compile_plan
from uavcover.run.plan_search import SearchRequest
from uavcover.run.plan_search import plan as plan_site
from uavcover.run.session import VehicleLink, connect, fly
from uavcover.run.upload import upload
from uavcover.scenario.site import Site, load_site
from uavcover.vehicle.fly import Orders

SCENARIO, EVALUATIONS, MISSING_SHARE, SPEED, TRIES = "jacksboro", 300, 0.2, 60.0, 4
COLUMNS = (
    "seed", "asked", "legs_missing", "flown", "planned", "together", "gap_mission_m", "share_of_first", "waypoints", "reached",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Flown:
    """A track with the plan it followed."""

    track: Track
    planned: PlannedRoute


def length_m(compiled: CompiledMission) -> float:
    """Of a whole mission over ground and height."""
    return float(np.linalg.norm(np.diff(compiled.path_m, axis=0), axis=1).sum())


def flown_by_mock(site: Site, compiled: CompiledMission) -> Track:
    """The track of the mock vehicle, wind and all.

    Raises:
        VehicleError: it failed to fly in every try.
    """
    for left in reversed(range(TRIES)):
        try:
            return flown_once(site, compiled)
        except VehicleError:
            if left == 0:
                raise
    raise AssertionError


def flown_once(site: Site, compiled: CompiledMission) -> Track:
    """One flight."""
    samples: list[TrackSample] = []
    with connect(VehicleLink(url="mock:", mock_speed=SPEED), site) as vehicle:
        upload(vehicle.client, compiled)
        fly(vehicle, site, compiled, Orders(on_sample=samples.append))
    rows = np.array(
        [
            [
                s.time_s,
                s.lat_deg,
                s.lon_deg,
                s.alt_amsl_m,
                s.east_m,
                s.north_m,
                s.up_m,
                s.roll_deg,
                s.pitch_deg,
                s.yaw_deg,
            ]
            for s in samples
        ]
    )
    numbers = np.array([s.current_waypoint for s in samples], dtype=np.int64)
    return Track(rows[:, 0].copy(), rows[:, 1:4].copy(), rows[:, 4:7].copy(), rows[:, 7:].copy(), numbers)


def without_legs(track: Track, legs: np.ndarray) -> Track:
    """The track without its samples on the legs to these waypoints."""
    keep = ~np.isin(track.current_waypoint, legs)
    return replace(
        track, time_s=track.time_s[keep], geodetic=track.geodetic[keep], enu_m=track.enu_m[keep],
        attitude_deg=track.attitude_deg[keep], current_waypoint=track.current_waypoint[keep],
    )  # fmt: skip


def measure(site: Site, first: Flown, first_m: float, promised: float, seed: int, asked: str) -> tuple[str, ...]:
    """One row of the table."""
    count = len(first.planned.waypoints_m)
    legs = np.random.default_rng(seed).choice(
        np.arange(1, count), size=round(MISSING_SHARE * (count - 1)), replace=False
    )
    torn = (without_legs(first.track, legs), first.planned)
    before = judge_tracks(site, [torn])
    already = before.report.coverage_of_coverable >= promised
    mission = plan_gap_mission(site, before, target=promised if asked == "planned" and not already else None)
    route = mission.closing.route.waypoints_m
    closing = flown_by_mock(site, mission.compiled)
    verdict = judge_tracks(site, [torn, (closing, PlannedRoute(route, 0.0))])
    together = verdict.report.coverage_of_coverable
    assert not verdict.report.violations, verdict.report.reasons
    gap_m = length_m(mission.compiled)
    return (
        f"{seed}", asked, f"{len(legs)} of {count - 1}", f"{100 * before.report.coverage_of_coverable:.2f} %",
        f"{100 * promised:.2f} %", f"{100 * together:.2f} %", f"{gap_m:.0f}", f"{gap_m / first_m:.2f}", f"{len(route)}",
        "yes" if together >= promised else "NO",
    )  # fmt: skip


def kept_rows(out: Path | None) -> list[tuple[str, ...]]:
    """Rows of an earlier run."""
    if out is None or not out.with_suffix(".csv").exists():
        return []
    with out.with_suffix(".csv").open(newline="") as file:
        return [tuple(row) for row in csv.reader(file)][1:]


def save_rows(out: Path | None, rows: list[tuple[str, ...]]) -> None:
    """Beside the Markdown file."""
    if out is not None:
        with out.with_suffix(".csv").open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it")
    parser.add_argument("--seeds", type=int, default=10)
    arguments = parser.parse_args()
    site = load_site(SCENARIO)
    plan = plan_site(site, SearchRequest(seed=1, evaluations=EVALUATIONS))
    compiled = compile_plan(site, plan.chosen.route)
    first_m = length_m(compiled)
    metrics = plan.chosen.metrics
    planned = PlannedRoute(plan.chosen.route.waypoints_m, metrics.coverage_fraction)
    first = Flown(flown_by_mock(site, compiled), planned)
    rows = kept_rows(arguments.out)
    for seed in range(arguments.seeds):
        for asked in ("planned", "everything"):
            if any(row[:2] == (f"{seed}", asked) for row in rows):
                continue
            rows.append(measure(site, first, first_m, metrics.coverage_of_coverable, seed, asked))
            print(*rows[-1], flush=True)
            save_rows(arguments.out, rows)
    lines = [
        "| seed | asked for | legs missing | flown | planned | together | gap mission, m | of the first | waypoints | reached |",
        "|---:|---|---:|---:|---:|---:|---:|---:|---:|---|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    shares = {asked: [float(row[7]) for row in rows if row[1] == asked] for asked in ("planned", "everything")}
    reached = sum(row[-1] == "yes" for row in rows)
    closing = (
        f"The planned coverage is reached in {reached} of {len(rows)} cases. Length of the gap mission against the first one "
        f"({first_m:.0f} m): for the planned coverage {np.mean(shares['planned']):.2f} on average and at most "
        f"{max(shares['planned']):.2f}; for everything that can be seen {np.mean(shares['everything']):.2f} and at most "
        f"{max(shares['everything']):.2f}."
    )
    print(closing)
    if arguments.out is not None:
        head = [
            "# Closing gaps, measured",
            "",
            f"Command: `.venv/bin/python scripts/close_gaps.py -o {arguments.out}`, {datetime.date.today().isoformat()}, "
            f"uavcover {metadata.version('uavcover')}, Python {platform.python_version()}, numpy {np.__version__}, "
            f"{os.cpu_count()} cores ({platform.machine()}). Scenario {SCENARIO}, {EVALUATIONS} evaluations; what is done is "
            "said at the top of the script.",
            "",
            closing,
            "",
        ]
        arguments.out.write_text("\n".join(head + lines) + "\n")


if __name__ == "__main__":
    main()
