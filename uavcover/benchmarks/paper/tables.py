"""Tables 5 and 6 under every reading, as Markdown and CSV."""

import csv
import io
from collections.abc import Sequence

from uavcover.benchmarks.mmf_tables import markdown
from uavcover.benchmarks.paper.published import TABLE_5, TABLE_6, Figures
from uavcover.benchmarks.paper.readings import READINGS
from uavcover.benchmarks.paper.runs import ALGORITHMS
from uavcover.benchmarks.paper.summary import CHOICES, PAPERS_NODES, Results, Row, misfit, row

_CHOSEN = {
    "weights": "chosen by the weights 0.6, 0.2, 0.2 (section 5.3)",
    "nodes": f"chosen by the paper's number of nodes: most coverage with {PAPERS_NODES[0]} to {PAPERS_NODES[1]}",
}


def readings_done(results: Results) -> list[str]:
    """Readings that both algorithms have runs of, in our order."""
    return [name for name in READINGS if all((name, algorithm) in results for algorithm in ALGORITHMS)]


def runs_csv(results: Results) -> str:
    """``runs.csv``: reading, algorithm, run, choice, coverage, nodes, length, cpu_s; unrounded."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["reading", "algorithm", "run", "choice", "coverage", "nodes", "length", "cpu_s"])
    for (reading, algorithm), found in results.items():
        for number, result in enumerate(found, start=1):
            for choice, choose in CHOICES.items():
                figures = choose([result]).figures
                writer.writerow(
                    [reading, algorithm, number, choice, figures.coverage, figures.nodes, figures.length, result.cpu_s]
                )
    return text.getvalue()


def tables_markdown(results: Results, *, population: int, iterations: int, version: str) -> str:
    """``tables.md``: both tables for both choices, and the readings by how well they fit."""
    runs = sorted({len(found) for found in results.values()})
    told = str(runs[0]) if len(runs) == 1 else f"{runs[0]} to {runs[-1]}"
    parts = [
        "# The paper's simulation under five readings\n",
        f"uavcover {version}; population {population}, {iterations} iterations, {told} run(s) of each, seeds from 1. Mean ± "
        "standard deviation. Lengths in the paper's units.\n",
        "| reading | meaning |\n|---|---|\n"
        + "\n".join(f"| {name} | {READINGS[name].meaning} |" for name in readings_done(results))
        + "\n",
    ]
    for choice, told in _CHOSEN.items():
        parts += [f"## Table 5, {told}\n", _table_5(results, choice)]
    for choice, told in _CHOSEN.items():
        parts += [f"## Table 6: of all runs one scheme, {told}\n", _table_6(results, choice)]
    parts += [
        "## Which reading fits\n",
        "Root mean square of the relative deviations of the six means of Table 5 (coverage, nodes and length of both "
        "algorithms); coverage apart, in percentage points, ours less the paper's; least misfit first.\n",
        _fits(results),
    ]
    return "\n".join(parts)


def _table_5(results: Results, choice: str) -> str:
    lines = [["paper", algorithm, *_spread(Row(mean, std, 5)), ""] for algorithm, (mean, std) in TABLE_5.items()]
    for reading in readings_done(results):
        rows: dict[str, Row] = {algorithm: row(results[reading, algorithm], choice) for algorithm in ALGORITHMS}
        fit = f"{misfit(rows):.3f}"
        lines += [[reading, algorithm, *_spread(rows[algorithm]), fit] for algorithm in ALGORITHMS]
    return markdown(["reading", "algorithm", "coverage %", "length", "nodes", "misfit"], lines) + "\n"


def _table_6(results: Results, choice: str) -> str:
    lines = [["paper", algorithm, *_plain(figures)] for algorithm, figures in TABLE_6.items()]
    for reading in readings_done(results):
        for algorithm in ALGORITHMS:
            lines.append([reading, algorithm, *_plain(CHOICES[choice](results[reading, algorithm]).figures)])
    return markdown(["reading", "algorithm", "coverage %", "length", "nodes"], lines) + "\n"


def _fits(results: Results) -> str:
    found: list[tuple[float, list[str]]] = []
    for choice in CHOICES:
        for reading in readings_done(results):
            rows: dict[str, Row] = {algorithm: row(results[reading, algorithm], choice) for algorithm in ALGORITHMS}
            gaps = [100.0 * (rows[name].mean.coverage - TABLE_5[name][0].coverage) for name in ALGORITHMS]
            gain = 100.0 * (rows["imodbo"].mean.coverage - rows["modbo"].mean.coverage)
            fit = misfit(rows)
            cells = [reading, choice, f"{fit:.3f}", *(f"{gap:+.1f}" for gap in gaps), f"{gain:+.1f}"]
            found.append((fit, cells))
    paper_gain = 100.0 * (TABLE_5["imodbo"][0].coverage - TABLE_5["modbo"][0].coverage)
    header = ["reading", "choice", "misfit", "modbo", "imodbo", f"imodbo less modbo (paper {paper_gain:+.1f})"]
    return markdown(header, [cells for _, cells in sorted(found, key=lambda item: item[0])]) + "\n"


def _spread(told: Row) -> Sequence[str]:
    mean, std = told.mean, told.std
    return (
        f"{100 * mean.coverage:.2f} ± {100 * std.coverage:.2f}",
        f"{mean.length:.2f} ± {std.length:.2f}",
        f"{mean.nodes:.1f} ± {std.nodes:.1f}",
    )


def _plain(figures: Figures) -> Sequence[str]:
    return f"{100 * figures.coverage:.1f}", f"{figures.length:.2f}", f"{figures.nodes:.0f}"
