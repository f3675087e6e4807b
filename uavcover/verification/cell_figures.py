"""How well the cells were seen, in figures, and how that grew."""

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.model.report import CellStatistics, CoverageMoment
from uavcover.verification.flown_coverage import FlownCoverage

FloatArray = NDArray[np.float64]

_MOMENTS = 200
"""Coverage over time is told at this many moments, evenly spread over the looks' time."""


def cell_statistics(coverage: CoverageMap, flown: FlownCoverage) -> CellStatistics:
    """Looks, ground sample distance and incidence of all cells."""
    seen = flown.seen

    def percentile(values: FloatArray, share: float) -> float | None:
        known = values[seen & np.isfinite(values)]
        return float(np.percentile(known, share)) if known.size else None

    return CellStatistics(
        count=coverage.grid.count,
        seen=int(seen.sum()),
        looks_mean=float(flown.looks[seen].mean()) if seen.any() else None,
        looks_max=int(flown.looks.max()),
        seen_twice_fraction=coverage.share(flown.looks >= 2),
        ground_sample_median_m=percentile(flown.ground_sample_m, 50.0),
        ground_sample_p95_m=percentile(flown.ground_sample_m, 95.0),
        incidence_median_deg=percentile(flown.incidence_deg, 50.0),
        incidence_p95_deg=percentile(flown.incidence_deg, 95.0),
    )


def coverage_by_time(coverage: CoverageMap, flown: FlownCoverage, times_s: FloatArray) -> tuple[CoverageMoment, ...]:
    """How much had been seen at moments of the (k,) times of the looks."""
    if times_s.size == 0:
        return ()
    order = np.flatnonzero(flown.seen)
    order = order[np.argsort(flown.first_seen_s[order], kind="stable")]
    weight = coverage.grid.weight_m2
    so_far = np.append(0.0, np.cumsum(weight[order])) / weight.sum()
    moments = np.linspace(times_s[0], times_s[-1], _MOMENTS) if times_s[-1] > times_s[0] else times_s[:1]
    shares = so_far[np.searchsorted(flown.first_seen_s[order], moments, side="right")]
    return tuple(CoverageMoment(float(t), float(share)) for t, share in zip(moments, shares, strict=True))
