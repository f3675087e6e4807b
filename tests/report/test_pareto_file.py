"""``pareto.csv`` is read back as it was written, or refused by line."""

from pathlib import Path

import pytest

from uavcover.errors import InputError
from uavcover.planner.pareto_file import read_pareto
from uavcover.run.folder import RunFolder


def test_members_come_back(run: RunFolder) -> None:
    first, second = read_pareto(run.file("pareto.csv"))
    assert (first.index, first.chosen, second.index, second.chosen) == (0, True, 1, False)
    assert second.path_length_m == 2.0 * first.path_length_m
    assert first.made_by == "boustrophedon"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("coverage_fraction,", "share,", "has no column 'coverage_fraction'"),
        ("\n1,0.5,0.5", "\n1,0.5,half", "line 3: cannot read the row as a member"),
        ("\n1,0.5,0.5", "\n1,0.5,nan", "line 3: a value is not a finite number"),
        ("\n1,0.5,0.5", "\n1,0.5\xff,0.5", None),
    ],
)
def test_broken_files(run: RunFolder, tmp_path: Path, old: str, new: str, message: str | None) -> None:
    text = run.file("pareto.csv").read_text()
    assert old in text
    path = tmp_path / "pareto.csv"
    path.write_text(text.replace(old, new), encoding="latin-1")
    with pytest.raises(InputError, match=message or "cannot be read"):
        read_pareto(path)
