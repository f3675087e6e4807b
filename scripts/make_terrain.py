"""Make the GeoTIFF that comes with the package from matplotlib's SRTM sample (public domain, NASA / USGS).

Usage: .venv/bin/python scripts/make_terrain.py

The sample is a 344 x 403 grid of int16 metres above EGM96, 3 arc seconds. Two things to mind:

- its ``ymin`` is the larger latitude: the edge of the *first* row, north;
- its corners name the outer edges of the pixels, not their centres: only then is a pixel exactly 3 arc seconds.
"""

import argparse
from pathlib import Path

import matplotlib.cbook
import numpy as np
import rasterio
from rasterio.transform import Affine

OUT = Path(__file__).resolve().parents[1] / "uavcover" / "data" / "jacksboro.tif"


def main() -> None:
    """Write the file and say what is in it."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
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


if __name__ == "__main__":
    main()
