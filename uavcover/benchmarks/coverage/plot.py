"""One picture of the benchmark: hypervolume, and length at the coverage asked for, over processor time."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uavcover.benchmarks.coverage.contenders import CONSTRUCTIONS, PLANNERS
from uavcover.benchmarks.coverage.runs import ONCE
from uavcover.benchmarks.coverage.summary import Outcomes, Sample, known


def draw(outcomes: Outcomes, path: Path) -> Path:
    """A column for each scenario; lines are means over the seeds, whiskers their extremes; returns the file."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    scenarios = outcomes.scenarios
    page, axes = plt.subplots(2, len(scenarios), figsize=(3.1 * len(scenarios) + 0.6, 5.6), squeeze=False)
    try:
        for column, scenario in enumerate(scenarios):
            _panel(axes[0, column], outcomes, scenario, lambda sample: sample.hypervolume())
            _panel(axes[1, column], outcomes, scenario, lambda sample: sample.asked_m)
            axes[0, column].set_title(scenario, fontsize=9)
            axes[1, column].set_xlabel("processor time, s", fontsize=8)
        axes[0, 0].set_ylabel("hypervolume (more is better)", fontsize=8)
        axes[1, 0].set_ylabel("length at the coverage asked for\n(less is better; missing: not reached)", fontsize=8)
        entries = {
            label: line for axis in axes.flat for line, label in zip(*axis.get_legend_handles_labels(), strict=True)
        }
        page.legend(entries.values(), entries.keys(), loc="lower center", ncol=len(entries) or 1, fontsize=8)
        page.tight_layout(rect=(0.0, 0.06, 1.0, 1.0))
        page.savefig(path, dpi=90)
    finally:
        plt.close(page)
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
    """The mean, never beside the smallest and the largest: that of equal values may round to there, and has no whiskers then."""
    return min(max(float(np.mean(values)), min(values)), max(values))
