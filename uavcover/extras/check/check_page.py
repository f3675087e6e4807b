"""Map of a checked mission as one HTML file: path with broken legs, fence, zones, profile and clearance of each leg."""

from pathlib import Path
from typing import Any

import numpy as np
import shapely

from uavcover.errors import InputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.check_report import figures_of
from uavcover.extras.check.findings import CheckFinding
from uavcover.extras.check.limits import Limits, LocalFence
from uavcover.extras.check.mission_file import CheckOutcome, CheckQuery
from uavcover.extras.check.segments import Segment
from uavcover.extras.check.tuning import PAGE
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray
from uavcover.report.charts import Chart, Plot
from uavcover.report.map_data import geodetic_fit, relief_image, rings_of, rounded, zone_data
from uavcover.report.page import rendered_page
from uavcover.run.file_group import write_file

_SCRIPT = Path(__file__).parent / "check.js"


def write_check_page(query: CheckQuery, outcome: CheckOutcome, path: Path) -> None:
    """Write the page; it opens without a network.

    Raises:
        InputError: the mission has no path that could be drawn.
        OutputError: the file cannot be written.
    """
    write_file(path, render_check_page(query, outcome).encode())


def render_check_page(query: CheckQuery, outcome: CheckOutcome) -> str:
    """The page as text.

    Raises:
        InputError: the mission has no path that could be drawn.
    """
    checked = outcome.checked
    if checked.path is None or checked.world is None or not checked.path.segments:
        raise InputError(
            f"--map: {query.file}: the mission has no path to draw; use a .geojson map, or repair the findings first"
        )
    legs = _legs(checked, checked.world)
    figures = {key: value for key, value in figures_of(checked).items() if value is not None}
    values = {
        "name": query.file.name,
        "verdict": checked.verdict,
        "findings": checked.findings,
        "figures": figures,
        "view_lines": () if outcome.view is None else outcome.view.lines,
        "legs": legs,
        "charts": [_profile(checked.world, checked.path.segments, checked.findings, query.limits)],
    }
    script = _SCRIPT.read_text(encoding="utf-8")
    data = _data(checked, checked.world, outcome, legs)
    return rendered_page(Path(__file__).parent / "check.html", own_script=script, data=data, facts=values)


def _broken_items(findings: tuple[CheckFinding, ...]) -> list[tuple[int, int]]:
    return [one.items for one in findings if one.weight == "breaks" and one.items is not None]


def _is_broken(segment: Segment, broken: list[tuple[int, int]]) -> bool:
    """Whether a finding names a segment's items. A finding of items 2 to 4 is about the legs 2-3 and 3-4."""
    begin, end = min(segment.items), max(segment.items)
    return any(low <= begin and end <= high for low, high in broken)


def _legs(checked: Checked, world: World) -> list[dict[str, Any]]:
    broken = _broken_items(checked.findings)
    legs = []
    for segment in () if checked.path is None else checked.path.distinct[: PAGE.most_legs]:
        line = segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)]
        if len(line) < 2:
            continue
        reached, places = _sampled(line)
        above = world.clearances_m(places)
        alts = world.alts_amsl_m(places)
        ranges = world.leg_height_ranges_m(line)[:, 0]
        legs.append({
            "from": segment.items[0], "to": segment.items[1], "phase": segment.phase,
            "broken": _is_broken(segment, broken), "length": round(float(reached[-1]), 1),
            "clearance": round(float(np.nanmin(ranges)), 1) if np.isfinite(ranges).any() else None,
            "points": rounded(line[:, :2]), "at": rounded(reached), "path": rounded(alts), "ground": rounded(alts - above),
        })  # fmt: skip
    return legs


def _sampled(line: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Distances along a line, and places there, for its profile."""
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.linspace(0.0, reached[-1], PAGE.profile_steps)
    return at, np.column_stack([np.interp(at, reached, line[:, axis]) for axis in range(3)])


def _profile(world: World, segments: tuple[Segment, ...], findings: tuple[CheckFinding, ...], limits: Limits) -> Chart:
    """Ground, the least height above it, and the path, broken legs apart, along the way."""
    broken = _broken_items(findings)
    begin, parts = 0.0, []
    for segment in segments[: PAGE.most_legs]:
        line = segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)]
        if len(line) < 2:
            continue
        at, places = _sampled(line)
        alts = world.alts_amsl_m(places)
        parts.append((begin + at, alts, alts - world.clearances_m(places), _is_broken(segment, broken)))
        begin += float(at[-1])
    along = np.concatenate([part[0] for part in parts]) / 1000.0
    ground, flown = np.concatenate([part[2] for part in parts]), np.concatenate([part[1] for part in parts])
    low, high = (
        float(np.nanmin([np.nanmin(flown), np.nanmin(ground)])),
        float(np.nanmax([flown.max(), np.nanmax(ground)])),
    )
    floor = low - 0.06 * (high - low + 1.0)
    plot = Plot((0.0, max(float(along[-1]), 1e-3)), (floor, high + 0.04 * (high - low + 1.0)))
    plot.between("band", along, ground, ground + limits.min_height_agl_m, name="below the least height")
    plot.between("ground", along, np.full(along.size, floor), ground, name="ground")
    plot.line("planned", along, flown, name="path")
    named = False
    for at, alts, _, is_broken in parts:
        if is_broken:
            plot.line("limit", at / 1000.0, alts, name="" if named else "broken")
            named = True
    return plot.finished("profile", "Along the path", x_label="distance, km", y_label="height above sea level, m")


def _data(checked: Checked, world: World, outcome: CheckOutcome, legs: list[dict[str, Any]]) -> dict[str, Any]:
    around = checked.around
    fence = [] if around is None else _fence(around.fence)
    points = np.vstack([np.zeros((1, 2)), *(np.array(leg["points"], float) for leg in legs)])
    shapes = [shapely.MultiPoint(points), *(shapely.LinearRing(ring["points"]) for ring in fence)]
    west, south, east, north = shapely.union_all(shapes).bounds
    bounds = (west - PAGE.pad_m, south - PAGE.pad_m, east + PAGE.pad_m, north + PAGE.pad_m)
    unseen = None if outcome.view is None else outcome.view.unseen_m
    return {
        "bounds": rounded(np.array(bounds)),
        "relief": relief_image(world.ground, bounds),
        "geodetic": geodetic_fit(world.frame, bounds),
        "legs": legs,
        "fence": fence,
        "noFly": [] if around is None else [zone_data(zone) for zone in around.zones],
        "obstacles": [] if around is None else [
            {"name": prism.footprint.name, "rings": [rounded(ring) for ring in rings_of(prism.footprint.polygon)]}
            for prism in around.prisms
        ],
        "unseen": [] if unseen is None or unseen.is_empty else [rounded(ring) for ring in rings_of(unseen)],
        "pictures": [] if outcome.view is None else rounded(outcome.view.pictures.places_m[:, :2]),
        "findings": [_finding(number, one, world) for number, one in enumerate(checked.findings, 1)],
    }  # fmt: skip


def _finding(number: int, one: CheckFinding, world: World) -> dict[str, Any]:
    place = None
    if one.lat_deg is not None and one.lon_deg is not None:
        place = rounded(np.array(world.place(one.lat_deg, one.lon_deg)))
    return {"number": number, "weight": one.weight, "kind": one.kind, "what": one.what, "do": one.do, "place": place}


def _fence(fence: LocalFence) -> list[dict[str, Any]]:
    angles = np.linspace(0.0, 2.0 * np.pi, PAGE.circle_corners, endpoint=False)
    rings = [(ring, True) for polygon in fence.inside for ring in rings_of(polygon)]
    rings += [(ring, False) for polygon in fence.outside for ring in rings_of(polygon)]
    rings += [
        (np.column_stack([east + radius * np.sin(angles), north + radius * np.cos(angles)]), stays)
        for east, north, radius, stays in fence.circles
    ]
    return [{"points": rounded(np.vstack([ring, ring[:1]])), "inside": stays} for ring, stays in rings]
