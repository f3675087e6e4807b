"""Heights in elevation files: their vertical datums, their units, and the gaps that are filled."""

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from pyproj.exceptions import ProjError
from pyproj.transformer import TransformerGroup

from uavcover.errors import InputError, TerrainError
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.terrain.terrain_source import TerrainSource

_FOOT_M, _SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0
_UNITS_M = {
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys(("dm", "decimetre", "decimeter"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimeter"), 0.01),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), _FOOT_M),
    **dict.fromkeys(("us-ft", "ftus", "us survey foot", "foot_us", "us survey feet"), _SURVEY_FOOT_M),
}
SEA_LEVEL_DATUMS = {"EGM96": ("egm96", "5773"), "EGM2008": ("egm2008", "3855")}
ELLIPSOID = "WGS84-ellipsoid"
DATUMS = (*SEA_LEVEL_DATUMS, ELLIPSOID)
_WITHOUT_HEIGHT, _ABOVE_EGM96 = 4979, "EPSG:4326+5773"


class Undulation:
    """Height of the EGM96 sea level, which autopilots use, above the WGS 84 ellipsoid, from a grid of PROJ."""

    def __init__(self) -> None:
        """Looks for the grid; nothing is fetched. Raises TerrainError: PROJ does not have it; names it."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the grid that is not there, which the error names
            group = TransformerGroup(_WITHOUT_HEIGHT, _ABOVE_EGM96, always_xy=True, allow_ballpark=False)
        if not group.transformers or not group.best_available:
            grids = [grid.short_name for operation in group.unavailable_operations for grid in operation.grids]
            raise TerrainError(
                f'terrain.vertical_datum: heights above the ellipsoid ("{ELLIPSOID}") require the geoid grid '
                f"{grids[0] if grids else 'of EGM96'}, which PROJ does not have on this machine; download it (projsync --file "
                f"{grids[0] if grids else 'us_nga_egm96_15.tif'}), or convert the file (gdalwarp with -t_srs EPSG:4326+5773)"
            )
        self._to_sea_level = group.transformers[0]

    def heights_m(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        """(n,) heights of the sea level above the ellipsoid at geodetic positions.

        Raises:
            TerrainError: the grid does not reach there.
        """
        try:
            _, _, above = self._to_sea_level.transform(lon_deg, lat_deg, np.zeros(np.shape(lat_deg)), errcheck=True)
        except ProjError as error:
            raise TerrainError(f"terrain.vertical_datum: no geoid grid covers the elevation data ({error})") from error
        return -np.asarray(above, dtype=float)


def datum_named(text: str) -> str:
    """One of ``DATUMS`` as the user writes it. Raises InputError: there is none of that name."""
    known = {datum.casefold(): datum for datum in DATUMS} | {"ellipsoid": ELLIPSOID}
    if text.casefold() not in known:
        raise InputError(f"--vertical-datum: must be EGM96 (SRTM), EGM2008 (Copernicus) or ellipsoid, not {text!r}")
    return known[text.casefold()]


def refuse_feet_by_guess(path: TerrainSource, horizontal: CRS) -> None:
    """Require the unit of heights that is not stated when positions are in feet: heights often are too.

    Raises:
        TerrainError: the system is in feet.
    """
    axis = horizontal.axis_info[0]
    if 0.3 < axis.unit_conversion_factor < 0.31:
        raise TerrainError(
            f"{path}: the coordinate system {horizontal.name} is in feet, but the file does not state the unit of its heights; "
            'set terrain.height_unit (--height-unit) to "ft", "us-ft" or "m"'
        )


def unit_of_heights_m(path: TerrainSource, crs: CRS, vertical_datum: str, unit: str | None) -> float:
    """The unit of the heights in metres, once datum and unit are checked.

    Args:
        path: names the file in errors.
        crs: of the file.
        vertical_datum: that of the scenario.
        unit: of the heights, as the file or the scenario has it; none: that of the system, or metres.

    Raises:
        TerrainError: the file names another datum or unit, or a unit that is not known.
    """
    unit_m = _UNITS_M.get((unit or "m").lower().strip())
    if unit_m is None:
        raise TerrainError(f"{path}: the heights are in {unit!r}; convert them to metres first")
    if crs.is_compound:
        vertical = crs.sub_crs_list[1]
        words = f"{vertical.name} {vertical.to_authority()}".lower()
        if not any(word in words for word in SEA_LEVEL_DATUMS.get(vertical_datum, ())):
            raise _contradiction(path, vertical_datum, vertical.name)
        axis = vertical.axis_info[0]
        if unit and abs(axis.unit_conversion_factor / unit_m - 1.0) > 1e-3:
            raise TerrainError(
                f"{path}: the file states both {unit!r} and {axis.unit_name!r} as the unit of its heights; convert "
                "them to metres first"
            )
        unit_m = float(axis.unit_conversion_factor)
    elif len(crs.axis_info) == 3 and vertical_datum != ELLIPSOID:
        raise _contradiction(path, vertical_datum, f"heights above the ellipsoid of {crs.name}")
    return unit_m


def _contradiction(path: TerrainSource, vertical_datum: str, found: str) -> TerrainError:
    return TerrainError(
        f"terrain.vertical_datum: the scenario says {vertical_datum}, but the file says {found} ({path}); correct the "
        "scenario, or convert the file (gdalwarp with -t_srs EPSG:4326+5773 for EGM96, EPSG:4326+3855 for EGM2008)"
    )


_NEIGHBOURS = np.ones((3, 3), dtype=int)


@dataclass(frozen=True, slots=True)
class FilledGaps:
    """Heights without the gaps that were small enough."""

    heights_m: FloatArray  # (rows, columns) with NaN only where a gap is larger, or reaches the edge of the data
    count: int  # how many gaps were filled
    largest_m: float  # longer side of the largest one that was filled


def fill_gaps(heights_m: FloatArray, *, pixel_m: tuple[float, float], up_to_m: float) -> FilledGaps:
    """Fill the gaps that are no longer than a length along rows and columns, linearly between the heights around each.

    Args:
        heights_m: (rows, columns) heights, NaN where there is no data; not changed.
        pixel_m: height and width of a pixel.
        up_to_m: longest side of a gap that is filled.
    """
    from scipy import ndimage  # half a second to load, and most elevation data has no gaps
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    filled = np.array(heights_m, dtype=float)
    labels, _ = ndimage.label(np.isnan(filled), structure=_NEIGHBOURS)
    count, largest_m = 0, 0.0
    for number, place in enumerate(ndimage.find_objects(labels), start=1):
        rows, columns = place
        side_m = max((rows.stop - rows.start) * pixel_m[0], (columns.stop - columns.start) * pixel_m[1])
        at_edge = (
            rows.start == 0 or columns.start == 0 or rows.stop == filled.shape[0] or columns.stop == filled.shape[1]
        )
        if side_m > up_to_m or at_edge:
            continue
        around = (slice(rows.start - 1, rows.stop + 1), slice(columns.start - 1, columns.stop + 1))
        gap = labels[around] == number
        rim = ndimage.binary_dilation(gap, structure=_NEIGHBOURS) & np.isfinite(heights_m[around])
        try:
            between = LinearNDInterpolator(np.argwhere(rim) * pixel_m, heights_m[around][rim])
        except QhullError:
            continue  # a rim on one line, beside another gap
        values = between(np.argwhere(gap) * pixel_m)
        if np.isfinite(values).all():
            filled[around][gap] = values
            count, largest_m = count + 1, max(largest_m, float(side_m))
    return FilledGaps(filled, count, largest_m)


def touching(mask: BoolArray) -> tuple[NDArray[np.int32], int]:
    """Number the groups of true elements that touch, also at corners, and count them.

    As ``scipy.ndimage.label`` does, which takes a third of a second to load; elevation data with level ground is frequent.

    Args:
        mask: (rows, columns).

    Returns:
        (rows, columns) numbers from 1, in the order of the first elements of the groups; 0 where the mask is false.
    """
    # First and last elements of the runs of each row, in a mask with a false column on either side.
    wide = np.pad(mask, ((0, 0), (1, 1)))
    first, last = (np.flatnonzero(wide[:, 1:-1] & ~beside) for beside in (wide[:, :-2], wide[:, 2:]))
    first, last = (at + at // mask.shape[1] * 2 + 1 for at in (first, last))
    # Pairs of runs that touch, in one row and in the next.
    begin = np.searchsorted(last, first + wide.shape[1] - 1)
    counts = np.searchsorted(first, last + wide.shape[1] + 1, side="right") - begin
    above = np.repeat(np.arange(len(first)), counts)
    below = np.arange(len(above)) + np.repeat(begin - np.cumsum(counts) + counts, counts)
    # Each run takes the lowest number beside it, until all that touch have one.
    group = np.arange(len(first))
    while (group[above] != group[below]).any():
        lower = np.minimum(group[above], group[below])
        np.minimum.at(group, group[above], lower)
        np.minimum.at(group, group[below], lower)
        while (group[group] != group).any():
            group = group[group]
    groups, numbers = np.unique(group, return_inverse=True)
    out = np.zeros(mask.shape, dtype=np.int32)
    out[mask] = np.repeat(numbers + 1, last - first + 1)
    return out, len(groups)
