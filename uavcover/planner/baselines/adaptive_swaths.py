"""Adaptive swaths: lines that bend with the terrain, and lines with few waypoints.

A sensor observes a wider strip over ridges and slopes than in valleys, so equally spaced straight lines waste coverage. Bent
lines keep the gap or overlap between neighbouring strips constant. Bending by a tenth of a swath is enough and adds almost
no length.

Lines with few waypoints are flown lower, so that a leg may deviate more from its height. A leg that may deviate by 2 m
follows every hill; a leg that flies lower and may deviate by 20 m crosses a valley in one piece. Its strip is a seventh
narrower, but it saves several times that cost in mission items.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.swaths import balance_lines
from uavcover.model.route import Route
from uavcover.planner.baselines.boustrophedon import (
    SwathLayout,
    area_edges,
    begun_near_home,
    best_height_agl_m,
    extents_between,
    fly_layout,
    join_lines,
    line_extents,
    regular_layout,
    strip_half_width_m,
    to_lines_frame,
    width_across_m,
    with_return_line,
)
from uavcover.planner.terrain_following import lay_over_terrain
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import is_ball_or_cone

_STATION_FRACTION = 0.5
"""Distance of stations along the lines, as a fraction of the sensor's reach."""
_ROUNDS = 4
"""Rounds of the balancing.

With 16 rounds and half the station distance, it took 8 times as long. The lines on 25 km² observed 0.1 points more and had
10 % more waypoints; on jacksboro they did not change (docs/results/large.md).
"""
_SMOOTHING = 10
_INSETS = (0.8, 0.9, 0.96, 1.0)
_TOLERANCE_FRACTION = 0.0025
"""Tolerance of legs to the best height, as a fraction of the band: a strip is as wide as its sensor is high."""
_STRAIGHT_FRACTION = 0.01
"""A line may be laid straight where it leaves its bends by no more than this fraction of the reach."""


def can_be_adapted(site: Site) -> bool:
    """Whether :mod:`uavcover.kernels.swaths` supports the sensor."""
    return site.scenario.sensor.looks_along_path and is_ball_or_cone(site.scenario.sensor.sight)


def adaptive_swaths(
    site: Site,  # with a sensor for which :func:`can_be_adapted` holds
    angle_rad: float,  # direction of the lines, counter-clockwise from east
    *,
    executor: Executor | None = None,  # lays out several in parallel; the routes do not depend on it
    should_stop: Callable[[], bool] = lambda: False,  # called before each number of lines; the first is always laid out
) -> list[Route]:
    """Balanced lines along and across a direction, for several numbers of lines around the one that fits the area.

    The number that just fits comes first: on every bundled terrain it is the best initial solution of a search.
    """
    limits = site.scenario.limits
    low, high = limits.min_height_agl_m + limits.height_margin_m, limits.max_height_agl_m - limits.height_margin_m
    tolerance = _TOLERANCE_FRACTION * (high - low)
    height = best_height_agl_m(site, tolerance_m=tolerance)
    swath = 2.0 * max(site.scenario.sensor.half_width_m(height), site.scenario.area.cell_size_m)
    ranked = []
    for angle in (angle_rad, angle_rad + 0.5 * math.pi):
        fitting = math.floor(width_across_m(site, angle) / swath)
        more = math.ceil(width_across_m(site, angle) / swath) - fitting
        numbers = (fitting, fitting - 1, *range(fitting + 1, fitting + more + 2))
        for rank, number in enumerate(number for number in numbers if number >= 1):
            layout = regular_layout(
                angle_rad=angle, lines=number, height_agl_m=height, inset=0.0, tolerance_m=tolerance
            )
            ranked.append((rank, layout))

    layouts = [layout for _, layout in sorted(ranked, key=lambda item: item[0])]
    layouts += [each for layout in layouts if (each := with_return_line(site, layout)) is not None]
    return [route for routes in _each(partial(_balanced, site), layouts, executor, should_stop) for route in routes]


_Given = TypeVar("_Given")
_Made = TypeVar("_Made")


def _each(
    make: Callable[[_Given], _Made], items: Sequence[_Given], executor: Executor | None, should_stop: Callable[[], bool]
) -> list[_Made]:
    """Results for the items: always the first, then the others until it is time to stop."""

    def unless_stopped(item: _Given) -> _Made | None:
        return None if should_stop() else make(item)

    rest = executor.map(unless_stopped, items[1:]) if executor is not None else map(unless_stopped, items[1:])
    return [make(item) for item in items[:1]] + [made for made in rest if made is not None]


@dataclass(frozen=True, slots=True, eq=False)
class BentLines:
    """The bent lines of a layout: n lines, s stations. They do not depend on the inset of the layout."""

    along_m: FloatArray  # (s,) stations along the lines' direction, from the origin
    across_m: FloatArray  # (n, s) the lines at the stations
    west_m: FloatArray  # (n,) where the area begins in each line's strip, along
    east_m: FloatArray  # (n,) where it ends
    heights_agl_m: FloatArray  # (n,) wanted height above ground of each line
    reach_m: float  # of the sensor at the mean of these heights

    def between(self, first: int, end: int) -> "BentLines":
        """The lines from ``first`` to before ``end``."""
        some = slice(first, end)
        return dataclasses.replace(
            self, across_m=self.across_m[some], west_m=self.west_m[some], east_m=self.east_m[some],
            heights_agl_m=self.heights_agl_m[some],
        )  # fmt: skip


def bend_lines(site: Site, layout: SwathLayout) -> BentLines:
    """Bend the lines of a layout until their strips share the ground evenly."""
    angle = layout.angle_rad
    borders, west, east = line_extents(site, layout)
    flown = west <= east
    borders, west, east, heights = borders[flown], west[flown], east[flown], layout.heights_agl_m[flown]
    reach = max(site.scenario.sensor.half_width_m(float(np.mean(heights))), site.scenario.area.cell_size_m)
    count = max(3, math.ceil((east.max() - west.min()) / (_STATION_FRACTION * reach)))
    along = np.linspace(west.min(), east.max(), count)
    step = along[1] - along[0]
    # Strips across the lines, one around each station: between where the area begins and ends.
    edges = np.concatenate([along[:1], 0.5 * (along[1:] + along[:-1]), along[-1:]])
    low, high = extents_between(area_edges(site, angle)[:, [1, 0, 3, 2]], edges).T
    there = (along >= west[:, None] - step) & (along <= east[:, None] + step) & (low <= high)
    across = balance_lines(
        site.ground.surface, site.scenario.sensor.sight, angle, along, np.ascontiguousarray(low),
        np.ascontiguousarray(high), heights, np.repeat(borders[:, None], count, axis=1), there, _ROUNDS, _SMOOTHING,
    )  # fmt: skip
    return BentLines(along, across, west, east, heights, reach)


def fly_bent(site: Site, layout: SwathLayout, bent: BentLines, *, straight_m: float | None = None) -> Route:
    """The route of a layout with its lines bent, laid over the terrain.

    Args:
        site: the layout's.
        layout: as for :func:`uavcover.planner.baselines.boustrophedon.fly_layout`.
        bent: its lines.
        straight_m: how far lines may leave their bends on the map to have fewer of them; by default a hundredth of the
            sensor's reach.
    """
    lines_m: list[FloatArray] = []
    for west, east, across in zip(bent.west_m, bent.east_m, bent.across_m, strict=True):
        inner = bent.along_m[(bent.along_m > west) & (bent.along_m < east)]
        along = np.concatenate([[west], inner, [east]])
        lines_m.append(np.column_stack([along, np.interp(along, bent.along_m, across)]))
    points_m, heights_m = join_lines(
        lines_m, bent.heights_agl_m, np.full(len(lines_m), layout.inset * bent.reach_m), layout,
        straight_m=_STRAIGHT_FRACTION * bent.reach_m if straight_m is None else straight_m,
    )  # fmt: skip
    points_m = points_m @ to_lines_frame(layout.angle_rad)
    return Route(lay_over_terrain(site, points_m, heights_m, tolerance_m=layout.tolerance_m))


BENT = (1 / 16, 1 / 8, 3 / 16)
_FIRST_BENT = 1 / 8
STRAIGHT = (3 / 16, 1 / 4, 3 / 8, 1 / 2)
"""Tolerances of legs to their height, as fractions of the band.

In order: lines that bend, the first of those with sure coverage, straight lines.
"""

_BEND = 0.8
"""Tolerance of bent lines laid straight on the map, as a fraction of their height tolerance."""

_LINES = {True: (1.0, 1.08), False: (1.0, 1.08, 1.2)}
"""Numbers of lines that bend, or that do not, as fractions of the width of the area over that of a swath of flat ground."""

_INSET = 0.5

TIGHT = (1 / 16, 1 / 8)
_FEWER = (0, 1)
TIGHT_INSETS = (0.96, 0.8)
"""Bent lines with nothing to spare, the best beginnings of all: how far legs may leave their height, how many lines fewer than
fit beside each other, and insets. On 25 km² 31 such lines observe 99.5 % in 14,800 s, where 33 up to the ends took 15,530 s."""


def tight_lines(site: Site, angle_rad: float) -> list[Route]:
    """Bent lines in one direction without reserve: the number that fits, or one fewer.

    Args:
        site: with a sensor for which :func:`can_be_adapted` holds.
        angle_rad: direction of the lines, counter-clockwise from east.
    """
    return _laid_out(site, _tight(site, angle_rad), None, lambda: False)


def tight_layouts(site: Site, angle_rad: float, *, fraction: float, more: int) -> list[SwathLayout]:
    """Layouts of bent lines side by side in one direction, by their inset.

    Args:
        site: with a sensor for which :func:`can_be_adapted` holds.
        angle_rad: direction of the lines, counter-clockwise from east.
        fraction: of the band, how far legs may leave their height.
        more: lines than fit beside each other.
    """
    layout = _regular(site, angle_rad, fraction, TIGHT_INSETS[0], fewer=-more)
    return [dataclasses.replace(layout, inset=inset) for inset in TIGHT_INSETS]


def fly_tight(site: Site, layout: SwathLayout, bent: BentLines) -> Route:
    """The route of such a layout. Its lines are as straight as the permitted deviation of its legs allows."""
    return fly_bent(site, layout, bent, straight_m=_BEND * layout.tolerance_m)


def ample_lines(site: Site, angle_rad: float, *, shortest: bool) -> list[Route]:
    """Bent lines in one direction, one more than fit, because fewer leave gaps where nearly full coverage is required.

    On 25 km², 29 lines that fit observe 99.17 to 99.44 % in 149 km, and 30 lines observe 99.60 to 99.85 % in 154 km.

    Args:
        site: with a sensor for which :func:`can_be_adapted` holds.
        angle_rad: direction of the lines, counter-clockwise from east.
        shortest: True: balanced lines with all waypoints that the ground requires; False: simple lines.
    """
    if not shortest:
        items = [
            (_regular(site, angle_rad, fraction, TIGHT_INSETS[0], fewer=-1), True, TIGHT_INSETS) for fraction in TIGHT
        ]
        return _laid_out(site, items, None, lambda: False)
    return _balanced(site, _regular(site, angle_rad, _TOLERANCE_FRACTION, 0.0, fewer=-1))


def _balanced(site: Site, layout: SwathLayout) -> list[Route]:
    bent, layout = bend_lines(site, layout), begun_near_home(site, layout)
    return [fly_bent(site, dataclasses.replace(layout, inset=inset), bent) for inset in _INSETS]


def simple_lines(
    site: Site,  # of any sensor
    angle_rad: float,  # direction of the lines, counter-clockwise from east
    *,
    executor: Executor | None = None,  # lays out several in parallel; the routes do not depend on it
    should_stop: Callable[[], bool] = lambda: False,  # called before each number of lines; the first is always laid out
) -> list[Route]:
    """Routes of parallel lines in one direction: the fewest lines first, and bent lines before straight ones."""
    bends = can_be_adapted(site)
    kinds = [(fraction, True) for fraction in BENT if bends] + [(fraction, False) for fraction in STRAIGHT]
    ranked: list[tuple[tuple[int, bool, bool], SwathLayout, bool]] = []
    for fraction, bent in kinds:
        layouts = {
            layout.heights_agl_m.size: layout
            for layout in (_regular(site, angle_rad, fraction, _INSET, widths=w) for w in _LINES[bent])
        }
        for more, lines in enumerate(sorted(layouts)):
            ranked.append(((more, not bent, fraction != _FIRST_BENT), layouts[lines], bent))
    items = _tight(site, angle_rad) if bends else []
    items += [(layout, bent, (_INSET,)) for _, layout, bent in sorted(ranked, key=lambda item: item[0])]
    return _laid_out(site, items, executor, should_stop)


def _regular(
    site: Site, angle_rad: float, fraction: float, inset: float, *, widths: float = 1.0, fewer: int | None = None
) -> SwathLayout:
    """Regular lines whose legs may deviate from their height by a fraction of the band.

    Args:
        site: of any sensor.
        angle_rad: their direction, counter-clockwise from east.
        fraction: of the band.
        inset: of their ends, as a fraction of the sensor's reach.
        widths: at least this multiple of the number that fits.
        fewer: or this number fewer than fit.
    """
    limits = site.scenario.limits
    tolerance_m = fraction * (limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m)
    height_m = best_height_agl_m(site, tolerance_m=tolerance_m)
    swath_m = 2.0 * strip_half_width_m(site, angle_rad, height_m)
    wanted = widths * width_across_m(site, angle_rad) / swath_m
    lines = math.ceil(wanted) if fewer is None else max(1, math.floor(wanted) - fewer)
    return regular_layout(angle_rad=angle_rad, lines=lines, height_agl_m=height_m, inset=inset, tolerance_m=tolerance_m)


_Item = tuple[SwathLayout, bool, tuple[float, ...]]
"""Lines, whether they bend, and the insets with which they are flown."""


def _tight(site: Site, angle_rad: float) -> list[_Item]:
    layouts = [
        _regular(site, angle_rad, fraction, TIGHT_INSETS[0], fewer=fewer) for fewer in _FEWER for fraction in TIGHT
    ]
    return [(layout, True, TIGHT_INSETS) for layout in layouts]


def _laid_out(
    site: Site, items: Sequence[_Item], executor: Executor | None, should_stop: Callable[[], bool]
) -> list[Route]:
    def routes(item: _Item) -> list[Route]:
        layout, bent, insets = item
        layout = begun_near_home(site, layout)
        if not bent:
            return [fly_layout(site, layout)]
        lines = bend_lines(site, layout)
        return [fly_tight(site, dataclasses.replace(layout, inset=inset), lines) for inset in insets]

    returning = [(with_return_line(site, layout), bent, insets) for layout, bent, insets in items]
    items = [*items, *((layout, bent, insets) for layout, bent, insets in returning if layout is not None)]
    return [route for some in _each(routes, items, executor, should_stop) for route in some]
