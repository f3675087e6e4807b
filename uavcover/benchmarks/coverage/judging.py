"""What a set of routes is worth: on the cells of the area, and the chosen ones on the hold-out."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from uavcover.benchmarks.coverage.cases import Case
from uavcover.coverage.coverage_map import CoverageMap
from uavcover.coverage.hold_out import HoldOut
from uavcover.leg_checks import measure_violations
from uavcover.model.route import RouteMember
from uavcover.optimizers.indicators import hypervolume
from uavcover.planning.members import judge_members, pareto_members
from uavcover.planning.selection import parse_rule, select
from uavcover.planning.snapshots import NamedRoute
from uavcover.site import Site

CHOICES = ("rule", "asked", "max-coverage")
"""How one route of a set is chosen: by the scenario's rule, the shortest with the coverage asked for, by most coverage."""


@dataclass(frozen=True, slots=True)
class Point:
    """A member of a Pareto set: share of the coverable area on the area's cells, waypoints, length."""

    coverage: float
    waypoints: float
    length_m: float


@dataclass(frozen=True, slots=True)
class Chosen:
    """The route that was chosen from a set.

    Attributes:
        met: whether it has the coverage that was asked for.
        coverage: share of what is coverable, on the cells of the area.
        hold_out: likewise on cells that no planner has seen.
        waypoints: how many.
        length_m: of the open path.
        violation: sum over the limits of the scenario, at full length; 0 when all are kept.
        made_by: the algorithm, or the name of a baseline.
    """

    met: bool
    coverage: float
    hold_out: float
    waypoints: int
    length_m: float
    violation: float
    made_by: str


@dataclass(frozen=True, slots=True)
class Moment:
    """A set of routes, judged.

    Attributes:
        at_s: processor time that it took, by the plan of the run.
        front: those that keep the limits and that no other dominates, by coverage.
        chosen: by the names of CHOICES; empty when no route keeps the limits.
    """

    at_s: float
    front: tuple[Point, ...]
    chosen: dict[str, Chosen]


class Judge:
    """Judges sets of routes of one case.

    Attributes:
        case: what is asked for.
        site: its scenario on its ground.
    """

    def __init__(self, case: Case, site: Site) -> None:
        self.case = case
        self.site = site
        self._cells = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
        self._hold_out = HoldOut(site)

    def moment(self, at_s: float, routes: Sequence[NamedRoute]) -> tuple[Moment, RouteMember | None]:
        """The routes judged, and the one that the scenario's rule chooses."""
        members = [member for member in judge_members(self._cells, routes) if member.violation <= 0.0]
        if not members:
            return Moment(at_s, (), {}), None
        pareto = pareto_members(members)
        rules = {
            "rule": self.case.rule,
            "asked": f"coverage>={self.case.asked!r}",
            "max-coverage": "max-coverage",
        }
        choices = {name: select(pareto, parse_rule(rule)) for name, rule in rules.items()}
        shares: dict[int, float] = {}
        for choice in choices.values():
            if choice.index not in shares:
                shares[choice.index] = self.hold_out(pareto[choice.index])
        chosen = {
            name: self._chosen(pareto[choice.index], shares[choice.index], met=choice.met)
            for name, choice in choices.items()
        }
        front = tuple(
            Point(m.metrics.coverage_of_coverable, float(m.metrics.waypoint_count), m.metrics.path_length_m)
            for m in pareto
        )
        return Moment(at_s, front, chosen), pareto[choices["rule"].index]

    def hold_out(self, member: RouteMember) -> float:
        """Share of what is coverable, on the hold-out cells."""
        return self._hold_out.coverage_of_coverable(member.route.waypoints_m)

    def judged(self, routes: Sequence[NamedRoute]) -> list[RouteMember]:
        """Routes on the cells of the area, whether they keep the limits or not."""
        return judge_members(self._cells, routes)

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


def moment_document(moment: Moment) -> dict[str, Any]:
    """A moment for JSON."""
    return {
        "at_s": moment.at_s,
        "chosen": {name: asdict(chosen) for name, chosen in moment.chosen.items()},
        "front": [[p.coverage, p.waypoints, p.length_m] for p in moment.front],
    }


def read_moment(document: dict[str, Any]) -> Moment:
    """A moment from JSON."""
    return Moment(
        at_s=float(document["at_s"]),
        front=tuple(Point(*map(float, values)) for values in document["front"]),
        chosen={name: Chosen(**values) for name, values in document["chosen"].items()},
    )


def hypervolume_share(case: Case, front: Sequence[Point], *, from_coverage: float = 0.0) -> float:
    """Share 0..1 of the box between the reference point and the ideal one (all seen, no waypoint, no way) that is dominated.

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
