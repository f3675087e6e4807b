"""Figures, rank tests, tables and picture of the coverage benchmark, from the runs in its folder.

Is ours better than the other planners: rank-sum tests of the hypervolume, and Friedman's ranks over the scenarios. Tables are CSV
and Markdown; the picture shows hypervolume, and length at the required coverage, over processor time.
"""

import datetime
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.extras.benchmarks.coverage.judging import (
    CASES,
    CHOICES,
    Case,
    Chosen,
    JudgedMoment,
    hypervolume_fraction,
    read_moment,
)
from uavcover.extras.benchmarks.coverage.runs import (
    CONSTRUCTIONS,
    CONTENDERS,
    EVALUATIONS,
    ONCE,
    OURS,
    PLANNERS,
    CoverageRun,
    Tried,
    length_at,
    run_of_key,
)
from uavcover.extras.benchmarks.rank_tests import compared, friedman
from uavcover.extras.benchmarks.runs import KeptRuns, csv_text, drawn, markdown, write_texts

HIGH_COVERAGE = 0.8
"""The second hypervolume counts only what observes more than this."""

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
        """Fraction of the box to the case's reference point that the set dominates."""
        return hypervolume_fraction(self.case, self.moment.front, from_coverage=from_coverage)

    def chosen(self, choice: str) -> Chosen | None:
        """The chosen route, None when nothing keeps the limits."""
        return self.moment.chosen.get(choice)

    @property
    def required_m(self) -> float:
        """Length of the shortest route with the coverage asked for; NaN when none has it."""
        chosen = self.chosen("asked")
        return chosen.length_m if chosen is not None and chosen.met else math.nan

    @property
    def fewest_full(self) -> float:
        """Fewest waypoints that observe everything; NaN when none do."""
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
        lengths = [sample.required_m for name in CONSTRUCTIONS for sample in self.ended(scenario, name, "once")]
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


def draw(outcomes: Outcomes, path: Path) -> Path:
    """A column for each scenario; lines are means over the seeds, whiskers their extremes; returns the file."""
    scenarios = outcomes.scenarios
    with drawn(path, dpi=90) as plt:
        page, axes = plt.subplots(2, len(scenarios), figsize=(3.1 * len(scenarios) + 0.6, 5.6), squeeze=False)
        for column, scenario in enumerate(scenarios):
            _panel(axes[0, column], outcomes, scenario, lambda sample: sample.hypervolume())
            _panel(axes[1, column], outcomes, scenario, lambda sample: sample.required_m)
            axes[0, column].set_title(scenario, fontsize=9)
            axes[1, column].set_xlabel("processor time, s", fontsize=8)
        axes[0, 0].set_ylabel("hypervolume (more is better)", fontsize=8)
        axes[1, 0].set_ylabel("length at the required coverage\n(less is better; missing: not reached)", fontsize=8)
        entries = {
            label: line for axis in axes.flat for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
        }
        page.legend(entries.values(), entries.keys(), loc="lower center", ncol=len(entries) or 1, fontsize=8)
        page.tight_layout(rect=(0.0, 0.06, 1.0, 1.0))
    return path


def _panel(axis: Any, outcomes: Outcomes, scenario: str, value: Callable[[Sample], float]) -> None:
    for number, name in enumerate(PLANNERS):
        at, low, mean, high = [], [], [], []
        for at_s in outcomes.times_s():
            values = known([value(sample) for sample in outcomes.at(scenario, name, at_s)])
            if values:
                at.append(at_s * 1.04 ** (number - 2))  # side by side
                low.append(min(values))
                mean.append(mean_between(values))
                high.append(max(values))
        if at:
            middle = np.array(mean)
            whiskers = [middle - low, np.array(high) - middle]
            axis.errorbar(
                at, middle, yerr=whiskers, fmt="o-", markersize=3.5, capsize=2.0, color=f"C{number}", label=name
            )
    for baseline, style in zip(CONSTRUCTIONS, ("-", "--", ":", "-.", (0, (1, 3))), strict=False):
        samples = outcomes.ended(scenario, baseline, ONCE)
        if samples and not math.isnan(value(samples[0])):
            axis.axhline(value(samples[0]), color="0.4", linestyle=style, linewidth=0.9, label=baseline)
    if times_s := outcomes.times_s():
        axis.set_xscale("log")
        axis.set_xticks(times_s, [f"{at_s:g}" for at_s in times_s])
        axis.set_xticks([], minor=True)
    axis.tick_params(labelsize=7)


def mean_between(values: Sequence[float]) -> float:
    """The mean, kept within the smallest and the largest: the mean of equal values may round beyond them."""
    return min(max(float(np.mean(values)), min(values)), max(values))


_COLUMNS = (
    "scenario", "algorithm", "effort", "run", "at_s", "choice", "met", "coverage", "hold_out", "waypoints", "length_m",
    "violation", "made_by", "boustrophedon_m", "best_baseline_m", "members", "hypervolume", "hypervolume_80",
    "fewest_full", "coverage_40", "evaluations", "cpu_s",
)  # fmt: skip

_FORTY = 40


def runs_csv(outcomes: Outcomes) -> str:
    """``runs.csv``: a row for each choice of each moment of each run; unrounded."""
    rows = []
    for sample in outcomes.every():
        run = sample.outcome.run
        volumes = (sample.hypervolume(), sample.hypervolume(from_coverage=HIGH_COVERAGE))
        for choice in CHOICES:
            chosen = sample.chosen(choice)
            if chosen is None:
                figures: tuple[object, ...] = (False, *[""] * 7)
            else:
                equal_m = outcomes.boustrophedon_m(run.scenario, chosen.hold_out)
                figures = (
                    chosen.met, chosen.coverage, chosen.hold_out, chosen.waypoints, chosen.length_m, chosen.violation,
                    chosen.made_by, equal_m,
                )  # fmt: skip
            rows.append(
                [
                    run.scenario, run.algorithm, run.effort, run.number, sample.moment.at_s, choice, *figures,
                    outcomes.best_baseline_m(run.scenario), len(sample.moment.front), *volumes, sample.fewest_full,
                    sample.most_with(_FORTY), sample.outcome.evaluations, sample.outcome.cpu_s,
                ]
            )  # fmt: skip
    return csv_text(_COLUMNS, rows)


def tables_markdown(outcomes: Outcomes, *, version: str, command: str, date: str) -> str:
    """``table.md``: every scenario at every processor time, at equal evaluations, and the tests."""
    parts = [
        "# Coverage: planners and baselines\n",
        f"`{command}`, {date}, uavcover {version}. {_EXPLANATION}\n",
    ]
    for scenario in outcomes.scenarios:
        case = CASES[scenario]
        best = outcomes.best_baseline_m(scenario)
        text = "no baseline has it" if math.isnan(best) else f"the best baseline has it with {best:,.1f}"
        parts += [
            f"## {scenario}\n",
            f"Required: {100 * case.required:g} % of the visible ground; {text}. Rule of the planners: `{case.rule}`. Reference "
            f"point: no coverage, {case.most_waypoints:g} waypoints, length {case.longest_m:,.0f}.\n",
            _scenario(outcomes, scenario),
        ]
        if scenario.startswith("paper"):
            parts.append(_counts(outcomes, scenario))
    parts.append(ranks_markdown(outcomes))
    return "\n".join(parts)


_EXPLANATION = (
    "Every run has one core and one thread; time is its own processor time, because the machine is shared, and holds for all "
    "that ours does, for the others without the judging of what they found. Means over the seeds, in brackets the worst. "
    "Hold-out: cells of "
    "half the size, shifted by half of one, none of them a cell that a planner counted on; exact rays. Lengths in metres (in "
    "the paper's units on its scenarios). Ours is `memetic`; of the others only what they found themselves counts, from the "
    "same constructed beginnings. *asked*: the shortest route with the required coverage, on the area's cells, and in how "
    "many of the runs there is one; *no worse*: in how many of the runs it is no longer than the best baseline. *less*: how "
    "much shorter than a tuned boustrophedon of the same hold-out coverage, interpolated between numbers of lines, the route "
    "is that the rule chooses. HV: share of the box between reference point and ideal that is dominated; HV80: the same above "
    "80 % coverage. *broken*: sum over the limits, at full length."
)

_HEADER = [
    "contender", "effort", "runs", "coverage", "hold-out", "waypoints", "length", "less", "asked", "no worse", "HV", "HV80",
    "broken",
]  # fmt: skip


def _scenario(outcomes: Outcomes, scenario: str) -> str:
    lines = []
    for name in outcomes.contenders(scenario):
        if name in CONSTRUCTIONS:
            lines.append(_line(outcomes, scenario, name, "once", outcomes.ended(scenario, name, ONCE)))
    for at_s in outcomes.times_s():
        for name in PLANNERS:
            lines.append(_line(outcomes, scenario, name, f"{at_s:g} s", outcomes.at(scenario, name, at_s)))
    for name in PLANNERS:
        samples = outcomes.ended(scenario, name, EVALUATIONS)
        effort = f"{samples[0].outcome.evaluations:,} evaluations" if samples else ""
        lines.append(_line(outcomes, scenario, name, effort, samples))
    return markdown(_HEADER, [line for line in lines if line]) + "\n"


def _line(outcomes: Outcomes, scenario: str, name: str, effort: str, samples: Sequence[Sample]) -> list[str]:
    if not samples:
        return []
    chosen = [route for sample in samples if (route := sample.chosen("rule")) is not None]
    best = outcomes.best_baseline_m(scenario)
    required = known([sample.required_m for sample in samples])
    no_worse = sum(is_no_worse(sample.required_m, best) for sample in samples)
    less = [1.0 - c.length_m / outcomes.boustrophedon_m(scenario, c.hold_out) for c in chosen]
    label = f"**{name}**" if name == OURS else name
    return [
        label, effort, str(len(samples)),
        _mean([100 * c.coverage for c in chosen], 2, worst=min), _mean([100 * c.hold_out for c in chosen], 2, worst=min),
        _mean([float(c.waypoints) for c in chosen], 1), _mean([c.length_m for c in chosen], 1, worst=max),
        _mean([100 * value for value in known(less)], 1, unit=" %"),
        f"{_mean(required, 1)} ({len(required)}/{len(samples)})" if required else f"none (0/{len(samples)})",
        f"{no_worse}/{len(samples)}",
        _mean([sample.hypervolume() for sample in samples], 4),
        _mean([sample.hypervolume(from_coverage=HIGH_COVERAGE) for sample in samples], 4),
        f"{max((c.violation for c in chosen), default=math.nan):g}",
    ]  # fmt: skip


def _counts(outcomes: Outcomes, scenario: str) -> str:
    """The figures that the paper's scenarios are judged by: waypoints for everything, coverage with 40."""
    lines = []
    rows: list[tuple[str, str, list[Sample]]] = [
        (name, "once", outcomes.ended(scenario, name, ONCE)) for name in CONSTRUCTIONS
    ]
    rows += [(name, f"{t:g} s", outcomes.at(scenario, name, t)) for t in outcomes.times_s() for name in PLANNERS]
    for name, effort, samples in rows:
        if samples:
            full = known([sample.fewest_full for sample in samples])
            forty = known([100 * sample.most_with(_FORTY) for sample in samples])
            full_m = f"{_mean(full, 1, worst=max)} ({len(full)}/{len(samples)})" if full else f"none (0/{len(samples)})"
            lines.append([name, effort, full_m, _mean(forty, 2, worst=min)])
    return (
        markdown(["contender", "effort", "fewest for full coverage", f"most coverage with {_FORTY}, %"], lines) + "\n"
    )


def _mean(
    values: Sequence[float], digits: int, *, worst: Callable[[Sequence[float]], float] | None = None, unit: str = ""
) -> str:
    if not values:
        return "-"
    text = f"{statistics.mean(values):.{digits}f}{unit}"
    return text if worst is None or len(values) == 1 else f"{text} ({worst(values):.{digits}f})"


def write_results(folder: KeptRuns, *, command: str) -> list[Path]:
    """Write runs.csv, table.md and coverage.png about all runs in the folder; return the files.

    Raises:
        InputError: the file of a run cannot be read.
        OutputError: a file cannot be written.
    """
    outcomes = read_outcomes(folder)
    date = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    texts = {
        "runs.csv": runs_csv(outcomes),
        "table.md": tables_markdown(outcomes, version=version("uavcover"), command=command, date=date),
    }
    files = write_texts(folder.path, texts)
    if outcomes.scenarios:
        files.append(draw(outcomes, folder.path / "coverage.png"))
    return files
