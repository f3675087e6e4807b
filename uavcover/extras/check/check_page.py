"""Map of a checked mission as one HTML file: path with broken legs, fence, zones, profile and clearance of each leg."""

import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from uavcover.errors import InputError, OutputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.findings import CheckFinding, Segment, along_m, positions_at
from uavcover.extras.check.mission_file import CheckOutcome, CheckQuery
from uavcover.extras.check.tuning import PAGE
from uavcover.extras.check.world import Limits, LocalFence, World
from uavcover.kernels.arrays import FloatArray
from uavcover.model.verdict import VerdictName, worst
from uavcover.report.charts import Chart, Plot
from uavcover.report.map_data import geodetic_fit, relief_image, rounded, zone_data
from uavcover.report.page import rendered_page
from uavcover.run.file_group import write_file
from uavcover.run.user import User
from uavcover.scenario.obstacles import rings_m

# Output of ``uavcover check``: text as text, JSON for programs, a map.


def document_of(query: CheckQuery, outcome: CheckOutcome) -> dict[str, Any]:
    """The outcome for programs."""
    checked = outcome.checked
    return {
        "schema_version": 1,
        "file": str(query.file),
        "sha256": hashlib.sha256(query.file.read_bytes()).hexdigest(),
        "verdict": checked.verdict,
        "findings": [one.document() for one in checked.findings],
        "figures": figures_of(checked),
        "view": None if outcome.view is None else outcome.view.document,
    }


def worst_verdict(outcomes: Sequence[CheckOutcome]) -> VerdictName:
    """The verdict of several missions: "passed" when all are."""
    return worst(each.verdict for each in outcomes)


def figures_of(checked: Checked) -> dict[str, float | None]:
    """Duration, distance and heights; None if unknown."""
    path, world = checked.path, checked.world
    known: dict[str, float | None] = dict.fromkeys(
        ("length_m", "time_s", "min_height_agl_m", "max_height_agl_m", "max_above_home_m", "max_distance_m")
    )
    if path is None or world is None or not path.segments:
        return known
    lines = [segment.known_m for segment in path.segments]
    points = np.vstack(lines)
    ranges = [world.leg_height_ranges_m(s.enu_m) for s in path.distinct if s.phase in ("route", "return")]
    rows = np.vstack([part for part in ranges if len(part)] or [np.full((1, 4), np.nan)])
    known["length_m"] = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
    known["time_s"] = checked.time_s if math.isfinite(checked.time_s) else None
    if np.isfinite(rows).any():
        known["min_height_agl_m"] = float(np.nanmin(rows[:, 0]))
        known["max_height_agl_m"] = float(np.nanmax(rows[:, 2]))
    if len(points):
        known["max_above_home_m"] = float(world.alts_amsl_m(points).max()) - world.home_alt_amsl_m
        known["max_distance_m"] = float(np.hypot(points[:, 0], points[:, 1]).max())
    return known


def print_findings(outcome: CheckOutcome, user: User) -> None:
    """Print the outcome: one row for each finding with its remedy below, then the figures."""
    checked = outcome.checked
    if checked.findings:
        user.say(f"{'':8}{'what':15}{'items':10}{'latitude, longitude':26}{'by':>9}")
    for one in checked.findings:
        items = "-".join(dict.fromkeys(map(str, one.items or ())))
        position = "" if one.lat_deg is None or one.lon_deg is None else f"{one.lat_deg:.6f}, {one.lon_deg:.6f}"
        by = "" if not one.unit else f"{one.by:.1f} {one.unit}" if one.by < 1000.0 else f"{one.by:.0f} {one.unit}"
        user.say(f"{one.weight:8}{one.kind:15}{items:10}{position:26}{by:>9}".rstrip())
        user.say(f"{'':8}{one.what}")
        user.say(f"{'':8}-> {one.do}")
    figures = figures_of(checked)
    over = ", trees and roofs" if checked.world is not None and checked.world.surface is not None else ""
    words = {
        "length_m": ("path", "m"), "time_s": ("time", "s"), "min_height_agl_m": (f"lowest height above ground{over}", "m"),
        "max_height_agl_m": ("greatest height above ground", "m"), "max_above_home_m": ("greatest height above home", "m"),
        "max_distance_m": ("greatest distance from home", "m"),
    }  # fmt: skip
    texts = [f"{name} {figures[key]:.0f} {unit}" for key, (name, unit) in words.items() if figures[key] is not None]
    if texts:
        user.say("; ".join(texts))
    if figures["time_s"] is not None:
        user.say(f"the flight time assumes {outcome.aircraft.speeds_text}; speeds in the mission take precedence")
    for line in () if outcome.view is None else outcome.view.lines:
        user.say(line)
    user.say(f"verdict: {checked.verdict}")


def write_map(outcome: CheckOutcome, path: Path, *, force: bool) -> None:
    """Write the path as lines and the findings as points, for any map program.

    Raises:
        OutputError: the file already exists, or cannot be written, or is not named .geojson.
    """
    refuse_map(path, force=force)
    checked = outcome.checked
    features: list[dict[str, Any]] = []
    if checked.path is not None and checked.world is not None:
        for segment in checked.path.distinct:
            if len(segment.known_m) < 2:
                continue
            positions = zip(*checked.world.frame.geodetic_from_enu(segment.known_m), strict=True)
            line = [[round(float(lon), 8), round(float(lat), 8), round(float(alt), 2)] for lat, lon, alt in positions]
            first, last = segment.items
            features.append(_feature("LineString", line, {"from_item": first, "item": last, "phase": segment.phase}))
    for one in checked.findings:
        if one.lat_deg is not None and one.lon_deg is not None:
            features.append(_feature("Point", [one.lon_deg, one.lat_deg], one.document()))
    if outcome.view is not None and checked.world is not None and not outcome.view.unobserved_m.is_empty:
        frame = checked.world.frame
        unobserved = shapely.transform(outcome.view.unobserved_m, lambda en_m: frame.lon_lat_from_en(en_m).round(8))
        shape = shapely.orient_polygons(unobserved)
        features.append(
            {"type": "Feature", "geometry": shapely.geometry.mapping(shape), "properties": {"kind": "unseen"}}
        )
    text = json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False)
    write_file(path, (text + "\n").encode())


def refuse_map(path: Path, *, force: bool) -> None:
    """Refuse a map that cannot be written, before anything is judged."""
    if path.suffix.lower() not in (".geojson", ".json", ".html"):
        raise OutputError(f"--map: {path}: the name must end in .geojson, or .html for a page")
    if path.exists() and not force:
        raise OutputError(f"{path} already exists; use --force to overwrite it, or choose another name")


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


_SCRIPT = Path(__file__).parent / "check.js"


def write_check_page(query: CheckQuery, outcome: CheckOutcome, path: Path) -> None:
    """Write the page; it opens without a network.

    Raises:
        InputError: the mission has no path that could be drawn.
        OutputError: the file cannot be written.
    """
    write_file(path, render_check_page(query, outcome).encode())


def render_check_page(query: CheckQuery, outcome: CheckOutcome) -> str:
    """The page as text. Raises InputError: the mission has no path that could be drawn."""
    checked = outcome.checked
    if checked.path is None or checked.world is None or not checked.path.segments:
        raise InputError(f"--map: {query.file}: the mission has no path to draw; use a .geojson map")
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
        line = segment.known_m
        if len(line) < 2:
            continue
        reached, positions = _sampled(line)
        above = world.clearances_m(positions)
        alts = world.alts_amsl_m(positions)
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
    at = np.linspace(0.0, along_m(line)[-1], PAGE.profile_steps)
    return at, positions_at(at, line)


def _profile(world: World, segments: tuple[Segment, ...], findings: tuple[CheckFinding, ...], limits: Limits) -> Chart:
    """Ground, the least height above it, and the path, broken legs apart, along the way."""
    broken = _broken_items(findings)
    begin, parts = 0.0, []
    for segment in segments[: PAGE.most_legs]:
        line = segment.known_m
        if len(line) < 2:
            continue
        at, positions = _sampled(line)
        alts = world.alts_amsl_m(positions)
        parts.append((begin + at, alts, alts - world.clearances_m(positions), _is_broken(segment, broken)))
        begin += float(at[-1])
    along = np.concatenate([part[0] for part in parts]) / 1000.0
    ground, flown = np.concatenate([part[2] for part in parts]), np.concatenate([part[1] for part in parts])
    low = float(np.nanmin([np.nanmin(flown), np.nanmin(ground)]))
    high = float(np.nanmax([flown.max(), np.nanmax(ground)]))
    floor = low - 0.06 * (high - low + 1.0)
    plot = Plot((0.0, max(float(along[-1]), 1e-3)), (floor, high + 0.04 * (high - low + 1.0)))
    plot.between("band", along, ground, ground + limits.min_height_agl_m, name="below the minimum height")
    plot.between("ground", along, np.full(along.size, floor), ground, name="ground")
    plot.line("planned", along, flown, name="path")
    named = False
    for at, alts, _, is_broken in parts:
        if is_broken:
            plot.line("limit", at / 1000.0, alts, name="" if named else "broken")
            named = True
    return plot.finished("profile", "Height profile", x_label="distance, km", y_label="height above sea level, m")


def _data(checked: Checked, world: World, outcome: CheckOutcome, legs: list[dict[str, Any]]) -> dict[str, Any]:
    around = checked.around
    fence = [] if around is None else _fence(around.fence)
    points = np.vstack([np.zeros((1, 2)), *(np.array(leg["points"], float) for leg in legs)])
    shapes = [shapely.MultiPoint(points), *(shapely.LinearRing(ring["points"]) for ring in fence)]
    west, south, east, north = shapely.union_all(shapes).bounds
    bounds = (west - PAGE.pad_m, south - PAGE.pad_m, east + PAGE.pad_m, north + PAGE.pad_m)
    unobserved = None if outcome.view is None else outcome.view.unobserved_m
    return {
        "bounds": rounded(np.array(bounds)),
        "relief": relief_image(world.ground, bounds),
        "geodetic": geodetic_fit(world.frame, bounds),
        "legs": legs,
        "fence": fence,
        "noFly": [] if around is None else [zone_data(zone) for zone in around.zones],
        "obstacles": [] if around is None else [
            {"name": prism.footprint.name, "rings": [rounded(ring) for ring in rings_m(prism.footprint.polygon)]}
            for prism in around.prisms
        ],
        "unseen": [] if unobserved is None or unobserved.is_empty else [rounded(ring) for ring in rings_m(unobserved)],
        "pictures": [] if outcome.view is None else rounded(outcome.view.photos.positions_m[:, :2]),
        "findings": [_finding(number, one, world) for number, one in enumerate(checked.findings, 1)],
    }  # fmt: skip


def _finding(number: int, one: CheckFinding, world: World) -> dict[str, Any]:
    position = None
    if one.lat_deg is not None and one.lon_deg is not None:
        position = rounded(np.array(world.position(one.lat_deg, one.lon_deg)))
    return {"number": number, "weight": one.weight, "kind": one.kind, "what": one.what, "do": one.do, "place": position}


def _fence(fence: LocalFence) -> list[dict[str, Any]]:
    angles = np.linspace(0.0, 2.0 * np.pi, PAGE.circle_corners, endpoint=False)
    rings = [(ring, True) for polygon in fence.inside for ring in rings_m(polygon)]
    rings += [(ring, False) for polygon in fence.outside for ring in rings_m(polygon)]
    rings += [
        (np.column_stack([east + radius * np.sin(angles), north + radius * np.cos(angles)]), stays)
        for east, north, radius, stays in fence.circles
    ]
    return [{"points": rounded(np.vstack([ring, ring[:1]])), "inside": stays} for ring, stays in rings]
