"""Output of ``uavcover check``: text for people, JSON for programs, a map."""

import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from uavcover.errors import OutputError
from uavcover.extras.check.check import Checked
from uavcover.extras.check.mission_file import CheckOutcome, CheckQuery
from uavcover.model.judgement import VerdictName, worst
from uavcover.run.file_group import write_file
from uavcover.run.user import User


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
    """Duration, distance and heights; None where they are not known."""
    path, world = checked.path, checked.world
    known: dict[str, float | None] = dict.fromkeys(
        ("length_m", "time_s", "min_height_agl_m", "max_height_agl_m", "max_above_home_m", "max_distance_m")
    )
    if path is None or world is None or not path.segments:
        return known
    lines = [segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)] for segment in path.segments]
    points = np.vstack(lines)
    ranges = [world.leg_height_ranges_m(s.enu_m) for s in path.distinct if s.phase in ("route", "return")]
    rows = np.vstack([part for part in ranges if len(part)] or [np.full((1, 4), np.nan)])
    known["length_m"] = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
    known["time_s"] = checked.time_s if math.isfinite(checked.time_s) else None
    if np.isfinite(rows).any():
        known["min_height_agl_m"], known["max_height_agl_m"] = (
            float(np.nanmin(rows[:, 0])),
            float(np.nanmax(rows[:, 2])),
        )
    if len(points):
        known["max_above_home_m"] = float(world.alts_amsl_m(points).max()) - world.home_alt_amsl_m
        known["max_distance_m"] = float(np.hypot(points[:, 0], points[:, 1]).max())
    return known


def say_findings(outcome: CheckOutcome, user: User) -> None:
    """Tell the outcome: one row for each finding and what to do about it below, then the figures."""
    checked = outcome.checked
    if checked.findings:
        user.say(f"{'':8}{'what':15}{'items':10}{'latitude, longitude':26}{'by':>9}")
    for one in checked.findings:
        items = (
            ""
            if one.items is None
            else f"{one.items[0]}"
            if one.items[0] == one.items[1]
            else f"{one.items[0]}-{one.items[1]}"
        )
        place = "" if one.lat_deg is None or one.lon_deg is None else f"{one.lat_deg:.6f}, {one.lon_deg:.6f}"
        by = "" if not one.unit else f"{one.by:.1f} {one.unit}" if one.by < 1000.0 else f"{one.by:.0f} {one.unit}"
        user.say(f"{one.weight:8}{one.kind:15}{items:10}{place:26}{by:>9}".rstrip())
        user.say(f"{'':8}{one.what}")
        user.say(f"{'':8}-> {one.do}")
    figures = figures_of(checked)
    over = ", trees and roofs" if checked.world is not None and checked.world.surface is not None else ""
    words = {
        "length_m": ("path", "m"), "time_s": ("time", "s"), "min_height_agl_m": (f"lowest above ground{over}", "m"),
        "max_height_agl_m": ("highest above ground", "m"), "max_above_home_m": ("highest above home", "m"),
        "max_distance_m": ("farthest from home", "m"),
    }  # fmt: skip
    texts = [f"{name} {figures[key]:.0f} {unit}" for key, (name, unit) in words.items() if figures[key] is not None]
    if texts:
        user.say("; ".join(texts))
    if figures["time_s"] is not None:
        user.say(f"the time assumes {outcome.aircraft.speeds_in_words}; speeds in the mission have priority")
    for line in () if outcome.view is None else outcome.view.lines:
        user.say(line)
    user.say(f"verdict: {checked.verdict}")


def write_map(outcome: CheckOutcome, path: Path, *, force: bool) -> None:
    """Write the path as lines and the findings as points, for any map program.

    Raises:
        OutputError: the file is there already, or cannot be written, or is not named .geojson.
    """
    refuse_map(path, force=force)
    checked = outcome.checked
    features: list[dict[str, Any]] = []
    if checked.path is not None and checked.world is not None:
        for segment in checked.path.distinct:
            known = segment.enu_m[np.isfinite(segment.enu_m).all(axis=1)]
            if len(known) < 2:
                continue
            lat, lon, alt = checked.world.frame.geodetic_from_enu(known)
            line = [
                [round(float(x), 8), round(float(y), 8), round(float(z), 2)]
                for y, x, z in zip(lat, lon, alt, strict=True)
            ]
            features.append(
                _feature(
                    "LineString",
                    line,
                    {"from_item": segment.items[0], "item": segment.items[1], "phase": segment.phase},
                )
            )
    for one in checked.findings:
        if one.lat_deg is not None and one.lon_deg is not None:
            features.append(_feature("Point", [one.lon_deg, one.lat_deg], one.document()))
    if outcome.view is not None and checked.world is not None and not outcome.view.unseen_m.is_empty:
        frame = checked.world.frame

        def lon_lat(places: Any) -> Any:
            lat, lon, _ = frame.geodetic_from_enu(np.column_stack([places, np.zeros(len(places))]))
            return np.column_stack([lon, lat]).round(8)

        shape = shapely.orient_polygons(shapely.transform(outcome.view.unseen_m, lon_lat))
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
        raise OutputError(f"{path}: this file already exists; choose another name, or use --force to replace it")


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}
