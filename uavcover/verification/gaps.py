"""What was not seen, grouped into connected regions, each with the reason."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.sight import NOT_IN_RANGE, OCCLUDED, SEEN, TOO_COARSE, TOO_OBLIQUE
from uavcover.model.report import Gap, GapReason
from uavcover.verification.flown_coverage import FlownCoverage

BoolArray = NDArray[np.bool_]

REASONS: tuple[GapReason, ...] = (
    "never-in-range",
    "too-oblique",
    "occluded",
    "out-of-limits",
    "too-coarse",
    "too-few-looks",
    "attitude-not-known",
)
"""In the order of their numbers in ``coverage.tif``."""
_OUTCOMES = {
    NOT_IN_RANGE: REASONS[0],
    TOO_OBLIQUE: REASONS[1],
    OCCLUDED: REASONS[2],
    TOO_COARSE: REASONS[4],
    SEEN: REASONS[5],
}


@dataclass(frozen=True, slots=True, eq=False)
class GapRegion:
    """A gap and its cells.

    Attributes:
        gap: what the report says of it.
        cells: (k,) numbers of its cells.
    """

    gap: Gap
    cells: NDArray[np.int64]


def find_gaps(coverage: CoverageMap, flown: FlownCoverage) -> list[GapRegion]:
    """Regions of cells that were not seen for the same reason, touching by side or corner; the largest first."""
    codes = reason_codes(coverage, flown)
    regions = [
        region for code, reason in enumerate(REASONS, start=1) for region in _regions(coverage, codes == code, reason)
    ]
    return sorted(regions, key=lambda region: -region.gap.area_m2)


def reason_codes(coverage: CoverageMap, flown: FlownCoverage) -> NDArray[np.uint8]:
    """(cells,) 0 where a cell was seen, else the number of its reason in REASONS, counted from 1."""
    codes = np.zeros(coverage.grid.count, dtype=np.uint8)
    missing = ~flown.seen
    for outcome, reason in _OUTCOMES.items():
        codes[missing & (flown.outcome == outcome)] = 1 + REASONS.index(reason)
    codes[missing & flown.possibly_by_attitude] = 1 + REASONS.index("attitude-not-known")
    # Said last: what cannot be seen at all was also never in range, or always too oblique.
    codes[missing & ~coverage.coverable] = 1 + REASONS.index("out-of-limits")
    return codes


def _regions(coverage: CoverageMap, missing: BoolArray, reason: GapReason) -> list[GapRegion]:
    if not missing.any():
        return []
    # Importing scipy.ndimage takes most of a second, which commands that judge nothing need not wait for.
    from scipy import ndimage

    cells, weight = coverage.grid.cells, coverage.grid.weight_m2
    inside = cells.lattice >= 0
    lattice = np.zeros(cells.lattice.shape, dtype=bool)
    lattice[inside] = missing[cells.lattice[inside]]
    labels, count = ndimage.label(lattice, structure=np.ones((3, 3)))
    label_of_cell = np.zeros(coverage.grid.count, dtype=np.int64)
    label_of_cell[cells.lattice[inside]] = labels[inside]
    members = np.flatnonzero(label_of_cell)
    members = members[np.argsort(label_of_cell[members], kind="stable")]
    groups = np.split(members, np.flatnonzero(np.diff(label_of_cell[members])) + 1)
    middles = np.array([np.average(cells.centre_m[group], axis=0, weights=weight[group]) for group in groups])
    lat, lon = np.full(count, np.nan), np.full(count, np.nan)
    if coverage.site.frame is not None:
        lat, lon, _ = coverage.site.frame.geodetic_from_enu(middles)
    return [
        GapRegion(
            Gap(
                cells=len(group), area_m2=float(weight[group].sum()), lat_deg=float(lat[k]), lon_deg=float(lon[k]),
                east_m=float(middles[k, 0]), north_m=float(middles[k, 1]), reason=reason,
                coverable=reason != "out-of-limits",
            ),
            group,
        )
        for k, group in enumerate(groups)
    ]  # fmt: skip
