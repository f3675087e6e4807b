"""Compare plans of flat fields with those of Fields2Cover 2.1, by coverage, length and time with turns.

Usage: .venv/bin/python scripts/bench_fields.py [-o docs/results/fields.md] [--only NAME] [--seeds 3] [--evaluations 4000]

Fields of 7 to 21 hectares, convex ones and others, seen by a camera that looks straight down from 60 m (a strip of 84 m), with
99.9 % of what can be seen asked for, on cells of 4 m.

`Fields2Cover` is its Python package, where it is installed: swaths with overlap allowed, the angle that its brute force finds
best by three of its objectives, the whole field as one cell or divided (trapezoidal or boustrophedon, along and across), in its
boustrophedon order, and the quickest five of these also in the order of its route planner (OR-tools, one second). From swath to
swath it flies straight. With swaths as wide as the strip it leaves up to half a strip unseen at a border, so narrower ones are
tried as well; its swaths end at the border, but the camera sees beyond their ends, so they are also drawn in by shares of half a
strip. Of all that see as much as asked for, the quickest counts: it is helped more than its users are.

`uavcover` makes the time of the route small (no way from home counts), in so many evaluations. Length is that of the lines and
straight ways between them; time allows for turns, with the accelerations of ArduPilot's defaults, and is figured alike for both.
Rows in the .csv beside the page are kept.
"""

import argparse
import datetime
import itertools
import math
import os
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import Transformer
from shapely import affinity

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import uavcover as uc
from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import file_to_write
from tests.terrain_kinds import SENSORS, TRUE_TO_SCALE, Kind, flat, write_kind
from uavcover.model.route import Route, RouteMetrics
from uavcover.routes.objectives import judge
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import judging_map

ASKED = 0.999
HEIGHT_M = 60.0
STRIP_M = 2.0 * HEIGHT_M * math.tan(math.radians(35.0))
WIDTHS = tuple(1.0 - 0.02 * k for k in range(16))
"""Of swaths, as shares of the strip."""
INSETS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_REORDERED = 5
COLUMNS = ("field", "way", "seed", "swaths", "coverage", "length_m", "time_s", "cpu_s", "date")

FIELDS: dict[str, shapely.Polygon] = {
    "square": shapely.box(-180.0, -180.0, 180.0, 180.0),
    "rectangle": affinity.rotate(shapely.box(-290.0, -120.0, 290.0, 120.0), 23.0),
    "triangle": shapely.Polygon([(-290, -200), (280, -160), (40, 270)]),
    "pentagon": shapely.Polygon([(-220, -150), (90, -210), (260, -20), (120, 210), (-170, 160)]),
    "L": shapely.Polygon([(-250, -250), (250, -250), (250, -40), (-40, -40), (-40, 250), (-250, 250)]),
    "U": shapely.Polygon([(-250, -220), (250, -220), (250, 220), (90, 220), (90, -60), (-90, -60), (-90, 220), (-250, 220)]),
    "arrow": shapely.Polygon([(-280, -220), (0, -80), (280, -220), (0, 280)]),
    "pond": shapely.Polygon(
        [(-230, -210), (240, -180), (220, 210), (-200, 190)], [[(-60, -70), (70, -60), (60, 60), (-50, 80)]]
    ),
    "teeth": shapely.Polygon(
        [(-260, -160), (260, -160), (260, 200), (170, 0), (90, 190), (0, 20), (-90, 210), (-170, 10), (-260, 180)]
    ),
}  # fmt: skip


def site_of(folder: Path, name: str) -> Site:
    """A field as a user would write it: an elevation file, an area and a scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    kind = Kind(flat, FIELDS[name], cell_size_m=4.0, band_m=(HEIGHT_M - 1.0, HEIGHT_M + 1.0), margin_m=0.9)
    scenario = write_kind(folder, kind, name=name, asked=ASKED, sensor=SENSORS["nadir"])
    return uc.load_site(str(scenario)).minimising("flight-time", waypoint_price=0.0)


def ours(folder: Path, name: str, seed: int, evaluations: int) -> tuple[RouteMetrics, int, float]:
    """Figures of our plan, its lines that are longer than half a strip, and the processor time that it took."""
    began = time.process_time()
    plan = uc.plan(site_of(folder, name), out=folder / "run", evaluations=evaluations, seed=seed, force=True)
    legs_m = np.linalg.norm(np.diff(plan.chosen.route.waypoints_m[:, :2], axis=0), axis=1)
    return plan.chosen.metrics, int(np.sum(legs_m > 0.5 * STRIP_M)), time.process_time() - began


def theirs(f2c: Any, folder: Path, name: str) -> tuple[RouteMetrics, int, float]:
    """Figures of the quickest route of Fields2Cover that sees as much as is asked for, and the number of its swaths."""
    site, began = site_of(folder, name), time.process_time()
    found = []
    for cells, swaths in _divided(f2c, _as_cells(f2c, FIELDS[name])):
        sorter = f2c.RP_Boustrophedon()
        lines = _lines([sorter.genSortedSwaths(swaths.at(k)) for k in range(swaths.size())])
        metrics = _quickest(site, lines)
        if metrics is not None:
            found.append((metrics, len(lines), cells, swaths))
    found.sort(key=lambda each: each[0].flight_time_s)
    ends = [(metrics, count) for metrics, count, _, _ in found]
    for _, count, cells, swaths in found[:_REORDERED]:
        route = f2c.RP_RoutePlannerBase().genRoute(cells, swaths)
        metrics = _quickest(site, _lines(route.getVectorSwaths()))
        if metrics is not None:
            ends.append((metrics, count))
    metrics, count = min(ends, key=lambda each: each[0].flight_time_s)
    return metrics, count, time.process_time() - began


def _divided(f2c: Any, field: Any) -> Iterator[tuple[Any, Any]]:
    """Cells of the field, and the swaths in each, in every way that is tried."""
    brute = f2c.SG_BruteForce()
    brute.setAllowOverlap(True)
    divided = [field]
    for way, angle in itertools.product((f2c.DECOMP_TrapezoidalDecomp, f2c.DECOMP_Boustrophedon), (0.0, 0.5 * math.pi)):
        division = way()
        division.setSplitAngle(angle)
        divided.append(division.decompose(field))
    objectives = (f2c.OBJ_NSwath, f2c.OBJ_NSwathModified, f2c.OBJ_SwathLength)
    for cells, objective, share in itertools.product(divided, objectives, WIDTHS):
        yield cells, brute.generateBestSwaths(objective(), share * STRIP_M, cells)


def _lines(groups: Iterable[Any]) -> np.ndarray:
    """(swaths, 2, 2) ends of swaths in their order, metres east and north of the middle of the field."""
    ends = [(_place(swath.startPoint()), _place(swath.endPoint())) for group in groups for swath in group]
    return np.array(ends).reshape(-1, 2, 2)


def _quickest(site: Site, lines: np.ndarray) -> RouteMetrics | None:
    """Figures of swaths that are drawn in as far as they still see what is asked for; none where they do not as they are."""
    best = None
    for inset in INSETS:
        metrics = judge(judging_map(site), _flown(site, lines, inset * 0.5 * STRIP_M))
        if metrics.coverage_of_coverable < ASKED:
            break
        best = metrics
    return best


def _as_cells(f2c: Any, field: shapely.Polygon) -> Any:
    cell = f2c.Cell()
    for ring in (field.exterior, *field.interiors):
        cell.addRing(f2c.LinearRing(f2c.VectorPoint([f2c.Point(float(x), float(y)) for x, y in ring.coords])))
    return f2c.Cells(cell)


def _place(point: Any) -> tuple[float, float]:
    return float(point.getX()), float(point.getY())


def _flown(site: Site, lines: np.ndarray, inset_m: float) -> Route:
    """The swaths one after the other at their height, both ends drawn in, by no more than to their middle."""
    drawn = lines.copy()
    for line in drawn:
        length_m = float(np.linalg.norm(line[1] - line[0]))
        by = min(inset_m / length_m, 0.5) * (line[1] - line[0]) if length_m > 0.0 else 0.0
        line[0] += by
        line[1] -= by
    places = drawn.reshape(-1, 2)
    moved_m = np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.01
    places = places[np.concatenate([[True], moved_m])]
    # From metres around the middle of the field to those of the site.
    lon_deg, lat_deg = Transformer.from_crs(TRUE_TO_SCALE, 4326, always_xy=True).transform(*places.T)
    local = site.frame.enu_from_geodetic(lat_deg, lon_deg, np.zeros(len(places)))[:, :2]
    return Route(np.column_stack([local, site.ground.heights_m(local) + HEIGHT_M]))


def page(rows: list[Row], evaluations: int) -> str:
    """The table: the middle seed of ours by time."""
    lines = [
        "# Flat fields: Fields2Cover",
        "",
        f"Command: `.venv/bin/python scripts/bench_fields.py --evaluations {evaluations}`, {max(row['date'] for row in rows)}, "
        f"uavcover {metadata.version('uavcover')}, {os.cpu_count()} cores. What is compared is said at the top of the script.",
        "",
        "| field | hectares | planner | swaths | coverage | length | time with turns | against Fields2Cover | seeds "
        "| processor time |",
        "|---|---:|---|---:|---:|---:|---:|---:|---|---:|",
    ]
    for name, field in FIELDS.items():
        own = [row for row in rows if row["field"] == name]
        rival = next((row for row in own if row["way"] != "uavcover"), None)
        ranked = sorted((row for row in own if row["way"] == "uavcover"), key=lambda row: float(row["time_s"]))
        for row in ([rival] if rival else []) + ranked[len(ranked) // 2 :][:1]:
            against, spread = "", ""
            if row["way"] == "uavcover":
                spread = f"{len(ranked)}: {float(ranked[0]['time_s']):.0f} to {float(ranked[-1]['time_s']):.0f} s"
                if rival is not None:
                    shares = [float(row[key]) / float(rival[key]) - 1.0 for key in ("length_m", "time_s")]
                    against = f"length {100.0 * shares[0]:+.1f} %, time {100.0 * shares[1]:+.1f} %"
            lines.append(
                f"| {name} | {field.area / 1e4:.1f} | {row['way']} | {row['swaths']} | {100.0 * float(row['coverage']):.2f} % "
                f"| {float(row['length_m']):.0f} m | {float(row['time_s']):.0f} s | {against} | {spread} "
                f"| {float(row['cpu_s']):.0f} s |"
            )
    return "\n".join(lines) + "\n"


def main() -> int:
    """What is missing in the table is measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/fields.md"))
    parser.add_argument("--only", choices=list(FIELDS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--evaluations", type=int, default=4000)
    chosen = parser.parse_args()
    try:
        import fields2cover as f2c
    except ImportError:
        f2c = None
        print("the Python package fields2cover is not installed: only our own plans are made")
    file = chosen.out.with_suffix(".csv")
    rows = read_rows(file)
    done = {(row["field"], row["way"], row["seed"]) for row in rows}
    wanted = [(name, "Fields2Cover", "") for name in FIELDS if f2c is not None]
    wanted += [(name, "uavcover", str(seed)) for seed in range(1, chosen.seeds + 1) for name in FIELDS]
    with tempfile.TemporaryDirectory() as temporary:
        for name, way, seed in wanted:
            if (name, way, seed) in done or chosen.only not in (None, name):
                continue
            folder = Path(temporary) / name
            measured = ours(folder, name, int(seed), chosen.evaluations) if seed else theirs(f2c, folder, name)
            metrics, swaths, cpu_s = measured
            values = {
                "field": name, "way": way, "seed": seed, "swaths": swaths, "coverage": metrics.coverage_of_coverable,
                "length_m": metrics.path_length_m, "time_s": metrics.flight_time_s, "cpu_s": cpu_s,
                "date": datetime.date.today(),
            }  # fmt: skip
            rows.append({key: str(value) for key, value in values.items()})
            print(rows[-1], flush=True)
            write_rows(file, COLUMNS, rows)
    chosen.out.write_text(page(rows, chosen.evaluations), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
