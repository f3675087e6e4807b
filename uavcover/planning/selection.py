"""Selection of one route from a Pareto set by a named rule."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.dominance import non_dominated_mask
from uavcover.model.route import Route, RouteMember

PAPER_WEIGHTS = (0.6, 0.2, 0.2)

_WEIGHTED = re.compile(r"weighted(?::(?P<weights>[^:]+))?")
_COVERAGE = re.compile(r"coverage\s*>=\s*(?P<share>[0-9.eE+-]+)")
_INDEX = re.compile(r"index:(?P<index>\d+)")


@dataclass(frozen=True, slots=True)
class Choice:
    """The chosen member.

    Attributes:
        index: its number in the set.
        met: whether the rule could be met; False when the required coverage is out of reach and the best was taken.
    """

    index: int
    met: bool


@dataclass(frozen=True, slots=True)
class Rule:
    """A parsed rule: ``weighted[:w1,w2,w3]``, ``knee``, ``max-coverage``, ``coverage>=X`` or ``index:N``.

    Attributes:
        text: as it was written.
        kind: the word before the parameters.
        numbers: the parameters.
    """

    text: str
    kind: str
    numbers: tuple[float, ...] = ()

    @property
    def required_coverage(self) -> float | None:
        """The share of the coverable area that the rule asks for, if it asks for one."""
        return self.numbers[0] if self.kind == "coverage" else None


def parse_rule(text: str) -> Rule:
    """Parse a selection rule.

    Raises:
        InputError: it is none of the rules, or its numbers are out of range.
    """
    rule = text.strip()
    if rule in {"knee", "max-coverage"}:
        return Rule(rule, rule)
    if match := _WEIGHTED.fullmatch(rule):
        try:
            weights = tuple(float(w) for w in match["weights"].split(",")) if match["weights"] else PAPER_WEIGHTS
        except ValueError:
            weights = ()
        if len(weights) != 3 or min(weights, default=-1.0) < 0.0 or not 0.0 < sum(weights) < np.inf:
            raise InputError(f"select: {text!r} needs three weights, none negative, as in weighted:0.6,0.2,0.2")
        return Rule(rule, "weighted", weights)
    if match := _COVERAGE.fullmatch(rule):
        try:
            share = float(match["share"])
        except ValueError:
            share = -1.0
        if not 0.0 <= share <= 1.0:
            raise InputError(f"select: {text!r} needs a share between 0 and 1, as in coverage>=0.95")
        return Rule(rule, "coverage", (share,))
    if match := _INDEX.fullmatch(rule):
        return Rule(rule, "index", (float(match["index"]),))
    raise InputError(
        f"select: {text!r} is not a rule; use weighted[:w1,w2,w3], knee, max-coverage, coverage>=X or index:N"
    )


def select(members: Sequence[RouteMember], rule: Rule) -> Choice:
    """Choose by a rule; ties go to the lower number.

    ``weighted``: smallest weighted sum of the objectives, each brought to 0..1 over the set (the paper's section 5.3).
    ``knee``: nearest to the ideal point after the same scaling. Both look at whole routes: parts of them lie on a straight line
    to nothing, and would make a knee of what sees half. ``max-coverage``: most coverage, then least cost.
    ``coverage>=X``: the one of least cost (by default: the shortest) that reaches X of what is coverable; when none does, as
    ``max-coverage`` and not met.

    Raises:
        InputError: ``index`` outside the set, or an empty set.
    """
    if not members:
        raise InputError("select: the Pareto set is empty")
    coverage = np.array([member.metrics.coverage_of_coverable for member in members])
    cost = np.array([member.metrics.cost for member in members])
    if rule.kind == "index":
        index = int(rule.numbers[0])
        if index >= len(members):
            raise InputError(
                f"select: index:{index} is outside the set of {len(members)} members (0..{len(members) - 1})"
            )
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
"""Of few cells two more or fewer say nothing."""

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
