"""``gaps`` takes what ``verify`` took: the logs that the verdict in the folder judged, wherever they lie."""

from pathlib import Path

import pytest

from uavcover.errors import InputError
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import logs_of_the_verdict
from uavcover.run.provenance import sha256_of


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    run = RunFolder(tmp_path / "run")
    run.path.mkdir()
    run.write_text("track.csv", "a track\n")
    return run


def judged(run: RunFolder, *logs: Path) -> None:
    tracks = {
        log.relative_to(run.path).as_posix() if log.is_relative_to(run.path) else log.name: sha256_of(log)
        for log in logs
    }
    run.write_json("verification.json", {"inputs": {"track": tracks}})


def test_without_a_verdict_or_with_one_on_its_own_track_it_is_the_runs_own(run: RunFolder) -> None:
    assert logs_of_the_verdict(run) == []
    judged(run, run.file("track.csv"))
    assert logs_of_the_verdict(run) == []


@pytest.mark.parametrize("document", [{}, {"inputs": None}, {"inputs": {"track": []}}, {"inputs": {"track": {}}}])
def test_a_verdict_that_names_no_log_is_no_obstacle(document: dict[str, object], run: RunFolder) -> None:
    run.write_json("verification.json", document)
    assert logs_of_the_verdict(run) == []


@pytest.mark.parametrize("position", ["in the run", "beside it", "where the command runs"])
def test_the_log_is_found(position: str, run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    folder = {"in the run": run.path, "beside it": tmp_path, "where the command runs": here}[position]
    log = folder / "00000042.BIN"
    log.write_bytes(b"what was flown")
    judged(run, log, run.file("track.csv"))
    found = logs_of_the_verdict(run)
    assert [path.resolve() for path in found] == [log.resolve(), run.file("track.csv").resolve()]


@pytest.mark.parametrize("change", ["gone", "another"])
def test_a_log_that_is_gone_or_another_one_is_to_be_named(change: str, run: RunFolder, tmp_path: Path) -> None:
    log = tmp_path / "flight.ulg"
    log.write_bytes(b"what was flown")
    judged(run, log)
    log.unlink() if change == "gone" else log.write_bytes(b"something else")
    with pytest.raises(
        InputError, match=r"the verdict refers to flight\.ulg, which is missing or has changed; specify the log"
    ):
        logs_of_the_verdict(run)
