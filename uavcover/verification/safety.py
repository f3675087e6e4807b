"""Was it safe? Heights, sea-level limits and the fence along the flown track, at its full length."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.model.report import Violation, ViolationKind
from uavcover.model.track import Track
from uavcover.site import Site

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

HEIGHT_TOLERANCE_M = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Lowest and highest point above ground next to each sample: on the legs before and after it.

    Attributes:
        lowest_agl_m: (n,).
        highest_agl_m: (n,).
    """

    lowest_agl_m: FloatArray
    highest_agl_m: FloatArray


def track_heights(site: Site, enu_m: FloatArray, joined: BoolArray) -> Heights:
    """Heights above ground of an (n, 3) track, between samples too where ``joined`` (n - 1,) says so."""
    here = enu_m[:, 2] - site.ground.heights_m(enu_m[:, :2])
    lowest, highest = here.copy(), here.copy()
    ranges = site.ground.leg_height_ranges_m(enu_m)
    for side in (slice(None, -1), slice(1, None)):
        lowest[side] = np.where(joined, np.fmin(lowest[side], ranges[:, 0]), lowest[side])
        highest[side] = np.where(joined, np.fmax(highest[side], ranges[:, 2]), highest[side])
    return Heights(lowest, highest)


def find_violations(
    site: Site, track: Track, enu_m: FloatArray, heights: Heights, route: BoolArray, column: BoolArray
) -> list[Violation]:
    """Every stretch of the track on which a limit was not kept, in order of time.

    Args:
        site: the scenario on its ground.
        track: the flown track.
        enu_m: (n, 3) its positions.
        heights: above ground.
        route: (n,) between the first and the last planned waypoint.
        column: (n,) take-off and landing, where clearance cannot be asked for.
    """
    limits = site.scenario.limits
    alts = track.geodetic[:, 2]
    outside = ~shapely.intersects_xy(site.fence, enu_m[:, 0], enu_m[:, 1])
    distance = np.zeros(len(track))
    distance[outside] = shapely.distance(site.fence, shapely.points(enu_m[outside, :2]))
    transit = ~route & ~column
    low, high = heights.lowest_agl_m, heights.highest_agl_m
    tolerance = HEIGHT_TOLERANCE_M
    found: list[Violation] = []

    def add(
        kind: ViolationKind,
        broken: BoolArray,
        value: FloatArray,
        limit: float,
        *,
        smallest: bool,
        phase: Literal["route", "transit"],
    ) -> None:
        for run in _runs(broken):
            worst = run[int(np.argmin(value[run]) if smallest else np.argmax(value[run]))]
            found.append(
                Violation(
                    kind=kind, start_s=float(track.time_s[run[0]]), end_s=float(track.time_s[run[-1]]),
                    worst=float(value[worst]), limit=float(limit),
                    lat_deg=float(track.geodetic[worst, 0]), lon_deg=float(track.geodetic[worst, 1]), phase=phase,
                )
            )  # fmt: skip

    minimum, maximum = limits.min_height_agl_m, limits.max_height_agl_m
    add("below-band", route & ~(low >= minimum - tolerance), low, minimum, smallest=True, phase="route")
    add("above-band", route & (high > maximum + tolerance), high, maximum, smallest=False, phase="route")
    # In transit the vehicle comes within the margin of what was planned; the clearance is what must be left of it.
    clearance = max(0.0, limits.transit_clearance_m - limits.height_margin_m)
    add("clearance", transit & ~(low >= clearance - tolerance), low, clearance, smallest=True, phase="transit")
    if limits.min_alt_amsl_m is not None:
        limit = limits.min_alt_amsl_m
        add("below-sea-level-limit", route & (alts < limit - tolerance), alts, limit, smallest=True, phase="route")
    if limits.max_alt_amsl_m is not None:
        limit = limits.max_alt_amsl_m
        add("above-sea-level-limit", route & (alts > limit + tolerance), alts, limit, smallest=False, phase="route")
        add("above-sea-level-limit", ~route & (alts > limit + tolerance), alts, limit, smallest=False, phase="transit")
    add("fence", outside & route, distance, 0.0, smallest=False, phase="route")
    add("fence", outside & ~route, distance, 0.0, smallest=False, phase="transit")
    return sorted(found, key=lambda violation: violation.start_s)


def _runs(mask: BoolArray) -> Iterator[NDArray[np.int64]]:
    chosen = np.flatnonzero(mask)
    if chosen.size:
        yield from np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1)
