"""Size and speed of recordings: an hour at 10 Hz over up to 250,000 cells. Writes docs/results/recording.{csv,md}.

Usage: .venv/bin/python scripts/bench_recording.py [OUT_DIR]
"""

import argparse
import csv
import dataclasses
import datetime
import platform
import tempfile
import time
from pathlib import Path

import numpy as np

from uavcover.judging.verify import flown_coverage, verify_track
from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.recording import describe_recording, read_recorded_track, write_recording
from uavcover.recording.layout import RecordingError
from uavcover.recording.viewer import headless_viewer, loading_time_s
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.coverage_map import CoverageMap, judging_map

RATE_HZ = 10.0
CASES = ((10.0, 600.0), (5.0, 1200.0), (4.0, 3600.0), (2.0, 600.0), (2.0, 3600.0))
"""Side of a cell in metres, and length of the flight in seconds; the last case is the one that is promised."""

COLUMNS = (
    "cells", "flight_s", "samples", "write_s", "size_mb", "read_track_s", "list_s", "viewer_loads_s", "same_verdict",
)  # fmt: skip


def hour_of_flight(coverage: CoverageMap, flight_s: float) -> Track:
    """Lines over the whole area, as far apart as the time allows, at 10 Hz, with a little roll and pitch."""
    site = coverage.site
    west, south, east, north = site.area.bounds
    speed = 10.0
    lines = max(2, int(flight_s * speed / (north - south)))
    places = [
        (e, n)
        for k, e in enumerate(np.linspace(west + 10.0, east - 10.0, lines))
        for n in (np.linspace(south, north, 9) if k % 2 == 0 else np.linspace(north, south, 9))
    ]
    waypoints = np.column_stack([places, site.ground.heights_m(places) + 90.0])
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1)))
    time_s = np.arange(0.0, flight_s, 1.0 / RATE_HZ)
    at = time_s * along[-1] / flight_s
    enu = np.column_stack([np.interp(at, along, waypoints[:, axis]) for axis in range(3)])
    rng = np.random.default_rng(11)
    velocity = np.gradient(enu, axis=0)
    yaw = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1])) % 360.0
    if site.frame is None:
        raise SystemExit("the scenario has no place on Earth")
    return Track(
        time_s=time_s,
        geodetic=np.column_stack(site.frame.geodetic_from_enu(enu)),
        enu_m=enu,
        attitude_deg=np.column_stack([rng.normal(0.0, 2.0, (time_s.size, 2)), yaw]),
        current_waypoint=np.searchsorted(along, at, side="right").astype(np.int64),
    )


def measure(cell_size_m: float, flight_s: float, folder: Path) -> dict[str, object]:
    """One case."""
    scenario = load_scenario("jacksboro")
    scenario = dataclasses.replace(scenario, area=dataclasses.replace(scenario.area, cell_size_m=cell_size_m))
    site = load_site(scenario)
    coverage = judging_map(site)
    track = hour_of_flight(coverage, flight_s)
    flown = flown_coverage(coverage, track, None)
    path = folder / "flight.rrd"
    started = time.perf_counter()
    write_recording(
        path, coverage=coverage, planned=Route(track.enu_m[::100]), track=track,
        first_seen_s=flown.first_seen_s,
    )  # fmt: skip
    written = time.perf_counter()
    again = read_recorded_track(path)
    read = time.perf_counter()
    describe_recording(path)
    listed = time.perf_counter()
    same = verify_track(site, coverage, again, None) == verify_track(site, coverage, track, None)
    return {
        "cells": coverage.grid.count,
        "flight_s": round(flight_s),
        "samples": len(track),
        "write_s": round(written - started, 2),
        "size_mb": round(path.stat().st_size / 1e6, 2),
        "read_track_s": round(read - written, 2),
        "list_s": round(listed - read, 2),
        "viewer_loads_s": round(loading_time_s(path), 2),
        "same_verdict": same,
    }


def main() -> None:
    """Measure every case and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", metavar="OUT_DIR", default=Path("docs/results"))
    out = parser.parse_args().out
    try:
        with headless_viewer(Path("the viewer")):
            pass
    except RecordingError as error:
        parser.error(str(error))
    out.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for case in CASES:
            rows.append(measure(*case, Path(folder)))
            print(rows[-1], flush=True)
    with (out / "recording.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    lines = ["# Recordings: size and speed", ""]
    lines += [
        f"Made by `scripts/bench_recording.py` on {datetime.date.today().isoformat()}: parallel lines over the demo's area, 10",
        "samples a second. `same_verdict`: verification of the recorded track, read back, equals that of the written one.",
        "`viewer_loads_s` is from opening the file in a running viewer until it says that all of it is there.",
        "",
        "| " + " | ".join(COLUMNS) + " |",
        "|" + " --- |" * len(COLUMNS),
    ]
    lines += ["| " + " | ".join(str(row[name]) for name in COLUMNS) + " |" for row in rows]
    lines += ["", f"Python {platform.python_version()}, {platform.machine()}, software rasterizer."]
    (out / "recording.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
