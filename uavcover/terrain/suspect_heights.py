"""Suspicious heights (filled voids, spikes, steps between tiles), and the question about them.

An elevation model marks missing data with a no-data value. If a program replaces the mark by a number, or never sets it, the
number looks like ground, and a hill inside it is invisible. Such positions have a rim that no ground has.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray
from rasterio.windows import Window
from shapely.geometry.base import BaseGeometry

from mission_io.data_tables import data_table
from uavcover.errors import InputError
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray, highest_around
from uavcover.terrain.elevation_file import open_raster
from uavcover.terrain.frames import Bounds, LocalFrame, lons_beside
from uavcover.terrain.ground import touching
from uavcover.terrain.terrain_source import TerrainSource


@dataclass(frozen=True, slots=True, kw_only=True)
class _Suspects:
    tip_pixels: int
    least_squares: int
    rim_pixels: int
    slope_pixels: int
    rim_times: float
    rim_m: float
    rim_fraction: float
    roof_m: float
    spike_times: float
    spike_m: float
    alone_times: float
    alone_pixels: int
    alone_slope: float
    step_pixels: int
    step_m: float
    step_errors: float
    step_times: float
    step_fraction: float
    strip_pixels: int
    around_pixels: int
    most_suspects: int


SUSPECTS = data_table(_Suspects, "uavcover/data/terrain.toml", "suspects")


Kind = Literal["block", "spike", "step"]
Size = tuple[float, float]
"""Height and width of a pixel in metres."""
LonLat = Callable[[FloatArray], FloatArray]
"""Longitudes and latitudes (n, 2) by columns and rows (n, 2)."""

_AROUND = np.ones((3, 3), dtype=int)


@dataclass(frozen=True, slots=True, eq=False)
class SuspectPixels:
    """Pixels with suspicious heights."""

    kind: Kind  # kind of the suspicion
    first: tuple[int, int]  # row and column of the first one of ``mask``
    # (rows, columns) which pixels, in their bounding box; the ones that a warp may have blended included
    mask: BoolArray
    value_m: float  # the one height of a block, the height of a spike, or the step of a seam
    rim_m: float  # typical height of the ground around; not for a seam

    @property
    def positions(self) -> tuple[slice, slice]:
        """The rows and the columns of ``mask``."""
        (row, column), (rows, columns) = self.first, self.mask.shape
        return slice(row, row + rows), slice(column, column + columns)

    def words(self, pixel_m: Size) -> str:
        """Description of the suspect pixels as text."""
        tall_m, wide_m = self.mask.shape[0] * pixel_m[0], self.mask.shape[1] * pixel_m[1]
        size = f"{wide_m:.0f} x {tall_m:.0f} m"
        if self.kind == "block":
            return (
                f"a block ({size}) of exactly {self.value_m:g} m whose rim is at {self.rim_m:.0f} m, like a filled void"
            )
        if self.kind == "spike":
            return f"a spike of {self.value_m:.0f} m in ground of {self.rim_m:.0f} m"
        return f"a straight step of {self.value_m:.1f} m over {max(tall_m, wide_m):.0f} m, as between mismatched tiles"


def suspect_pixels(heights_m: FloatArray, pixel_m: Size) -> list[SuspectPixels]:
    """Find the pixels of a raster with suspicious heights.

    Args:
        heights_m: (rows, columns) heights as in the file, NaN without data. A correction that varies with the position, such as
            the geoid's, would hide that a block has one value.
        pixel_m: height and width of a pixel.
    """
    if min(heights_m.shape) < 2 * (SUSPECTS.rim_pixels + 1):
        return []
    blocks = _blocks(heights_m)
    left = heights_m
    if blocks:
        left = heights_m.copy()
        for block in blocks:
            left[block.positions][block.mask] = math.nan
    return [*blocks, *_spikes(left, pixel_m), *_steps(left)]


def _blocks(heights: FloatArray) -> list[SuspectPixels]:
    level_right, level_down = heights[:, 1:] == heights[:, :-1], heights[1:] == heights[:-1]
    square = level_right[1:] & level_right[:-1] & level_down[:, 1:] & level_down[:, :-1]
    if not square.any():
        return []
    # Squares that touch share a pixel: they have one value.
    labels, count = touching(square)
    pixels = np.zeros(heights.shape, dtype=labels.dtype)
    for rows in (slice(0, -1), slice(1, None)):
        for columns in (slice(0, -1), slice(1, None)):
            np.maximum(pixels[rows, columns], labels, out=pixels[rows, columns])
    squares = np.bincount(labels.ravel(), minlength=count + 1)
    whole, below, above, rims = _rims(heights, pixels.astype(np.int64), count)
    with np.errstate(invalid="ignore", divide="ignore"):
        steep = np.maximum(below, above) >= SUSPECTS.rim_fraction * whole
        chosen = (whole >= 4) & steep & (squares >= SUSPECTS.least_squares)
    if not chosen[1:].any():
        return []
    from scipy import ndimage  # a third of a second to load

    found = []
    taken = np.zeros(heights.shape, dtype=bool)
    positions = ndimage.find_objects(pixels)
    for number in np.flatnonzero(chosen[1:]) + 1:
        core = pixels[positions[number - 1]] == number
        if taken[positions[number - 1]][core].any():
            continue
        # With what is narrower than two pixels and joined to it, such as the tip of a wedge.
        value = float(heights[positions[number - 1]][core][0])
        rows, columns = (
            _grown(part, size, SUSPECTS.tip_pixels)
            for part, size in zip(positions[number - 1], heights.shape, strict=True)
        )
        alike, _ = ndimage.label(heights[rows, columns] == value, structure=_AROUND)
        block = alike == alike[pixels[rows, columns] == number][0]
        taken[rows, columns] |= block
        mask = ndimage.binary_dilation(block, _AROUND, SUSPECTS.rim_pixels)
        (box,) = ndimage.find_objects(mask.astype(np.int8))
        first = (rows.start + box[0].start, columns.start + box[1].start)
        found.append(SuspectPixels("block", first, mask[box], value, float(rims[number])))
    return found


def _grown(part: slice, size: int, by: int) -> slice:
    return slice(max(0, part.start - by), min(size, part.stop + by))


def _rims(heights: FloatArray, pixels: IntArray, count: int) -> tuple[FloatArray, IntArray, IntArray, FloatArray]:
    """Of every block by its number: rim positions, those steeply above and below the block, and their mean height.

    Places count where the ground beyond is known. In each of the four directions a rim is a pixel of the block, the ground
    ``SUSPECTS.rim_pixels`` farther, and the mean slope beyond.
    """
    rises, slopes, numbers, grounds = [], [], [], []
    reach = SUSPECTS.rim_pixels + SUSPECTS.slope_pixels
    for turned in range(4):
        h, n = np.rot90(heights, turned), np.rot90(pixels, turned)
        edge = (n[:, :-reach] > 0) & (n[:, 1 : 1 - reach] != n[:, :-reach])
        row, column = np.nonzero(edge)
        number = n[row, column]
        ground = h[row, column + SUSPECTS.rim_pixels]
        rise = ground - h[row, column]
        slope = np.mean(
            [np.abs(h[row, column + k + 1] - h[row, column + k]) for k in range(SUSPECTS.rim_pixels, reach)], axis=0
        )
        beyond = np.all([n[row, column + k] != number for k in range(1, reach + 1)], axis=0)
        good = np.isfinite(rise) & np.isfinite(slope) & beyond
        rises.append(rise[good])
        slopes.append(slope[good])
        numbers.append(number[good])
        grounds.append(ground[good])
    number, rise, slope, ground = (np.concatenate(parts) for parts in (numbers, rises, slopes, grounds))
    whole = np.bincount(number, minlength=count + 1).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        usual = np.bincount(number, slope, count + 1) / whole
        mean = np.bincount(number, ground, count + 1) / whole
    usually = SUSPECTS.rim_times * SUSPECTS.rim_pixels * np.maximum(slope, usual[number])
    below = np.bincount(number[rise > usually + SUSPECTS.rim_m], minlength=count + 1)
    return whole, below, np.bincount(number[-rise > usually + SUSPECTS.roof_m], minlength=count + 1), mean


def _spikes(heights: FloatArray, pixel_m: Size) -> list[SuspectPixels]:
    """Single pixels and clumps of up to 3 x 3 that lie above or below all of the ring around."""
    high = np.where(np.isnan(heights), -np.inf, heights)
    low = np.where(np.isnan(heights), np.inf, heights)
    top, bottom = _ring(high, np.maximum), _ring(low, np.minimum)
    with np.errstate(invalid="ignore"):
        beyond = SUSPECTS.spike_times * (top - bottom) + max(SUSPECTS.spike_m, *pixel_m)
        spike = np.isfinite(beyond) & ((heights - top > beyond) | (bottom - heights > beyond))
    spike |= _rough_alone(heights, pixel_m)
    if not spike.any():
        return []
    from scipy import ndimage

    labels, _ = ndimage.label(spike, structure=_AROUND)
    found = []
    for number, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        grown = tuple(
            _grown(part, size, SUSPECTS.rim_pixels) for part, size in zip((rows, columns), heights.shape, strict=True)
        )
        mask = ndimage.binary_dilation(labels[grown] == number, _AROUND)
        own = labels[rows, columns] == number
        inside = heights[rows, columns][own]
        rim = 0.5 * float(top[rows, columns][own][0] + bottom[rows, columns][own][0])
        value = float(inside[np.argmax(np.abs(inside - rim))])
        found.append(SuspectPixels("spike", (grown[0].start, grown[1].start), mask, value, rim))
    return found


def _rough_alone(heights: FloatArray, pixel_m: Size) -> BoolArray:
    """Single pixels that differ from their eight neighbours' mean far more than any pixel within ten of them."""
    wide, (rows, columns) = np.pad(heights, 1, mode="edge"), heights.shape
    around = [wide[i : i + rows, j : j + columns] for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    off_m = np.abs(heights - 0.125 * sum(around))
    off_m[np.isnan(off_m)] = 0.0
    rough = off_m > max(SUSPECTS.spike_m, SUSPECTS.alone_slope * max(pixel_m))
    if not rough.any():
        return rough
    # The square around each pixel without the 3 x 3 in its middle, as four rectangles.
    far, rows, columns = SUSPECTS.alone_pixels, *off_m.shape
    padded, others, half = np.pad(off_m, far), np.zeros_like(off_m), (far + 2) // 2
    for size, (row, column) in (
        ((far - 1, 2 * far + 1), (-half, 0)), ((far - 1, 2 * far + 1), (half, 0)),
        ((3, far - 1), (0, -half)), ((3, far - 1), (0, half)),
    ):  # fmt: skip
        found = highest_around(padded, *size)
        first, left = far + row, far + column
        np.maximum(others, found[first : first + rows, left : left + columns], out=others)
    return rough & (off_m > SUSPECTS.alone_times * others)


def _ring(values: FloatArray, extreme: np.ufunc) -> FloatArray:
    """The extreme of the 16 pixels two away from each; at the raster's edge of the existing ones."""
    empty = -math.inf if extreme is np.maximum else math.inf
    padded = np.pad(values, 2, constant_values=empty)
    out = np.full(values.shape, empty)
    for row in range(5):
        for column in range(5):
            if max(abs(row - 2), abs(column - 2)) == 2:
                extreme(out, padded[row : row + values.shape[0], column : column + values.shape[1]], out=out)
    return out


def _steps(heights: FloatArray) -> list[SuspectPixels]:
    return [
        SuspectPixels(
            "step",
            (column, row) if turned else (row, column),
            np.ones((2, count) if turned else (count, 2), dtype=bool),
            abs(step),
            0.0,
        )
        for turned, grid in ((False, heights), (True, heights.T))
        for row, column, count, step in _seams(grid)
    ]


def _seams(heights: FloatArray) -> list[tuple[int, int, int, float]]:
    """Straight steps between two columns: first row, column left of it, number of rows, step."""
    if heights.shape[0] < SUSPECTS.step_pixels or heights.shape[1] < 4:
        return []
    rises = np.diff(heights, axis=1)
    own = rises[:, 1:-1] - 0.5 * (rises[:, :-2] + rises[:, 2:])
    size, half = SUSPECTS.step_pixels, SUSPECTS.step_pixels // 2
    firsts = range(0, len(own) - size + 1, half)
    steps = np.zeros((len(firsts), own.shape[1]))
    errors = np.ones_like(steps)
    for row, first in enumerate(firsts):
        part = own[first : first + size]
        enough = np.flatnonzero(np.isfinite(part).sum(axis=0) >= 0.75 * size)
        if not len(enough):
            continue
        part = part[:, enough]
        median = np.nanmedian(part, axis=0)
        alike = np.nanmean(np.sign(part) == np.sign(median), axis=0) >= SUSPECTS.step_fraction
        # Next to a step, half of it appears as a bend.
        padded = np.concatenate([[0.0], np.abs(median), [0.0]])
        peak = padded[1:-1] > SUSPECTS.step_times * np.maximum(padded[:-2], padded[2:])
        steps[row, enough] = np.where(alike & peak & (np.abs(median) > SUSPECTS.step_m), median, 0.0)
        spread = 1.4826 * np.nanmedian(np.abs(part - median), axis=0)
        errors[row, enough] = np.maximum(1.2533 * spread / math.sqrt(size), 1e-6)
    found = []
    certain = np.abs(steps) > SUSPECTS.step_errors * errors
    for column in np.flatnonzero(certain.any(axis=0)).tolist():
        # Where a seam is certain somewhere, it goes on as far as there is a step.
        goes_on = np.flatnonzero(np.diff(np.concatenate([[0.0], np.sign(steps[:, column]), [0.0]])))
        for begin, end in pairwise(goes_on.tolist()):
            if certain[begin:end, column].any():
                last = firsts[end - 1] + size
                found.append((firsts[begin], column + 1, last - firsts[begin], float(steps[begin:end, column].mean())))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class SuspectPosition:
    """A part of elevation data with suspicious heights."""

    words: str  # description and position
    shape: BaseGeometry  # in longitude and latitude, degrees, continuous across 180

    def in_frame(self, frame: LocalFrame) -> BaseGeometry:
        """The shape on the map of a local frame, (east, north) metres."""
        return shapely.transform(self.shape, frame.en_from_lon_lat)


def suspect_positions(
    source: Path | TerrainSource, vertical_datum: str, around_deg: Bounds, near: BaseGeometry | None = None
) -> tuple[SuspectPosition, ...]:
    """The places of elevation data that do not look like ground.

    Args:
        source: the elevation data.
        vertical_datum: of its heights.
        around_deg: west, south, east, north of what matters; the data is looked at somewhat beyond.
        near: in longitude and latitude: places that it does not touch are omitted; None: those outside ``around_deg``.

    Raises:
        TerrainError: the data cannot be used.
    """
    region = shapely.box(*around_deg) if near is None else near
    found = []
    windows = _pixels_around(source, vertical_datum, around_deg, margin=SUSPECTS.around_pixels)
    for heights_m, pixel_m, lon_lat_deg in windows:
        for one in suspect_pixels(heights_m, pixel_m):
            shape = _outline(one, lon_lat_deg)
            if region.intersects(shape):
                lon, lat = shape.representative_point().coords[0]
                at = f"at latitude {lat:.5f}, longitude {math.remainder(lon, 360.0):.5f}"
                found.append(SuspectPosition(f"{one.words(pixel_m)}, {at}", shape))
    return tuple(found)


def _pixels_around(
    path: Path | TerrainSource, vertical_datum: str, around_deg: Bounds, *, margin: int
) -> Iterator[tuple[FloatArray, Size, LonLat]]:
    """The pixels around west, south, east, north in degrees, in strips where they are many, with ``margin`` pixels around.

    Yields: (rows, columns) heights as the file has them, in metres above its own datum, NaN without data; the size of a pixel;
        and its longitudes, continuous, and latitudes (n, 2) by columns and rows (n, 2), integers at pixel centres.
    """
    west, south, east, north = around_deg
    rim = np.linspace(0.0, 1.0, 9)
    lon, lat = (axis.ravel() for axis in np.meshgrid(west + rim * (east - west), south + rim * (north - south)))
    with open_raster(path, vertical_datum) as raster:
        pixels = raster.pixels_at(lat, lon)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        size = np.array([raster.dataset.width, raster.dataset.height])
        if not len(pixels):
            return
        first = np.clip(np.floor(pixels.min(axis=0)) - margin, 0, size).astype(int)
        last = np.clip(np.ceil(pixels.max(axis=0)) + margin + 1, 0, size).astype(int)
        columns, rows = (last - first).tolist()
        if min(columns, rows) < 2:
            return
        middle = 0.5 * (first + last)
        at = np.column_stack(raster.positions_of(middle + np.array([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)])))
        frame = LocalFrame(float(at[0, 0]), math.remainder(float(at[0, 1]), 360.0), 0.0)
        sides = np.linalg.norm(np.diff(frame.enu_from_geodetic(at[:, 0], at[:, 1], 0.0)[[1, 0, 2]], axis=0), axis=1)
        as_stored = replace(raster, undulation=None)
        water_m = raster.path.water_height_m
        if water_m is not None and raster.undulation is not None:
            water_m += float(raster.undulation.heights_m(at[:1, 0], at[:1, 1])[0])
        step = max(4 * margin, SUSPECTS.strip_pixels // columns)
        for row in range(0, rows, step):
            top, bottom = max(0, row - margin), min(rows, row + step + margin)
            corner = first + np.array([0, top])

            def lon_lat_deg(pixels: FloatArray, corner: NDArray[np.int64] = corner) -> FloatArray:
                lats, lons = raster.positions_of(pixels + corner)
                return np.column_stack([lons_beside(lons, west), lats])

            heights = as_stored.read(Window(corner[0], corner[1], columns, bottom - top))
            if water_m is not None:
                heights = np.where(np.isnan(heights), water_m, heights)
            yield heights, (float(sides[0]), float(sides[1])), lon_lat_deg


def _outline(found: SuspectPixels, lon_lat_deg: LonLat) -> BaseGeometry:
    padded = np.zeros((found.mask.shape[0], found.mask.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = found.mask
    turns = np.diff(padded, axis=1)
    (rows, begins), (_, ends) = np.nonzero(turns == 1), np.nonzero(turns == -1)
    row, column = found.first
    boxes = shapely.box(column + begins - 0.5, row + rows - 0.5, column + ends - 0.5, row + rows + 0.5)
    return shapely.transform(shapely.union_all(boxes), lon_lat_deg)


class Respondent(Protocol):
    """Receiver of warnings and questions, as :class:`uavcover.run.user.User`."""

    def warn(self, line: str) -> None:
        """Show a warning."""

    def agrees(self, question: str) -> bool:
        """Ask a question that is answered by yes or no."""


def confirmed_trust(
    source: TerrainSource,  # the elevation data of the ground
    datum: str,  # of its heights
    region: shapely.Polygon | shapely.MultiPolygon,  # where flights may go, (east, north) metres
    frame: LocalFrame,  # of the region
    user: Respondent,  # is asked
    *,
    trusted: bool,  # whether the user already accepted them; then nothing is checked
) -> bool:
    """Whether to accept suspicious heights; asks if there are any.

    Raises:
        InputError: heights are suspicious, and the user rejects them, or cannot be asked.
    """
    if trusted:
        return True

    def lon_lat_deg(en_m: FloatArray) -> FloatArray:
        lon, lat = frame.lon_lat_from_en(en_m).T
        return np.column_stack([lons_beside(lon, frame.lon_deg), lat])

    on_earth = shapely.transform(region, lon_lat_deg)
    found = suspect_positions(source, datum, on_earth.bounds, on_earth)
    if not found:
        return False
    for one in found[: SUSPECTS.most_suspects]:
        user.warn(f"{source.name} has {one.words}")
    if user.agrees("check that the terrain has this shape"):
        return True
    more = f" and {len(found) - 1} more of this kind" if len(found) > 1 else ""
    raise InputError(
        f"{source}: the data contains {found[0].words}{more}; use other data, or mark the missing heights "
        "(gdal_edit.py -a_nodata); if the heights are correct, use --trust-dem (terrain.trust_heights = true)"
    )
