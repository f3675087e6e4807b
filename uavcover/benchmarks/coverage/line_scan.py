"""The boustrophedon, tuned for as long as it takes: many directions, heights, insets, and every number of lines."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from uavcover.benchmarks.coverage.judging import Judge
from uavcover.coverage.coverage_map import CoverageMap
from uavcover.coverage.sensors import reach_at_height_m
from uavcover.model.route import Route
from uavcover.planning.baselines import PLAIN_TOLERANCE_M, TUNED, best_height_agl_m
from uavcover.planning.node_rows import fly_rows, scanned_rows
from uavcover.planning.snapshots import NamedRoute
from uavcover.planning.swaths import fly_layout, long_side_angle_rad, regular_layout, width_across_m
from uavcover.site import Site

_ANGLES = 12
_INSETS = (0.0, 0.5, 0.8)
_FEWEST_LINES, _MOST_LINES = 0.8, 1.45
_MOST_NODES = 120

_LESS_COVERAGE = (0.0, 0.002, 0.005, 0.01, 0.03)
_LONGER = 1.05


@dataclass(frozen=True, slots=True)
class Tried:
    """A boustrophedon that was tried.

    Attributes:
        family: all that does not change with the number of lines, as text.
        lines: how many lines, or rows of nodes.
        coverage: share of what is coverable, on the cells of the area.
        hold_out: likewise on cells that no planner has seen.
        waypoints: how many.
        length_m: of the open path.
        violation: 0 when all limits are kept.
    """

    family: str
    lines: int
    coverage: float
    hold_out: float
    waypoints: int
    length_m: float
    violation: float


def scan(judge: Judge) -> tuple[list[Tried], list[NamedRoute]]:
    """What was worth judging of everything that was tried, and the routes.

    All are tried on the planner's cells first. Families that are more than 5 % longer there than the best, at every one of a few
    coverages about the one that is asked for, are not judged on the finer cells.
    """
    site = judge.site
    laid = list(_lines(site) if site.scenario.sensor.sensing == "along-path" else _rows(site))
    coarse = CoverageMap(site, cell_size_m=site.scenario.planning_cell_size_m)
    first = [
        Tried(family, lines, seen, seen, len(route), route.length_m, 0.0)
        for family, lines, route in laid
        for seen in [coarse.share_of_coverable(coarse.seen(route.waypoints_m))]
    ]
    kept = short_families(first, [judge.case.asked - less for less in _LESS_COVERAGE])
    routes: list[NamedRoute] = [(route, TUNED) for family, _, route in laid if family in kept]
    names = [(family, lines) for family, lines, _ in laid if family in kept]
    tried = [
        Tried(
            family, lines, m.metrics.coverage_of_coverable, judge.hold_out(m), m.metrics.waypoint_count,
            m.metrics.path_length_m, m.violation,
        )
        for (family, lines), m in zip(names, judge.judged(routes), strict=True)
    ]  # fmt: skip
    return tried, routes


def short_families(tried: Sequence[Tried], coverages: Sequence[float]) -> set[str]:
    """Families that are at most 5 % longer than the best at one of the coverages."""
    by_family: dict[str, list[Tried]] = {}
    for one in tried:
        by_family.setdefault(one.family, []).append(one)
    kept: set[str] = set()
    for coverage in coverages:
        lengths = {family: length_at(members, coverage) for family, members in by_family.items()}
        best = min((length for length in lengths.values() if not math.isnan(length)), default=math.inf)
        kept |= {family for family, length in lengths.items() if length <= _LONGER * best}
    return kept


def _lines(site: Site) -> Iterator[tuple[str, int, Route]]:
    best, limits = best_height_agl_m(site), site.scenario.limits
    middle = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    for k in range(_ANGLES):
        angle = long_side_angle_rad(site) + k * math.pi / _ANGLES
        width = width_across_m(site, angle)
        for height in sorted({best, 0.5 * (best + middle)}, reverse=True):
            strip = 2.0 * max(reach_at_height_m(site.scenario.sensor, height), site.scenario.area.cell_size_m)
            few, many = (max(1, math.ceil(share * width / strip - 1e-9)) for share in (_FEWEST_LINES, _MOST_LINES))
            for inset in _INSETS:
                for lines in range(few, many + 1):
                    layout = regular_layout(
                        angle_rad=angle, lines=lines, height_agl_m=height, inset=inset, tolerance_m=PLAIN_TOLERANCE_M
                    )
                    family = f"{math.degrees(angle):.0f} degrees, {height:.1f} m, inset {inset:g}"
                    yield family, lines, fly_layout(site, layout)


def _rows(site: Site) -> Iterator[tuple[str, int, Route]]:
    for rows in scanned_rows(site, most_nodes=_MOST_NODES):
        family = f"{rows.columns} columns, stagger {rows.stagger:g}, height share {rows.height_share:g}"
        yield family, rows.rows, fly_rows(site, rows)


def length_at(tried: Sequence[Tried], hold_out: float) -> float:
    """Length of the shortest boustrophedon with a hold-out coverage, or NaN where none has it.

    Within a family the length between two numbers of lines that follow each other is interpolated by their coverage: a
    number of lines is a coarse step, and whoever needs a little less than 31 lines give should not be compared with all 31.
    """
    found = []
    for _, members in groupby(sorted(tried, key=lambda t: (t.family, t.lines)), key=lambda t: t.family):
        family = [member for member in members if member.violation <= 0.0]
        found += [one.length_m for one in family if one.hold_out >= hold_out]
        for few, many in pairwise(family):
            if few.hold_out < hold_out < many.hold_out and many.lines == few.lines + 1:
                share = (hold_out - few.hold_out) / (many.hold_out - few.hold_out)
                found.append(few.length_m + share * (many.length_m - few.length_m))
    return min(found, default=math.nan)
