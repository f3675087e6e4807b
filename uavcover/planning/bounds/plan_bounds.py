"""The bounds of a plan: how few waypoints, how much coverage, how short a path there can be, beside what was found."""

from collections.abc import Callable

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.kernels.sight import horizontal_reach
from uavcover.model.bounds import Bound
from uavcover.model.route import Plan, RouteMember
from uavcover.planning.bounds.path_length import least_path_length_m
from uavcover.planning.selection import parse_rule
from uavcover.planning.set_cover.candidates import finest_lattice_candidates
from uavcover.planning.set_cover.programs import CoverProgram, SolverEffort
from uavcover.planning.set_cover.reduced import reduce

SPACING_CELLS = 0.5
MOST_PLACES = 20_000
"""The finest lattice on which a bound is proved."""

QUICK_PAIRS = 500_000
"""Places times cells in reach, up to which the linear relaxation is a matter of a second and done without being asked."""

_MET = 1e-9
_ANYWHERE = "any path inside the height band"


def path_bounds(coverage: CoverageMap, plan: Plan) -> list[Bound]:
    """The shortest path that sees what is asked; for sensors that look along the path.

    Args:
        coverage: on the cells by which routes are judged.
        plan: the routes.
    """
    if coverage.site.scenario.sensor.sensing != "along-path":
        return []
    share = _asked(plan)
    lengths = [m.metrics.path_length_m for m in _feasible(plan) if m.metrics.coverage_of_coverable >= share - _MET]
    limit = least_path_length_m(coverage, share)
    return [
        Bound("shortest_path_m", share, limit, min(lengths, default=None), _ANYWHERE, "area within reach of a curve")
    ]


def are_quick(coverage: CoverageMap) -> bool:
    """Whether the linear relaxations on the lattice are a matter of a second."""
    cells = coverage.grid.cells
    across = 2.0 * horizontal_reach(coverage.sight) / (SPACING_CELLS * cells.size_m)
    return min(coverage.grid.count * across * across, MOST_PLACES * (SPACING_CELLS * across) ** 2) <= QUICK_PAIRS


def waypoint_bounds(coverage: CoverageMap, plan: Plan, effort: SolverEffort) -> list[Bound]:
    """Fewest waypoints and most coverage on a lattice; for sensors that look from waypoints.

    Args:
        coverage: on the cells by which routes are judged.
        plan: the routes.
        effort: for each question. With no nodes the linear relaxation alone, which is equal for equal plans; otherwise branch
            and bound, and the better of both.
    """
    if coverage.site.scenario.sensor.sensing != "at-waypoints":
        return []
    spacing_m = SPACING_CELLS * coverage.grid.cells.size_m
    candidates = finest_lattice_candidates(coverage, spacing_m=spacing_m, most=MOST_PLACES)
    program = CoverProgram(reduce(candidates))
    share = min(_asked(plan), program.reachable)
    count = plan.chosen.metrics.waypoint_count
    counts = [m.metrics.waypoint_count for m in _feasible(plan) if m.metrics.coverage_of_coverable >= share - _MET]
    seen = [m.metrics.coverage_of_coverable for m in _feasible(plan) if m.metrics.waypoint_count <= count]
    fewest = _best_proof(max, lambda e: program.fewest_places(share, e).bound, effort)
    most = _best_proof(min, lambda e: program.most_coverage(count, e).bound, effort)
    bounds = []
    if fewest is not None:
        bounds.append(
            Bound("fewest_waypoints", share, fewest[0], min(counts, default=None), candidates.in_words, fewest[1])
        )
    if most is not None:
        bounds.append(Bound("most_coverage", count, most[0], max(seen, default=None), candidates.in_words, most[1]))
    return bounds


def _best_proof(
    tighter: Callable[..., tuple[float, str]], ask: Callable[[SolverEffort], float | None], effort: SolverEffort
) -> tuple[float, str] | None:
    """The tighter of the relaxation's limit and that of branch and bound, with its name; none when neither came to an end."""
    proofs = [(ask(SolverEffort(time_s=effort.time_s, nodes=0)), "linear relaxation")]
    if effort.nodes != 0:
        proofs.append((ask(effort), "branch and bound"))
    known = [(limit, method) for limit, method in proofs if limit is not None]
    return tighter(known, key=lambda proof: proof[0]) if known else None


def _asked(plan: Plan) -> float:
    """The share of what can be covered that the rule asks for; all where it asks for none."""
    asked = parse_rule(plan.rule).required_coverage
    return 1.0 if asked is None else asked


def _feasible(plan: Plan) -> list[RouteMember]:
    return [member for member in (*plan.members, *plan.baselines) if member.violation <= 0.0]
