"""Parallel lines in one direction: the direction, the claim, and that no plain lines are better."""

import dataclasses

import numpy as np
import pytest

from tests.naive import plan_coverage
from tests.planner.sites import flat, hills, make_site
from uavcover.errors import InputError, ScenarioError
from uavcover.missions.objectives import mission_cost
from uavcover.model.scenario import PlannerSettings
from uavcover.model.sensor import FrameCamera
from uavcover.planner.baselines.boustrophedon import (
    angle_of_heading_rad,
    fly_layout,
    heading_of_angle_deg,
    long_side_angle_rad,
    plain_boustrophedon,
)
from uavcover.planner.plan_search import SearchRequest, plan
from uavcover.planner.planner import Effort, plan_routes
from uavcover.sensing.site_maps import judging_map

SURVEY = FrameCamera(
    kind="frame-camera", fov_across_deg=70.0, fov_along_deg=56.0, range_m=400.0, mount="stabilised", forward_overlap=0.7,
    side_overlap=0.6,
)  # fmt: skip


def planned(site, **effort):
    return plan_routes(
        site,
        settings=site.scenario.planner,
        select_rule="coverage>=0.98",
        effort=Effort(100, None, lambda: 0.0),
        **effort,
    )


def lines(heading_deg):
    return {"algorithm": "lines", "line_heading_deg": heading_deg}


@pytest.mark.parametrize("heading_deg", [0.0, 45.0, 90.0, 200.0, 359.0])
def test_headings_and_angles(heading_deg):
    assert heading_of_angle_deg(angle_of_heading_rad(heading_deg)) == pytest.approx(heading_deg % 180.0)


@pytest.mark.parametrize("ups", [flat, hills], ids=["flat", "hills"])
@pytest.mark.parametrize("heading_deg", [0.0, 37.0, None])
def test_lines_have_their_heading_and_see_what_was_asked(ups, heading_deg):
    site = make_site(ups, sensor=SURVEY, planner=lines(heading_deg))
    plan = planned(site)
    assert plan.rule_met
    assert plan.chosen.violation == 0.0
    legs = np.diff(plan.chosen.route.waypoints_m[:, :2], axis=0)
    lengths, headings = np.hypot(*legs.T), np.degrees(np.arctan2(*legs.T)) % 180.0
    wanted = heading_of_angle_deg(long_side_angle_rad(site.area)) if heading_deg is None else heading_deg
    off = np.abs((headings - wanted + 90.0) % 180.0 - 90.0)
    # All but the ways from line to line, which lead along the border of the area.
    assert lengths[off < 0.1].sum() > 0.5 * lengths.sum()
    assert lengths[off >= 0.1].max(initial=0.0) < 150.0
    fine = judging_map(site)
    observed = fine.fraction_of_coverable(fine.observed(plan.chosen.route.waypoints_m))
    assert observed == pytest.approx(plan.chosen.metrics.coverage_of_coverable)
    assert observed >= 0.98
    plain = fly_layout(site, plain_boustrophedon(site, angle_rad=angle_of_heading_rad(wanted)))
    if fine.fraction_of_coverable(fine.observed(plain.waypoints_m)) >= 0.98:
        assert mission_cost(site, plan.chosen.route).time_s <= mission_cost(site, plain).time_s + 1e-6


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_a_tilted_camera_that_keeps_its_heading_begins_before_the_area(heading_deg):
    """Lines over the area alone never see the ground at its near edge from the side that is asked for."""
    tilted = dataclasses.replace(SURVEY, pitch_deg=-45.0, heading_deg=heading_deg)
    site = make_site(flat, sensor=tilted, planner=lines(heading_deg))
    plan = planned(site)
    assert plan.rule_met
    back = -np.array([np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))])
    corners = np.array([[0.0, 0.0], [300.0, 0.0], [300.0, 200.0], [0.0, 200.0]])
    assert (plan.chosen.route.waypoints_m[:, :2] @ back).max() > (corners @ back).max() + 20.0
    assert _observed_on_level_ground(site, plan.chosen.route.waypoints_m) == pytest.approx(
        plan.chosen.metrics.coverage_fraction, abs=0.01
    )


def _observed_on_level_ground(site, waypoints_m):
    """Share of the area in the pictures of a route, from the scenario's figures alone."""
    sensor = {key: value for key, value in dataclasses.asdict(site.scenario.sensor).items() if value is not None}
    limits = {"min_height_agl_m": site.scenario.limits.min_height_agl_m}
    positions, headings = plan_coverage.looks({"sensor": sensor, "limits": limits}, waypoints_m)
    east, north = np.meshgrid(np.arange(1.0, 300.0, 2.0), np.arange(1.0, 200.0, 2.0))
    ground = np.column_stack([east.ravel(), north.ravel(), np.zeros(east.size)])
    up = np.tile([0.0, 0.0, 1.0], (len(ground), 1))
    observed = np.zeros(len(ground), dtype=bool)
    for position, heading in zip(positions, headings, strict=True):
        observed |= plan_coverage._in_view(sensor, ground - position, up, heading)
    return observed.mean()


def test_it_ends_when_told_to_and_is_the_same_for_any_number_of_threads():
    site = make_site(hills, sensor=SURVEY, planner=lines(0.0))
    assert planned(site).chosen.route.waypoints_m.tolist() == planned(site).chosen.route.waypoints_m.tolist()
    stopped = planned(site, should_stop=lambda: True)
    assert stopped.interrupted
    assert stopped.evaluations < planned(site).evaluations


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"line_heading_deg": 10.0}, 'line_heading_deg: requires algorithm = "lines"'),
        ({"algorithm": "lines", "line_heading_deg": 360.0}, "must be at least 0 and below 360"),
        ({"algorithm": "lines", "encoding": "waypoints"}, '"waypoints" does not apply to lines'),
    ],
)
def test_settings_that_contradict(settings, words):
    with pytest.raises((ScenarioError, ValueError), match=words):
        PlannerSettings(**settings)


@pytest.mark.parametrize("algorithm", ["memetic", "pymoo:NSGA3"])
def test_another_algorithm_for_lines_of_one_heading_is_one_error(algorithm):
    """Regression: another optimizer in their place was a fault of uavcover; the heading would have been left out."""
    site = make_site(flat, sensor=SURVEY, planner=lines(30.0))
    with pytest.raises(InputError, match=r'^line_heading_deg: requires algorithm = "lines"'):
        plan(site, SearchRequest(algorithm=algorithm))
