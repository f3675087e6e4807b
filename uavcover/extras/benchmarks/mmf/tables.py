"""Tables of the MMF benchmark as Markdown and CSV: the paper's Tables 3 and 4, wins, ranks, fidelity, ablation.

Beside our figures stand those that the paper reports, and the highest PSP that was found for a set of 200 points.
"""

import csv
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, reference_sets
from uavcover.extras.benchmarks.mmf.runs import (
    FLOOR,
    METRICS,
    Budget,
    MmfFolder,
    RunId,
    Samples,
    figure,
    measured,
    runs_csv,
    summary_csv,
    table_order,
)
from uavcover.extras.benchmarks.rank_tests import Comparison, compared, friedman
from uavcover.extras.benchmarks.runs import csv_text, drawn, markdown, write_texts


@dataclass(frozen=True, slots=True)
class Published:
    """A figure of the paper."""

    mean: float  # over 10 runs
    std: float  # the standard deviation; NaN without one


@cache
def published() -> MappingProxyType[tuple[str, str, str], Published]:
    """(metric, function, algorithm) -> figure, for IGD and PSP and the seven algorithms of the paper.

    Algorithm ``ceiling`` (PSP only) is no algorithm but the highest PSP that was found by optimizing 200 points against the
    reference set itself, with an IGD no worse than the paper's IMODBO: a search result, not a proof.
    """
    text = files("uavcover").joinpath("data", "paper_mmf.csv").read_text(encoding="utf-8")
    return MappingProxyType(
        {
            (row["metric"], row["function"], row["algorithm"]): Published(
                float(row["mean"]), float(row["std"] or "nan")
            )
            for row in csv.DictReader(text.splitlines())
        }
    )


PAPER = ("nsga2", "moead", "mowoa", "mossa", "mogwo", "modbo", "imodbo")
"""The algorithms of the paper, in the order of its tables."""

_ABLATION = (
    "modbo",
    "modbo+lhs",
    "modbo+dynamic",
    "modbo+sine-cosine",
    "imodbo-lhs",
    "imodbo-dynamic",
    "imodbo-sine-cosine",
    "imodbo",
)
_READINGS = ("modbo", "modbo+own-best", "imodbo", "imodbo+own-best")
_VARIANTS = tuple(name for name in (*_ABLATION, *_READINGS) if "+" in name or "-" in name)


def contestants(samples: Samples) -> list[str]:
    """The algorithms that were run, without ablation variants, in our order; the floor comes last."""
    return table_order({algorithm for _, algorithm in samples if algorithm not in _VARIANTS})


def tables_markdown(samples: Samples, budget: Budget, *, version: str) -> str:
    """``tables.md``: everything that can be said of the runs that are there."""
    runs = sorted({len(columns["IGD"]) for columns in samples.values()})
    result = str(runs[0]) if len(runs) == 1 else f"{runs[0]} to {runs[-1]}"
    parts = [
        "# The MMF functions\n",
        f"uavcover {version}; {result} run(s) of each; population {budget.population}, {budget.iterations} iterations "
        f"({budget.population * budget.iterations:,} evaluations), at most {budget.archive} solutions returned. Mean ± standard "
        f"deviation of the runs. `{FLOOR}` is {budget.archive} uniform random points: the floor, no algorithm. PSP says nothing "
        "without IGD beside it: random points have a higher PSP than the paper's IMODBO on nine functions.\n",
        _beside_the_paper(samples, "IGD", "Table 3: IGD, less is better"),
        _beside_the_paper(samples, "PSP", "Table 4: PSP, more is better"),
        *(_means(samples, metric, f"{metric}, {METRICS[metric]} is better") for metric in ("IGDx", "CR", "HV")),
    ]
    parts += [_ratios(samples, metric) for metric in ("IGD", "PSP")]
    parts += [_limits(samples, pivot) for pivot in pivots(samples)]
    parts += [_wins(samples, pivot) for pivot in pivots(samples)]
    parts.append(_ranks(samples))
    parts.append(_ablation(samples, _ABLATION, "The three improvements of IMODBO, one by one"))
    parts.append(_ablation(samples, _READINGS, "Survival by front and crowding, or each beetle its own best"))
    return "\n".join(part for part in parts if part)


def pivots(samples: Samples) -> list[str]:
    """The algorithms that the others are compared with: IMODBO and its better variants, where they were run."""
    return [name for name in contestants(samples) if name.startswith("imodbo")]


def rivals_of(pivot: str, function: str, samples: Samples) -> list[str]:
    """The contestants other than ``pivot`` that were run on a function; the floor is none of them."""
    return [name for name in contestants(samples) if name not in (pivot, FLOOR) and (function, name) in samples]


def comparisons(samples: Samples, pivot: str, metric: str) -> dict[str, list[Comparison]]:
    """Function -> how ``pivot`` stands to each rival; one family of tests for each function."""
    return {
        function: compared(
            samples[function, pivot][metric],
            [(name, samples[function, name][metric]) for name in rivals_of(pivot, function, samples)],
            better=METRICS[metric],
        )
        for function in functions(samples)
        if (function, pivot) in samples
    }


def functions(samples: Samples) -> list[str]:
    """The functions that were run, in our order."""
    return [name for name in PROBLEMS if any(key[0] == name for key in samples)]


def short(value: float) -> str:
    """A figure with four digits, as text: the CSV files have it unrounded."""
    if math.isnan(value):
        return "-"
    return f"{value:.4g}" if 1e-2 <= abs(value) < 1e5 or value == 0 or math.isinf(value) else f"{value:.3e}"


def _mean_and_std(samples: Samples, function: str, algorithm: str, metric: str) -> str:
    if (function, algorithm) not in samples:
        return "-"
    result = figure(samples[function, algorithm][metric])
    return short(result.mean) if math.isnan(result.std) else f"{short(result.mean)} ± {result.std:.1e}"


def _means(samples: Samples, metric: str, title: str) -> str:
    names = contestants(samples)
    rows = [
        [function, *(_mean_and_std(samples, function, name, metric) for name in names)]
        for function in functions(samples)
    ]
    return f"## {title}\n\n{markdown(['function', *names], rows)}\n"


def _beside_the_paper(samples: Samples, metric: str, title: str) -> str:
    """Two rows for each function: ours, and the paper's."""
    names, figures = contestants(samples), published()
    with_ceiling = metric == "PSP"
    header = ["function", "", *names, *(["ceiling"] if with_ceiling else [])]
    rows = []
    for function in functions(samples):
        ours = [_mean_and_std(samples, function, name, metric) for name in names]
        theirs = []
        for name in names:
            printed = figures.get((metric, function, name))
            theirs.append(f"{short(printed.mean)} ± {printed.std:.1e}" if printed else "")
        ceiling = [short(figures[metric, function, "ceiling"].mean)] if with_ceiling else []
        rows += [[function, "ours", *ours, *ceiling], ["", "paper", *theirs, *([""] if with_ceiling else [])]]
    return f"## {title}\n\n{markdown(header, rows)}\n"


def _ratios(samples: Samples, metric: str) -> str:
    """Our mean over the paper's, for each algorithm that the paper has."""
    names = [name for name in PAPER if name in contestants(samples)]
    if not names:
        return ""
    figures = published()
    ratios = {
        (function, name): samples[function, name][metric].mean() / figures[metric, function, name].mean
        for function in functions(samples)
        for name in names
        if (function, name) in samples
    }
    rows = [
        [function, *(short(ratios.get((function, name), math.nan)) for name in names)]
        for function in functions(samples)
    ]
    good = (0.0, 1.0) if METRICS[metric] == "less" else (1.0, math.inf)
    for title, (low, high) in {
        **{f"within a factor of {limit:g}": (1.0 / limit, limit) for limit in (1.5, 2.0)}, "at least as good": good,
    }.items():  # fmt: skip
        within = [[low <= ratio <= high for (_, other), ratio in ratios.items() if other == name] for name in names]
        rows.append([title, *(f"{sum(every)} of {len(every)}" for every in within)])
    return f"## {metric}: ours / the paper's\n\n{markdown(['function', *names], rows)}\n"


def _limits(samples: Samples, name: str) -> str:
    """One algorithm against the paper's IMODBO and against the highest PSP known."""
    figures = published()
    shared = complete(samples, [name])
    rows, ratios = [], []
    for function in shared:
        result = {metric: samples[function, name][metric].mean() for metric in ("PSP", "IGD")}
        psp = result["PSP"] / figures["PSP", function, "imodbo"].mean
        ceiling = result["PSP"] / figures["PSP", function, "ceiling"].mean
        igd = result["IGD"] / figures["IGD", function, "imodbo"].mean
        ratios.append((psp, ceiling, igd))
        both = "yes" if psp > 1 and igd <= 1 else "**no**"
        rows.append([function, short(result["PSP"]), f"{psp:.2f}", f"{ceiling:.2f}", f"{igd:.2f}", both])
    table = np.array(ratios)
    kept = table[:, 2] <= 1
    return (
        f"## {name} against the paper's IMODBO and the ceiling\n\n"
        "The ceiling is the highest PSP found for 200 points with that IGD by optimizing against the reference itself; "
        "no proof.\n\n"
        f"{markdown(['function', 'PSP', '/ paper', '/ ceiling', 'IGD / paper', 'both'], rows)}\n\n"
        f"Together with an IGD no worse than the paper's IMODBO: PSP above its on {int((kept & (table[:, 0] > 1)).sum())} of "
        f"{len(table)}; at least 0.7 of the ceiling on {int((kept & (table[:, 1] >= 0.7)).sum())}, "
        f"0.9 on {int((kept & (table[:, 1] >= 0.9)).sum())}.\n"
    )


def _wins(samples: Samples, pivot: str) -> str:
    rivals = [name for name in contestants(samples) if name not in (pivot, FLOOR)]
    rows = []
    for metric in METRICS:
        result = comparisons(samples, pivot, metric)
        cells = []
        for rival in rivals:
            outcomes = [one.outcome for per_function in result.values() for one in per_function if one.rival == rival]
            cells.append("/".join(str(outcomes.count(kind)) for kind in ("win", "tie", "loss")))
        all_won = sum(bool(per) and all(one.outcome == "win" for one in per) for per in result.values())
        rows.append([metric, *cells, f"{all_won} of {len(result)}"])
    return (
        f"## {pivot} against the others: win/tie/loss\n\nWilcoxon's rank-sum test, two-sided at 5 %, Holm's correction over the "
        f"rivals on each function. Last column: functions on which it wins against every other.\n\n"
        f"{markdown(['', *rivals, 'wins against all'], rows)}\n"
    )


def complete(samples: Samples, names: Collection[str]) -> list[str]:
    """The functions on which all of ``names`` were run."""
    return [function for function in functions(samples) if all((function, name) in samples for name in names)]


def _ranks(samples: Samples) -> str:
    names = [name for name in contestants(samples) if name != FLOOR]
    shared = complete(samples, names)
    if len(names) < 2 or not shared:
        return ""
    rows = []
    for metric in METRICS:
        means = np.array([[samples[function, name][metric].mean() for name in names] for function in shared])
        result = friedman(means, better=METRICS[metric])
        rows.append([metric, *(f"{rank:.2f}" for rank in result.ranks), short(result.p)])
    return f"## Friedman's mean ranks over {len(shared)} functions (1 is best)\n\n{markdown(['', *names, 'p'], rows)}\n"


def _ablation(samples: Samples, variants: Sequence[str], title: str) -> str:
    names = [name for name in variants if any(key[1] == name for key in samples)]
    shared = complete(samples, names)
    if not shared or "modbo" not in names or not set(names) & set(_VARIANTS):
        return ""
    parts = [f"## {title}\n"]
    for metric in ("IGD", "PSP"):
        means = np.array([[samples[function, name][metric].mean() for name in names] for function in shared])
        ratio = np.exp(np.log(means / means[:, [names.index("modbo")]]).mean(axis=0))
        rows = [[function, *map(short, row)] for function, row in zip(shared, means, strict=True)]
        rows.append(["geometric mean of the ratio to modbo", *(f"{value:.3f}" for value in ratio)])
        rows.append(["mean rank", *(f"{rank:.2f}" for rank in friedman(means, better=METRICS[metric]).ranks)])
        parts.append(f"{metric}, {METRICS[metric]} is better:\n\n{markdown(['function', *names], rows)}\n")
    return "\n".join(parts)


# Everything written about the runs in the folder of an MMF benchmark: tables, and the paper's Figures 3 to 6.
#
# A figure shows what each algorithm found on a function, beside the reference.


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """A figure of the paper."""

    number: int  # in the paper
    function: str  # what was solved
    space: Literal["front", "set"]  # whether the front (objective space) or the set (decision space) is drawn


FIGURES: Final = (
    PaperFigure(3, "MMF1", "front"),
    PaperFigure(4, "MMF15", "front"),
    PaperFigure(5, "MMF8", "set"),
    PaperFigure(6, "MMF14_a", "set"),
)


def median_run(folder: MmfFolder, samples: Samples, function: str, algorithm: str) -> RunId:
    """The run in the middle by IGDx (the lower one of two)."""
    runs = [run for run in folder.runs() if (run.function, run.algorithm) == (function, algorithm)]
    order = np.argsort(samples[function, algorithm]["IGDx"], kind="stable")
    return runs[int(order[(len(runs) - 1) // 2])]


def draw(figure: PaperFigure, folder: MmfFolder, samples: Samples) -> Path:
    """Draw a panel for each algorithm, its median run over the reference; returns the file."""
    names = [name for name in contestants(samples) if (figure.function, name) in samples]
    reference = reference_sets(figure.function)
    true = reference.pareto_front if figure.space == "front" else reference.pareto_set
    projection = "3d" if true.shape[1] == 3 else None
    columns = min(4, len(names))
    rows = math.ceil(len(names) / columns)
    path = folder.path / f"figure{figure.number}.png"
    with drawn(path, dpi=90) as plt:
        page, axes = plt.subplots(
            rows, columns, figsize=(3.0 * columns, 2.8 * rows), squeeze=False, subplot_kw={"projection": projection}
        )
        for axis in axes.flat[len(names) :]:
            axis.set_visible(False)
        for name, axis in zip(names, axes.flat, strict=False):
            x, objectives = folder.read(median_run(folder, samples, figure.function, name))
            _panel(axis, name, true, objectives if figure.space == "front" else x)
        what = "fronts" if figure.space == "front" else "sets"
        page.suptitle(f"As the paper's Figure {figure.number}: {what} on {figure.function} (grey: reference)")
        page.tight_layout()
    return path


def _panel(axis: Any, name: str, true: Any, found: Any) -> None:
    axis.plot(*true.T, ".", color="0.75", markersize=1.5)
    axis.plot(*found.T, ".", color="tab:red", markersize=3.0)
    low, high = true.min(axis=0), true.max(axis=0)
    margin = 0.15 * np.where(high > low, high - low, 1.0)
    limits = (axis.set_xlim, axis.set_ylim, *([axis.set_zlim] if true.shape[1] == 3 else []))
    for set_limits, start, end in zip(limits, low - margin, high + margin, strict=True):
        set_limits(start, end)
    outside = int(((found < low - margin) | (found > high + margin)).any(axis=1).sum())
    axis.set_title(name if not outside else f"{name} ({outside} outside)", fontsize=9)
    axis.tick_params(labelsize=6)


def write_results(folder: MmfFolder, budget: Budget) -> list[Path]:
    """Write summary.csv, runs.csv, comparisons.csv, tables.md and the figures of the functions that were run.

    All runs in the folder count, also those of earlier commands.

    Returns:
        The files.

    Raises:
        InputError: the file of a run cannot be read.
        OutputError: a file cannot be written.
    """
    samples = measured(folder)
    texts = {
        "summary.csv": summary_csv(samples),
        "runs.csv": runs_csv(samples),
        "comparisons.csv": comparisons_csv(samples),
        "tables.md": tables_markdown(samples, budget, version=version("uavcover")),
    }
    ran = functions(samples)
    return write_texts(folder.path, texts) + [draw(one, folder, samples) for one in FIGURES if one.function in ran]


def comparisons_csv(samples: Samples) -> str:
    """``comparisons.csv``: metric, algorithm, rival, function, p, p_holm, outcome (of the algorithm)."""
    rows = (
        [metric, pivot, one.rival, function, one.p, one.p_holm, one.outcome]
        for metric in METRICS
        for pivot in pivots(samples)
        for function, rivals in comparisons(samples, pivot, metric).items()
        for one in rivals
    )
    return csv_text(["metric", "algorithm", "rival", "function", "p", "p_holm", "outcome"], rows)
