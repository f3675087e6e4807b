"""The runs of the coverage benchmark read back, their figures, and rank tests over them.

Is ours better than the other planners: rank-sum tests of the hypervolume, and Friedman's ranks over the scenarios.
"""

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uavcover.extras.benchmarks.coverage.contenders import CONSTRUCTIONS, CONTENDERS, OURS, PLANNERS, Tried, length_at
from uavcover.extras.benchmarks.coverage.judging import (
    CASES,
    Case,
    Chosen,
    JudgedMoment,
    hypervolume_share,
    read_moment,
)
from uavcover.extras.benchmarks.coverage.runs import CoverageRun, run_of_key
from uavcover.extras.benchmarks.rank_tests import compared, friedman
from uavcover.extras.benchmarks.runs import KeptRuns, markdown

HIGH_COVERAGE = 0.8
"""The second hypervolume counts only what sees more than this."""

_FULL = 1.0 - 1e-9
_SAME = 1.0 + 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class CoverageOutcome:
    """A run that is done."""

    run: CoverageRun  # which
    moments: tuple[JudgedMoment, ...]  # what it had when, ascending
    evaluations: int  # that it spent
    cpu_s: float  # processor time that planning took
    tried: tuple[Tried, ...]  # every boustrophedon of a scan


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """State of a run at a moment."""

    outcome: CoverageOutcome
    moment: JudgedMoment

    @property
    def case(self) -> Case:
        """The case with its required coverage."""
        return CASES[self.outcome.run.scenario]

    def hypervolume(self, *, from_coverage: float = 0.0) -> float:
        """Share of the box to the case's reference point that the set dominates."""
        return hypervolume_share(self.case, self.moment.front, from_coverage=from_coverage)

    def chosen(self, choice: str) -> Chosen | None:
        """The chosen route, none when nothing keeps the limits."""
        return self.moment.chosen.get(choice)

    @property
    def asked_m(self) -> float:
        """Length of the shortest route with the coverage asked for; NaN when none has it."""
        chosen = self.chosen("asked")
        return chosen.length_m if chosen is not None and chosen.met else math.nan

    @property
    def fewest_full(self) -> float:
        """Fewest waypoints that see everything; NaN when none do."""
        return min((p.waypoints for p in self.moment.front if p.coverage >= _FULL), default=math.nan)

    def most_with(self, waypoints: int) -> float:
        """Most coverage with at most ``waypoints`` waypoints; NaN when there is no such route."""
        return max((p.coverage for p in self.moment.front if p.waypoints <= waypoints), default=math.nan)


class Outcomes:
    """Everything that is done."""

    def __init__(self, outcomes: Iterable[CoverageOutcome]) -> None:
        self._all = list(outcomes)

    @cached_property
    def scenarios(self) -> list[str]:
        """Scenarios with runs, in our order."""
        return [name for name in CASES if any(o.run.scenario == name for o in self._all)]

    def contenders(self, scenario: str) -> list[str]:
        """Contenders with runs there, in our order."""
        return [
            name for name in CONTENDERS if any(o.run.algorithm == name for o in self._all if o.run.scenario == scenario)
        ]

    def every(self) -> list[Sample]:
        """Every moment of every run."""
        return [Sample(outcome, moment) for outcome in self._all for moment in outcome.moments]

    def at(self, scenario: str, algorithm: str, at_s: float) -> list[Sample]:
        """A contender's runs at a processor time, one for each seed: with that budget, else with a longer one."""
        best: dict[int, Sample] = {}
        for outcome in self._of(scenario, algorithm):
            budget = outcome.run.budget_s
            for moment in outcome.moments:
                if budget is None or moment.at_s != at_s:
                    continue
                before = best.get(outcome.run.number)
                if before is None or budget < (before.outcome.run.budget_s or math.inf):
                    best[outcome.run.number] = Sample(outcome, moment)
        return [best[number] for number in sorted(best)]

    def ended(self, scenario: str, algorithm: str, effort: str) -> list[Sample]:
        """A contender's runs of an effort, at their end."""
        found = [o for o in self._of(scenario, algorithm) if o.run.effort == effort]
        return [Sample(o, o.moments[-1]) for o in sorted(found, key=lambda o: o.run.number)]

    def best_baseline_m(self, scenario: str) -> float:
        """Length of the shortest baseline with the coverage asked for; NaN when none has it."""
        lengths = [sample.asked_m for name in CONSTRUCTIONS for sample in self.ended(scenario, name, "once")]
        return min((length for length in lengths if not math.isnan(length)), default=math.nan)

    def boustrophedon_m(self, scenario: str, hold_out: float) -> float:
        """Length of a boustrophedon with a hold-out coverage, interpolated between numbers of lines; NaN when unknown."""
        tried = [one for o in self._of(scenario, "boustrophedon-tuned") for one in o.tried]
        return length_at(tried, hold_out)

    def times_s(self) -> list[float]:
        """Every processor time that was looked at, ascending."""
        return sorted({m.at_s for o in self._all if o.run.budget_s is not None for m in o.moments})

    def _of(self, scenario: str, algorithm: str) -> list[CoverageOutcome]:
        return [o for o in self._all if (o.run.scenario, o.run.algorithm) == (scenario, algorithm)]


def read_outcomes(folder: KeptRuns) -> Outcomes:
    """Every run in a folder. Raises InputError: the file of a run cannot be read."""
    found = []
    for key in folder.done():
        document = folder.read(key)
        found.append(
            CoverageOutcome(
                run_of_key(key),
                tuple(read_moment(moment) for moment in document["moments"]),
                int(document["evaluations"]),
                float(document["cpu_s"]),
                tuple(Tried(**one) for one in document["tried"]),
            )
        )
    return Outcomes(found)


def is_no_worse(length_m: float, baseline_m: float) -> bool:
    """Whether a length is no longer than the best baseline's; where no baseline has the coverage, any length is."""
    return not math.isnan(length_m) and (math.isnan(baseline_m) or length_m <= baseline_m * _SAME)


def known(values: Sequence[float]) -> list[float]:
    """The values that are numbers."""
    return [value for value in values if not math.isnan(value)]


def ranks_markdown(outcomes: Outcomes) -> str:
    """Both tables for every processor time that has enough runs of all; empty when none has."""
    parts = [
        _at(outcomes, at_s, label, from_coverage)
        for at_s in outcomes.times_s()
        for label, from_coverage in (("HV", 0.0), ("HV80", HIGH_COVERAGE))
    ]
    return "\n".join(part for part in parts if part)


def _at(outcomes: Outcomes, at_s: float, label: str, from_coverage: float) -> str:
    lines, table = [], []
    for scenario in outcomes.scenarios:
        samples = {name: outcomes.at(scenario, name, at_s) for name in PLANNERS}
        values = {name: _volumes(found, from_coverage) for name, found in samples.items() if len(found) >= 2}
        rivals = [(name, volumes) for name, volumes in values.items() if name != OURS]
        if OURS not in values or not rivals:
            continue
        outcome = {one.rival: one for one in compared(values[OURS], rivals, better="more")}
        cells = [
            f"{outcome[name].outcome} ({outcome[name].p_holm:.2g})" if name in outcome else "" for name in PLANNERS[1:]
        ]
        lines.append([scenario, *cells])
        if len(values) == len(PLANNERS):
            table.append([statistics.mean(values[name].tolist()) for name in PLANNERS])
    if not lines:
        return ""
    text = [
        f"## {label} at {at_s:g} s: {OURS} against the others\n",
        "Rank-sum tests; p, adjusted by Holm within a scenario, in brackets; a tie when p is 0.05 or more.\n",
        markdown(["scenario", *PLANNERS[1:]], lines) + "\n",
    ]
    if table:
        ranks = friedman(table, better="more")
        text.append(
            f"Mean ranks over {len(table)} scenario(s), 1 is best: "
            + ", ".join(f"{name} {rank:.2f}" for name, rank in zip(PLANNERS, ranks.ranks, strict=True))
            + (f"; Friedman's p {ranks.p:.2g}" if np.isfinite(ranks.p) else "")
            + ".\n"
        )
    return "\n".join(text)


def _volumes(samples: list[Sample], from_coverage: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([sample.hypervolume(from_coverage=from_coverage) for sample in samples])
