"""The notebooks of the documentation run from top to bottom, and are committed without outputs."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "notebooks"
SHOWN = {
    "plan_and_look": ["Site valley", "<svg", "report.html"],
    "judge_a_log": ["<svg", "Verdict", "% seen\nbetween", "- "],
    "paper_benchmark": ["imodbo-niching", "Plan: "],
}


def test_every_notebook_is_tested_and_described() -> None:
    names = {path.stem for path in FOLDER.glob("*.ipynb")}
    assert names == set(SHOWN)
    page = (FOLDER / "index.md").read_text(encoding="utf-8")
    assert all(f"({name}.ipynb)" in page for name in names)


@pytest.mark.parametrize("name", SHOWN)
def test_no_outputs_are_committed(name: str) -> None:
    document = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    cells = [cell for cell in document["cells"] if cell["cell_type"] == "code"]
    assert cells
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)


@pytest.mark.parametrize("name", SHOWN)
def test_the_notebook_runs(name: str, tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-W", "error", "-m", "tests.run_notebook", str(FOLDER / f"{name}.ipynb")],
        cwd=ROOT, env={**os.environ, "MPLBACKEND": "Agg", "TMPDIR": str(tmp_path)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    for text in SHOWN[name]:
        assert text in ended.stdout
