"""What a flight names as the next command: nothing that leads to a verdict before everything is flown."""

from pathlib import Path

import pytest

from uavcover.flight.command import commands_after_flight
from uavcover.model.track import Ending
from uavcover.run.folder import RunFolder

TO = ("--to", "URL")


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    for name in ("plan.json", "sortie-1/plan.json", "sortie-2/plan.json", "sortie-1/track.csv"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.touch()
    return RunFolder(tmp_path)


def test_after_a_sortie_comes_the_next_one_and_the_verdict_is_on_all(run: RunFolder) -> None:
    sortie = RunFolder(run.file("sortie-1"))
    assert commands_after_flight(sortie, Ending.LANDED, TO) == [
        f"uavcover plan-upload {run} --sortie 2 --to URL",
        f"uavcover fly {run} --sortie 2 --to URL",
    ]
    assert commands_after_flight(sortie, Ending.LANDED, ("--to", "mock:")) == [
        f"uavcover fly {run} --sortie 2 --to mock:"
    ]
    run.file("sortie-2/track.csv").touch()
    assert commands_after_flight(sortie, Ending.LANDED, TO) == [f"uavcover verify {run}"]


def test_what_was_stopped_is_gone_on_with(run: RunFolder) -> None:
    sortie = RunFolder(run.file("sortie-1"))
    for ending in (Ending.RETURNED, Ending.LEFT_HOLDING, Ending.RESERVE_KEPT):
        assert commands_after_flight(sortie, ending, TO) == [
            f"uavcover fly {sortie} --resume --to URL",
            f"uavcover verify {run}",
        ]
    assert commands_after_flight(sortie, Ending.NOT_FLOWN, TO) == [f"uavcover fly {sortie} --to URL --force"]


def test_a_gap_mission_is_judged_with_the_flight_whose_gaps_it_closes(tmp_path: Path) -> None:
    for name in ("plan.json", "track.csv", "gaps/plan.json", "gaps/track.csv"):
        file = tmp_path / name
        file.parent.mkdir(exist_ok=True)
        file.touch()
    (command,) = commands_after_flight(RunFolder(tmp_path / "gaps"), Ending.LANDED, TO)
    assert command == f"uavcover verify {tmp_path} --log {tmp_path}/track.csv --log {tmp_path}/gaps/track.csv"
