"""Energy of whole missions over mountains: ours against the best lines, each at 99 % seen.

Usage: .venv/bin/python scripts/bench_mountains.py [DEM_FOLDER] [-o docs/results/mountains.md] [--only PLACE[:WAY]] [--seeds 1]
       [--evaluations N]

Places: the bundled `jacksboro` and `ridge-25km2`, and `davosdorf`, the square kilometre around 46.81707 N, 9.82911 E with the
sensor, limits and vehicle of `jacksboro`. Its heights (`resources/davosdorf.tif` of ethz-asl/terrain-navigation) are not in this
repository: DEM_FOLDER is the folder that has them; without it that place is left out.

Ways, all with `planner.objective = "energy"`:
- boustrophedon: the plain and the tuned ones of `uavcover plan`; contour-lines: theirs; simple-lines: lines that bend and lines
  of few waypoints in six directions. Of each the whole scan is evaluated on the planner's cells, then its best two directions
  once more with 19 numbers of lines; and from the least energy on they are judged on the area's own cells. The best is that of
  least energy that sees 99 % and keeps every limit.
- ours: `uavcover plan --select "coverage>=0.99"`, with so many evaluations (EVALUATIONS).

Energy is that of the whole mission (take-off, ways there and home, route, landing, of all flights) in seconds of hovering, by
one judge for all (uavcover.routes.objectives). The hold-out is the share that is seen on cells of half the size. Each
finished row is kept in the .csv beside the page; run again after a stop, it goes on with what is missing.
"""

import argparse
import dataclasses
import datetime
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

import uavcover as uc
from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import existing_folder, first_and_second
from uavcover.model.area import Area
from uavcover.model.home import Home
from uavcover.model.route import Route, RouteMember
from uavcover.model.scenario import Scenario
from uavcover.model.terrain import RasterTerrain
from uavcover.planning.baselines.adaptive_swaths import BENT, STRAIGHT, bend_lines, fly_bent, simple_lines
from uavcover.planning.baselines.boustrophedon import (
    PLAIN_TOLERANCE_M,
    Baseline,
    best_height_agl_m,
    boustrophedons,
    evaluated,
)
from uavcover.planning.baselines.contour_lines import fly_contours, layouts_to_try
from uavcover.planning.baselines.swaths import fly_layout, long_side_angle_rad, regular_layout, width_across_m
from uavcover.routes.objectives import judge_member
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import CoverageMap, finer_map, judging_map, planning_map
from uavcover.sensing.sensors import reach_at_height_m

ASKED = 0.99
LESS = 0.10
"""How much less energy than the best lines is asked for."""

PLACES = ("jacksboro", "davosdorf", "ridge-25km2")
_DIRECTIONS = 6
_REFINED = 2
_FINER = tuple(0.7 + 0.03 * k for k in range(19))
"""The best two directions of a scan are tried once more, with so many times the lines that flat ground needs."""

_BEND = 0.8
"""As in simple_lines: how far bent lines may be laid straight on the map, as a share of how far they may leave their height."""

Direction = tuple[float, ...]
"""Of lines: counter-clockwise from east; of contour lines: how smoothed and how straightened the contours are."""

EVALUATIONS = {"jacksboro": 4000, "davosdorf": 4000, "ridge-25km2": 26000}
_TRIED = 60
"""So many of a scan are judged on the area's own cells at most."""

_COARSE = 0.004
"""Cells of the planner may see so much less than those of the area."""

COLUMNS = (
    "place", "way", "seed", "coverage", "hold_out", "energy_hover_s", "mission_s", "length_m", "waypoints", "sorties",
    "made_by", "tried", "evaluations", "cpu_s", "commit", "date",
)  # fmt: skip


def scenario_of(place: str, dem_folder: Path | None) -> Scenario | None:
    """The scenario of a place with the energy as its objective; none where its heights are not there."""
    scenario = load_scenario("jacksboro" if place == "davosdorf" else place)
    if place == "davosdorf":
        if dem_folder is None or not (file := dem_folder / "davosdorf.tif").is_file():
            return None
        lat, lon = 46.81707, 9.82911
        north, east = 500.0 / 111_180.0, 500.0 / (111_320.0 * math.cos(math.radians(lat)))
        ring = tuple((lon + e * east, lat + n * north) for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
        scenario = dataclasses.replace(
            scenario, name=place, description="1 km x 1 km above Davos Dorf, nadir camera, 10 m model",
            area=Area(polygon_lon_lat_deg=ring, cell_size_m=scenario.area.cell_size_m),
            terrain=RasterTerrain(kind="raster", file=str(file.resolve()), vertical_datum="EGM96"),
            home=Home(lat_deg=lat - 0.98 * north, lon_deg=lon + 0.98 * east),
        )  # fmt: skip
    planner = dataclasses.replace(scenario.planner, objective="energy")
    return dataclasses.replace(scenario, planner=planner, select=f"coverage>={ASKED}")


@dataclass(frozen=True, slots=True)
class Tried:
    """Lines that were tried: in which direction, and how good they are on the planner's cells."""

    direction: Direction
    lines: Baseline


def boustrophedon_scan(coverage: CoverageMap) -> list[Tried]:
    """Those of `uavcover plan`."""
    return [Tried((b.layout.angle_rad,), b) for b in boustrophedons(coverage) if b.layout is not None]


def boustrophedons_in(site: Site, direction: Direction) -> list[Route]:
    """More numbers of lines in a direction, at the heights and insets of the scan."""
    limits = site.scenario.limits
    best_m = best_height_agl_m(site)
    heights_m = {best_m, 0.5 * (best_m + 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m))}
    return [
        fly_layout(
            site,
            regular_layout(
                angle_rad=direction[0], lines=lines, height_agl_m=height_m, inset=inset, tolerance_m=PLAIN_TOLERANCE_M
            ),
        )
        for height_m in sorted(heights_m)
        for lines in _numbers(site, direction[0], height_m)
        for inset in (0.0, 0.5)
    ]


def _numbers(site: Site, angle_rad: float, height_m: float) -> list[int]:
    swath_m = 2.0 * reach_at_height_m(site.scenario.sensor, height_m)
    return sorted({max(1, math.ceil(more * width_across_m(site, angle_rad) / swath_m)) for more in _FINER})


def contour_scan(coverage: CoverageMap) -> list[Tried]:
    """Those of `uavcover plan`."""
    layouts = [layout for batch in layouts_to_try(coverage.site) for layout in batch]
    found = evaluated(coverage, "contour-lines", [fly_contours(coverage.site, layout) for layout in layouts], None)
    return [Tried((x.smoothing, x.straightening), b) for x, b in zip(layouts, found, strict=True)]


def contours_in(site: Site, direction: Direction) -> list[Route]:
    """More numbers of lines that follow the contours as closely, at the heights and insets of the scan."""
    alike = [
        layout
        for batch in layouts_to_try(site)
        for layout in batch
        if (layout.smoothing, layout.straightening) == direction and layout.lines == 1.0
    ]
    return [fly_contours(site, dataclasses.replace(layout, lines=more)) for layout in alike for more in _FINER]


def simple_scan(coverage: CoverageMap) -> list[Tried]:
    """Lines that bend and lines of few waypoints, in every direction."""
    site, first = coverage.site, long_side_angle_rad(coverage.site.area)
    angles = [first + k * math.pi / _DIRECTIONS for k in range(_DIRECTIONS)]
    return [
        Tried((angle,), b)
        for angle in angles
        for b in evaluated(coverage, "simple-lines", simple_lines(site, angle), None)
    ]


def simple_in(site: Site, direction: Direction) -> list[Route]:
    """More numbers of lines, bent and straight, that may leave their height as those of the scan."""
    limits, routes = site.scenario.limits, []
    band_m = limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m
    for shares, bent in ((BENT, True), (STRAIGHT, False)):
        for tolerance_m in (share * band_m for share in shares):
            height_m = best_height_agl_m(site, tolerance_m=tolerance_m)
            for lines in _numbers(site, direction[0], height_m):
                layout = regular_layout(
                    angle_rad=direction[0], lines=lines, height_agl_m=height_m, inset=0.5, tolerance_m=tolerance_m
                )
                straight_m = _BEND * tolerance_m
                routes.append(
                    fly_bent(site, layout, bend_lines(site, layout), straight_m=straight_m)
                    if bent
                    else fly_layout(site, layout)
                )
    return routes


Scan = Callable[[CoverageMap], list[Tried]]
LINES: dict[str, tuple[Scan, Callable[[Site, Direction], list[Route]]]] = {
    "boustrophedon": (boustrophedon_scan, boustrophedons_in),
    "contour-lines": (contour_scan, contours_in),
    "simple-lines": (simple_scan, simple_in),
}
OURS = "ours"


def best_lines(site: Site, way: str) -> tuple[RouteMember | None, int]:
    """The lines of least energy that see enough and keep the limits, and how many were tried."""
    coarse, fine = planning_map(site), judging_map(site)
    scan, finer = LINES[way]
    enough = (ASKED - _COARSE) * coarse.share(coarse.coverable)

    def near(tried: Sequence[Tried]) -> list[Tried]:
        seen = [t for t in tried if t.lines.violation <= 0.0 and -float(t.lines.objectives[0]) >= enough]
        return sorted(seen, key=lambda t: float(t.lines.objectives[2]))

    tried = scan(coarse)
    for direction in list(dict.fromkeys(each.direction for each in near(tried)))[:_REFINED]:
        more = evaluated(coarse, way, finer(site, direction), None)
        tried += [Tried(direction, each) for each in more]
    best: RouteMember | None = None
    for each in near(tried)[:_TRIED]:
        # The objective has straight ways home, and the price of waypoints; what is judged has neither.
        if best is not None and float(each.lines.objectives[2]) > 1.05 * _energy_s(best):
            break
        member = judge_member(fine, each.lines.route, way, margin_m=site.scenario.limits.height_margin_m)
        if member.violation > 0.0 or member.metrics.coverage_of_coverable < ASKED:
            continue
        if best is None or _energy_s(member) < _energy_s(best):
            best = member
    return best, len(tried)


def _energy_s(member: RouteMember) -> float:
    return member.metrics.mission_energy_hover_s or math.inf


def measure(site: Site, way: str, seed: int, evaluations: int) -> Row:
    """One row."""
    begin, sorties = time.process_time(), ""
    if way == OURS:
        with tempfile.TemporaryDirectory() as folder:
            plan = uc.plan(site, out=Path(folder) / "run", evaluations=evaluations, seed=seed)
            sorties = str(len(list((Path(folder) / "run").glob("sortie-*"))) or 1)
        member, tried = plan.chosen if plan.rule_met else None, plan.evaluations
    else:
        member, tried = best_lines(site, way)
    cpu_s = time.process_time() - begin
    row = {"way": way, "seed": str(seed) if way == OURS else "", "tried": str(tried), "cpu_s": f"{cpu_s:.1f}"}
    row |= {"evaluations": str(evaluations) if way == OURS else "", "sorties": sorties}
    if member is None:
        return row | {"made_by": "none sees as much"}
    finer, m = finer_map(site), member.metrics
    hold_out = "" if finer is None else repr(finer.share_of_coverable(finer.seen(member.route.waypoints_m)))
    return row | {
        "coverage": repr(m.coverage_of_coverable), "hold_out": hold_out, "energy_hover_s": repr(m.mission_energy_hover_s),
        "mission_s": repr(m.mission_time_s), "length_m": repr(m.path_length_m), "waypoints": str(m.waypoint_count),
        "made_by": member.origin,
    }  # fmt: skip


def _place_lines(place: str, rows: Sequence[Row]) -> Iterator[str]:
    """The table's rows of a place, and behind each of ours how it compares."""
    lines = [float(row["energy_hover_s"]) for row in rows if row["way"] != OURS and row["energy_hover_s"]]
    best = min(lines, default=math.nan)
    for row in rows:
        if not row["energy_hover_s"]:
            yield f"| {place} | {row['way']} | | | | | | | {row['made_by']} |"
            continue
        energy = float(row["energy_hover_s"])
        against = f"{100.0 * (energy / best - 1.0):+.1f} %" if row["way"] == OURS else ""
        seed = f" (seed {row['seed']})" if row["seed"] else ""
        hold_out = f"{100.0 * float(row['hold_out']):.2f} %" if row["hold_out"] else ""
        yield (
            f"| {place} | {row['way']}{seed} | {100.0 * float(row['coverage']):.2f} % | {hold_out} | {energy:.0f} s | "
            f"{against} | {float(row['mission_s']):.0f} s | {row['waypoints']} | {row['made_by']} |"
        )


def verdicts(rows: Sequence[Row]) -> Iterator[str]:
    """Where the aim is reached, and where it is missed."""
    for place in PLACES:
        own = [row for row in rows if row["place"] == place and row["energy_hover_s"]]
        ours = [float(row["energy_hover_s"]) for row in own if row["way"] == OURS]
        lines = {row["way"]: float(row["energy_hover_s"]) for row in own if row["way"] != OURS}
        if not ours or not lines:
            yield f"- {place}: not measured."
            continue
        best = min(lines, key=lambda way: lines[way])
        saved = 1.0 - max(ours) / lines[best]
        word = "reached" if saved >= LESS else "**missed**"
        missing = ", ".join(way for way in LINES if way not in lines)
        yield (
            f"- {place}: {100.0 * saved:.1f} % less than the best lines ({best}), of {100.0 * LESS:.0f} % asked: {word}"
            + (f"; not there: {missing}." if missing else ".")
        )


def page(rows: Sequence[Row]) -> str:
    """The page."""
    table = [line for place in PLACES for line in _place_lines(place, [row for row in rows if row["place"] == place])]
    lines = [
        "# Energy over mountains",
        "",
        f"Command: `.venv/bin/python scripts/bench_mountains.py DEM_FOLDER`, "
        f"{max((row['date'] for row in rows), default='')}, uavcover {metadata.version('uavcover')}, product code of commit "
        f"{', '.join(sorted({row['commit'] for row in rows}))}. What is measured is said at the top of the script.",
        "",
        *verdicts(rows),
        "",
        "| place | way | seen of what can be seen | on finer cells | energy, in hovering | against the best lines | time "
        "| waypoints | made by |",
        "|---|---|---:|---:|---:|---:|---:|---:|---|",
        *table,
        "",
        "The vehicles have the default power model: a quadcopter of about 2 kg, calm air. Evaluations and processor times are in "
        "[mountains.csv](mountains.csv).",
    ]
    return "\n".join(lines) + "\n"


def commit_of() -> str:
    """The commit that is measured."""
    root = Path(__file__).resolve().parents[1]
    found = subprocess.run(
        ["git", "-C", str(root), "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True
    )
    return found.stdout.strip()


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dem_folder", type=existing_folder, nargs="?", metavar="DEM_FOLDER")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/results/mountains.md"))
    parser.add_argument("--only", type=first_and_second(PLACES, [*LINES, OURS]), default="", metavar="PLACE[:WAY]")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--evaluations", type=int, help="of ours, for every place; default: EVALUATIONS")
    chosen = parser.parse_args(arguments)
    file = chosen.out.with_suffix(".csv")
    file.parent.mkdir(parents=True, exist_ok=True)
    rows = read_rows(file)
    done = {(row["place"], row["way"], row["seed"]) for row in rows}
    only_place, only_way = chosen.only
    for place in PLACES:
        if only_place not in ("", place):
            continue
        scenario = scenario_of(place, chosen.dem_folder)
        if scenario is None:
            print(f"{place}: left out, no davosdorf.tif in DEM_FOLDER")
            continue
        site = load_site(scenario)
        ways = [(way, 0) for way in LINES] + [(OURS, seed) for seed in range(1, chosen.seeds + 1)]
        for way, seed in ways:
            key = place, way, str(seed) if way == OURS else ""
            if key in done or only_way not in ("", way):
                continue
            evaluations = chosen.evaluations or EVALUATIONS[place]
            head = {"place": place, "commit": commit_of(), "date": datetime.date.today().isoformat()}
            row = {**dict.fromkeys(COLUMNS, ""), **head, **measure(site, way, seed, evaluations)}
            print(row, flush=True)
            rows.append(row)
            rows.sort(key=lambda r: (PLACES.index(r["place"]), [*LINES, OURS].index(r["way"]), r["seed"]))
            write_rows(file, COLUMNS, rows)
            chosen.out.write_text(page(rows), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
