"""A flight with missing legs and the mission that closes its gaps, verified together."""

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from tests.verification.flights import Flight, fly_along, taken
from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.route import Route
from uavcover.planner.close_gaps import plan_gap_mission
from uavcover.verification.command import judge_tracks
from uavcover.verification.flown_route import PlannedRoute

pytestmark = pytest.mark.usefixtures("attitudes_count")


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight(
        make_site(hills, ring=((0, 0), (600, 0), (600, 300), (0, 300)), requirements={"min_coverage_of_coverable": 0.9})
    )


def length_m(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@pytest.mark.parametrize("seed", range(3))
def test_plan_and_gap_mission_together_reach_the_planned_coverage(flight: Flight, seed: int) -> None:
    site, track = flight.site, flight.track
    first = compile_mission(site, Route(flight.planned.waypoints_m), autopilot="ardupilot")
    legs = np.arange(1, len(flight.planned.waypoints_m))
    lost = np.random.default_rng(seed).choice(legs, size=max(1, len(legs) // 5), replace=False)
    torn = (taken(track, np.flatnonzero(~np.isin(track.current_waypoint, lost))), flight.planned)
    before = judge_tracks(site, [torn])
    promised = flight.planned.coverage_fraction
    assert before.report.coverage_fraction < promised
    mission = plan_gap_mission(site, before)
    assert mission.plan.rule_met
    assert length_m(mission.compiled.path_m) < 0.5 * length_m(first.path_m)
    assert site.home_m is not None
    path = np.vstack([site.home_m, mission.compiled.path_m, site.home_m])
    count = len(mission.repair.route)
    repair = fly_along(site, path, first=mission.compiled.first_waypoint_item, count=count)
    planned = PlannedRoute(mission.repair.route.waypoints_m, 0.0)
    both = judge_tracks(site, [torn, (repair, planned)]).report
    assert both.coverage_fraction >= promised
    assert both.violations == ()
    assert both.coverage_of_coverable == pytest.approx(mission.coverage_after, abs=0.005)


def test_what_cannot_be_asked_and_what_cannot_be_closed(flight: Flight) -> None:
    verdict = judge_tracks(flight.site, [(flight.track, flight.planned)])
    with pytest.raises(InputError, match="min area"):
        plan_gap_mission(flight.site, verdict, min_area_m2=-1.0)
    with pytest.raises(InputError, match="target"):
        plan_gap_mission(flight.site, verdict, target=1.1)
    with pytest.raises(InfeasibleError, match="large enough"):
        plan_gap_mission(flight.site, verdict, min_area_m2=1e9)
    with pytest.raises(InfeasibleError, match="already reached 50 %"):
        plan_gap_mission(flight.site, verdict, target=0.5)
