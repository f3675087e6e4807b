"""Gaps in elevation data, such as lakes: closed by interpolation from their rim, up to a stated size."""

from dataclasses import dataclass

import numpy as np

from uavcover.kernels.arrays import FloatArray

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
