"""The script that compares energies over mountains: it goes on where it was stopped, and tells where it misses."""

from pathlib import Path

import pytest

from scripts import bench_mountains
from scripts.bench_mountains import COLUMNS, LINES, OURS, Row, main, page, scenario_of


def row(place: str, way: str, energy_s: float | None, seed: str = "") -> Row:
    figures = {} if energy_s is None else {
        "energy_hover_s": repr(energy_s), "coverage": "0.9912", "hold_out": "0.9903", "mission_s": "900.0", "waypoints": "30"
    }  # fmt: skip
    head = {"place": place, "way": way, "seed": seed, "made_by": "someone", "commit": "abc", "date": "2026-01-01"}
    return {**dict.fromkeys(COLUMNS, ""), **head, **figures}


def test_misses_are_told_and_the_best_lines_are_what_counts() -> None:
    rows = [
        row("jacksboro", "boustrophedon", 1000.0), row("jacksboro", "contour-lines", 950.0), row("jacksboro", OURS, 855.1, "1"),
        row("davosdorf", "boustrophedon", None), row("davosdorf", "contour-lines", 500.0), row("davosdorf", OURS, 449.0, "1"),
    ]  # fmt: skip
    text = page(rows)
    assert "- jacksboro: 10.0 % less than the best lines (contour-lines), of 10 % asked: **missed**" in text
    assert "- davosdorf: 10.2 % less than the best lines (contour-lines), of 10 % asked: reached" in text
    assert "not there: boustrophedon, simple-lines" in text
    assert "- ridge-25km2: not measured." in text
    assert "| jacksboro | ours (seed 1) | 99.12 % | 99.03 % | 855 s | -10.0 % |" in text


def test_it_goes_on_with_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def measured(_site: object, way: str, seed: int, _evaluations: int) -> Row:
        asked.append(way)
        if len(asked) == 3:
            raise KeyboardInterrupt
        return {**row("", way, 100.0, str(seed) if way == OURS else ""), "place": "jacksboro"}

    monkeypatch.setattr(bench_mountains, "measure", measured)
    monkeypatch.setattr(bench_mountains, "load_site", lambda scenario: scenario)
    arguments = ["-o", str(tmp_path / "m.md"), "--only", "jacksboro"]
    with pytest.raises(KeyboardInterrupt):
        main(arguments)
    assert main(arguments) == 0
    assert asked == [*list(LINES)[:3], *list(LINES)[2:], OURS]
    assert main(arguments) == 0
    assert len(asked) == 5
    assert (tmp_path / "m.md").read_text().count("| jacksboro |") == 4


def test_a_place_without_its_heights_is_left_out(tmp_path: Path) -> None:
    assert scenario_of("davosdorf", None) is None
    assert scenario_of("davosdorf", tmp_path) is None
    known = scenario_of("jacksboro", None)
    assert known is not None
    assert (known.objective, known.select) == ("energy", "coverage>=0.99")
