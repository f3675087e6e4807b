"""Everything that is written about the runs in the folder of the paper's simulation."""

import csv
import io
from importlib.metadata import version
from pathlib import Path

from uavcover.benchmarks.kept_runs import KeptRuns
from uavcover.benchmarks.paper.figures import draw_schemes, draw_terrain
from uavcover.benchmarks.paper.readings import READINGS
from uavcover.benchmarks.paper.runs import ALGORITHMS, PaperResult, paper_runs, read_result
from uavcover.benchmarks.paper.summary import CHOICES, Results, Scheme
from uavcover.benchmarks.paper.tables import readings_done, runs_csv, tables_markdown
from uavcover.run_folder import write_text

_MOST_RUNS = 1000


def read_results(folder: KeptRuns) -> Results:
    """Every run that is done, whoever asked for it.

    Raises:
        InputError: the file of a run cannot be read.
    """
    found: dict[tuple[str, str], list[PaperResult]] = {}
    done = set(folder.done())
    for run in paper_runs(READINGS, ALGORITHMS, _MOST_RUNS):
        if run.key in done:
            found.setdefault((run.reading, run.algorithm), []).append(read_result(folder, run))
    return found


def write_results(folder: KeptRuns) -> list[Path]:
    """Write runs.csv, tables.md, the routes and the figures; returns the files.

    Raises:
        InputError: the file of a run cannot be read.
        OutputError: a file cannot be written.
    """
    results = read_results(folder)
    population, iterations = int(folder.settings["population"]), int(folder.settings["iterations"])
    told = tables_markdown(results, population=population, iterations=iterations, version=version("uavcover"))
    texts = {"runs.csv": runs_csv(results), "tables.md": told}
    drawn: dict[str, dict[str, Scheme]] = {}
    for reading in readings_done(results):
        for choice, choose in CHOICES.items():
            schemes: dict[str, Scheme] = {algorithm: choose(results[reading, algorithm]) for algorithm in ALGORITHMS}
            drawn.setdefault(reading, schemes)
            for algorithm, scheme in schemes.items():
                texts[f"route-{reading}-{algorithm}-{choice}.csv"] = _route_csv(scheme)
    for name, text in texts.items():
        write_text(folder.path / name, text)
    files = [folder.path / name for name in texts]
    files.append(draw_terrain(folder.path / "figure7.png"))
    for reading, schemes in drawn.items():
        files.append(draw_schemes(folder.path / f"figures8-11-{reading}.png", READINGS[reading], schemes))
    return files


def _route_csv(scheme: Scheme) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["x", "y", "z"])
    writer.writerows(scheme.route.tolist())
    return text.getvalue()
