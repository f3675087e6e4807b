"""What was not seen, grouped into connected regions, each with the reason."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.tally import NOT_IN_RANGE, OCCLUDED, TOO_OBLIQUE
from uavcover.model.report import Gap, GapReason
from uavcover.verification.flown_coverage import FlownCoverage

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

REASONS: tuple[GapReason, ...] = ("never-in-range", "too-oblique", "occluded", "out-of-limits")
_OF_OUTCOME: dict[int, GapReason] = {
    NOT_IN_RANGE: "never-in-range",
    TOO_OBLIQUE: "too-oblique",
    OCCLUDED: "occluded",
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
    """Regions of cells that were not seen, touching by side or corner; the largest first.

    What could have been seen and what could not are never in one region.
    """
    missing = ~flown.seen
    regions = _regions(coverage, flown, missing & coverage.coverable, coverable=True)
    regions += _regions(coverage, flown, missing & ~coverage.coverable, coverable=False)
    return sorted(regions, key=lambda region: -region.gap.area_m2)


def _regions(coverage: CoverageMap, flown: FlownCoverage, missing: BoolArray, *, coverable: bool) -> list[GapRegion]:
    # Importing scipy.ndimage takes most of a second, which commands that judge nothing need not wait for.
    from scipy import ndimage

    cells, weight = coverage.grid.cells, coverage.grid.weight_m2
    inside = cells.lattice >= 0
    lattice = np.zeros(cells.lattice.shape, dtype=bool)
    lattice[inside] = missing[cells.lattice[inside]]
    labels, count = ndimage.label(lattice, structure=np.ones((3, 3)))
    if count == 0:
        return []
    label_of_cell = np.zeros(coverage.grid.count, dtype=np.int64)
    label_of_cell[cells.lattice[inside]] = labels[inside]
    members = np.flatnonzero(label_of_cell)
    members = members[np.argsort(label_of_cell[members], kind="stable")]
    groups = np.split(members, np.flatnonzero(np.diff(label_of_cell[members])) + 1)
    middles = np.array([np.average(cells.centre_m[group], axis=0, weights=weight[group]) for group in groups])
    lat, lon = np.full(count, np.nan), np.full(count, np.nan)
    if coverage.site.frame is not None:
        lat, lon, _ = coverage.site.frame.geodetic_from_enu(middles)
    regions = []
    for k, group in enumerate(groups):
        areas = _areas_by_reason(flown.outcome[group], weight[group], coverable=coverable)
        gap = Gap(
            cells=len(group), area_m2=float(weight[group].sum()), lat_deg=float(lat[k]), lon_deg=float(lon[k]),
            east_m=float(middles[k, 0]), north_m=float(middles[k, 1]), reason=max(areas, key=lambda name: areas[name]),
            area_m2_by_reason=areas, coverable=coverable,
        )  # fmt: skip
        regions.append(GapRegion(gap, group))
    return regions


def _areas_by_reason(outcomes: NDArray[np.uint8], weight_m2: FloatArray, *, coverable: bool) -> dict[GapReason, float]:
    """Ground area for each reason that occurs."""
    if not coverable:
        return {"out-of-limits": float(weight_m2.sum())}
    areas: dict[GapReason, float] = {}
    for outcome, reason in _OF_OUTCOME.items():
        here = outcomes == outcome
        if here.any():
            areas[reason] = float(weight_m2[here].sum())
    return areas


def reason_codes(coverage: CoverageMap, flown: FlownCoverage) -> NDArray[np.uint8]:
    """(cells,) 0 where a cell was seen, else the number of its reason in REASONS, counted from 1."""
    codes = np.where(coverage.coverable, 1 + flown.outcome, 1 + REASONS.index("out-of-limits"))
    return np.where(flown.seen, 0, codes).astype(np.uint8)
