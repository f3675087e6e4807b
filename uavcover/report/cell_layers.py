"""Images of the cells for a report's map and 3D view: coverage, gaps, photos per point, sample distance, ...

Each is a data URI with one pixel a cell; row 0 is the north.
"""

import base64
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray
from PIL import Image

from uavcover.kernels.arrays import BoolArray, ByteArray, FloatArray
from uavcover.report.content import FIGURES, ReportContent
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.pictures import PictureCounts, pictures_asked
from uavcover.verification.flown_coverage import FlownCoverage
from uavcover.verification.gaps import REASONS, reason_codes
from uavcover.verification.verify import Verdict

Bounds = tuple[float, float, float, float]
Rgb = tuple[int, int, int]


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
    title: str  # for people
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
    asked = pictures_asked(coverage.site.scenario.sensor)
    layers: list[CellLayer | None] = []
    if verdict is None:
        classes = [(UNSEEN_RGB, "not observed", ~planned.seen), (SEEN_RGB, "observed, as planned", planned.seen)]
        layers.append(_classes_layer(coverage, "planned-coverage", "Coverage, planned", classes))
    else:
        layers += [coverage_layer(coverage, verdict.flown), gap_layer(coverage, verdict.flown)]
        layers += picture_layers(coverage, verdict.pictures, "flown", asked)
    layers += picture_layers(coverage, planned.pictures, "planned", asked)
    if verdict is not None:
        layers += _flown_layers(coverage, verdict)
    return [layer for layer in layers if layer is not None]


def _flown_layers(coverage: CoverageMap, verdict: Verdict) -> list[CellLayer | None]:
    flown = verdict.flown
    start_s = float(np.nanmin(flown.first_seen_s)) if flown.seen.any() else 0.0
    passes = np.where(flown.passes > 0, flown.passes.astype(float), np.nan)
    # Of single pictures there are layers of their own.
    sample_m = np.full(flown.seen.size, np.nan) if verdict.pictures is not None else flown.ground_sample_m
    return [
        ramp_layer(coverage, key, title, values, colors, label)
        for key, title, values, colors, label in (
            ("looks", "Number of observations", passes, "viridis", label("{:.0f}")),
            ("first-seen", "First observation", (flown.first_seen_s - start_s) / 60.0, "cividis", label("{:.1f} min")),
            ("sample", "Ground sample distance", 100.0 * sample_m, "plasma_r", label("{:.1f} cm")),
            ("incidence", "Incidence angle", flown.incidence_deg, "magma_r", label("{:.0f}°")),
            ("distance", "Minimum distance", flown.nearest_m, "plasma_r", label("{:.0f} m")),
        )
    ]


def picture_layers(
    coverage: CoverageMap, counts: PictureCounts | None, which: str, asked: int | None
) -> list[CellLayer | None]:
    """Pictures per point against the overlap asked for, and the best ground sample distance."""
    if counts is None:
        return []
    pictures = counts.pictures
    title = f"Photos per point, {which}"
    if asked is None:
        shown = np.where(pictures > 0, pictures.astype(float), np.nan)
        per_point = ramp_layer(coverage, f"pictures-{which}", title, shown, "viridis", label("{:.0f}"))
    else:
        per_point = _classes_layer(
            coverage, f"pictures-{which}", f"{title} (overlap)",
            [
                (rgb, f"{low}" if low == high else f"{low} or more" if high is None else f"{low} to {high}",
                 (pictures >= low) & (pictures <= (np.iinfo(np.int32).max if high is None else high)))
                for rgb, low, high in _picture_classes(asked)
            ],
        )  # fmt: skip
    sample = ramp_layer(
        coverage, f"sample-{which}", f"Ground sample distance, {which}", 100.0 * counts.ground_sample_m, "plasma_r",
        label("{:.1f} cm"),
    )  # fmt: skip
    return [per_point, sample]


def _picture_classes(asked: int) -> list[tuple[Rgb, int, int | None]]:
    """Colour, fewest and most photos of each class: warm below the required number, green from there on."""
    half = asked // 2
    classes: list[tuple[Rgb, int, int | None]] = [
        (NOT_COVERABLE_RGB, 0, 0),
        (UNSEEN_RGB, 1, half),
        (POSSIBLE_RGB, max(half + 1, 1), asked - 1),
        (SEEN_RGB, asked, 2 * asked - 1),
        (SURE_RGB, 2 * asked, None),
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
    exact = bool((flown.surely_seen == flown.seen).all() and (flown.possibly_seen == flown.seen).all())
    kinds: list[tuple[Rgb, str, NDArray[np.bool_]]] = [
        (UNSEEN_RGB, "not observed", np.ones(coverage.grid.count, dtype=bool)),
        (NOT_COVERABLE_RGB, REASON_WORDS["out-of-limits"], ~coverage.coverable),
    ]
    if exact:
        kinds.append((SEEN_RGB, "observed", flown.seen))
    else:
        kinds.append((POSSIBLE_RGB, "possibly observed", flown.possibly_seen))
        kinds.append((SEEN_RGB, "probably observed", flown.seen))
        kinds.append((SURE_RGB, "certainly observed", flown.surely_seen))
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
            legend.append(LegendEntry(_hex(_REASON_RGB[number]), REASON_WORDS[reason]))
    return CellLayer("gaps", "Gaps, by reason", _cells_image(coverage, colors), tuple(legend))


def ramp_layer(
    coverage: CoverageMap, key: str, title: str, values: FloatArray, colors: str, label: Callable[[float], str]
) -> CellLayer | None:
    """Values on a ramp of colours; none where no cell has one."""
    known = np.isfinite(values)
    if not known.any():
        return None
    low, high = float(values[known].min()), float(values[known].max())
    share = np.zeros(values.size) if high == low else (np.where(known, values, low) - low) / (high - low)
    rgba = np.asarray(colormaps[colors](share, bytes=True), dtype=np.uint8)
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
    picture = np.zeros((*lattice.shape, 4), dtype=np.uint8)
    inside = lattice >= 0
    picture[inside] = rgba[lattice[inside]]
    return data_uri(picture[::-1], "PNG", optimize=True)


def data_uri(pixels: ByteArray, kind: str, **options: object) -> str:
    """Pixels as a data URI: (h, w, 3 or 4) bytes, in a format that Pillow writes."""
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, kind, **options)
    return f"data:image/{kind.lower()};base64,{base64.b64encode(out.getvalue()).decode()}"


def _hex(rgb: tuple[int, ...]) -> str:
    return "#" + "".join(f"{part:02x}" for part in rgb)
