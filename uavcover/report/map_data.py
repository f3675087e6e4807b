"""Data for the map and the 3D view of a report, as JSON in local metres, east before north.

Pictures of ground and cells are data URIs; row 0 is the north.
"""

import base64
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from uavcover.judging.gaps import REASONS, reason_codes
from uavcover.judging.verify import Verdict
from uavcover.kernels.arrays import ByteArray, FloatArray
from uavcover.report.content import Flight, ReportContent
from uavcover.report.plots import flight_style
from uavcover.scenario.ground import Ground
from uavcover.scenario.obstacles import Prism
from uavcover.scenario.relief import relief_grid
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

Bounds = tuple[float, float, float, float]
Rgb = tuple[int, int, int]

RELIEF_PIXELS = 900
"""Along the longer side of the relief."""

_JPEG_QUALITY = 82
_RAMP_STEPS = 9

# Distinguishable with any colour vision (palette of Okabe and Ito).
SURE_RGB: Rgb = (0, 114, 96)
SEEN_RGB: Rgb = (0, 158, 115)
POSSIBLE_RGB: Rgb = (240, 228, 66)
UNSEEN_RGB: Rgb = (213, 94, 0)
NOT_COVERABLE_RGB: Rgb = (136, 34, 85)
_REASON_RGB: tuple[Rgb, ...] = (
    (213, 94, 0),
    (240, 228, 66),
    (0, 114, 178),
    NOT_COVERABLE_RGB,
    (86, 180, 233),
    (204, 121, 167),
    (160, 160, 160),
)
REASON_WORDS = {
    "never-in-range": "never in range and field of view",
    "too-oblique": "seen too obliquely only",
    "occluded": "hidden behind ground",
    "out-of-limits": "cannot be seen from inside the limits",
    "too-coarse": "a pixel saw too much ground",
    "too-few-looks": "seen by too few looks",
    "attitude-not-known": "perhaps seen, the camera's direction is not known",
}


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A colour and its meaning; the colour as ``#rrggbb``."""

    color: str
    label: str


@dataclass(frozen=True, slots=True)
class CellLayer:
    """A picture of the cells.

    Attributes:
        key: short name.
        title: for people.
        image: data URI, one pixel a cell, transparent outside the area.
        legend: what the colours mean.
    """

    key: str
    title: str
    image: str
    legend: tuple[LegendEntry, ...]


def relief_image(ground: Ground, bounds_m: Bounds) -> str:
    """A relief of a rectangle (west, south, east, north) as a JPEG data URI."""
    grid = relief_grid(ground, bounds_m, nodes=RELIEF_PIXELS)
    return _data_uri(grid.rgb[::-1], "JPEG", quality=_JPEG_QUALITY)


def cells_bounds_m(coverage: CoverageMap) -> Bounds:
    """West, south, east, north of the lattice of cells, to their outer sides."""
    cells = coverage.grid.cells
    rows, columns = cells.lattice.shape
    half = 0.5 * cells.size_m
    west, south = cells.east0_m - half, cells.north0_m - half
    return west, south, west + columns * cells.size_m, south + rows * cells.size_m


def cell_layers(coverage: CoverageMap, verdict: Verdict) -> list[CellLayer]:
    """The cell layers after a flight; layers without any known value are omitted."""
    flown = verdict.flown
    layers = [_coverage_layer(coverage, verdict), _gap_layer(coverage, verdict)]
    start_s = float(np.nanmin(flown.first_seen_s)) if flown.seen.any() else 0.0
    passes = np.where(flown.passes > 0, flown.passes.astype(float), np.nan)
    for key, title, values, colors, label in (
        ("looks", "Passes that saw it", passes, "viridis", _label("{:.0f}")),
        ("first-seen", "When first seen", (flown.first_seen_s - start_s) / 60.0, "cividis", _label("{:.1f} min")),
        ("sample", "Ground sample distance", 100.0 * flown.ground_sample_m, "plasma_r", _label("{:.1f} cm")),
        ("incidence", "Incidence angle", flown.incidence_deg, "magma_r", _label("{:.0f}°")),
        ("distance", "Shortest distance", flown.nearest_m, "plasma_r", _label("{:.0f} m")),
    ):
        layer = _ramp_layer(coverage, key, title, values, colors, label)
        layers += [] if layer is None else [layer]
    return layers


def _label(template: str) -> Callable[[float], str]:
    return template.format


def _coverage_layer(coverage: CoverageMap, verdict: Verdict) -> CellLayer:
    flown = verdict.flown
    exact = bool((flown.surely_seen == flown.seen).all() and (flown.possibly_seen == flown.seen).all())
    kinds: list[tuple[Rgb, str, NDArray[np.bool_]]] = [
        (UNSEEN_RGB, "not seen", np.ones(coverage.grid.count, dtype=bool)),
        (NOT_COVERABLE_RGB, REASON_WORDS["out-of-limits"], ~coverage.coverable),
    ]
    if exact:
        kinds.append((SEEN_RGB, "seen", flown.seen))
    else:
        kinds.append((POSSIBLE_RGB, "possibly seen, by the stated uncertainty", flown.possibly_seen))
        kinds.append((SEEN_RGB, "seen, but not surely", flown.seen))
        kinds.append((SURE_RGB, "surely seen", flown.surely_seen))
    colors = np.zeros((coverage.grid.count, 4), dtype=np.uint8)
    for rgb, _, where in kinds:
        colors[where] = (*rgb, 150)
    legend = tuple(LegendEntry(_hex(rgb), label) for rgb, label, where in reversed(kinds) if where.any())
    return CellLayer("coverage", "Coverage", _cells_image(coverage, colors), legend)


def _gap_layer(coverage: CoverageMap, verdict: Verdict) -> CellLayer:
    codes = reason_codes(coverage, verdict.flown)
    colors = np.zeros((coverage.grid.count, 4), dtype=np.uint8)
    legend = []
    for number, reason in enumerate(REASONS):
        here = codes == number + 1
        colors[here] = (*_REASON_RGB[number], 220)
        if here.any():
            legend.append(LegendEntry(_hex(_REASON_RGB[number]), REASON_WORDS[reason]))
    return CellLayer("gaps", "Gaps, by reason", _cells_image(coverage, colors), tuple(legend))


def _ramp_layer(
    coverage: CoverageMap, key: str, title: str, values: FloatArray, colors: str, label: Callable[[float], str]
) -> CellLayer | None:
    known = np.isfinite(values)
    if not known.any():
        return None
    low, high = float(values[known].min()), float(values[known].max())
    share = np.zeros(values.size) if high == low else (np.where(known, values, low) - low) / (high - low)
    rgba = np.asarray(colormaps[colors](share, bytes=True), dtype=np.uint8)
    rgba[:, 3] = np.where(known, 190, 0)
    steps = np.linspace(0.0, 1.0, _RAMP_STEPS if high > low else 1)
    ends = {0: label(low), len(steps) - 1: label(high)}
    legend = tuple(
        LegendEntry(_hex(tuple(round(255 * c) for c in colormaps[colors](float(s))[:3])), ends.get(i, ""))
        for i, s in enumerate(steps)
    )
    return CellLayer(key, title, _cells_image(coverage, rgba), legend)


def _cells_image(coverage: CoverageMap, rgba: ByteArray) -> str:
    lattice = coverage.grid.cells.lattice
    picture = np.zeros((*lattice.shape, 4), dtype=np.uint8)
    inside = lattice >= 0
    picture[inside] = rgba[lattice[inside]]
    return _data_uri(picture[::-1], "PNG", optimize=True)


def _data_uri(pixels: ByteArray, kind: str, **options: object) -> str:
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, kind, **options)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(out.getvalue()).decode()}"


def _hex(rgb: tuple[int, ...]) -> str:
    return "#" + "".join(f"{part:02x}" for part in rgb)


SURFACE_NODES = 110
"""Along the longer side of the ground in the 3D view."""

MAX_SAMPLES = 4000
"""Of the flown line; a longer track is drawn through every second, third... sample."""

_PAD_M = 30.0


def map_data(content: ReportContent) -> dict[str, Any]:
    """All drawing data, rounded to visible precision."""
    site = content.site
    bounds = bounds_m(site)
    west, south, east, north = cells_bounds_m(content.coverage)
    verdict = content.verdict
    return {
        "bounds": _rounded(np.array(bounds)),
        "relief": relief_image(site.ground, bounds),
        "geodetic": _geodetic_fit(site, bounds),
        "area": [_rounded(ring) for ring in _rings(site.area)],
        "fence": [_rounded(ring) for ring in _rings(site.fence)],
        "obstacles": [_obstacle(site, prism) for prism in site.prisms],
        "home": None if site.home_m is None else _rounded(site.home_m),
        "plan": _rounded(content.planned.route.waypoints_m),
        "planHeights": _rounded(_heights_agl_m(site, content.planned.route.waypoints_m)),
        "cellBounds": _rounded(np.array([west, south, east, north])),
        "cells": [] if verdict is None else [_layer(layer) for layer in cell_layers(content.coverage, verdict)],
        "tracks": [_track(flight, number) for number, flight in enumerate(content.flights)],
        "gaps": [] if verdict is None else _gaps(verdict),
        "violations": [] if verdict is None else _violations(verdict, content.flights),
        "surface": _surface(site, bounds),
    }


def drawn_every(samples: int) -> int:
    """Every how many samples one is drawn."""
    return max(1, math.ceil(samples / MAX_SAMPLES))


def bounds_m(site: Site) -> Bounds:
    """The displayed bounds: fence and area with a margin."""
    west, south, east, north = shapely.union_all([site.area, site.fence]).bounds
    return west - _PAD_M, south - _PAD_M, east + _PAD_M, north + _PAD_M


def _rings(polygons: shapely.Polygon | shapely.MultiPolygon) -> list[FloatArray]:
    return [
        np.asarray(ring.coords)[:, :2]
        for polygon in shapely.get_parts(polygons)
        for ring in (polygon.exterior, *polygon.interiors)
    ]


def _obstacle(site: Site, prism: Prism) -> dict[str, Any]:
    """Outline and courtyards with the up coordinates of the ground and of the flat top."""
    rings = _rings(prism.footprint.polygon)
    return {
        "name": prism.footprint.name,
        "height": round(prism.footprint.height_m, 1),
        "rings": [_rounded(np.column_stack([ring, site.ground.heights_m(ring)])) for ring in rings],
        "top": _rounded(np.array([prism.top_m]))[0],
    }


def _layer(layer: Any) -> dict[str, Any]:
    return {
        "key": layer.key,
        "title": layer.title,
        "image": layer.image,
        "legend": [{"color": entry.color, "label": entry.label} for entry in layer.legend],
    }


def _track(flight: Flight, number: int) -> dict[str, Any]:
    every = drawn_every(len(flight.track))
    keep = np.unique(np.append(np.arange(0, len(flight.track), every), len(flight.track) - 1))
    return {
        "name": flight.name,
        "style": flight_style(number),
        "points": _rounded(flight.enu_m[keep]),
        "times": _rounded(flight.clock_s[keep]),
        "heights": _rounded(flight.height_agl_m[keep]),
    }


def _gaps(verdict: Verdict) -> list[dict[str, Any]]:
    return [
        {
            "east": gap.east_m,
            "north": gap.north_m,
            "area": round(gap.area_m2),
            "cells": gap.cells,
            "reason": REASON_WORDS[gap.reason],
            "coverable": gap.coverable,
        }
        for gap in verdict.report.gaps
    ]


def _violations(verdict: Verdict, flights: Sequence[Flight]) -> list[dict[str, Any]]:
    starts_s = [float(flight.track.time_s[0]) for flight in flights]
    return [
        {
            "east": v.east_m,
            "north": v.north_m,
            "kind": v.kind,
            "from": round(v.start_s - starts_s[v.track], 1),
            "to": round(v.end_s - starts_s[v.track], 1),
            "worst": f"{v.worst:.1f} {v.unit}",
            "limit": f"{v.limit:g} {v.unit}",
        }
        for v in verdict.report.violations
    ]


def _surface(site: Site, bounds: Bounds) -> dict[str, Any]:
    """Heights at the nodes of a grid, rows from the north, in tenths of a metre; null without elevation."""
    west, south, east, north = bounds
    step = max(east - west, north - south) / (SURFACE_NODES - 1)
    columns = max(2, math.ceil((east - west) / step) + 1)
    rows = max(2, math.ceil((north - south) / step) + 1)
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, columns), np.linspace(north, south, rows))
    up = site.ground.heights_m(np.column_stack([grid_e.ravel(), grid_n.ravel()]))
    return {"columns": columns, "rows": rows, "up": _rounded(up)}


def _geodetic_fit(site: Site, bounds: Bounds) -> dict[str, list[float]] | None:
    """Coefficients of latitude and longitude in 1, e, n, e e, e n, n n (kilometres), to show the pointer's position."""
    if site.frame is None:
        return None
    west, south, east, north = bounds
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, 9), np.linspace(south, north, 9))
    places = np.column_stack([grid_e.ravel(), grid_n.ravel(), np.zeros(grid_e.size)])
    lat, lon, _ = site.frame.geodetic_from_enu(places)
    e, n = places[:, 0] / 1000.0, places[:, 1] / 1000.0
    basis = np.column_stack([np.ones(e.size), e, n, e * e, e * n, n * n])
    return {
        name: np.linalg.lstsq(basis, values, rcond=None)[0].tolist() for name, values in (("lat", lat), ("lon", lon))
    }


def _heights_agl_m(site: Site, points_m: FloatArray) -> FloatArray:
    return site.ground.heights_agl_m(points_m)


def _rounded(values: FloatArray) -> Any:
    """Nested lists of numbers, NaN as null: to a tenth, and in a scenario of a few metres to a ten-thousandth."""
    finite = values[np.isfinite(values)]
    digits = 1 if finite.size and np.abs(finite).max() > 50.0 else 4
    return _listed(np.round(values, digits))


def _listed(values: FloatArray) -> Any:
    if values.ndim > 1:
        return [_listed(row) for row in values]
    return [value if math.isfinite(value) else None for value in values.tolist()]
