"""Make the GeoTIFF that comes with the package from matplotlib's SRTM sample (public domain, NASA / USGS), and the obstacles.

Usage: .venv/bin/python scripts/docs/make_terrain.py

The sample is a 344 x 403 grid of int16 metres above EGM96, 3 arc seconds. Two things to mind:

- its ``ymin`` is the larger latitude: the edge of the *first* row, north;
- its corners name the outer edges of the pixels, not their centres: only then is a pixel exactly 3 arc seconds.

The obstacles are sixty boxes for the bundled scenario ridge-obstacles, drawn by a seed: always the same file.
"""

import argparse
import csv
import math
from pathlib import Path

import matplotlib.cbook
import numpy as np
import rasterio
from rasterio.transform import Affine

DATA = Path(__file__).resolve().parents[2] / "uavcover" / "data"
OUT = DATA / "jacksboro.tif"
OBSTACLES = DATA / "ridge-obstacles.csv"
BOXES = 60
SIDE_M = 1000.0
INSET_M = 30.0
APART_M = 45.0
"""Between the middles of two boxes: a corner is at most 18 m from the middle, so there is always a way between them."""
HOME_M = (470.0, -470.0)
FROM_HOME_M = 60.0


def write_terrain() -> None:
    """Write the file and say what is in it."""
    sample = matplotlib.cbook.get_sample_data("jacksboro_fault_dem.npz")
    heights = np.asarray(sample["elevation"], dtype=np.int16)
    rows, columns = heights.shape
    west, east = float(sample["xmin"]), float(sample["xmax"])
    north, south = float(sample["ymin"]), float(sample["ymax"])
    if not north > south:
        raise SystemExit("the sample has changed: its ymin is no longer the north edge")
    OUT.parent.mkdir(exist_ok=True)
    with rasterio.open(
        OUT, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="int16", crs="EPSG:4326+5773",
        transform=Affine((east - west) / columns, 0.0, west, 0.0, -(north - south) / rows, north), nodata=-32768,
        compress="deflate", predictor=2, zlevel=9,
    ) as file:  # fmt: skip
        file.write(heights, 1)
        file.update_tags(
            SOURCE="SRTM 3 arc seconds, public domain (NASA / USGS); matplotlib sample jacksboro_fault_dem.npz",
            PLACE="Pine Mountain, Jacksboro fault, Tennessee / Kentucky",
        )
        file.units = ("m",)
    print(f"{OUT.name}: {columns} x {rows}, {heights.min()}..{heights.max()} m, {OUT.stat().st_size} bytes")


def write_obstacles() -> None:
    """Draw places until sixty are far enough from each other and from the take-off place."""
    rng = np.random.default_rng(60)
    middles: list[tuple[float, float]] = []
    reach = 0.5 * SIDE_M - INSET_M
    while len(middles) < BOXES:
        east, north = (round(float(value), 1) for value in rng.uniform(-reach, reach, 2))
        near = any(math.dist((east, north), other) < APART_M for other in middles)
        if not near and math.dist((east, north), HOME_M) >= FROM_HOME_M:
            middles.append((east, north))
    with OBSTACLES.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "east_m", "north_m", "length_m", "width_m", "heading_deg", "height_m"])
        for number, (east, north) in enumerate(middles, start=1):
            length, width, heading, height = (
                round(float(rng.uniform(low, high)), 1) for low, high in ((12, 30), (8, 20), (0, 180), (10, 25))
            )
            writer.writerow([f"box {number}", east, north, length, width, heading, height])


def main() -> None:
    """Write both."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    write_terrain()
    write_obstacles()


if __name__ == "__main__":
    main()
