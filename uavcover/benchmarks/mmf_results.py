"""Everything that is written about the runs in the folder of an MMF benchmark."""

import csv
import io
from importlib.metadata import version
from pathlib import Path

from uavcover.benchmarks.contenders import Budget
from uavcover.benchmarks.mmf_figures import FIGURES, draw
from uavcover.benchmarks.mmf_folder import MmfFolder
from uavcover.benchmarks.mmf_summary import METRICS, Samples, measured, runs_csv, summary_csv
from uavcover.benchmarks.mmf_tables import comparisons, functions, pivots, tables_markdown
from uavcover.run_folder import write_text


def write_results(folder: MmfFolder, budget: Budget) -> list[Path]:
    """Write summary.csv, runs.csv, comparisons.csv, tables.md and the figures of the functions that were run.

    All runs in the folder count, whoever asked for them.

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
