"""Withhold strips of pictures from a flight of the mock, and see whether ``judge-photos`` finds them: docs/results/photos.md.

Usage: .venv/bin/python scripts/withheld_strips.py RUN [--strips 20]

RUN is a flown survey, such as:
    uavcover new 36.4762,-84.2160,150 --dem uavcover/data/jacksboro.tif --camera dji-m3e --gsd 2.5cm -o survey.toml
    uavcover plan survey.toml -o RUN --budget 20s && uavcover fly RUN --to mock:
The pictures are those that the mock told of, at the samples of the flown track that know of each first. What should be found is
counted by tests/naive/pictures.py, which goes through every picture with rays of its own, on a sample of the cells. A place is
missing when it is in fewer pictures than the overlap asked for gives, or in none that is fine enough.
"""

import argparse
import csv
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from scripts.options import run_folder
from tests.naive import pictures as naive
from uavcover.judging.photos.placing import Assumptions
from uavcover.judging.photos.readers import read_pictures
from uavcover.run.photo_judgement import PhotoRequest, judged
from uavcover.run.user import Unattended
from uavcover.scenario.site import load_site
from uavcover.vehicle.track_file import read_track_with_warnings

_COMPARED_CELLS = 400


def taken(run: Path) -> list[list[float]]:
    """Latitude, longitude, height above sea level, yaw and time of each picture of a flown track."""
    track = read_track_with_warnings(run / "track.csv").track
    counts = np.nan_to_num(track.pictures_taken)
    samples = np.flatnonzero(np.diff(counts) > 0) + 1
    yaw = track.attitude_deg[samples, 2]
    return np.column_stack([track.geodetic[samples], yaw, track.time_s[samples]]).tolist()


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=run_folder)
    parser.add_argument("--strips", type=int, default=20)
    arguments = parser.parse_args()
    site, rows = load_site(arguments.run / "scenario.toml"), taken(arguments.run)
    rng = np.random.default_rng(1)
    whole, _, lacking_whole, cells = _judged(site, rows, np.ones(len(rows), bool), arguments.run)
    print(f"{len(rows)} pictures, {int(whole.drawn.sum())} cells, {whole.needed} pictures asked for")
    print(f"whole flight: {100.0 * whole.document['overlap_fraction']:.2f} % of the area is in so many pictures\n")
    print(
        "| strip | pictures withheld | missing, m2 | found, m2 | found though not missing, % of the area | counts that differ |"
    )
    print("|---|---:|---:|---:|---:|---:|")
    every_found, worst, differing, compared = 0, 0.0, 0, 0
    weight = whole.coverage.grid.weight_m2
    for strip in range(arguments.strips):
        count = int(rng.integers(len(rows) // 8, len(rows) // 4))
        first = int(rng.integers(0, len(rows) - count))
        kept = np.ones(len(rows), bool)
        kept[first : first + count] = False
        verdict, counted, lacking, cells = _judged(site, rows, kept, arguments.run)
        shown = verdict.shown.pictures[cells]
        wrong = int((shown != counted).sum())
        differing, compared = differing + wrong, compared + len(cells)
        gone = lacking & ~lacking_whole
        told = ~verdict.shown.enough(whole.needed)
        before = ~whole.shown.enough(whole.needed)
        scale = weight[whole.drawn].sum() / weight[cells].sum()
        missing_m2 = float(weight[cells][gone].sum() * scale)
        found_m2 = float(weight[whole.drawn & told & ~before].sum())
        false = float(weight[cells][told[cells] & ~before[cells] & ~gone].sum() / weight[cells].sum())
        worst = max(worst, false)
        hit = bool((told[cells] & gone).any()) if gone.any() else found_m2 == 0.0
        every_found += hit
        print(
            f"| {strip + 1} | {count} | {missing_m2:.0f} | {found_m2:.0f} | {100.0 * false:.2f} | {wrong} of {len(cells)} |"
        )
    print(
        f"\n{every_found} of {arguments.strips} strips found; at most {100.0 * worst:.2f} % of the area told though not missing; "
        f"{differing} of {compared} counts ({100.0 * differing / compared:.2f} %) differ from brute force"
    )


def _judged(site, rows, kept, run):
    """The verdict on the pictures that are kept; by brute force how many show some cells, and which of these are missing."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "pictures.csv"
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["name", "latitude", "longitude", "altitude", "yaw", "time", "pitch", "roll"])
            for number, row in enumerate(rows):
                if kept[number]:
                    writer.writerow([f"p{number:04d}", *map(repr, row), -90.0, 0.0])
        request = PhotoRequest(
            photos=(path,), area=None, scenario=run, assumed=Assumptions(), takeoff=None, coverage=0.98, mount_known=True,
            refly=False, budget_s=None, force=False,
        )  # fmt: skip
        verdict = judged(request, read_pictures([path]), site, Unattended())
    grid = verdict.coverage.grid
    cells = np.random.default_rng(2).choice(np.flatnonzero(verdict.drawn), _COMPARED_CELLS, replace=False)
    chosen = np.array(rows)[kept]
    eyes = site.frame.enu_from_geodetic(chosen[:, 0], chosen[:, 1], chosen[:, 2])
    sensor = replace(verdict.coverage.site.scenario.sensor, max_ground_sample_m=None)
    counted, sample_m, _ = naive.count(
        sensor, site.ground.heights_m, eyes, chosen[:, 3], grid.cells.centre_m[cells], grid.cells.normal[cells]
    )
    return verdict, counted, (counted < verdict.needed) | (sample_m > site.scenario.sensor.max_ground_sample_m), cells


if __name__ == "__main__":
    main()
