"""Judge photos that other people published, from folders that the user names, and write a table.

Usage: python scripts/bench/real_photos.py FOLDER -o PAGE.md

FOLDER holds copies of the folders of ``CASES``; what is not there is left out and named. Nothing of it becomes part of this
project. No elevation data comes with them: the ground is taken as the photos' heights, smoothed over 40 m, minus a height above
ground. So gaps and overlap are those of an assumed ground; what is read, what is refused and which photos are missing is not.
A hole is a group of deleted photos; it is found where the command names a stretch without photos that has one of them.
"""

import argparse
import csv
import datetime
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rasterio
import shapely
from rasterio.transform import from_origin

from scripts.options import existing_folder, file_to_write
from uavcover.extras.photos.readers import read_photos

ROOT = Path(__file__).resolve().parents[2]
_METRES_PER_DEGREE, _SMOOTHED_M, _PIXEL_M, _AROUND_M = 111_195.0, 40.0, 20.0, 400.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Photos of a folder; ``without`` is a list of photos to delete from their table, in groups under # lines."""

    name: str
    folder: str
    source: str
    photos: str = ""
    height_agl_m: float
    area: str = ""
    without: str = ""
    options: str = "--overlap 60/50"


_BEACH = Case(
    name="Brighton Beach", folder="drone_dataset_brighton_beach", photos="images", height_agl_m=40.0,
    source="github.com/pierotofy/drone_dataset_brighton_beach (BSD-2-Clause)",
)  # fmt: skip
_FREETOWN = Case(
    name="Freetown, all", folder="freetown", photos="image_metadata.csv", height_agl_m=115.0, area="aoi.geojson",
    options="--camera dji-mini-4-pro --overlap 80/60",
    source="github.com/hotosm/drone-tm, src/backend/tests/freetown_dataset (AGPL-3.0)",
)  # fmt: skip
CASES = (
    _BEACH,
    replace(_BEACH, name="Banana, no GPS", folder="dataset_banana", source="github.com/pierotofy/dataset_banana (MIT)"),
    _FREETOWN,
    replace(_FREETOWN, name="Freetown, 32 deleted", without="images-to-delete-for-gaps.txt"),
    Case(name="RedEdge-MX", folder="REDEDGE-MX", height_agl_m=60.0,
         source="github.com/micasense/imageprocessing, data/REDEDGE-MX by Git LFS (MIT); DroneDB's multispectral test "
         "data is no stand-in, because its licence allows tests of DroneDB alone"),
)  # fmt: skip
COLUMNS = (
    "data", "photos", "looks", "verdict", "overlap", "gaps (m2)", "missing photos", "stretches", "holes", "seconds",
)  # fmt: skip


def ground_under(photos: Path, path: Path, height_agl_m: float) -> str:
    """Write elevation data under photos, and return the area around them."""
    reported = [p for p in read_photos([photos]).photos if p.lacks() is None]
    positions = np.array([(p.lon_deg, p.lat_deg, p.alt_m or 0.0) for p in reported] or [(8.0, 46.0, 0.0)], dtype=float)
    scale = _METRES_PER_DEGREE * np.array([np.cos(np.radians(positions[:, 1].mean())), 1.0])
    west, north = positions[:, 0].min() - _AROUND_M / scale[0], positions[:, 1].max() + _AROUND_M / scale[1]
    width, height = np.ceil((np.ptp(positions[:, :2], axis=0) * scale + 2 * _AROUND_M) / _PIXEL_M).astype(int)
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    nodes = np.array([west, north]) + np.column_stack([columns.ravel(), -rows.ravel()]) * _PIXEL_M / scale
    squares = (((nodes[:, None] - positions[:, :2]) * scale) ** 2).sum(axis=2)
    weights = np.exp(-squares / (2 * _SMOOTHED_M**2)) + 1e-9 / (1.0 + squares)
    ground = (weights @ positions[:, 2] / weights.sum(axis=1) - height_agl_m).reshape(height, width)
    transform = from_origin(west, north, *(_PIXEL_M / scale))
    grid = {"width": width, "height": height, "crs": "EPSG:4326", "transform": transform}
    with rasterio.open(path, "w", driver="GTiff", count=1, dtype="float32", **grid) as file:
        file.write(ground.astype(np.float32), 1)
    return shapely.MultiPoint(positions[:, :2]).buffer(10.0 / scale[1]).convex_hull.wkt


def run(*command: str) -> subprocess.CompletedProcess[str]:
    """A command, and what it printed."""
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def judge(case: Case, folder: Path, work: Path) -> list[str]:
    """One row of the table."""
    photos = folder / case.photos
    area = ground_under(photos, work / "ground.tif", case.height_agl_m)
    listed = (folder / case.without).read_text().split("#")[1:] if case.without else ()
    groups = [[Path(line).name for line in group.split("\n")[1:] if line] for group in listed]
    if groups:
        rows, photos = photos.read_text().split("\n"), work / photos.name
        photos.write_text("\n".join(r for r in rows if not any(name in r for group in groups for name in group)))
    dem = ("--dem", work / "ground.tif", "--vertical-datum", "EGM96", "--no-refly", "--json", "-o", work / "out")
    required = (photos, "--area", folder / case.area if case.area else area, *case.options.split(), *dem)
    began = time.monotonic()
    ended = run(sys.executable, "-m", "uavcover", "judge-photos", *map(str, required))
    seconds = f"{time.monotonic() - began:.0f}"
    if ended.returncode not in (0, 1):
        return [case.name, *[""] * 2, f"refused: {ended.stderr.splitlines()[-1][7:]}", *[""] * 5, seconds]
    reported = json.loads(ended.stdout)
    missing = reported["missing_photos"]
    found = sum(any(one["after"] < name < one["before"] for one in missing for name in group) for group in groups)
    return [
        case.name, str(reported["counted"]), str(reported["looks"]), reported["verdict"],
        f"{100.0 * reported['overlap_fraction']:.2f} %",
        f"{sum(gap['area_m2'] for gap in reported['gaps']):.0f}", str(sum(one["photos"] for one in missing)), str(len(missing)),
        f"{found} of {len(groups)}" if groups else "", seconds,
    ]  # fmt: skip


def main() -> None:
    """Judge what is there."""
    parser = argparse.ArgumentParser(description="Judge published photos in folders that the user names.")
    parser.add_argument("folder", type=existing_folder, help="with copies of the published folders")
    parser.add_argument("-o", "--out", type=file_to_write, required=True)
    options = parser.parse_args()
    there = [case for case in CASES if (options.folder / case.folder).is_dir()]
    if not there:
        names = ", ".join(dict.fromkeys(case.folder for case in CASES))
        parser.error(f"argument folder: {options.folder}: none of {names} in it; copy one there")
    table = [list(COLUMNS)]
    for case in there:
        with tempfile.TemporaryDirectory() as work:
            table.append(judge(case, options.folder / case.folder, Path(work)))
        print(*table[-1], sep=", ", flush=True)
    with options.out.with_suffix(".csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(table)
    about = (__doc__ or "").partition("PAGE.md]\n\n")[2].strip()
    rows = [f"| {' | '.join(row)} |" for row in (COLUMNS, ["---"] * len(COLUMNS), *table[1:])]
    sources = [f"- {c.name}: {c.source}. `{c.options}`, {c.height_agl_m:g} m above ground" for c in there]
    sources += [f"- {c.name} is left out, because it was not there: {c.source}" for c in CASES if c not in there]
    commit = run("git", "rev-parse", "--short", "HEAD").stdout.strip()
    ended = f"`python scripts/bench/real_photos.py FOLDER`, commit {commit}, {datetime.datetime.now(datetime.UTC):%Y-%m-%d}."
    lines = [about, "", *rows, "", *sources, "", ended]
    options.out.write_text("# Real photos\n\n" + "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
