"""Everything that is written about the runs in the folder of a coverage benchmark."""

import datetime
from importlib.metadata import version
from pathlib import Path

from uavcover.benchmarks.coverage.plot import draw
from uavcover.benchmarks.coverage.summary import read_outcomes
from uavcover.benchmarks.coverage.tables import runs_csv, tables_markdown
from uavcover.benchmarks.kept_runs import KeptRuns
from uavcover.run_folder import write_text


def write_results(folder: KeptRuns, *, command: str) -> list[Path]:
    """Write runs.csv, table.md and coverage.png about all runs in the folder, whoever asked for them; returns the files.

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
    for name, text in texts.items():
        write_text(folder.path / name, text)
    files = [folder.path / name for name in texts]
    if outcomes.scenarios:
        files.append(draw(outcomes, folder.path / "coverage.png"))
    return files
