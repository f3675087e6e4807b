"""Selection of one route from a Pareto set by a named rule, with conditions on how it would be flown."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.dominance import non_dominated_mask
from uavcover.model.route import MissionSize, Route, RouteMember

PAPER_WEIGHTS = (0.6, 0.2, 0.2)

_WEIGHTED = re.compile(r"weighted(?::(?P<weights>[^:]+))?")
_COVERAGE = re.compile(r"coverage\s*>=\s*(?P<share>[0-9.eE+-]+)")
_INDEX = re.compile(r"index:(?P<index>\d+)")
_CONDITION = re.compile(r",?\s*(?P<what>[a-z-]+)\s*<=\s*(?P<limit>[^,<>]*)$")
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}


@dataclass(frozen=True, slots=True)
class Choice:
    """The chosen member."""

    index: int  # its number in the set
    met: bool  # whether the rule could be met; False when the required coverage is out of reach and the best was taken


@dataclass(frozen=True, slots=True)
class Condition:
    """Limit on the mission of a route: ``sorties<=N``, ``vehicles<=N`` or ``done<=TIME``."""

    what: str  # sorties, vehicles or done (from the first take-off to the last landing)
    most: float  # a number, or seconds

    def excess(self, size: MissionSize | None) -> float:
        """Excess of a mission over its limit, as a share of it; infinite without a mission."""
        if size is None:
            return math.inf
        value = {"sorties": size.sorties, "vehicles": size.vehicles, "done": size.makespan_s}[self.what]
        return max(0.0, value / self.most - 1.0)


@dataclass(frozen=True, slots=True)
class Rule:
    """A parsed rule: ``weighted[:w1,w2,w3]``, ``knee``, ``max-coverage``, ``coverage>=X`` or ``index:N``, and conditions."""

    text: str  # as it was written
    kind: str  # the word before the parameters
    numbers: tuple[float, ...] = ()  # the parameters
    conditions: tuple[Condition, ...] = ()  # on how the route would be flown; known once it is cut into sorties

    @property
    def required_coverage(self) -> float | None:
        """The share of the coverable area that the rule asks for, if it asks for one."""
        return self.numbers[0] if self.kind == "coverage" else None


def parse_rule(text: str) -> Rule:
    """Parse a selection rule, such as ``coverage>=0.98,sorties<=3,done<=40m``; conditions alone are those of ``max-coverage``.

    Raises:
        InputError: it is none of the rules, or its numbers are out of range.
    """
    rest, conditions = text.strip(), list[Condition]()
    while match := _CONDITION.search(rest):
        conditions.insert(0, _condition(match["what"], match["limit"].strip(), text))
        rest = rest[: match.start()].rstrip()
    if not conditions:
        return _parse_choice(rest)
    names = [condition.what for condition in conditions]
    if len(set(names)) < len(names):
        raise InputError(f"select: {text!r} has two conditions of the same kind; keep only the stricter one")
    choice = _parse_choice(rest or "max-coverage")
    if choice.kind == "index":
        raise InputError(f"select: {text!r} selects a single route; remove the conditions")
    return replace(choice, text=text.strip(), conditions=tuple(conditions))


def _condition(what: str, limit: str, text: str) -> Condition:
    if what not in {"sorties", "vehicles", "done"}:
        raise InputError(f"select: {text!r}: unknown condition {what!r}; use sorties<=N, vehicles<=N or done<=TIME")
    number, unit = (limit[:-1], limit[-1]) if what == "done" and limit[-1:] in _SECONDS else (limit, "s")
    try:
        most = float(number) * _SECONDS[unit]
    except ValueError:
        most = -1.0
    if not 0.0 < most < math.inf or (what != "done" and not most.is_integer()):
        example = "a time such as 40m, 1200s or 1.5h" if what == "done" else "a whole number of at least 1"
        raise InputError(f"select: {text!r}: {what}<= requires {example}")
    return Condition(what, most)


def _parse_choice(text: str) -> Rule:
    """A rule without its conditions."""
    rule = text.strip()
    if rule in {"knee", "max-coverage"}:
        return Rule(rule, rule)
    if match := _WEIGHTED.fullmatch(rule):
        try:
            weights = tuple(float(w) for w in match["weights"].split(",")) if match["weights"] else PAPER_WEIGHTS
        except ValueError:
            weights = ()
        if len(weights) != 3 or min(weights, default=-1.0) < 0.0 or not 0.0 < sum(weights) < np.inf:
            raise InputError(f"select: {text!r} requires three weights of at least 0, such as weighted:0.6,0.2,0.2")
        return Rule(rule, "weighted", weights)
    if match := _COVERAGE.fullmatch(rule):
        try:
            share = float(match["share"])
        except ValueError:
            share = -1.0
        if not 0.0 <= share <= 1.0:
            raise InputError(f"select: {text!r} requires a fraction between 0 and 1, such as coverage>=0.95")
        return Rule(rule, "coverage", (share,))
    if match := _INDEX.fullmatch(rule):
        return Rule(rule, "index", (float(match["index"]),))
    raise InputError(
        f"select: unknown rule {text!r}; use weighted[:w1,w2,w3], knee, max-coverage, coverage>=X or index:N, "
        "followed by conditions (,sorties<=N ,vehicles<=N ,done<=TIME)"
    )


def select(members: Sequence[RouteMember], rule: Rule) -> Choice:
    """Choose by a rule; ties go to the lower number.

    ``weighted``: smallest weighted sum of the objectives, each brought to 0..1 over the set (the paper's section 5.3).
    ``knee``: nearest to the ideal point after the same scaling. Both look at whole routes: parts of them lie on a straight line
    to nothing, and would make a knee of what sees half. ``max-coverage``: most coverage, then least cost.
    ``coverage>=X``: the one of least cost (by default: the shortest) that reaches X of what is coverable; when none does, as
    ``max-coverage`` and not met. Conditions are not looked at: :func:`select_flown` does.

    Raises:
        InputError: ``index`` outside the set, or an empty set.
    """
    return _select(members, rule, [member.metrics.cost for member in members])


def select_flown(members: Sequence[RouteMember], rule: Rule, *, soonest: bool) -> Choice:
    """Choose by a rule with its conditions among members whose missions are known.

    Only members that keep all conditions are looked at; when none does, the one that exceeds them least, and not met.

    Args:
        members: one without a mission keeps no condition.
        rule: as :func:`select` takes it.
        soonest: whether the cost of a route is when all vehicles are done with it.

    Raises:
        InputError: ``index`` outside the set, or an empty set.
    """
    excess = [math.fsum(each.excess(member.mission) for each in rule.conditions) for member in members]
    fewest = min(excess, default=0.0)
    kept = [k for k, more in enumerate(excess) if more <= fewest]
    cost = [members[k].metrics.cost for k in kept]
    if soonest:
        sizes = [members[k].mission for k in kept]
        cost = [math.inf if size is None else size.makespan_s for size in sizes]
    choice = _select([members[k] for k in kept], rule, cost)
    return Choice(kept[choice.index], met=choice.met and fewest == 0.0)


def _select(members: Sequence[RouteMember], rule: Rule, costs: Sequence[float]) -> Choice:
    if not members:
        raise InputError("select: the Pareto set is empty")
    coverage = np.array([member.metrics.coverage_of_coverable for member in members])
    cost = np.array(costs)
    if rule.kind == "index":
        index = int(rule.numbers[0])
        if index >= len(members):
            raise InputError(f"select: index:{index} does not exist; the set has the members 0 to {len(members) - 1}")
        return Choice(index, met=True)
    if rule.kind == "coverage":
        enough = np.flatnonzero(coverage >= rule.numbers[0])
        if enough.size:
            return Choice(int(enough[np.lexsort((-coverage[enough], cost[enough]))[0]]), met=True)
    if rule.kind in {"coverage", "max-coverage"}:
        return Choice(int(np.lexsort((cost, -coverage))[0]), met=rule.kind == "max-coverage")
    whole = [k for k, member in enumerate(members) if not member.is_part] or list(range(len(members)))
    scaled = _scaled([members[k] for k in whole])
    worth = scaled @ np.array(rule.numbers) if rule.kind == "weighted" else (scaled**2).sum(axis=1)
    return Choice(whole[int(np.argmin(worth))], met=True)


_FLUKE = 0.0015
_FLUKE_OF_GOAL = 0.0004
"""Share of the coverage that other cells may see less, and what may be missing of a required one: cells are a sample."""

_FLUKE_CELLS = 2.0
"""Of few cells two more or fewer do not matter."""

_MOST_TRIES = 40


def without_flukes(
    members: Sequence[RouteMember], rule: Rule, elsewhere: Callable[[Route], float], *, cells: int
) -> list[RouteMember]:
    """The members without those that a rule would choose for luck: other cells see less of them.

    Among many routes that just reach a coverage, the cheapest is likely to be one that its cells flatter. Only what the rule
    would choose is looked at, until one is confirmed; when none is, the one that lacks least stays.

    Args:
        members: feasible; one at least.
        rule: by which one of those that nothing dominates will be chosen.
        elsewhere: share of what can be covered that a route sees on other cells.
        cells: how many the members were judged on.
    """
    few = _FLUKE_CELLS / cells
    left, flukes, met_before = list(members), list[tuple[float, RouteMember]](), False
    while left and len(flukes) < _MOST_TRIES:
        values = np.array([[-m.metrics.coverage_of_coverable, m.metrics.waypoint_count, m.metrics.cost] for m in left])
        front = [left[k] for k in np.flatnonzero(non_dominated_mask(values, np.zeros(len(left))))]
        choice = select(front, rule)
        chosen = front[choice.index]
        met_before = choice.met if not flukes else met_before
        if rule.kind == "index" or (met_before and not choice.met):
            break
        seen, asked = chosen.metrics.coverage_of_coverable, rule.required_coverage
        least = seen - max(_FLUKE, few)
        if asked is not None and choice.met:
            least = max(asked - max(_FLUKE_OF_GOAL, few), least - _FLUKE)
        lacking = least - elsewhere(chosen.route)
        if lacking <= 0.0:
            return left
        flukes.append((lacking, chosen))
        left = [member for member in left if member is not chosen]
    # None is confirmed: the best of what was looked at, with all that the rule would not choose before it.
    best = min(flukes, key=lambda each: each[0])[1] if flukes else None
    return [member for member in members if member is best or all(member is not each for _, each in flukes)]


def _scaled(members: Sequence[RouteMember]) -> FloatArray:
    """(n, 3) objectives, all minimised, brought to 0..1 over the set; 0 where the set has no spread."""
    values = np.array([[-m.metrics.coverage_of_coverable, m.metrics.waypoint_count, m.metrics.cost] for m in members])
    spread = np.ptp(values, axis=0)
    return np.asarray((values - values.min(axis=0)) / np.where(spread > 0.0, spread, 1.0))
