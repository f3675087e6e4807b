import dataclasses
import re
from pathlib import Path

import pytest

import uavcover as uc
from mission_io.errors import VehicleSilentError
from tests.cli.conftest import corner_of_the_demo
from uavcover.errors import InputError, OptimizerError
from uavcover.flight.connect import VehicleLink, connect, home_of, require_home
from uavcover.missions.flights import export_text
from uavcover.missions.mission_compiler import compile_mission
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.planner.plan_files import bounds as bounds_of
from uavcover.planner.plan_files import least_length_m
from uavcover.planner.plan_search import SearchRequest, plan
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.user import Unattended
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import load_site

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "python_api.md"


def test_the_example_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    # With a smaller area; the demo's flies in test_setup.
    example = example.replace('"jacksboro"', repr(str(corner_of_the_demo(tmp_path))))
    assert "corner.toml" in example
    monkeypatch.chdir(tmp_path)
    exec(compile(example, str(PAGE), "exec"), {})
    planned, held, judged = capsys.readouterr().out.splitlines()[:3]
    assert planned.startswith("<Plan: 9")
    assert held == "held as planned: True"
    assert re.match(r"passed 0\.9\d+|passed 1\.000", judged)
    assert (tmp_path / "run" / "report.html").exists()


def test_every_public_name_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert [name for name in uc.__all__ if f"::: uavcover.{name}\n" not in page] == []


def test_a_saved_plan_reads_back(tmp_path: Path) -> None:
    request = PlanRequest(
        scenario=str(corner_of_the_demo(tmp_path)),
        folder=tmp_path / "run",
        command=["test"],
        force=False,
        evaluations=40,
        seed=5,
    )
    outcome = plan_into(request, Unattended(), check_site=require_home)
    site, document = read_planned(RunFolder(tmp_path / "run"))
    chosen = outcome.plan.chosen
    assert (document.route.waypoints_m == chosen.route.waypoints_m).all()
    assert document.coverage_fraction == chosen.metrics.coverage_fraction
    assert document.coverage_of_coverable == chosen.metrics.coverage_of_coverable
    assert document.rule_met == outcome.plan.rule_met
    assert home_of(site) == home_of(outcome.site)
    assert compile_mission(site, document.route).mission == outcome.compiled.mission  # type: ignore[union-attr]


def test_bounds_are_what_nothing_beats() -> None:
    bounds = bounds_of(load_site("jacksboro"))
    assert 0.9 < bounds["coverable_fraction"] <= 1.0
    assert bounds["length_reference_m"] > 1000.0
    assert "length_reference_m" not in bounds_of(load_site("paper-R2"))


def test_the_least_length_is_the_bound_of_the_plan() -> None:
    scenario = load_scenario("jacksboro")
    planner = dataclasses.replace(scenario.planner, objective="length")
    assert least_length_m(load_site(scenario), "coverage>=0.98") is None, "the mission's time is made small"
    site = load_site(dataclasses.replace(scenario, planner=planner))
    least_m = least_length_m(site, "coverage>=0.98")
    assert least_m is not None
    assert 3000.0 < least_m < bounds_of(site)["length_reference_m"]
    assert least_length_m(site, "knee") is None
    assert least_length_m(load_site("paper-R2"), "coverage>=0.98") is None


@pytest.mark.parametrize("changes", [{"budget_s": 0.0}, {"workers": 0}, {"evaluations": -1}, {"algorithm": "beetle"}])
def test_arguments_out_of_range(changes: dict[str, object]) -> None:
    site = load_site("paper-R2")
    with pytest.raises((InputError, OptimizerError), match=re.escape(next(iter(changes)).removesuffix("_s"))):
        plan(site, SearchRequest(**changes))  # type: ignore[arg-type]


def test_no_place_on_earth_no_home() -> None:
    site = load_site("paper-R2")
    assert home_of(site) is None
    with pytest.raises((InputError, OptimizerError), match="no position on Earth"):
        require_home(site)


def test_nobody_there() -> None:
    with pytest.raises(VehicleSilentError), connect(VehicleLink(url="udpin://127.0.0.1:0", timeout_s=0.2)):
        pass


def test_format_that_is_not_known() -> None:
    with pytest.raises((InputError, OptimizerError), match="waypoints, plan, kml"):
        export_text(None, "shp", autopilot="px4", name="x")  # type: ignore[arg-type]
