"""What the judge says of falsified flights: a few of each family always, all of them by ``tests/falsify.py``."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests import falsify
from tests.falsifying.honest_run import base_run


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A run folder by the name of its base, flown once. Not to be changed."""
    flown: dict[str, Path] = {}

    def run(name: str) -> Path:
        if name not in flown:
            flown[name] = base_run(tmp_path_factory.mktemp("base"), name)
            # The flight itself passes, and leaves a verdict that says so for those who look for one.
            code, out, err = falsify.command("verify", flown[name])
            assert code == 0, out + err
        return flown[name]

    return run


def reported(rows: list[falsify.Judged]) -> list[tuple[str, str, str, str]]:
    return [(row.family, row.way, row.judged_as, row.finding) for row in rows if row.finding]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_none_of_a_few_of_all_families_is_passed(runs: Callable[[str], Path], seed: int) -> None:
    rows = list(falsify.judge_all(runs("hills"), seed=seed, count=12))
    assert reported(rows) == []
    assert len({row.family for row in rows}) > 4


def test_no_attitude_is_believed_that_cannot_be(runs: Callable[[str], Path]) -> None:
    rows = list(falsify.judge_all(runs("wide picture"), seed=5, families=["attitude"], count=8))
    assert reported(rows) == []
    assert len(rows) == 16


@pytest.mark.parametrize("name", ["hills", "slow"])
def test_no_velocity_is_believed_that_is_not_that_of_the_positions(runs: Callable[[str], Path], name: str) -> None:
    rows = list(falsify.judge_all(runs(name), families=["velocity"], seed=5, count=6))
    assert reported(rows) == []
    assert len(rows) == 12
    assert any("reported velocity and positions contradict each other" in row.reasons for row in rows)


def test_no_photo_counts_that_was_not_reported(runs: Callable[[str], Path]) -> None:
    families = ["photos not reported", "one flight twice", "photos that are one look", "honest"]
    rows = list(falsify.judge_all(runs("survey"), families=families))
    assert reported(rows) == []
    assert sum(row.family == "photos not reported" for row in rows) == 20
    assert sum(row.family == "one flight twice" for row in rows) == 4
    assert sum(row.judged_as == falsify.SURVEY for row in rows) == 5 + 2


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_obstacles_that_were_taken_away_are_missed(runs: Callable[[str], Path]) -> None:
    rows = list(falsify.judge_all(runs("barns"), families=["obstacles changed"]))
    assert len(rows) == 2
    assert reported(rows) == []
