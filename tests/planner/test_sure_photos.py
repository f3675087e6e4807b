"""Pictures by distance that centimetres decide on, and routes without them."""

from pathlib import Path

import numpy as np
import pytest

from scripts.bench.kinds import measure
from tests.terrain_kinds import write_scenario
from uavcover.model.route import Route
from uavcover.planner.final_changes import LEAST_SPARE_M, certainly, unsure_photos, with_sure_photos
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.flown_line import line_flown
from uavcover.sensing.site_maps import judging_map

DISTANCE_M = 40.0
UP_M = 80.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return load_site(str(write_scenario(tmp_path_factory.mktemp("flat"), "flat", "sparse")))


def there_and_back(site: Site, spare_m: float) -> np.ndarray:
    """A route that turns back so far behind the place where its third picture is due."""
    turn_e, positions = 190.0, np.zeros(0)
    for _ in range(6):
        route = np.array([[100.0, 100.0, UP_M], [turn_e, 100.0, UP_M], [100.0, 110.0, UP_M], [100.0, 300.0, UP_M]])
        positions = line_flown(site, route).positions_m
        turn_e += 100.0 + 2.0 * DISTANCE_M + spare_m - positions[:, 0].max()
    assert positions[:, 0].max() == pytest.approx(180.0 + spare_m, abs=0.01)
    return route


def photos(site: Site, route: np.ndarray) -> int:
    return len(judging_map(site).flown_observations(route))


@pytest.mark.parametrize("spare_m", [0.2, -0.2, LEAST_SPARE_M - 0.02, 0.02 - LEAST_SPARE_M])
def test_a_picture_due_just_where_the_line_turns_back_is_unsure(site: Site, spare_m: float) -> None:
    first = next(unsure_photos(site, there_and_back(site, spare_m)))
    assert first.spare_m == pytest.approx(spare_m, abs=0.02)
    np.testing.assert_allclose(first.turning_m[0], 180.0 + spare_m, atol=0.02)
    np.testing.assert_allclose(first.away, [1.0, 0.0], atol=0.02)


@pytest.mark.parametrize("spare_m", [LEAST_SPARE_M + 0.1, -LEAST_SPARE_M - 0.1, 5.0])
def test_one_that_is_due_well_before_or_behind_is_sure(site: Site, spare_m: float) -> None:
    assert [u for u in unsure_photos(site, there_and_back(site, spare_m)) if abs(u.turning_m[0] - 180.0) < 10.0] == []


@pytest.mark.parametrize(("end_m", "unsure"), [(80.2, True), (79.8, False), (81.0, False)])
def test_the_last_one_is_unsure_where_the_line_ends_just_behind_it(site: Site, end_m: float, unsure: bool) -> None:
    line = np.array([[100.0, 100.0, UP_M], [100.0 + end_m, 100.0, UP_M]])
    middle_m = line_flown(site, line).positions_m[-1, 0]
    line[1, 0] += 100.0 + end_m - middle_m  # it turns home on the inside of its end
    assert bool(list(unsure_photos(site, line))) is unsure


@pytest.mark.parametrize("spare_m", [0.2, -0.2, 0.02, -0.02])
def test_a_waypoint_gives_way_and_the_same_pictures_are_sure(site: Site, spare_m: float) -> None:
    route = there_and_back(site, spare_m)
    other = with_sure_photos(site, Route(route))
    assert other is not None
    assert list(unsure_photos(site, other.waypoints_m)) == []
    assert photos(site, other.waypoints_m) == photos(site, route)
    moved_m = np.linalg.norm(other.waypoints_m - route, axis=1)
    assert 0.2 < moved_m.max() < 1.5
    np.testing.assert_allclose(
        site.ground.heights_agl_m(other.waypoints_m), site.ground.heights_agl_m(route), atol=1e-6
    )
    assert with_sure_photos(site, other) is None
    assert certainly(site, other) is other


def test_a_route_stays_where_giving_way_would_break_a_limit(site: Site) -> None:
    route = there_and_back(site, 0.2)
    east_m = float(np.max(np.array(site.fence.exterior.coords)[:, 0]))
    route[:, 0] += east_m - 0.05 - route[1, 0]
    assert next(unsure_photos(site, route)).spare_m == pytest.approx(0.2, abs=0.05)
    assert with_sure_photos(site, Route(route)) is not None
    whole = Route(route)
    assert certainly(site, whole) is whole


@pytest.mark.parametrize("sensor", ["nadir", "pictures"])
def test_sensors_without_a_trigger_have_none(sensor: str, tmp_path: Path) -> None:
    other = load_site(str(write_scenario(tmp_path, "flat", sensor)))
    assert list(unsure_photos(other, np.array([[100.0, 100.0, UP_M], [180.2, 100.0, UP_M]]))) == []


def test_a_flight_with_few_pictures_sees_what_is_planned(tmp_path: Path) -> None:
    row = measure(tmp_path, "narrow band", "sparse", 1, evaluations=60, flown=True)
    assert row.met
    # Photos count where the vehicle reports them: with two of three in a line, one that is late costs more than a point.
    assert row.flown >= row.claimed - 0.015
    assert row.recomputed == pytest.approx(row.claimed, abs=0.003)
