"""Everything written about the runs in the folder of an MMF benchmark: tables, and the paper's Figures 3 to 6.

A figure shows what each algorithm found on a function, beside the reference.
"""

import csv
import io
import math
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from uavcover.extras.benchmarks.mmf.reference_sets import reference_sets
from uavcover.extras.benchmarks.mmf.runs import Budget, MmfFolder, RunId
from uavcover.extras.benchmarks.mmf.summary import METRICS, Samples, measured, runs_csv, summary_csv
from uavcover.extras.benchmarks.mmf.tables import comparisons, contestants, functions, pivots, tables_markdown
from uavcover.run.folder import write_text


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
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    names = [name for name in contestants(samples) if (figure.function, name) in samples]
    reference = reference_sets(figure.function)
    true = reference.pareto_front if figure.space == "front" else reference.pareto_set
    projection = "3d" if true.shape[1] == 3 else None
    columns = min(4, len(names))
    rows = math.ceil(len(names) / columns)
    page, axes = plt.subplots(
        rows, columns, figsize=(3.0 * columns, 2.8 * rows), squeeze=False, subplot_kw={"projection": projection}
    )
    try:
        for axis in axes.flat[len(names) :]:
            axis.set_visible(False)
        for name, axis in zip(names, axes.flat, strict=False):
            x, objectives = folder.read(median_run(folder, samples, figure.function, name))
            _panel(axis, name, true, objectives if figure.space == "front" else x)
        what = "fronts" if figure.space == "front" else "sets"
        page.suptitle(f"As the paper's Figure {figure.number}: {what} on {figure.function} (grey: reference)")
        page.tight_layout()
        path = folder.path / f"figure{figure.number}.png"
        page.savefig(path, dpi=90)
    finally:
        plt.close(page)
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
    files = []
    for name, text in texts.items():
        write_text(folder.path / name, text)
        files.append(folder.path / name)
    ran = functions(samples)
    files += [draw(one, folder, samples) for one in FIGURES if one.function in ran]
    return files


def comparisons_csv(samples: Samples) -> str:
    """``comparisons.csv``: metric, algorithm, rival, function, p, p_holm, outcome (of the algorithm)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["metric", "algorithm", "rival", "function", "p", "p_holm", "outcome"])
    for metric in METRICS:
        for pivot in pivots(samples):
            for function, rivals in comparisons(samples, pivot, metric).items():
                for one in rivals:
                    writer.writerow([metric, pivot, one.rival, function, one.p, one.p_holm, one.outcome])
    return text.getvalue()
