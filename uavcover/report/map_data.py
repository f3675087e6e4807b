"""Data for the map and the 3D view of a report, as JSON in local metres, east before north, and images of its cells."""

import base64
import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from uavcover.errors import UavcoverError
from uavcover.kernels.arrays import BoolArray, ByteArray, FloatArray
from uavcover.missions.failsafes import IN_PLACE
from uavcover.missions.mission_compiler import compile_mission
from uavcover.missions.return_advice import flight_states
from uavcover.model.route import Route
from uavcover.model.verdict import Gap
from uavcover.report.content import FIGURES, Flight, ReportContent, bounds_m
from uavcover.report.plots import flight_style
from uavcover.scenario.airspace.flyable import zone_lines_m
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.obstacles import Prism, rings_m
from uavcover.scenario.site import Site, area_as_drawn
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import PhotoCounts, photos_required
from uavcover.terrain.frames import Bounds, LocalFrame
from uavcover.terrain.ground import Ground, relief_grid
from uavcover.verification.flown_coverage import FlownCoverage
from uavcover.verification.gaps import REASONS, reason_codes
from uavcover.verification.verify import Verdict


def map_data(content: ReportContent) -> dict[str, Any]:
    """All drawing data, rounded to visible precision."""
    site = content.site
    bounds = bounds_m(site)
    verdict = content.verdict
    return {
        "bounds": rounded(np.array(bounds)),
        "relief": relief_image(site.ground, bounds),
        "geodetic": geodetic_fit(site.frame, bounds),
        "area": [rounded(ring) for ring in rings_m(site.area)],
        "drawn": [rounded(ring) for ring in rings_m(area_as_drawn(site))] if site.scenario.area.margin_m > 0.0 else [],
        "fence": [rounded(ring) for ring in rings_m(site.fence)],
        "obstacles": [_obstacle(site, prism) for prism in site.prisms],
        "noFly": [
            zone_data(zone) | {"lines": [rounded(line) for line in zone_lines_m(site, zone, bounds)]}
            for zone in site.zones
        ],
        "home": None if site.home_m is None else rounded(site.home_m),
        "plan": rounded(content.planned.route.waypoints_m),
        "planHeights": rounded(site.ground.heights_agl_m(content.planned.route.waypoints_m)),
        "sorties": [
            {"name": f"sortie {number + 1}", "style": flight_style(number), "points": rounded(route_m)}
            for number, route_m in enumerate(content.sorties_m)
        ],
        "cellBounds": rounded(np.array(cells_bounds_m(content.coverage))),
        "cells": [asdict(layer) for layer in cell_layers(content)],
        "pictures": _photos(content),
        "tracks": [_track(flight, number) for number, flight in enumerate(content.flights)],
        "gaps": [] if verdict is None else gap_data(verdict.report.gaps),
        "violations": [] if verdict is None else _violations(verdict, content.flights),
        "unsafeReturns": _unsafe_returns(site, content.sorties_m or (content.planned.route.waypoints_m,)),
        "surface": _surface(site, bounds),
    }


def drawn_every(samples: int) -> int:
    """Every how many samples one is drawn."""
    return max(1, math.ceil(samples / FIGURES.max_samples))


def relief_image(ground: Ground, bounds_m: Bounds) -> str:
    """A relief of a rectangle (west, south, east, north) as a JPEG data URI."""
    grid = relief_grid(ground, bounds_m, nodes=FIGURES.relief_pixels)
    return data_uri(grid.rgb[::-1], "JPEG", quality=FIGURES.jpeg_quality)


def _obstacle(site: Site, prism: Prism) -> dict[str, Any]:
    """Outline and courtyards with the up coordinates of the ground and of the flat top."""
    rings = rings_m(prism.footprint.polygon)
    return {
        "name": prism.footprint.name,
        "height": round(prism.footprint.height_m, 1),
        "rings": [rounded(np.column_stack([ring, site.ground.heights_m(ring)])) for ring in rings],
        "top": rounded(np.array([prism.top_m]))[0],
    }


def zone_data(zone: Zone) -> dict[str, Any]:
    """A no-fly zone for the map."""
    return {
        "name": zone.name,
        "heights": zone.heights_text(),
        "rings": [rounded(r) for r in rings_m(zone.outline)],
    }


def _track(flight: Flight, number: int) -> dict[str, Any]:
    every = drawn_every(len(flight.track))
    keep = np.unique(np.append(np.arange(0, len(flight.track), every), len(flight.track) - 1))
    return {
        "name": flight.name,
        "style": flight_style(number),
        "points": rounded(flight.enu_m[keep]),
        "times": rounded(flight.clock_s[keep]),
        "heights": rounded(flight.height_agl_m[keep]),
    }


def _photos(content: ReportContent) -> dict[str, Any]:
    """Positions of single photos, planned and flown; empty for a sensor without photos."""
    planned, verdict = content.planned_view, content.verdict
    flown = None if verdict is None or verdict.photos is None else verdict.observations
    return {
        "planned": [] if planned.photos is None else rounded(planned.poses.eyes),
        "flown": [] if flown is None else rounded(flown.positions_m[flown.known]),
        "unknown": 0 if flown is None else int((~flown.known).sum()),
    }


def gap_data(gaps: Iterable[Gap]) -> list[dict[str, Any]]:
    """Gaps as the script takes them."""
    return [
        {
            "east": gap.east_m,
            "north": gap.north_m,
            "area": round(gap.area_m2),
            "cells": gap.cells,
            "reason": REASON_TEXTS[gap.reason],
            "coverable": gap.coverable,
        }
        for gap in gaps
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


def _unsafe_returns(site: Site, routes_m: Sequence[FloatArray]) -> list[dict[str, Any]]:
    """Parts of the flights from where the autopilot's own return is not safe; empty where there is no mission."""
    found = []
    for route_m in routes_m:
        try:
            compiled = compile_mission(site, Route(route_m), autopilot=site.scenario.vehicle.autopilot)
        except UavcoverError:
            continue  # the report says elsewhere that there is no mission
        advice = compiled.return_advice
        states = flight_states(site, compiled.path_m, begin_s=compiled.own_returns.begin_s)
        away = [one for one in advice.unsafe if one.destination != IN_PLACE]
        for one, words in zip(away, advice.sentences, strict=True):
            inside = (states.times_s >= one.begin_s) & (states.times_s <= one.end_s)
            points = states.positions_m[inside, :2]
            drawn = rounded(points[:: drawn_every(len(points))])
            east, north = round(one.position_m[0], 1), round(one.position_m[1], 1)
            found.append({"points": drawn, "east": east, "north": north, "words": words})
    return found


def _surface(site: Site, bounds: Bounds) -> dict[str, Any]:
    """Heights at the nodes of a grid, rows from the north, in tenths of a metre; null without elevation."""
    west, south, east, north = bounds
    step = max(east - west, north - south) / (FIGURES.surface_nodes - 1)
    columns = max(2, math.ceil((east - west) / step) + 1)
    rows = max(2, math.ceil((north - south) / step) + 1)
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, columns), np.linspace(north, south, rows))
    up = site.ground.heights_m(np.column_stack([grid_e.ravel(), grid_n.ravel()]))
    return {"columns": columns, "rows": rows, "up": rounded(up)}


def geodetic_fit(frame: LocalFrame | None, bounds: Bounds) -> dict[str, list[float]] | None:
    """Coefficients of latitude and longitude in 1, e, n, e e, e n, n n (kilometres), for the pointer's position."""
    if frame is None:
        return None
    west, south, east, north = bounds
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, 9), np.linspace(south, north, 9))
    positions = np.column_stack([grid_e.ravel(), grid_n.ravel(), np.zeros(grid_e.size)])
    lat, lon, _ = frame.geodetic_from_enu(positions)
    e, n = positions[:, 0] / 1000.0, positions[:, 1] / 1000.0
    basis = np.column_stack([np.ones(e.size), e, n, e * e, e * n, n * n])
    return {
        name: np.linalg.lstsq(basis, values, rcond=None)[0].tolist() for name, values in (("lat", lat), ("lon", lon))
    }


def rounded(values: FloatArray) -> Any:
    """Nested lists of numbers, NaN as null: to a tenth, and in a scenario of a few metres to a ten-thousandth."""
    finite = values[np.isfinite(values)]
    digits = 1 if finite.size and np.abs(finite).max() > 50.0 else 4
    return _listed(np.round(values, digits))


def _listed(values: FloatArray) -> Any:
    if values.ndim > 1:
        return [_listed(row) for row in values]
    return [value if math.isfinite(value) else None for value in values.tolist()]


Rgb = tuple[int, int, int]

# Images of the cells: one pixel a cell; row 0 is the north.
# Distinguishable with any colour vision (palette of Okabe and Ito).
SURE_RGB: Rgb = (0, 114, 96)
OBSERVED_RGB: Rgb = (0, 158, 115)
POSSIBLE_RGB: Rgb = (240, 228, 66)
UNOBSERVED_RGB: Rgb = (213, 94, 0)
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
REASON_TEXTS = {
    "never-in-range": "never in range and field of view",
    "too-oblique": "observed only at too flat an angle",
    "occluded": "hidden by terrain or obstacles",
    "out-of-limits": "not visible from any position within the limits",
    "too-coarse": "ground sample distance too large",
    "too-few-looks": "too few observations",
    "attitude-not-known": "possibly observed, but the camera direction is unknown",
}


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A colour and its meaning; the colour as ``#rrggbb``."""

    color: str
    label: str


@dataclass(frozen=True, slots=True)
class CellLayer:
    """A picture of the cells."""

    key: str  # short name
    title: str  # shown to the user
    image: str  # data URI, one pixel a cell, transparent outside the area
    legend: tuple[LegendEntry, ...]  # what the colours mean


def cells_bounds_m(coverage: CoverageMap) -> Bounds:
    """West, south, east, north of the lattice of cells, to their outer sides."""
    cells = coverage.grid.cells
    rows, columns = cells.lattice.shape
    half = 0.5 * cells.size_m
    west, south = cells.east0_m - half, cells.north0_m - half
    return west, south, west + columns * cells.size_m, south + rows * cells.size_m


def cell_layers(content: ReportContent) -> list[CellLayer]:
    """The cell layers of a run, those of the flight before those of the plan. Layers without known values are omitted."""
    coverage, verdict, planned = content.coverage, content.verdict, content.planned_view
    required = photos_required(coverage.site.scenario.sensor)
    layers: list[CellLayer | None] = []
    if verdict is None:
        there = planned.observed
        classes = [(UNOBSERVED_RGB, "not observed", ~there), (OBSERVED_RGB, "observed, as planned", there)]
        layers.append(_classes_layer(coverage, "planned-coverage", "Coverage, planned", classes))
    else:
        layers += [coverage_layer(coverage, verdict.flown), gap_layer(coverage, verdict.flown)]
        layers += photo_count_layers(coverage, verdict.photos, "flown", required)
    layers += photo_count_layers(coverage, planned.photos, "planned", required)
    if verdict is not None:
        layers += _flown_layers(coverage, verdict)
    return [layer for layer in layers if layer is not None]


def _flown_layers(coverage: CoverageMap, verdict: Verdict) -> list[CellLayer | None]:
    flown = verdict.flown
    start_s = float(np.nanmin(flown.first_observed_s)) if flown.observed.any() else 0.0
    passes = np.where(flown.passes > 0, flown.passes.astype(float), np.nan)
    # Of single pictures there are layers of their own.
    sample_m = np.full(flown.observed.size, np.nan) if verdict.photos is not None else flown.ground_sample_m
    first_min = (flown.first_observed_s - start_s) / 60.0
    return [
        ramp_layer(coverage, key, title, values, colors, label)
        for key, title, values, colors, label in (
            ("looks", "Number of observations", passes, "viridis", label("{:.0f}")),
            ("first-seen", "First observation", first_min, "cividis", label("{:.1f} min")),
            ("sample", "Ground sample distance", 100.0 * sample_m, "plasma_r", label("{:.1f} cm")),
            ("incidence", "Incidence angle", flown.incidence_deg, "magma_r", label("{:.0f}°")),
            ("distance", "Minimum distance", flown.nearest_m, "plasma_r", label("{:.0f} m")),
        )
    ]


def photo_count_layers(
    coverage: CoverageMap, counts: PhotoCounts | None, which: str, required: int | None
) -> list[CellLayer | None]:
    """Photos per point compared with the required overlap, and the best ground sample distance."""
    if counts is None:
        return []
    photos = counts.photos
    title = f"Photos per point, {which}"
    if required is None:
        shown = np.where(photos > 0, photos.astype(float), np.nan)
        per_point = ramp_layer(coverage, f"pictures-{which}", title, shown, "viridis", label("{:.0f}"))
    else:
        per_point = _classes_layer(
            coverage, f"pictures-{which}", f"{title} (overlap)",
            [
                (rgb, f"{low}" if low == high else f"{low} or more" if high is None else f"{low} to {high}",
                 (photos >= low) & (photos <= (np.iinfo(np.int32).max if high is None else high)))
                for rgb, low, high in _photo_classes(required)
            ],
        )  # fmt: skip
    sample = ramp_layer(
        coverage, f"sample-{which}", f"Ground sample distance, {which}", 100.0 * counts.ground_sample_m, "plasma_r",
        label("{:.1f} cm"),
    )  # fmt: skip
    return [per_point, sample]


def _photo_classes(required: int) -> list[tuple[Rgb, int, int | None]]:
    """Colour, fewest and most photos of each class: warm below the required number, green from there on."""
    half = required // 2
    classes: list[tuple[Rgb, int, int | None]] = [
        (NOT_COVERABLE_RGB, 0, 0),
        (UNOBSERVED_RGB, 1, half),
        (POSSIBLE_RGB, max(half + 1, 1), required - 1),
        (OBSERVED_RGB, required, 2 * required - 1),
        (SURE_RGB, 2 * required, None),
    ]
    return [(rgb, low, high) for rgb, low, high in classes if high is None or low <= high]


def _classes_layer(coverage: CoverageMap, key: str, title: str, classes: list[tuple[Rgb, str, BoolArray]]) -> CellLayer:
    """Cells in the colour of their class; of a cell in several, the last."""
    legend = tuple(LegendEntry(_hex(rgb), label) for rgb, label, where in reversed(classes) if where.any())
    return CellLayer(key, title, classes_image(coverage, [(rgb, where) for rgb, _, where in classes]), legend)


def classes_image(coverage: CoverageMap, classes: Sequence[tuple[Rgb, BoolArray]]) -> str:
    """An image of the cells in the colour of their class; of a cell in several, the last."""
    colors = np.zeros((coverage.grid.count, 4), dtype=np.uint8)
    for rgb, where in classes:
        colors[where] = (*rgb, 150)
    return _cells_image(coverage, colors)


def label(template: str) -> Callable[[float], str]:
    """Writes values by a template of ``str.format``."""
    return template.format


def coverage_layer(coverage: CoverageMap, flown: FlownCoverage) -> CellLayer:
    """Cells that were surely, possibly or not observed."""
    exact = bool((flown.certain_cells == flown.observed).all() and (flown.possible_cells == flown.observed).all())
    kinds: list[tuple[Rgb, str, NDArray[np.bool_]]] = [
        (UNOBSERVED_RGB, "not observed", np.ones(coverage.grid.count, dtype=bool)),
        (NOT_COVERABLE_RGB, REASON_TEXTS["out-of-limits"], ~coverage.coverable),
    ]
    if exact:
        kinds.append((OBSERVED_RGB, "observed", flown.observed))
    else:
        kinds.append((POSSIBLE_RGB, "possibly observed", flown.possible_cells))
        kinds.append((OBSERVED_RGB, "probably observed", flown.observed))
        kinds.append((SURE_RGB, "certainly observed", flown.certain_cells))
    return _classes_layer(coverage, "coverage", "Coverage", kinds)


def gap_layer(coverage: CoverageMap, flown: FlownCoverage) -> CellLayer:
    """Reasons why cells were not observed."""
    codes = reason_codes(coverage, flown)
    colors = np.zeros((coverage.grid.count, 4), dtype=np.uint8)
    legend = []
    for number, reason in enumerate(REASONS):
        here = codes == number + 1
        colors[here] = (*_REASON_RGB[number], 220)
        if here.any():
            legend.append(LegendEntry(_hex(_REASON_RGB[number]), REASON_TEXTS[reason]))
    return CellLayer("gaps", "Gaps, by reason", _cells_image(coverage, colors), tuple(legend))


def ramp_layer(
    coverage: CoverageMap, key: str, title: str, values: FloatArray, colors: str, label: Callable[[float], str]
) -> CellLayer | None:
    """Values on a ramp of colours; None where no cell has one."""
    known = np.isfinite(values)
    if not known.any():
        return None
    low, high = float(values[known].min()), float(values[known].max())
    fraction = np.zeros(values.size) if high == low else (np.where(known, values, low) - low) / (high - low)
    rgba = np.asarray(colormaps[colors](fraction, bytes=True), dtype=np.uint8)
    rgba[:, 3] = np.where(known, 190, 0)
    steps = np.linspace(0.0, 1.0, FIGURES.ramp_steps if high > low else 1)
    ends = {0: label(low), len(steps) - 1: label(high)}
    legend = tuple(
        LegendEntry(_hex(tuple(round(255 * c) for c in colormaps[colors](float(s))[:3])), ends.get(i, ""))
        for i, s in enumerate(steps)
    )
    return CellLayer(key, title, _cells_image(coverage, rgba), legend)


def _cells_image(coverage: CoverageMap, rgba: ByteArray) -> str:
    lattice = coverage.grid.cells.lattice
    photo = np.zeros((*lattice.shape, 4), dtype=np.uint8)
    inside = lattice >= 0
    photo[inside] = rgba[lattice[inside]]
    return data_uri(photo[::-1], "PNG", optimize=True)


def data_uri(pixels: ByteArray, kind: str, **options: object) -> str:
    """Pixels as a data URI: (h, w, 3 or 4) bytes, in a format that Pillow writes."""
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, kind, **options)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(out.getvalue()).decode()}"


def _hex(rgb: tuple[int, ...]) -> str:
    return "#" + "".join(f"{part:02x}" for part in rgb)
