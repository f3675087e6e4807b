"""Look at the cells of a large area in one piece and in blocks, and count the cells that differ.

Usage: .venv/bin/python scripts/check_seams.py [-o docs/results/seams.md] [--squares 1] [--side 5000]

Squares of generated terrain (seeded octaves of smooth noise, 900 m of relief, pixels of 90 m) with cells of 5 m. A wandering
flight with a leaning camera is counted on each square: once on a map of the whole square, once by blocks of 37 rows of the
lattice, each cut by itself, with only what was observed within the sensor's reach. Every cell's place, normal and weight,
and all that is known of it after the flight (when it was first seen, how often, how closely, how surely, why not) has to be
equal to the last bit. A second count moves the edges: blocks of 101 rows. Last, blocks with a halo that is 30 m too small,
which has to show: differences there are what a missing halo costs.
"""

import argparse
import dataclasses
import datetime
import tempfile
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import rasterio
import shapely
from rasterio.transform import from_origin
from scipy.ndimage import zoom

if __name__ == "__main__":
    import sys

    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.options import file_to_write
from uavcover.judging.flown_blocks import near_block
from uavcover.judging.flown_coverage import FlownCoverage, count_observations
from uavcover.judging.observations import Observations
from uavcover.model.scenario import Uncertainty
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap, judging_block, judging_map, row_blocks

CELL_M = 5.0
STEPS = (37, 101)
_TOO_SMALL_M = 30.0
_PIXEL_M = 90.0


def generated(side_m: float, folder: Path) -> str:
    """A scenario on generated terrain, and its elevation file beside it."""
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
[origin]
lat_deg = 46.05
lon_deg = 15.0
alt_amsl_m = 800.0
[area]
polygon_east_north_m = [[{-half}, {-half}], [{half}, {-half}], [{half}, {half}], [{-half}, {half}]]
cell_size_m = {CELL_M}
[terrain]
kind = "raster"
file = "ground.tif"
vertical_datum = "EGM96"
[sensor]
kind = "nadir-camera"
fov_deg = 70.0
range_m = 1500.0
sample_spacing_m = 30.0
[limits]
min_height_agl_m = 300.0
max_height_agl_m = 600.0
[vehicle]
cruise_speed_m_s = 30.0
[planner]
algorithm = "memetic"
"""


def wandering(site: Site, rng: np.random.Generator) -> Observations:
    """A flight over a square, up and down and leaning, an observation about every 60 m."""
    west, south, east, north = site.area.bounds
    lines = np.arange(south, north, 1400.0)
    legs = [
        np.column_stack(
            [np.linspace(west, east, 150)[:: 1 - 2 * (k % 2)], np.full(150, y) + 250.0 * rng.normal(size=150)]
        )
        for k, y in enumerate(lines)
    ]
    en = np.vstack(legs)
    count = len(en)
    places = np.column_stack([en, site.ground.ups_m(en, 300.0 + 300.0 * rng.random(count))])
    axes = np.column_stack([0.2 * rng.normal(size=(count, 2)), -np.ones(count)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    tops = np.cross(axes, np.tile([1.0, 0.3, 0.0], (count, 1)))
    tops /= np.linalg.norm(tops, axis=1)[:, None]
    return Observations(places, axes, tops, 4.0 * np.arange(count, dtype=float), np.ones(count, dtype=bool))


def different(whole: CoverageMap, counted: FlownCoverage, blocks: list[tuple[CoverageMap, FlownCoverage]]) -> int:
    """How many cells are not equal in everything."""
    wrong = np.zeros(whole.grid.count, dtype=bool)
    first = 0
    for block, found in blocks:
        part = slice(first, first + block.grid.count)
        first = part.stop
        for one, other in [
            (whole.grid.cells.centre_m[part], block.grid.cells.centre_m),
            (whole.grid.cells.normal[part], block.grid.cells.normal),
            (whole.grid.weight_m2[part], block.grid.weight_m2),
            *(
                (getattr(counted, each.name)[part], getattr(found, each.name))
                for each in dataclasses.fields(FlownCoverage)
            ),
        ]:
            unequal = ~((one == other) | ((one != one) & (other != other)))
            wrong[part] |= unequal if unequal.ndim == 1 else unequal.any(axis=1)
    if first != whole.grid.count:
        raise SystemExit(f"{first} cells in blocks, {whole.grid.count} in one piece")
    return int(wrong.sum())


def in_blocks(site: Site, observations: Observations, step: int) -> list[tuple[CoverageMap, FlownCoverage]]:
    """Each block by itself, with what was observed near it."""
    columns = judging_map(site).grid.cells.lattice.shape[1]
    found = []
    for rows in row_blocks(site, cells=step * columns):
        block = judging_block(site, rows)
        found.append((block, count_observations(block, near_block(block, observations))))
    return found


def without_halo(site: Site, observations: Observations, step: int) -> list[tuple[CoverageMap, FlownCoverage]]:
    """The same with a halo that is too small."""
    columns = judging_map(site).grid.cells.lattice.shape[1]
    found = []
    for rows in row_blocks(site, cells=step * columns):
        block = judging_block(site, rows)
        centre_m, north_m = block.grid.cells.centre_m, observations.places_m[:, 1]
        halo_m = 600.0 * np.tan(np.radians(35.0)) - _TOO_SMALL_M
        near = (north_m >= centre_m[:, 1].min() - halo_m) & (north_m <= centre_m[:, 1].max() + halo_m)
        found.append((block, count_observations(block, observations.where(near))))
    return found


def main() -> None:
    """Count differences, square by square."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/seams.md"))
    parser.add_argument("--squares", type=int, default=1)
    parser.add_argument("--side", type=float, default=5000.0)
    arguments = parser.parse_args()
    rng, begin_s = np.random.default_rng(5), time.process_time()
    cells, seen, wrong, too_small = 0, 0, dict.fromkeys(STEPS, 0), 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.toml"
        file.write_text(generated(40_000.0, Path(folder)), encoding="utf-8")
        large = load_site(file)
        unsure = dataclasses.replace(large.scenario, uncertainty=Uncertainty(position_m=3.0, attitude_deg=1.0))
        for _ in range(arguments.squares):
            west, south = rng.uniform(-19_000.0, 19_000.0 - arguments.side, 2)
            area = shapely.box(west, south, west + arguments.side, south + arguments.side)
            site = dataclasses.replace(large, area=area, scenario=unsure)
            observations = wandering(site, rng)
            whole = judging_map(site)
            counted = count_observations(whole, observations)
            cells, seen = cells + whole.grid.count, seen + int(counted.seen.sum())
            for step in STEPS:
                wrong[step] += different(whole, counted, in_blocks(site, observations, step))
            too_small += different(whole, counted, without_halo(site, observations, STEPS[0]))
            print(cells, seen, wrong, too_small, f"{time.process_time() - begin_s:.0f} s", flush=True)
    lines = [
        "# Seams between blocks of cells",
        "",
        f"Command: `.venv/bin/python scripts/check_seams.py --squares {arguments.squares} --side {arguments.side:g}`, "
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, {time.process_time() - begin_s:.0f} s of "
        "processor time. What is compared is said at the top of the script.",
        "",
        f"{cells:,} cells of {CELL_M:g} m, {100.0 * seen / cells:.1f} % of them seen by the flight:",
        "",
        "| blocks | cells that differ from those of one piece |",
        "|---|---:|",
        *(f"| of {step} rows | {count} |" for step, count in wrong.items()),
        f"| of {STEPS[0]} rows, with a halo {_TOO_SMALL_M:g} m less than the camera's reach | {too_small} |",
    ]
    arguments.out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
