"""What the seams between the parts of a large area cost.

Usage: .venv/bin/python scripts/bench_part_seams.py [-o docs/results/part_seams.md] [--only 1000km2-30m:8]

The same area is planned in one part and in more, by the planner of parts, with equal seed and equal evaluations; so one part is
searched in as many rounds as the others, without seams. `25km2-10m` is ridge-25km2's square of the bundled heights (its camera,
limits, vehicle and home; what is made small is the time of the mission), `1000km2-30m` the generated square of
scripts/bench_cluster.py (no home: length). 98 % of what can be seen is asked for. Beside the cost of the route there is how
much of it is flown within a swath's width of a seam, for each square kilometre there, and how much of the ground there is
missed; and the same elsewhere. In one part these are of the places where the seams of the division into the most parts are: of
a route that knows of no seams.
"""

import argparse
import datetime
import tempfile
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import shapely

if __name__ == "__main__":
    import sys

    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.bench_cluster import generated
from scripts.bench_planner import window
from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import file_to_write, one_of
from uavcover.planning.parts.division import divide
from uavcover.planning.parts.planner import flight_work, plan_by_parts, search_parts_with
from uavcover.planning.search.optimizer_search import Effort, SearchRun
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import judging_map

CASES: dict[str, tuple[int, tuple[int, ...]]] = {
    "25km2-10m": (10_000, (1, 2, 4, 9)),
    "1000km2-30m": (50_000, (1, 2, 4, 8)),
}
"""Evaluations, and numbers of parts."""
ASKED = 0.98
COLUMNS = (
    "area", "parts", "evaluations", "coverage", "cost", "unit", "length_m", "waypoints", "near_share", "flown_near", "flown_else",
    "missed_near", "missed_else", "cpu_s", "date",
)  # fmt: skip


def site_of(area: str, folder: Path) -> Site:
    """Its site."""
    if area == "25km2-10m":
        return load_site(window(5000.0, 10.0))
    file = folder / "scenario.toml"
    file.write_text(generated(31_620.0, folder), encoding="utf-8")
    return load_site(file)


def near_seams(site: Site, parts: int) -> shapely.Geometry:
    """All ground within a swath's width of a seam."""
    work = flight_work(site)
    borders = shapely.union_all([piece.boundary for piece in divide(site.area, parts, work)])
    inner = borders.difference(site.area.boundary.buffer(1.0))
    return inner.buffer(work.swath_m).intersection(site.area)


def measured(area: str, parts: int) -> Row:
    """A plan and what is near its seams."""
    evaluations, numbers = CASES[area]
    with tempfile.TemporaryDirectory() as folder:
        site = site_of(area, Path(folder))
    begin_s = time.process_time()
    plan = plan_by_parts(
        site,
        parts=parts,
        settings=site.scenario.planner,
        select_rule=f"coverage>={ASKED}",
        run=SearchRun(
            effort=Effort(evaluations, None, time.monotonic),
            started=time.monotonic(),
            executor=None,
            should_stop=lambda: False,
            on_progress=lambda _: None,
        ),
        run_tasks=search_parts_with(None, now=time.monotonic, should_stop=lambda: False),
    )
    cpu_s = time.process_time() - begin_s
    # The shortest that was joined and sees enough; the rule may choose lines.
    joined = [member for member in plan.members if member.origin == "parts"]
    enough = [each for each in joined if each.metrics.coverage_of_coverable >= ASKED] or joined
    found = min(enough, key=lambda each: each.metrics.cost)
    route_m, fine = found.route.waypoints_m, judging_map(site)
    near = near_seams(site, parts if parts > 1 else max(numbers))
    line = shapely.LineString(route_m[:, :2])
    flown_m = line.intersection(near).length
    is_near = np.asarray(shapely.contains_xy(near, *fine.grid.middles_m.T))
    missed, weight = ~fine.seen(route_m), np.where(fine.coverable, fine.grid.weight_m2, 0.0)

    def share(among: np.ndarray) -> float:
        return float(weight[missed & among].sum() / weight[among].sum())

    values = {
        "evaluations": evaluations, "coverage": found.metrics.coverage_of_coverable, "cost": found.metrics.cost,
        "unit": "s" if site.home_m is not None else "m", "length_m": found.metrics.path_length_m,
        "waypoints": found.metrics.waypoint_count, "near_share": near.area / site.area.area,
        "flown_near": flown_m / near.area * 1e3, "flown_else": (line.length - flown_m) / (site.area.area - near.area) * 1e3,
        "missed_near": share(is_near), "missed_else": share(~is_near), "cpu_s": cpu_s,
    }  # fmt: skip
    return {key: str(value) for key, value in values.items()}


def page(rows: list[Row]) -> str:
    """The table."""
    lines = [
        "# Seams between parts of a large area",
        "",
        f"Command: `.venv/bin/python scripts/bench_part_seams.py`, {max(row['date'] for row in rows)}, uavcover "
        f"{metadata.version('uavcover')}. What is measured is said at the top of the script. One seed each.",
        "",
        "| area | parts | evaluations | coverage | cost | against one part | waypoints | ground near seams "
        "| route near them, elsewhere | missed near them, elsewhere | processor time |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]  # fmt: skip
    alone = {row["area"]: float(row["cost"]) for row in rows if row["parts"] == "1"}

    def pair(row: Row, name: str, factor: float, digits: int, unit: str) -> str:
        return ", ".join(f"{factor * float(row[f'{name}_{where}']):.{digits}f}{unit}" for where in ("near", "else"))

    for row in rows:
        cost = float(row["cost"])
        shown = f"{cost:.0f} s" if row["unit"] == "s" else f"{cost / 1000.0:.1f} km"
        against = (
            "" if row["parts"] == "1" or row["area"] not in alone else f"{100 * (cost / alone[row['area']] - 1):+.1f} %"
        )
        lines.append(
            f"| {row['area']} | {row['parts']} | {row['evaluations']} | {100 * float(row['coverage']):.2f} % | {shown} "
            f"| {against} | {row['waypoints']} | {100 * float(row['near_share']):.0f} % "
            f"| {pair(row, 'flown', 1.0, 3, ' km/km²')} "
            f"| {pair(row, 'missed', 100.0, 1, ' %')} | {float(row['cpu_s']):.0f} s |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure what is missing."""
    names = [*CASES, *(f"{area}:{parts}" for area, (_, numbers) in CASES.items() for parts in numbers)]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/part_seams.md"))
    parser.add_argument("--only", type=one_of(names), help="AREA or AREA:PARTS")
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = read_rows(table)
    done = {(row["area"], row["parts"]) for row in rows}
    for area, (_, numbers) in CASES.items():
        for parts in numbers:
            if (area, str(parts)) in done or arguments.only not in (None, area, f"{area}:{parts}"):
                continue
            head = {"area": area, "parts": str(parts), "date": datetime.date.today().isoformat()}
            rows.append({**head, **measured(area, parts)})
            rows.sort(key=lambda row: (list(CASES).index(row["area"]), int(row["parts"])))
            write_rows(table, COLUMNS, rows)
            arguments.out.write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
