"""A flight that is killed after any of its writes leaves a run that verify judges, not one that it refuses."""

import itertools
import os
import shutil
from pathlib import Path

import pytest

from tests import falsify
from tests.falsifying.honest_run import HILLS, Field, make_site, save_lines
from uavcover.run import file_group
from uavcover.run.folder import RunFolder


class KilledError(BaseException):
    """Nothing of this process runs after it."""


class Kill:
    """``os.replace`` of a process that is killed at one of its calls: from then on it does nothing."""

    def __init__(self, call: int) -> None:
        self.calls = itertools.count()
        self._call = call
        self.dead = False

    def __call__(self, source: Path, target: Path) -> None:
        if self.dead:
            raise KilledError
        self.dead = next(self.calls) == self._call
        os.rename(source, target)
        if self.dead:
            raise KilledError


# What a killed process leaves open is closed by nothing.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("planned")
    site = make_site(folder / "scenario", HILLS)
    run = RunFolder(folder / "run")
    save_lines(run, site, HILLS)
    return site, run.path


def fly(planned, folder: Path, monkeypatch: pytest.MonkeyPatch, kill: Kill) -> RunFolder:
    site, path = planned
    run = RunFolder(shutil.copytree(path, folder / "run"))
    with monkeypatch.context() as patch:
        patch.setattr(file_group.os, "replace", kill)
        try:
            Field(site=site).fly(run)
        except KilledError:
            assert kill.dead
    return run


def test_no_write_leaves_a_run_that_is_refused(planned, tmp_path, monkeypatch):
    whole = Kill(-1)
    (tmp_path / "whole").mkdir()
    fly(planned, tmp_path / "whole", monkeypatch, whole)
    writes = next(whole.calls)
    assert 4 <= writes < 12
    verdicts = []
    for call in range(writes):
        folder = tmp_path / f"{call}"
        folder.mkdir()
        run = fly(planned, folder, monkeypatch, Kill(call))
        track = run.file("track.csv")
        if not track.exists() or track.read_bytes().count(b"\n") < 10:
            continue
        code, _, err = falsify.command("verify", run, "--json")
        assert code in (0, 1), (call, err)
        verdicts.append(code)
        if run.file("flight.rrd").exists():
            code, _, err = falsify.command("verify", run, "--log", run.file("flight.rrd"), "--json")
            assert code in (0, 1) or "cannot be read" in err or "no samples" in err, (call, err)
    assert verdicts.count(0) >= 2
