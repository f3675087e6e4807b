"""Pictures of ground and cells for the map, as data URIs; row 0 is the north."""

import base64
import io
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.terrain.ground import Ground
from uavcover.terrain.relief_grid import relief_grid
from uavcover.verification.gaps import REASONS, reason_codes
from uavcover.verification.verify import Verdict

FloatArray = NDArray[np.float64]
ByteArray = NDArray[np.uint8]
Bounds = tuple[float, float, float, float]
Rgb = tuple[int, int, int]

RELIEF_PIXELS = 900
"""Along the longer side of the relief."""

_JPEG_QUALITY = 82
_RAMP_STEPS = 9

# Told apart by people with any colour vision (palette of Okabe and Ito).
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
    """Everything that is known of the cells after a flight; a layer without any known value is left out."""
    flown = verdict.flown
    layers = [_coverage_layer(coverage, verdict), _gap_layer(coverage, verdict)]
    start_s = float(np.nanmin(flown.first_seen_s)) if flown.seen.any() else 0.0
    looks = np.where(flown.looks > 0, flown.looks.astype(float), np.nan)
    for key, title, values, colors, label in (
        ("looks", "Passes that saw it", looks, "viridis", _label("{:.0f}")),
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
