"""Scenarios of the benchmark, the required coverage of each, and the value of a set of routes.

Sets are judged on the cells of the area, with the hypervolume measured from a point of each scenario; chosen routes are judged on
hold-out cells, which no planner has observed.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final, cast

import numpy as np
import shapely

from uavcover.extras.benchmarks.indicators import hypervolume
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.sight import MIDPOINT, RAY
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.route import RouteMember
from uavcover.planner.final_changes import with_sound_corners
from uavcover.planner.front import NamedRoute, judge_members, pareto_members
from uavcover.planner.selection_rule import parse_rule, select
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap


@dataclass(frozen=True, slots=True)
class Case:
    """A bundled scenario as a problem."""

    scenario: str  # its name
    rule: str  # by which the planners choose
    required: float  # fraction of the coverable area at which routes are compared
    most_waypoints: float  # reference point of the hypervolume; its coverage is 0
    longest_m: float  # reference point of the hypervolume, its length


CASES: Final = MappingProxyType(
    {
        case.scenario: case
        for case in (
            Case("paper-R2", "max-coverage", 1.0, 61.0, 120.0),
            Case("paper-r1", "max-coverage", 1.0, 61.0, 120.0),
            Case("paper-planar", "max-coverage", 1.0, 61.0, 120.0),
            Case("jacksboro", "coverage>=0.98", 0.98, 100.0, 20_000.0),
            Case("ridge-25km2", "coverage>=0.995", 0.995, 2_000.0, 400_000.0),
            Case("ridge-obstacles", "coverage>=0.99", 0.99, 400.0, 20_000.0),
        )
    }
)
"""The cases by scenario, in the order in which they are run."""


_SAME_POSITION = 1e-6


class HoldOut:
    """Coverage on cells of half the area's cell size, the whole lattice shifted by half of such a cell.

    A cell whose centre is also the centre of a cell of the area or of the planner does not count: a route may have been
    made to observe just that point. Lines of sight are exact rays, independent of the scenario's planning model.

    Attributes:
        coverage: the map on these cells.
        held_out: (cells,) whether a cell counts.
    """

    def __init__(self, site: Site) -> None:
        west, south, east, north = site.area.bounds
        scenario = site.scenario
        cell_m = 0.5 * scenario.area.cell_size_m
        inner = shapely.intersection(site.area, shapely.box(west + 0.5 * cell_m, south + 0.5 * cell_m, east, north))
        area = cast("shapely.Polygon | shapely.MultiPolygon", inner)
        self.coverage = CoverageMap(dataclasses.replace(site, area=area), cell_size_m=cell_m)
        if self.coverage.sight.line_of_sight == MIDPOINT:
            self.coverage.sight = self.coverage.sight._replace(line_of_sight=RAY)
        centres = self.coverage.grid.cells.centre_m[:, :2] - (west, south)
        sizes = (scenario.area.cell_size_m, scenario.planning_cell_size_m)
        self.held_out: BoolArray = ~np.logical_or.reduce([_is_centre(centres, size) for size in sizes])

    def coverage_of_coverable(self, route_m: FloatArray) -> float:
        """Coverage of the visible ground by an (n, 3) ENU route, 0..1."""
        weight_m2, counts = self.coverage.grid.weight_m2, self._coverable
        whole = float(weight_m2[counts].sum())
        return float(weight_m2[counts & self.coverage.observed(route_m)].sum()) / whole if whole > 0.0 else 0.0

    @cached_property
    def _coverable(self) -> BoolArray:
        return self.held_out & self.coverage.coverable


def _is_centre(positions_m: FloatArray, cell_m: float) -> BoolArray:
    """(n,) whether (n, 2) positions, counted from the lattice's corner, are centres of its cells."""
    at = positions_m / cell_m - 0.5
    return np.asarray((np.abs(at - np.round(at)) < _SAME_POSITION).all(axis=1))


CHOICES = ("rule", "asked", "max-coverage")
"""Ways to choose one route of a set: the scenario's rule, the shortest with the required coverage, the most coverage."""


@dataclass(frozen=True, slots=True)
class Point:
    """A member of a Pareto set: fraction of the coverable area on the area's cells, waypoints, length."""

    coverage: float
    waypoints: float
    length_m: float


@dataclass(frozen=True, slots=True)
class Chosen:
    """The route that was chosen from a set."""

    met: bool  # whether it has the required coverage
    coverage: float  # fraction of the visible ground, on the cells of the area
    hold_out: float  # the same on cells that no planner has used
    waypoints: int  # how many
    length_m: float  # of the open path
    violation: float  # sum over the limits of the scenario, at full length; 0 when all are kept
    made_by: str  # the algorithm, or the name of a baseline


@dataclass(frozen=True, slots=True)
class JudgedMoment:
    """A set of routes, judged."""

    at_s: float  # processor time that it took, by the plan of the run
    front: tuple[Point, ...]  # those that keep the limits and that no other dominates, by coverage
    chosen: dict[str, Chosen]  # by the names of CHOICES; empty when no route keeps the limits


class Judge:
    """Judges sets of routes of one case.

    Attributes:
        case: the scenario and its required coverage.
        site: its scenario on its ground.
    """

    def __init__(self, case: Case, site: Site) -> None:
        self.case = case
        self.site = site
        self._cells = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
        self._hold_out = HoldOut(site)

    def moment(self, at_s: float, routes: Sequence[NamedRoute]) -> tuple[JudgedMoment, RouteMember | None]:
        """The routes judged, and the one that the scenario's rule chooses."""
        members = [member for member in self.judged(routes) if member.violation <= 0.0]
        if not members:
            return JudgedMoment(at_s, (), {}), None
        pareto = pareto_members(members)
        rules = {
            "rule": self.case.rule,
            "asked": f"coverage>={self.case.required!r}",
            "max-coverage": "max-coverage",
        }
        choices = {name: select(pareto, parse_rule(rule)) for name, rule in rules.items()}
        fractions: dict[int, float] = {}
        for choice in choices.values():
            if choice.index not in fractions:
                fractions[choice.index] = self.hold_out(pareto[choice.index])
        chosen = {
            name: self._chosen(pareto[choice.index], fractions[choice.index], met=choice.met)
            for name, choice in choices.items()
        }
        front = tuple(
            Point(m.metrics.coverage_of_coverable, float(m.metrics.waypoint_count), m.metrics.path_length_m)
            for m in pareto
        )
        return JudgedMoment(at_s, front, chosen), pareto[choices["rule"].index]

    def hold_out(self, member: RouteMember) -> float:
        """Fraction of the visible ground, on the hold-out cells."""
        return self._hold_out.coverage_of_coverable(member.route.waypoints_m)

    def judged(self, routes: Sequence[NamedRoute]) -> list[RouteMember]:
        """Routes on the cells of the area, whether they keep the limits or not.

        Corners that break one are repaired first.

        So they are before the planner chooses: over 25 km² any set of lines has hundreds of such corners.
        """
        return judge_members(self._cells, [(with_sound_corners(self.site, route), origin) for route, origin in routes])

    def _chosen(self, member: RouteMember, hold_out: float, *, met: bool) -> Chosen:
        metrics = member.metrics
        return Chosen(
            met=met,
            coverage=metrics.coverage_of_coverable,
            hold_out=hold_out,
            waypoints=metrics.waypoint_count,
            length_m=metrics.path_length_m,
            violation=measure_violations(self.site, member.route.waypoints_m, margin_m=0.0).total,
            made_by=member.origin,
        )


def moment_document(moment: JudgedMoment) -> dict[str, Any]:
    """A moment for JSON."""
    return {
        "at_s": moment.at_s,
        "chosen": {name: asdict(chosen) for name, chosen in moment.chosen.items()},
        "front": [[p.coverage, p.waypoints, p.length_m] for p in moment.front],
    }


def read_moment(document: dict[str, Any]) -> JudgedMoment:
    """A moment from JSON."""
    return JudgedMoment(
        at_s=float(document["at_s"]),
        front=tuple(Point(*map(float, values)) for values in document["front"]),
        chosen={name: Chosen(**values) for name, values in document["chosen"].items()},
    )


def hypervolume_fraction(case: Case, front: Sequence[Point], *, from_coverage: float = 0.0) -> float:
    """Share 0..1 of the box between the reference point and the ideal one that is dominated.

    Ideal: all covered, no waypoint, length 0.

    Args:
        case: its reference point has the waypoints and the length.
        front: the set.
        from_coverage: the reference point's coverage.
    """
    if not front:
        return 0.0
    values = np.array(
        [
            [(1.0 - p.coverage) / (1.0 - from_coverage), p.waypoints / case.most_waypoints, p.length_m / case.longest_m]
            for p in front
        ]
    )
    return hypervolume(values, np.ones(3))
