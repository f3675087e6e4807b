"""Plan the sample missions of EnergyAwareMCPP (CTU Prague) and compare energies, both by the model of its authors.

Usage: .venv/bin/python scripts/bench_energy_aware.py FOLDER [-o docs/results/energy_aware.md] [--only cape] [--evaluations 2000]

FOLDER is ``sample_configs`` of a copy of ``ctu-mrs/EnergyAwareMCPP`` in which its program has run in each folder
(``../../build/coverage_mission_planner config.yaml > out.log``), so that ``path_*.csv`` lie beside ``config.yaml``. Nothing of
that repository is in this one. The model of power, best speed and turns is that of D. Datsko, F. Nekovar, R. Penicka, M. Saska:
"Energy-aware Multi-UAV Coverage Mission Planning with Optimal Speed of Flight", IEEE Robotics and Automation Letters, 2024.

Their lines are ``sweeping_step`` apart, so a place is seen when a path passes within half a step of it. `uavcover plan` gets the
same area, a disc sensor of that radius over flat ground, the same start, as many vehicles as they have paths, and is asked to see
as large a share as their paths do. What paths see is then measured exactly for both, as the area of polygons, with the ways from
the start and back, which count for the energy too. Rows are kept in the .csv beside the page; run again after a stop, it goes on.
"""

import argparse
import csv
import datetime
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from itertools import pairwise
from pathlib import Path

import numpy as np
import rasterio
import shapely
from rasterio.transform import from_origin

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import existing_folder, file_to_write

M_PER_DEG = 111319.5
"""Of their map: a degree of latitude, and of longitude at the equator."""
AIR_KG_M3, GRAVITY_M_S2 = 1.225, 9.8
EFFICIENCY = 0.391
"""Of motor and propeller, as they measured it."""
CRUISE_SHARE = 1.092
"""Power at the speed of the longest range, as a share of that of hovering."""
CELLS_PER_STEP = 6
COLUMNS = (
    "case", "paths", "step_m", "area_ha", "their_coverage", "their_largest_wh", "their_total_wh", "their_length_m", "coverage",
    "largest_wh", "total_wh", "length_m", "waypoints", "evaluations", "cpu_s", "date",
)  # fmt: skip

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Craft:
    """Their vehicle.

    Attributes:
        hover_w: power while hovering, and while it accelerates.
        cruise_w: power at its best speed.
        best_m_s: that speed.
        mass_kg: with its battery.
        acceleration_m_s2: on average.
        deviation_m: how far it may cut a corner.
    """

    hover_w: float
    cruise_w: float
    best_m_s: float
    mass_kg: float
    acceleration_m_s2: float
    deviation_m: float


@dataclass(frozen=True, slots=True)
class Turn:
    """A corner: the speed at its beginning and end, the slowest one in between, and how fast one becomes the other."""

    entry_m_s: float
    slowest_m_s: float
    acceleration_m_s2: float
    energy_j: float


def number(config: str, key: str) -> float:
    """A number of config.yaml."""
    found = re.search(rf"^ *{key}: *([-+\d.eE]+)", config, re.MULTILINE)
    if found is None:
        raise SystemExit(f"config.yaml has no number {key}")
    return float(found[1])


def craft_of(config: str) -> Craft:
    """Their equations 4, 5, 17 and 18."""
    mass, rotors, radius = (number(config, key) for key in ("drone_mass", "number_of_propellers", "propeller_radius"))
    thrust = mass * GRAVITY_M_S2
    discs = 2.0 * AIR_KG_M3 * math.pi * rotors
    induced = math.sqrt(thrust / discs) / radius
    hover = thrust**1.5 / (EFFICIENCY * radius * math.sqrt(discs))
    slowness = (
        number(config, "c0")
        + number(config, "c1") * induced
        + number(config, "c2") * number(config, "drone_area") * 1e4
    )
    acceleration, deviation = number(config, "average_acceleration"), number(config, "allowed_path_deviation")
    return Craft(hover, CRUISE_SHARE * hover, induced / slowness, mass, acceleration, deviation)


def turn_at(craft: Craft, before: Points, corner: tuple[float, float]) -> Turn:
    """The turn between the places of ``before``, first and last, at a corner; none below a degree."""
    into, out = np.subtract(corner, before[0]), np.subtract(before[1], corner)
    cosine = float(into @ out) / math.sqrt(float(into @ into) * float(out @ out))
    angle = math.acos(cosine) if abs(cosine) <= 1.0 else math.pi
    best, mass = craft.best_m_s, craft.mass_kg
    if math.degrees(angle) < 1.0:
        return Turn(best, 0.0, craft.acceleration_m_s2, 0.0)
    half = angle / 2.0
    across = min(
        math.sqrt(2.0 * craft.deviation_m * craft.acceleration_m_s2 * math.cos(half)), math.sin(angle) * best / 2.0
    )
    slowest = across / math.tan(half)
    entry = slowest + across * math.tan(half)
    after = 0.5 * (entry**2 + (math.sin(angle) ** 2 - math.cos(angle) ** 2) * best**2)
    return Turn(entry, slowest, craft.acceleration_m_s2 * math.sin(half), mass * (best**2 - entry**2 + after))


def short_leg_j(craft: Craft, first: tuple[float, float], last: tuple[float, float], length_m: float) -> float:
    """A leg too short for the best speed; first and last: speed there, and acceleration from or to it."""
    (v0, a0), (v1, a1) = first, last
    if not length_m:
        return 0.0
    square = (v0**2 / a0 + v1**2 / a1 + 2.0 * length_m) / (1.0 / a0 + 1.0 / a1)
    top = math.sqrt(square) if square >= 0.0 else math.nan
    if not max(v0, v1) <= top <= craft.best_m_s:
        middle = (v0 + v1) / 2.0
        return length_m / middle * (craft.hover_w + (craft.cruise_w - craft.hover_w) * middle / craft.best_m_s)
    if top > v0 and top > v1:
        return craft.hover_w * ((top - v0) / a0 + (top - v1) / a1)
    return 0.0


def long_leg_j(craft: Craft, v0: float, v1: float, length_m: float) -> float:
    """A leg between two speeds, at the best speed as long as it can be."""
    best, a = craft.best_m_s, craft.acceleration_m_s2
    cruise_m = length_m - (2.0 * best**2 - v0**2 - v1**2) / (2.0 * a)
    if cruise_m < 0.0:
        return short_leg_j(craft, (v0, a), (v1, a), length_m)
    return cruise_m / best * craft.cruise_w + craft.hover_w * (2.0 * best - v0 - v1) / a


def path_energy_j(craft: Craft, path: Points) -> float:
    """What their model says a path takes, from rest to rest."""
    places = [path[0], *(b for a, b in pairwise(path) if a != b)]
    rest = Turn(0.0, 0.0, craft.acceleration_m_s2, craft.mass_kg * craft.best_m_s**2 / 2.0)
    corners = zip(places, places[1:], places[2:], strict=False)
    turns = [rest, *(turn_at(craft, (a, c), b) for a, b, c in corners), rest]
    total = 0.0
    for start, end, begin, finish in zip(places, places[1:], turns, turns[1:], strict=False):
        total += begin.energy_j
        slow_m = sum((t.entry_m_s**2 - t.slowest_m_s**2) / (2.0 * t.acceleration_m_s2) for t in (begin, finish))
        length_m = math.dist(start, end)
        if slow_m < length_m:
            total += long_leg_j(craft, begin.entry_m_s, finish.entry_m_s, length_m - slow_m)
            total += craft.hover_w * sum((t.entry_m_s - t.slowest_m_s) / t.acceleration_m_s2 for t in (begin, finish))
        else:
            ends = [(t.slowest_m_s, t.acceleration_m_s2) for t in (begin, finish)]
            total += short_leg_j(craft, ends[0], ends[1], length_m)
    return total


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One of their sample missions, and what their program made of it.

    Attributes:
        name: of its folder.
        config: the text of config.yaml.
        rings_lat_lon_deg: the area's outline, then its holes.
        paths_lat_lon_deg: of their vehicles, from the start and back.
    """

    name: str
    config: str
    rings_lat_lon_deg: tuple[Points, ...]
    paths_lat_lon_deg: tuple[Points, ...]

    @property
    def start_lat_lon_deg(self) -> tuple[float, float]:
        """Where all paths begin and end."""
        return number(self.config, "start_x"), number(self.config, "start_y")

    @property
    def step_m(self) -> float:
        """Between two of their lines."""
        return number(self.config, "sweeping_step")

    def metres(self, points: Points) -> list[tuple[float, float]]:
        """East and north of their origin, on their map."""
        lat0, lon0 = number(self.config, "latitude_origin"), number(self.config, "longitude_origin")
        scale = M_PER_DEG * math.cos(math.radians(lat0))
        return [((lon - lon0) * scale, (lat - lat0) * M_PER_DEG) for lat, lon in points]

    def area(self) -> shapely.Polygon:
        """What is to be seen, on their map."""
        outline, *holes = (self.metres(ring) for ring in self.rings_lat_lon_deg)
        return shapely.Polygon(outline, holes)

    def seen_fraction(self, paths: Sequence[Points]) -> float:
        """The share of the area within half a step of the paths."""
        near = shapely.union_all([shapely.LineString(p).buffer(self.step_m / 2.0, quad_segs=64) for p in paths])
        return float(near.intersection(self.area()).area / self.area().area)


def read_points(file: Path) -> Points:
    """Latitudes and longitudes of one of their .csv files."""
    with file.open(encoding="utf-8", newline="") as lines:
        return [(float(row[0]), float(row[1])) for row in csv.reader(lines) if row]


def read_case(folder: Path) -> Case:
    """One of their folders."""
    paths = sorted(folder.glob("path_*.csv"))
    if not paths:
        raise SystemExit(f"{folder} has no path_*.csv: run their program there first")
    rings = [folder / "fly_zone.csv", *sorted(folder.glob("no_fly_zone_*.csv"))]
    config = (folder / "config.yaml").read_text(encoding="utf-8")
    return Case(folder.name, config, tuple(map(read_points, rings)), tuple(map(read_points, paths)))


def write_scenario(case: Case, craft: Craft, folder: Path, asked: float) -> Path:
    """The same mission as a scenario of ours, on flat ground, with nothing that keeps vehicles apart in time."""
    lats, lons = zip(*case.rings_lat_lon_deg[0], strict=True)
    west, north, pixel = min(lons) - 0.06, max(lats) + 0.02, 0.002
    shape = (math.ceil((north - min(lats) + 0.02) / pixel), math.ceil((max(lons) + 0.06 - west) / pixel))
    profile = {
        "driver": "GTiff",
        "height": shape[0],
        "width": shape[1],
        "count": 1,
        "dtype": "float32",
        "crs": "EPSG:4326",
    }
    with rasterio.open(folder / "flat.tif", "w", transform=from_origin(west, north, pixel, pixel), **profile) as raster:
        raster.write(np.full((1, *shape), 100.0, dtype=np.float32))
    rings = [[[lon, lat] for lat, lon in ring] for ring in case.rings_lat_lon_deg]
    endurance = min(1e6, number(case.config, "max_single_path_energy") * 3600.0 / craft.cruise_w)
    home = case.start_lat_lon_deg
    file = folder / "scenario.toml"
    holes = f"holes_lon_lat_deg = {rings[1:]}\n" if rings[1:] else ""
    file.write_text(
        f'name = "{case.name}"\nselect = "coverage>={asked:.5f}"\n'
        f"[area]\ncell_size_m = {case.step_m / CELLS_PER_STEP}\npolygon_lon_lat_deg = {rings[0]}\n{holes}"
        '[terrain]\nkind = "raster"\nfile = "flat.tif"\nvertical_datum = "EGM96"\n'
        f"[home]\nlat_deg = {home[0]}\nlon_deg = {home[1]}\n"
        '[sensor]\nkind = "disc"\nsensing = "along-path"\n'
        f"radius_m = {case.step_m / 2.0}\nsample_spacing_m = {case.step_m / 10.0}\n"
        "[limits]\nmin_height_agl_m = 8.0\nmax_height_agl_m = 12.0\nheight_margin_m = 1.0\ntransit_clearance_m = 5.0\n"
        f"[vehicle]\ncruise_speed_m_s = {craft.best_m_s}\nacceleration_m_s2 = {craft.acceleration_m_s2}\njerk_m_s3 = 100.0\n"
        "max_climb_m_s = 20.0\nmax_descent_m_s = 20.0\ntakeoff_height_m = 9.0\nreturn_height_m = 9.0\nreserve_fraction = 0.0\n"
        f"endurance_s = {endurance}\nmax_mission_items = 5000\n"
        f"[fleet]\nvehicles = {len(case.paths_lat_lon_deg)}\nturnaround_s = 0.0\nseparation_m = 1.0\npath_error_m = 0.0\n"
        "timing_error_fraction = 0.0\nstart_error_s = 0.0\npad_s = 0.0\n",
        encoding="utf-8",
    )
    return file


def planned(case: Case, craft: Craft, asked: float, evaluations: int) -> tuple[list[Points], int, float]:
    """Our paths from the start and back, on their map; how many waypoints they have; seconds of processor time."""
    with tempfile.TemporaryDirectory() as name:
        run = Path(name) / "run"
        scenario = write_scenario(case, craft, Path(name), asked)
        command = [
            sys.executable,
            "-m",
            "uavcover",
            "plan",
            str(scenario),
            "-o",
            str(run),
            "-q",
            "--evaluations",
            str(evaluations),
        ]
        process = subprocess.Popen(command)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"{case.name}: no plan (exit code {process.returncode})")
        plan = json.loads((run / "plan.json").read_text(encoding="utf-8"))
    if not plan["rule_met"]:
        print(f"{case.name}: the plan does not see as much as is asked for", file=sys.stderr)
    waypoints = case.metres([(p["lat_deg"], p["lon_deg"]) for p in plan["waypoints"]])
    home = case.metres([case.start_lat_lon_deg])
    cuts = [(s["first_waypoint"], s["last_waypoint"]) for s in plan["sorties"]] or [(0, len(waypoints) - 1)]
    paths: list[Points] = [[*home, *waypoints[first : last + 1], *home] for first, last in cuts]
    return paths, len(waypoints), usage.ru_utime + usage.ru_stime


def compare(case: Case, evaluations: int) -> Row:
    """A row: what their paths and ours see, and what they take."""
    craft = craft_of(case.config)
    theirs = [case.metres(path) for path in case.paths_lat_lon_deg]
    asked = case.seen_fraction(theirs)
    ours, waypoints, cpu_s = planned(case, craft, asked, evaluations)
    their_wh, our_wh = ([path_energy_j(craft, p) / 3600.0 for p in paths] for paths in (theirs, ours))
    their_m, our_m = (sum(shapely.LineString(p).length for p in paths) for paths in (theirs, ours))
    return {
        "case": case.name,
        "paths": f"{len(theirs)} {len(ours)}",
        "step_m": f"{case.step_m:g}",
        "area_ha": f"{case.area().area / 1e4:.2f}",
        "their_coverage": f"{asked:.5f}",
        "their_largest_wh": f"{max(their_wh):.2f}",
        "their_total_wh": f"{sum(their_wh):.2f}",
        "their_length_m": f"{their_m:.0f}",
        "coverage": f"{case.seen_fraction(ours):.5f}",
        "largest_wh": f"{max(our_wh):.2f}",
        "total_wh": f"{sum(our_wh):.2f}",
        "length_m": f"{our_m:.0f}",
        "waypoints": str(waypoints),
        "evaluations": str(evaluations),
        "cpu_s": f"{cpu_s:.0f}",
        "date": datetime.date.today().isoformat(),
    }


def table(rows: Sequence[Row], evaluations: int) -> str:
    """The page."""
    lines = [
        "# Against EnergyAwareMCPP",
        "",
        f"Command: `.venv/bin/python scripts/bench_energy_aware.py FOLDER --evaluations {evaluations}`, {rows[0]['date']}, "
        f"uavcover {metadata.version('uavcover')}. What is compared, and how, is said at the top of the script.",
        "",
        "| mission | step | area | paths, theirs and ours | seen | largest energy | total energy | length |",
        "|---|---:|---:|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [row["case"], f"{row['step_m']} m", f"{row['area_ha']} ha", " / ".join(row["paths"].split())]
        cells.append(f"{float(row['their_coverage']):.2%} / {float(row['coverage']):.2%}")
        for key, unit in (("largest_wh", "Wh"), ("total_wh", "Wh"), ("length_m", "m")):
            a, b = float(row["their_" + key]), float(row[key])
            cells.append(f"{a:g} / {b:g} {unit} ({b / a - 1.0:+.1%})")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Compare what is not in the .csv, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=existing_folder)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/energy_aware.md"))
    parser.add_argument("--only")
    parser.add_argument("--evaluations", type=int, default=2000)
    args = parser.parse_args()
    file = args.out.with_suffix(".csv")
    rows = read_rows(file)
    done = {(row["case"], row["evaluations"]) for row in rows}
    cases = sorted(path.parent for path in args.folder.glob("*/config.yaml") if args.only in (None, path.parent.name))
    if not cases:
        parser.error(f"{args.folder}: no {args.only or '*'}/config.yaml in it; see the top of the script")
    for folder in cases:
        if (folder.name, str(args.evaluations)) in done:
            continue
        rows.append(compare(read_case(folder), args.evaluations))
        print(rows[-1], file=sys.stderr)
        write_rows(file, COLUMNS, rows)
    if rows:
        args.out.write_text(table(rows, args.evaluations), encoding="utf-8")


if __name__ == "__main__":
    main()
