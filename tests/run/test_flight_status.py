import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from uavcover.model.track import Ending, FlightOutcome
from uavcover.run import provenance
from uavcover.run.folder import RunFolder

OUTCOME = FlightOutcome(Ending.LANDED, 4, 100, 20.0, None)


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    run = RunFolder(tmp_path)
    run.write_json("run.json", {"schema_version": 1, "seed": 3, "flight": OUTCOME.as_json()})
    return run


def flight(run: RunFolder) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(run.file("run.json").read_text())
    assert document["seed"] == 3, "the remaining document is kept"
    found: dict[str, Any] = document["flight"]
    return found


def test_a_flight_is_flying_from_its_first_second_and_then_has_its_outcome(run: RunFolder) -> None:
    assert provenance.settled_ending(run) == "landed"
    provenance.note_flying(run)
    assert flight(run)["ending"] == provenance.settled_ending(run) == "flying"
    assert "samples" not in flight(run), "nothing of the older flight is left"
    provenance.seal_flight(run, samples=0, outcome=OUTCOME, command=[])
    assert flight(run) == OUTCOME.as_json()


def test_a_killed_flight_reads_interrupted_and_is_written_down(run: RunFolder) -> None:
    code = (
        "import os, signal, sys; from uavcover.run import provenance; from uavcover.run.folder import RunFolder; "
        "provenance.note_flying(RunFolder(sys.argv[1])); os.kill(os.getpid(), signal.SIGKILL)"
    )
    killed = subprocess.run([sys.executable, "-c", code, str(run)], check=False)
    assert killed.returncode == -9
    assert flight(run)["ending"] == "flying"
    assert provenance.settled_ending(run) == "interrupted"
    assert flight(run)["ending"] == "interrupted"
    assert "process" not in flight(run)


@pytest.mark.parametrize(
    "process",
    [
        {"boot_id": "00000000-another-start-of-the-machine"},
        {"started": 1},
        {"pid": 2**22 + 5, "started": None},
        {"pid": 0},
        {"pid": -1},
        {"pid": "1"},
        {"pid": None},
    ],
    ids=["restarted machine", "number given anew", "no such process", "zero", "minus one", "text", "none"],
)
def test_another_process_is_not_the_one_that_flew(process: dict[str, Any], run: RunFolder) -> None:
    provenance.note_flying(run)
    document = json.loads(run.file("run.json").read_text())
    document["flight"]["process"] |= process
    run.write_json("run.json", document)
    assert provenance.settled_ending(run) == "interrupted"


@pytest.mark.parametrize("process", [None, [], "pid 7", {}])
def test_a_flight_of_which_nobody_says_who_follows_it_is_interrupted(process: object, run: RunFolder) -> None:
    run.write_json("run.json", {"seed": 3, "flight": {"ending": "flying", "process": process}})
    assert provenance.settled_ending(run) == "interrupted"


def test_where_the_operating_system_tells_little_the_process_number_decides(
    run: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(provenance, "_BOOT", Path("/nowhere/boot_id"))
    monkeypatch.setattr(provenance, "_started", lambda _: None)
    provenance.note_flying(run)
    assert provenance.settled_ending(run) == "flying"
    monkeypatch.setattr(os, "kill", lambda *_: (_ for _ in ()).throw(PermissionError()))
    assert provenance.settled_ending(run) == "flying"
    monkeypatch.setattr(os, "kill", lambda *_: (_ for _ in ()).throw(ProcessLookupError()))
    assert provenance.settled_ending(run) == "interrupted"


@pytest.mark.parametrize("document", [{}, {"flight": None}, {"flight": "landed"}, {"flight": {"ending": 3}}])
def test_a_run_without_a_flight_has_no_ending(document: dict[str, Any], tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    assert provenance.settled_ending(run) is None
    run.write_json("run.json", document)
    assert provenance.settled_ending(run) is None


def test_a_folder_that_may_only_be_read_is_looked_at(run: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    from uavcover.errors import OutputError

    provenance.note_flying(run)
    monkeypatch.setattr(provenance, "is_running", lambda _: False)

    def refuse(*_: object) -> None:
        raise OutputError("read-only")

    monkeypatch.setattr(RunFolder, "write_json", refuse)
    assert provenance.settled_ending(run) == "interrupted"
    assert flight(run)["ending"] == "flying"
