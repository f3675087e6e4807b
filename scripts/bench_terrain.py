"""How far the ground in use is from the file's own bilinear surface, and how long reading it takes.

Usage: .venv/bin/python scripts/bench_terrain.py [-o docs/results/terrain.md] [--quick]

Rugged made-up files (slopes to 45 degrees) in many rasters, and the bundled ones. Places are drawn in the local frame, brought to
the Earth by formulas of the tests' own (tests/naive/file_ground.py) and looked up with rasterio and pyproj alone.
"""

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from scripts.options import file_to_write  # noqa: E402
from uavcover.kernels.grid import steepest_of_finite  # noqa: E402
from uavcover.scenario.elevation_file import read_ground  # noqa: E402
from uavcover.scenario.frames import LocalFrame  # noqa: E402
from uavcover.scenario.scenario_file import load_scenario, terrain_source  # noqa: E402
from uavcover.scenario.site import load_site  # noqa: E402


@dataclass(frozen=True, slots=True)
class Place:
    """A raster somewhere on Earth; ``turn_deg`` is by how much its rows are turned in its own system."""

    name: str
    lat_deg: float
    lon_deg: float
    epsg: int
    turn_deg: float = 0.0


PLACES = (
    Place("degrees, equator", 0.02, 36.8, 4326),
    Place("degrees, 36 N", 36.48, -84.21, 4326),
    Place("degrees, 60 N", 60.1, 10.3, 4326),
    Place("degrees, 45 S", -45.2, 169.4, 4326),
    Place("UTM, central meridian", 47.2, 9.02, 32632),
    Place("UTM, 2.9 degrees aside", 47.2, 11.9, 32632),
    Place("UTM, 2.9 degrees aside, turned 3", 47.2, 11.9, 32632, 3.0),
    Place("UTM, 60 N, turned -3", 60.1, 6.2, 32632, -3.0),
    Place("UTM south, turned 40", -45.2, 169.4, 32759, 40.0),
    Place("Lambert azimuthal (Europe)", 63.0, 26.0, 3035),
)
SIZES_M = {1.0: (1000.0, 5000.0), 5.0: (2500.0, 5000.0), 10.0: (5000.0, 10_000.0), 30.0: (5000.0, 10_000.0, 20_000.0)}
BUNDLED = ("jacksboro", "ridge-obstacles", "ridge-25km2")
ALT_M = 550.0


def measure(place: Place, pixel_m: float, size_m: float, folder: Path) -> str:
    """One row of the table."""
    from tests.scenario.dem_files import largest_difference_m, write_dem

    rng = np.random.default_rng(int(1000 * pixel_m + size_m))
    path = write_dem(
        folder / "dem.tif", rng, lat_deg=place.lat_deg, lon_deg=place.lon_deg, epsg=place.epsg, pixel_m=pixel_m,
        size_m=size_m, turn_deg=place.turn_deg,
    )  # fmt: skip
    frame, half = LocalFrame(place.lat_deg, place.lon_deg, ALT_M), 0.5 * size_m
    began = time.process_time()
    ground = read_ground(path, "EGM96", frame=frame, bounds_m=(-half, -half, half, half), grid_step_m=None)
    took = time.process_time() - began
    origin = (place.lat_deg, place.lon_deg, ALT_M)
    found = largest_difference_m(ground, path, rng, origin=origin, size_m=size_m, count=200_000)
    up_m = ground.surface.up_m
    steepest = np.degrees(np.arctan(steepest_of_finite(up_m, ground.surface.grid)))
    return (
        f"| {place.name} | {pixel_m:g} | {size_m / 1000.0:g} | {np.ptp(up_m):.0f} | {steepest:.0f} | {1000.0 * found:.2f} | "
        f"{1000.0 * ground.error_m:.2f} | {took:.1f} |"
    )


def measure_bundled(name: str) -> str:
    """One row of the table."""
    from tests.naive.file_ground import FileGround

    began = time.process_time()
    site = load_site(name)
    took = time.process_time() - began
    assert site.frame is not None
    rng = np.random.default_rng(1)
    west, south, east, north = site.fence.bounds
    places = np.column_stack([rng.uniform(west, east, 200_000), rng.uniform(south, north, 200_000), np.zeros(200_000)])
    places[:, 2] = site.ground.heights_m(places[:, :2]) + rng.uniform(0.0, 150.0, 200_000)
    lat, lon, alt = site.frame.geodetic_from_enu(places)
    file = FileGround(terrain_source(load_scenario(name).terrain).files[0])  # type: ignore[no-untyped-call]
    found = float(np.abs(site.ground.heights_agl_m(places) - (alt - file.height_m(lat, lon))).max())  # type: ignore[no-untyped-call]
    up_m, grid = site.ground.surface.up_m, site.ground.surface.grid
    steepest = np.degrees(np.arctan(steepest_of_finite(up_m, grid)))
    size_km = max(east - west, north - south) / 1000.0
    return (
        f"| `{name}` | {site.ground.surface.step_m:.0f} | {size_km:.1f} | {np.ptp(up_m):.0f} | {steepest:.0f} | "
        f"{1000.0 * found:.2f} | {1000.0 * site.ground.error_m:.2f} | {took:.1f} |"
    )


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--out", type=file_to_write, default=ROOT / "docs" / "results" / "terrain.md")
    parser.add_argument("--quick", action="store_true", help="the smallest area of each pixel size only")
    arguments = parser.parse_args()
    rows = [measure_bundled(name) for name in BUNDLED]
    with tempfile.TemporaryDirectory() as folder:
        for place in PLACES:
            for pixel_m, sizes_m in SIZES_M.items():
                for size_m in sizes_m[:1] if arguments.quick else sizes_m:
                    rows.append(measure(place, pixel_m, size_m, Path(folder)))
                    print(rows[-1], flush=True)
    arguments.out.write_text(HEAD + "\n".join(rows) + "\n", encoding="utf-8")


HEAD = """# The ground in use against the file's own

Largest difference of heights above ground, at 200,000 random places up to 150 m above it: ours against that of the file
at their latitude, longitude and height, by rasterio, pyproj and the formulas of the ellipsoid alone. Made-up files are
fractal relief. "At load" is what uavcover itself measures then, keeps with the ground (`largest_error_m` in `run.json`), and adds
to a stated uncertainty. Made by `scripts/bench_terrain.py`; processor time of one thread.

| raster | pixel, m | area, km | relief, m | steepest, degrees | largest difference, mm | at load, mm | reading, s |
|---|---:|---:|---:|---:|---:|---:|---:|
"""

if __name__ == "__main__":
    main()
