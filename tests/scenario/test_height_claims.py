"""Heights that plans claim, computed again from the elevation file by code that shares nothing with what made them."""

import json
import math

import numpy as np
import pytest

from tests.cli.conftest import corner_of_the_demo
from tests.naive.file_ground import FileGround, enu_points, leg_ranges_m, mission_points, plan_points
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.run.user import Unattended
from uavcover.scenario.scenario_file import load_scenario, terrain_source

STEP_M = 0.5
ALLOWED_M = 0.1
ROUNDING_M = 0.02
"""Mission files hold degrees to 1e-7 and heights to a millimetre at worst: up to 1 cm aside, as much in height on the slopes."""

ON_EARTH = ["jacksboro", "ridge-obstacles", pytest.param("ridge-25km2", marks=pytest.mark.long)]
LOCAL = [pytest.param("paper-R2", marks=pytest.mark.long), "paper-r1", "paper-planar"]


def planned(tmp_path, name):
    folder = tmp_path / "run"
    request = PlanRequest(scenario=name, folder=folder, command=["test"], force=False, evaluations=60, seed=3)
    plan_into(request, Unattended(), check_site=lambda _: None)
    return folder


@pytest.mark.parametrize("name", ON_EARTH)
def test_no_leg_leaves_the_band_that_it_claims(tmp_path, name):
    folder, scenario = planned(tmp_path, name), load_scenario(name)
    ground = FileGround(terrain_source(scenario.terrain).files[0])
    low, high = scenario.limits.min_height_agl_m, scenario.limits.max_height_agl_m
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    points = plan_points(folder / "plan.json")
    assert len(points) >= 15
    np.testing.assert_allclose(enu_points(folder / "plan.json"), points, rtol=0.0, atol=1e-6)

    ranges = leg_ranges_m(ground.height_m, points, step_m=STEP_M)
    assert ranges[:, 0].min() >= low - ALLOWED_M
    assert ranges[:, 1].max() <= high + ALLOWED_M
    # The claims themselves: of the whole route, and of every waypoint.
    assert plan["metrics"]["min_height_agl_m"] == pytest.approx(ranges[:, 0].min(), abs=ALLOWED_M)
    assert plan["metrics"]["max_height_agl_m"] == pytest.approx(ranges[:, 1].max(), abs=ALLOWED_M)
    claimed = [waypoint["height_agl_m"] for waypoint in plan["waypoints"]]
    np.testing.assert_allclose(claimed, points[:, 2] - ground.height_m(points[:, 0], points[:, 1]), atol=0.01)

    missions = sorted(folder.glob("**/mission.waypoints"))
    assert missions
    for mission in missions:
        flown = mission_points(mission)
        # The planned waypoints are among the mission's; the ways there and home keep the transit clearance.
        ranges = leg_ranges_m(ground.height_m, flown, step_m=STEP_M)
        assert ranges[:, 0].min() >= min(scenario.limits.transit_clearance_m, low) - ALLOWED_M - ROUNDING_M
        is_planned = np.array([np.abs(points - row).max(axis=1).min() < 0.05 for row in flown])
        both = is_planned[:-1] & is_planned[1:]
        assert both.sum() > 10
        assert ranges[both, 0].min() >= low - ALLOWED_M - ROUNDING_M
        assert ranges[both, 1].max() <= high + ALLOWED_M + ROUNDING_M


@pytest.mark.parametrize("name", LOCAL)
def test_no_node_of_the_paper_leaves_the_band_that_it_claims(tmp_path, name):
    plan = json.loads((planned(tmp_path, name) / "plan.json").read_text(encoding="utf-8"))
    limits = load_scenario(name).limits
    for node in plan["waypoints"]:
        above = node["up_m"] - math.sin(node["north_m"]) * math.cos(node["east_m"])
        assert node["height_agl_m"] == pytest.approx(above, abs=1e-9)
        assert limits.min_height_agl_m - 1e-6 <= above <= limits.max_height_agl_m + 1e-6


def test_the_check_sees_ground_that_is_brought_to_another_grid(tmp_path):
    """What this test is for: half a pixel's grid, as it was, leaves the band by metres."""
    scenario = load_scenario("jacksboro")
    old = corner_of_the_demo(tmp_path)
    text = old.read_text(encoding="utf-8")
    assert 'vertical_datum = "EGM96"' in text
    # The shortest route follows the terrain with most waypoints, near to the ends of the band.
    text = text.replace("[planner]", '[planner]\nobjective = "length"\nwaypoint_price = 0.0')
    old.write_text(text.replace('vertical_datum = "EGM96"', 'vertical_datum = "EGM96"\ngrid_step_m = 37.0'))
    folder = planned(tmp_path, str(old))
    ground = FileGround(terrain_source(scenario.terrain).files[0])
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    ranges = leg_ranges_m(ground.height_m, plan_points(folder / "plan.json"), step_m=STEP_M)
    too_high_m = ranges[:, 1].max() - plan["metrics"]["max_height_agl_m"]
    too_low_m = plan["metrics"]["min_height_agl_m"] - ranges[:, 0].min()
    assert max(too_high_m, too_low_m) > 10 * ALLOWED_M
