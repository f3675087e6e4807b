"""The public names, and the chain that the package's docstring and docs show."""

import re
from pathlib import Path

import pytest

import mission_io
import uavcover as uc
from tests.cli.conftest import corner_of_the_demo, files

NAMES = {
    "FlightOptions", "InfeasibleError", "InputError", "Plan", "Route", "Site", "Track", "UavcoverError", "VehicleError",
    "VehicleLink", "Verdict", "compile_mission", "connect", "find_gaps", "fly", "load_site", "plan", "select", "upload",
    "verify", "verify_track", "write_report",
}  # fmt: skip


def test_the_public_names() -> None:
    assert set(uc.__all__) == NAMES
    assert all(getattr(uc, name) is not None for name in NAMES)
    assert set(uc.__all__) <= set(dir(uc))
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = uc.no_such_name


def test_every_public_name_has_one_place() -> None:
    positions = {name for names in uc._MODULES.values() for name in names}
    assert positions | (NAMES & set(vars(uc))) == NAMES


def test_mission_io_exports_what_it_says() -> None:
    assert all(hasattr(mission_io, name) for name in mission_io.__all__)


def test_the_whole_chain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines of the docstring, run as they stand, with a smaller area and a faster vehicle."""
    chain = re.findall(r"^    (.*)$", (uc.__doc__ or "").split("too::", 1)[1], re.MULTILINE)
    assert len(chain) <= 12
    code = "\n".join(chain).replace(
        'uc.connect("mock:", site)', 'uc.connect(uc.VehicleLink(url="mock:", mock_speed=40.0), site)'
    )
    assert "mock_speed" in code
    assert code.count('"jacksboro"') == 1
    code = code.replace('"jacksboro"', repr(str(corner_of_the_demo(tmp_path))))
    monkeypatch.chdir(tmp_path)
    shown: dict[str, object] = {}
    exec(compile(code, "docstring", "exec"), shown)
    run = tmp_path / "RUN"
    assert {"plan.json", "mission.waypoints", "upload.json", "track.csv", "flight.rrd", "verification.json",
            "gaps.geojson", "report.html"} <= files(run)  # fmt: skip
    site, plan, track, verdict = shown["site"], shown["plan"], shown["track"], shown["verdict"]
    assert isinstance(verdict, uc.Verdict)
    assert verdict.report.passed
    assert re.match(r"<Verdict: passed; (9\d|100)\.\d+ % of the area", repr(verdict))
    assert re.match(r"<Plan: 9\d\.\d+ % of the visible ground, \d+ waypoints", repr(plan))
    assert re.match(r"<Site jacksboro: \d+\.\d+ square kilometres at 36\.", repr(site))
    assert re.match(r"<Track: \d+ samples over \d+ s>", repr(track))
    for drawn in (plan, track, verdict):
        assert "<svg" in drawn._repr_html_()  # type: ignore[attr-defined]
    assert isinstance(site, uc.Site)
    assert isinstance(track, uc.Track)
    assert isinstance(plan, uc.Plan)
    in_memory = uc.verify_track(site, track, plan)
    assert in_memory.report.coverage_fraction == verdict.report.coverage_fraction
    assert len(uc.compile_mission(site, plan).mission.items) == len(
        uc.compile_mission(site, plan.chosen.route).mission.items
    )
    with pytest.raises(uc.InputError, match="--force"):
        uc.plan(site, out=run, evaluations=40)
    chosen = uc.select(run, "max-coverage", force=True)
    assert chosen.rule_met
