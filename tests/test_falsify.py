"""The ways to falsify a flight: what they are. ``tests/verification/test_falsified.py`` has them judged."""

import dataclasses
import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests import falsify
from tests.falsifying.every_way import every_way
from tests.falsifying.flown import Flown, read_flown
from tests.falsifying.honest_run import HILLS, honest_run
from tests.falsifying.way import FAMILIES


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed."""
    return honest_run(tmp_path_factory.mktemp("hills"), HILLS)


@pytest.fixture(scope="module")
def flown(run: Path) -> Flown:
    return read_flown(run)


def hashes(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_there_are_at_least_80_in_every_family_each_with_a_reason(flown: Flown) -> None:
    ways = every_way(flown, seed=0)
    assert len([way for way in ways if not way.honest]) >= 200
    names = [(way.family, way.name) for way in ways]
    assert len(set(names)) == len(names)
    assert all(way.because and way.family for way in ways)
    # The other families need obstacles, zones with times, or a camera that takes single photos.
    others = {"obstacles changed", "dates", "photos not reported", "one flight twice", "photos that are one look"}
    assert {way.family for way in ways} == {*FAMILIES, "two at once"} - others


def test_each_changes_the_record_the_same_way_for_a_seed_and_leaves_the_original_alone(flown: Flown) -> None:
    before = flown.text().encode()
    first = [(way.family, way.name, way.record(flown)) for way in every_way(flown, seed=3) if way.of_track]
    again = [(way.family, way.name, way.record(flown)) for way in every_way(flown, seed=3) if way.of_track]
    assert first == again
    assert flown.text().encode() == before
    for family, name, record in first:
        assert (record == before) == ((family, name) == ("honest", "as it is")), (family, name)
    other = [(way.family, way.name, way.record(flown)) for way in every_way(flown, seed=4)[::3] if way.of_track]
    assert len({record for *_, record in other} - {record for *_, record in first}) > 15


def test_meddling_changes_the_copy_alone_or_is_undone(flown: Flown, run: Path, tmp_path: Path) -> None:
    before, outside = hashes(run), hashes(run.parent / "scenario")
    ways = [way for way in every_way(flown, seed=0) if way.meddle is not None]
    assert len(ways) > 30
    undone = 0
    for number, way in enumerate(ways):
        copy = shutil.copytree(run, tmp_path / str(number))
        assert way.meddle is not None
        undo = way.meddle(copy)
        changed = hashes(copy) != before or (copy / "track.csv").is_dir()
        if undo is not None:
            undone += 1
            changed = hashes(run.parent / "scenario") != outside
            undo()
        assert changed, way.name
        assert hashes(run.parent / "scenario") == outside, way.name
        shutil.rmtree(copy)
    assert undone == 2
    assert hashes(run) == before


def test_honest_ways_pass_as_foreign_logs(run: Path) -> None:
    rows = list(falsify.judge_all(run, families=["honest"]))
    assert len(rows) >= 10
    assert [row for row in rows if row.finding] == []
    assert {row.verdict for row in rows} == {"passed"}


def test_the_command(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "table.md"
    arguments = [str(run), "--family", "text", "--ways", "3", "--seed", "1", "-o", str(out)]
    code = falsify.main(arguments)
    printed = capsys.readouterr().out
    assert printed.splitlines()[-1].startswith("ways: 3, as run folder: 3")
    assert code == int("PASSED" in printed or "caught, but" in printed)
    assert "| text |" in out.read_text()
    assert len(out.with_name("falsified.csv").read_text().splitlines()) == 1 + 6
    for wrong in ([str(run), "--family", "nonsense"], ["--family", "text"]):
        with pytest.raises(SystemExit) as ended:
            falsify.main(wrong)
        assert ended.value.code == 2


def test_a_run_that_was_broken_off_goes_on(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(run), "--family", "text", "--ways", "2", "--keep", str(tmp_path)]
    falsify.main(arguments)
    (kept,) = tmp_path.glob("*.jsonl")
    lines = kept.read_text().splitlines(keepends=True)
    assert len(lines) == 4
    kept.write_text("".join(lines[:3]) + lines[3][:20])
    capsys.readouterr()
    judged: list[str] = []
    monkeypatch.setattr(falsify, "judge", lambda way, *_, **__: judged.append(way.name) or falsify.Judged(**ROW))
    falsify.main(arguments)
    assert len(judged) == 1
    assert len(kept.read_text().splitlines()) == 4
    assert capsys.readouterr().out.splitlines()[-1].startswith("ways: ")


ROW = {
    "scenario": "hills", "family": "text", "way": "one", "judged_as": falsify.LOG, "verdict": "refused", "exit_code": 2,
    "reasons": "", "because": "", "finding": "",
}  # fmt: skip


def test_a_finding_is_what_passes_and_what_crashes(
    run: Path, flown: Flown, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    way = next(way for way in every_way(flown, seed=0) if way.family == "teleports")

    def judged(code: int, out: str, *, honest: bool = False) -> str:
        monkeypatch.setattr(falsify, "command", lambda *_: (code, out, ""))
        folder = Path(tmp_path / f"{code}{honest}{len(out)}")
        folder.mkdir()
        (folder / "x").touch()
        return falsify.judge(dataclasses.replace(way, honest=honest), flown, run, falsify.LOG, folder=folder).finding

    assert judged(0, '{"passed": true}') == falsify.PASSED
    assert judged(1, '{"passed": true, "verdict": "passed"}') == falsify.PASSED
    assert judged(1, '{"passed": false, "verdict": "not proved"}') == ""
    assert judged(2, '{"error": "no"}') == ""
    assert judged(70, '{"error": "a fault"}').startswith("ended with 70")
    assert judged(1, '{"passed": false}', honest=True) != ""


def test_numbers_of_the_parameters_are_drawn_from_the_flight(flown: Flown) -> None:
    route = flown.time_s[flown.on_route]
    assert flown.moment(0.0) == route[0]
    assert flown.moment(1.0) == route[-1]
    assert np.isclose(flown.step_s, 0.1)
