"""Measure verification: a 1-hour track at 10 Hz over 250,000 cells, and how the time grows with cells and samples.

Usage: .venv/bin/python scripts/bench_verify.py [-o docs/results/verification.md]

The ground is a made-up range of hills with slopes of up to 2 (63 degrees), steep enough that rays have to be traced. "judged" is
verification itself with compiled kernels, from the loaded track to the verdict, "CPU" its processor time on all cores; "command"
is `uavcover verify` as a user runs it, from its start to its end: imports, terrain, `track.csv` read, verdict,
`verification.json` and `coverage.tif` written. Wall times mean something only on a machine that has nothing else to do: the share
of the machine that was had is CPU time by wall time.
"""

import argparse
import csv
import datetime
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from rasterio.transform import from_origin

from scripts.options import file_to_write
from uavcover.model.track import Track, TrackSample
from uavcover.run.judge import judge_tracks
from uavcover.scenario.site import Site, load_site
from uavcover.vehicle.track_file import TrackWriter

LAT_DEG, LON_DEG = 46.6, 11.7
SIDE_M, HEIGHT_AGL_M, SPEED_M_S, SAMPLES, RATE_HZ = 2500.0, 110.0, 12.0, 36_000, 10.0
COLUMNS = ("cells", "samples", "what", "judged_s", "judged_cpu_s", "command_s", "command_cpu_s", "coverage")

SCENARIO = """
name = "bench-verify"
[area]
polygon_east_north_m = [[0.0, 0.0], [{side}, 0.0], [{side}, {side}], [0.0, {side}]]
cell_size_m = {cell}
[terrain]
kind = "raster"
file = "hills.tif"
vertical_datum = "EGM96"
[origin]
lat_deg = {lat}
lon_deg = {lon}
alt_amsl_m = 1000.0
[home]
east_m = 10.0
north_m = 10.0
[sensor]
kind = "nadir-camera"
fov_deg = {fov}
range_m = 300.0
pixels_across = 4000
[limits]
min_height_agl_m = 40.0
max_height_agl_m = 150.0
[requirements]
min_coverage_of_coverable = 0.0
"""


def write_hills(path: Path) -> None:
    """Sines of several wavelengths, 3 km around the origin, pixels of 20 m."""
    pixel_deg = 20.0 / 111_000.0
    rows = columns = 320
    west, north = LON_DEG - 0.4 * columns * pixel_deg, LAT_DEG + 0.6 * rows * pixel_deg
    y, x = np.mgrid[0:rows, 0:columns] * 20.0
    up = 1000.0 + 90.0 * np.sin(x / 310.0) * np.cos(y / 270.0) + 45.0 * np.sin(x / 70.0 + 1.0) * np.cos(y / 90.0)
    up += 12.0 * np.sin(x / 23.0) * np.sin(y / 19.0)
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", crs="EPSG:4326",
        transform=from_origin(west, north, pixel_deg, pixel_deg),
    ) as file:  # fmt: skip
        file.write(up.astype(np.float32), 1)


def fly_lines(site: Site, samples: int) -> Track:
    """Lines side by side at a constant height above ground, in gusts that roll and pitch the vehicle by some degrees."""
    lines = 17
    across = (np.arange(lines) + 0.5) * SIDE_M / lines
    corners = np.array([(e, n) for k, n in enumerate(across) for e in ((0.0, SIDE_M) if k % 2 == 0 else (SIDE_M, 0.0))])
    flown = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    along = (np.arange(samples) * SPEED_M_S * SAMPLES / samples / RATE_HZ) % flown[-1]
    places = np.column_stack([np.interp(along, flown, corners[:, axis]) for axis in (0, 1)])
    enu = np.column_stack([places, site.ground.heights_m(places) + HEIGHT_AGL_M])
    time_s = np.arange(samples) * SAMPLES / samples / RATE_HZ
    attitude = np.column_stack([5.0 * np.sin(time_s / 3.0), 4.0 * np.cos(time_s / 2.0) - 6.0, 90.0 + 0.0 * time_s])
    assert site.frame is not None
    geodetic = np.column_stack(site.frame.geodetic_from_enu(enu))
    return Track(time_s, geodetic, enu, attitude, np.ones(samples, dtype=np.int64))


def save_track(path: Path, track: Track) -> None:
    """As ``fly`` writes it."""
    with TrackWriter(path, overwrite=True) as writer:
        for k in range(len(track)):
            writer.write(
                TrackSample(
                    float(track.time_s[k]), *map(float, track.geodetic[k]), *map(float, track.enu_m[k]),
                    *map(float, track.attitude_deg[k]), int(track.current_waypoint[k]),
                )
            )  # fmt: skip


def measure(
    folder: Path, *, cell_m: float, samples: int, fov_deg: float = 70.0, unsure: bool = False
) -> tuple[str, ...]:
    """One row of the table."""
    (folder / "scenario.toml").write_text(
        SCENARIO.format(side=SIDE_M, cell=cell_m, lat=LAT_DEG, lon=LON_DEG, fov=fov_deg)
        + ("[uncertainty]\nposition_m = 2.0\nterrain_m = 3.0\nattitude_deg = 1.0\n" if unsure else "")
    )
    site = load_site(folder / "scenario.toml")
    track = fly_lines(site, samples)
    few = replace_samples(track, 50)
    judge_tracks(site, [(few, None)])  # compiles what is not in the cache
    started, cpu_started = time.perf_counter(), time.process_time()
    verdict = judge_tracks(site, [(track, None)])
    judged_s, cpu_s = time.perf_counter() - started, time.process_time() - cpu_started
    save_track(folder / "track.csv", track)
    started, cpu_started = time.perf_counter(), children_cpu_s()
    subprocess.run(
        [sys.executable, "-m", "uavcover", "verify", str(folder), "-q", "--accept-changed", "record"],
        check=False,
        stdout=subprocess.DEVNULL,
        cwd=folder,
    )
    command_s = time.perf_counter() - started
    assert (folder / "coverage.tif").exists()
    what = "with uncertainty" if unsure else f"{fov_deg:g} degrees field of view"
    share = verdict.report.coverage_fraction
    figures = (judged_s, cpu_s, command_s, children_cpu_s() - cpu_started)
    return f"{verdict.coverage.grid.count}", f"{samples}", what, *(f"{x:.2f}" for x in figures), f"{100 * share:.1f} %"


def children_cpu_s() -> float:
    """Processor time of the processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def replace_samples(track: Track, count: int) -> Track:
    """The first samples of a track."""
    cut = slice(0, count)
    return replace(
        track, time_s=track.time_s[cut].copy(), geodetic=track.geodetic[cut].copy(), enu_m=track.enu_m[cut].copy(),
        attitude_deg=track.attitude_deg[cut].copy(), current_waypoint=track.current_waypoint[cut].copy(),
    )  # fmt: skip


def main() -> None:
    """Measure, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it")
    out = parser.parse_args().out
    cases: list[dict[str, Any]] = [{"cell_m": 5.0, "samples": SAMPLES}]
    cases += [{"cell_m": cell_m, "samples": SAMPLES} for cell_m in (20.0, 10.0)]
    cases += [{"cell_m": 5.0, "samples": samples} for samples in (9_000, 18_000)]
    cases += [
        {"cell_m": 5.0, "samples": SAMPLES, "unsure": True},
        {"cell_m": 5.0, "samples": SAMPLES, "fov_deg": 100.0},
    ]
    cases += [{"cell_m": 2.5, "samples": SAMPLES}, {"cell_m": 5.0, "samples": 72_000}]
    rows: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_hills(folder / "hills.tif")
        for case in cases:
            rows.append(measure(folder, **case))
            print(*rows[-1], flush=True)
            if out is not None:
                save(out, rows)


def save(out: Path, rows: list[tuple[str, ...]]) -> None:
    """What there is so far, as Markdown and beside it as CSV."""
    head = [
        "# Verification, measured",
        "",
        f"Command: `.venv/bin/python scripts/bench_verify.py -o {out}`, {datetime.date.today().isoformat()}, "
        f"uavcover {metadata.version('uavcover')}, Python {platform.python_version()}, numpy {np.__version__}, "
        f"{os.cpu_count()} cores ({platform.machine()}), shared with other work (load average {os.getloadavg()[2]:.0f}). "
        "One hour of flight (43 km) each; what is measured is said at the top of the script.",
        "",
        "| cells | samples | what | judged, s | CPU, s | command, s | CPU, s | coverage |",
        "|---:|---:|---|---:|---:|---:|---:|---:|",
    ]
    out.write_text("\n".join(head + [f"| {' | '.join(row)} |" for row in rows]) + "\n")
    with out.with_suffix(".csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
