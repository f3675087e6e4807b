"""Tables and picture of the coverage benchmark, from the runs in its folder.

Tables are CSV and Markdown; the picture shows hypervolume, and length at the required coverage, over processor time.
"""

import datetime
import math
import statistics
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.extras.benchmarks.coverage.contenders import CONSTRUCTIONS, OURS, PLANNERS
from uavcover.extras.benchmarks.coverage.judging import CASES, CHOICES
from uavcover.extras.benchmarks.coverage.runs import EVALUATIONS, ONCE
from uavcover.extras.benchmarks.coverage.summary import (
    HIGH_COVERAGE,
    Outcomes,
    Sample,
    is_no_worse,
    known,
    ranks_markdown,
    read_outcomes,
)
from uavcover.extras.benchmarks.runs import KeptRuns, csv_text, drawn, markdown, write_texts


def draw(outcomes: Outcomes, path: Path) -> Path:
    """A column for each scenario; lines are means over the seeds, whiskers their extremes; returns the file."""
    scenarios = outcomes.scenarios
    with drawn(path, dpi=90) as plt:
        page, axes = plt.subplots(2, len(scenarios), figsize=(3.1 * len(scenarios) + 0.6, 5.6), squeeze=False)
        for column, scenario in enumerate(scenarios):
            _panel(axes[0, column], outcomes, scenario, lambda sample: sample.hypervolume())
            _panel(axes[1, column], outcomes, scenario, lambda sample: sample.asked_m)
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
            f"Required: {100 * case.asked:g} % of the visible ground; {text}. Rule of the planners: `{case.rule}`. Reference "
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
    asked = known([sample.asked_m for sample in samples])
    no_worse = sum(is_no_worse(sample.asked_m, best) for sample in samples)
    less = [1.0 - c.length_m / outcomes.boustrophedon_m(scenario, c.hold_out) for c in chosen]
    label = f"**{name}**" if name == OURS else name
    return [
        label, effort, str(len(samples)),
        _mean([100 * c.coverage for c in chosen], 2, worst=min), _mean([100 * c.hold_out for c in chosen], 2, worst=min),
        _mean([float(c.waypoints) for c in chosen], 1), _mean([c.length_m for c in chosen], 1, worst=max),
        _mean([100 * value for value in known(less)], 1, unit=" %"),
        f"{_mean(asked, 1)} ({len(asked)}/{len(samples)})" if asked else f"none (0/{len(samples)})",
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
            seen = f"{_mean(full, 1, worst=max)} ({len(full)}/{len(samples)})" if full else f"none (0/{len(samples)})"
            lines.append([name, effort, seen, _mean(forty, 2, worst=min)])
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
