"""`plan --rally auto`: places to land from which every second of a flight has a safe way down."""

import dataclasses

import numpy as np
import pytest

from tests.missions.compiled_routes import route
from tests.planner.sites import make_site, ridge
from uavcover.errors import ScenarioError
from uavcover.missions.mission_compiler import CompiledMission, compile_mission
from uavcover.model.scenario import PlannerSettings
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.site import Site, build_site

ROUTE = route((20, 150, 160), (200, 150, 160), (260, 150, 80), (260, 50, 80), (200, 50, 160), (20, 50, 160))
"""To the far side of the ridge and back, so that the return transit has no ridge below it."""


def walled(**vehicle: float) -> Site:
    """A ridge between home and the far half of the area, higher than the return height."""
    return make_site(
        ridge(140.0, 100.0), vehicle={"return_height_m": 60.0, **vehicle},
        limits={"max_climb_angle_deg": 80.0, "max_height_agl_m": 180.0},
    )  # fmt: skip


def flown(
    site: Site, rally: str | tuple[tuple[float, float], ...], autopilot: AutopilotName = "ardupilot"
) -> CompiledMission:
    planner = dataclasses.replace(site.scenario.planner, rally=rally)
    own = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, planner=planner))
    return compile_mission(own, ROUTE, autopilot=autopilot)


def test_rally_points_make_an_unsafe_return_safe() -> None:
    site = walled()
    before, after = flown(site, "home"), flown(site, "auto")
    assert before.return_advice.sentences
    assert after.return_advice.sentences == ()
    assert len(before.rally.points) == 1
    assert 2 <= len(after.rally.points) <= 3


def test_proposed_points_are_for_px4_at_the_height_of_the_ground() -> None:
    site = walled()
    found = flown(site, "auto", "px4")
    assert found.return_advice.sentences == ()
    assert site.frame is not None
    for point in found.rally.points[1:]:
        enu = site.frame.enu_from_geodetic(point.lat_deg, point.lon_deg, 400.0)[0]
        assert abs(site.ground.heights_m(enu[:2])[0] - point.alt_m - site.home_m[2]) < 0.5


def test_nothing_is_proposed_where_the_return_is_safe() -> None:
    site = make_site()
    planner = dataclasses.replace(site.scenario.planner, rally="auto")
    own = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, planner=planner))
    assert len(compile_mission(own, route((0, 50, 80), (200, 50, 80)), autopilot="ardupilot").rally.points) == 1


def test_where_no_place_helps_the_plan_says_from_where_to_where() -> None:
    """All ground behind the ridge is steep: nothing to land on."""

    def steep(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return ridge(140.0, 100.0)(east, north) + np.where(east > 160.0, 0.3 * np.abs(north - 100.0), 0.0)

    site = make_site(
        steep, vehicle={"return_height_m": 60.0}, limits={"max_climb_angle_deg": 80.0, "max_height_agl_m": 180.0}
    )
    advice = flown(site, "auto").return_advice
    assert advice.sentences
    assert all(words.startswith("from waypoint ") for words in advice.sentences)


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_rally_points_of_the_scenario_are_added_to_home(autopilot: AutopilotName) -> None:
    site = walled()
    assert site.frame is not None
    lats, lons, _ = site.frame.geodetic_from_enu(np.array([[240.0, 100.0, 0.0], [-20.0, 60.0, 0.0]]))
    given = tuple(zip(lons.tolist(), lats.tolist(), strict=True))
    found = flown(site, given, autopilot).rally.points
    assert [(p.lon_deg, p.lat_deg) for p in found[1:]] == [
        (pytest.approx(lon, abs=1e-6), pytest.approx(lat, abs=1e-6)) for lon, lat in given
    ]
    assert all(point.alt_m is not None for point in found)


def test_a_rally_point_outside_the_fence_is_refused() -> None:
    site = make_site()
    scenario = site.scenario
    assert site.frame is not None
    lat, lon, _ = site.frame.geodetic_from_enu(np.array([[5000.0, 0.0, 0.0]]))
    planner = dataclasses.replace(scenario.planner, rally=((float(lon[0]), float(lat[0])),))
    with pytest.raises(ScenarioError, match=r"planner\.rally\.0: the position is outside limits\.fence"):
        build_site(dataclasses.replace(scenario, planner=planner))


@pytest.mark.parametrize("given", [(), ((181.0, 0.0),), ((0.0, 91.0),)], ids=str)
def test_rally_points_that_are_none(given: tuple[tuple[float, float], ...]) -> None:
    with pytest.raises(ValueError, match="rally"):
        PlannerSettings(rally=given)
