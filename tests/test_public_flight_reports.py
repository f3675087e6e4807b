"""Classes of public bug reports on logs and records of flights: the judge's verdict on each, and its words.

Each is a way of :mod:`tests.falsifying` to change an honest flight.
"""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import falsify
from tests.falsifying.every_way import every_way
from tests.falsifying.flown import read_flown
from tests.falsifying.honest_run import OBLIQUE, SURVEY, Base, honest_run


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightReport:
    """A class of reports.

    Attributes:
        name: of the class.
        base: the honest flight.
        family: of ways to change it.
        way: how its name begins.
        answer: that the verdict and its grounds match.
    """

    name: str
    base: Base
    family: str
    way: str
    answer: str


REPORTS = (
    FlightReport(
        name="a camera stops", base=SURVEY, family="photos not reported", way="stopped after",
        answer=r"^not proved: coverage \d\.\d+ % of the visible ground is below",
    ),
    FlightReport(
        name="a survey with losses on its link", base=SURVEY, family="honest", way="a quarter", answer="^passed",
    ),
    FlightReport(
        name="noise excuses instant corners", base=OBLIQUE, family="noise as an excuse", way="10 m/s, 10 Hz, off by 1 m",
        answer=r"^not proved: the (positions have independent errors of 1\.0 m|vehicle cannot have moved like this)",
    ),
    FlightReport(
        name="few samples excuse them", base=OBLIQUE, family="noise as an excuse", way="a sample every 1.9 s, on the plan, l",
        answer=r"^not proved: the samples are 1\.9 s apart and no attitude confirms them",
    ),
    FlightReport(
        name="an attitude of another time", base=OBLIQUE, family="attitude", way="roll and pitch 5 s late",
        answer="^not proved: roll and pitch do not match the flown accelerations",
    ),
    FlightReport(
        name="one flight as two logs", base=SURVEY, family="one flight twice", way="one of",
        answer=r"^failed: the required overlap, 8 photos of every point, is achieved on \d\.",
    ),
    FlightReport(
        name="bands of one camera", base=SURVEY, family="photos that are one look", way="bands",
        answer=r"^failed: the required overlap, 8 photos of every point, is achieved on 11\.",
    ),
    FlightReport(
        name="a vehicle that hovers", base=SURVEY, family="photos that are one look", way="hovering",
        answer=r"^failed: the required overlap, 8 photos of every point, is achieved on 13\.",
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def run_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Base], Path]:
    """The run folder of an honest flight, flown once. Not to be changed."""
    flown: dict[str, Path] = {}

    def run(base: Base) -> Path:
        if base.name not in flown:
            flown[base.name] = honest_run(tmp_path_factory.mktemp("honest"), base)
        return flown[base.name]

    return run


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.name)
def test_each_class_has_the_right_answer(report: FlightReport, run_of: Callable[[Base], Path], tmp_path: Path) -> None:
    run = run_of(report.base)
    flown = read_flown(run)
    ways = every_way(flown, seed=0, families=[report.family])
    way = next(way for way in ways if way.name.startswith(report.way))
    row = falsify.judge(way, flown, run, falsify.judged_as_of(way)[-1], folder=tmp_path)
    answer = f"{row.verdict}: {row.reasons}"
    assert re.search(report.answer, answer), answer


def test_a_fly_that_is_killed_before_it_seals_its_track_is_judged(
    run_of: Callable[[Base], Path], tmp_path: Path
) -> None:
    shutil.copytree(run_of(OBLIQUE), tmp_path / "run")
    document = json.loads((tmp_path / "run/run.json").read_text())
    document["provenance"] = [entry for entry in document["provenance"] if entry["did"] == "plan"]
    document.pop("flight", None)
    (tmp_path / "run/run.json").write_text(json.dumps(document))
    code, out, err = falsify.command("verify", tmp_path / "run")
    assert code == 0, err
    assert "no hash" in out
