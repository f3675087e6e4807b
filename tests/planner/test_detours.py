"""Around what is too tall to fly over."""

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site, tower
from uavcover.missions.leg_checks import find_problems, measure_violations
from uavcover.model.limits import Obstacles
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.planner.terrain_following import around_obstacles, lay_over_terrain

MAST = tower(140, 60, 160, 140, 150, name="mast")
LOW = tower(60, 80, 80, 120, 60, name="shed")
LINE = np.array([[0.0, 110.0], [300.0, 110.0]])


def test_only_what_is_too_tall_is_flown_around_on_the_shorter_side() -> None:
    site = make_site(flat, obstacles=Obstacles(prisms=(MAST, LOW), clearance_beside_m=15.0))
    positions, heights = around_obstacles(site, LINE, np.array([60.0, 90.0]), apart_m=0.0)
    # Around the northern end, 140 + 15 m, which is nearer than the southern one; the shed is flown over.
    assert positions[[0, -1]].tolist() == LINE.tolist()
    assert positions[:, 1].max() == pytest.approx(155.05)
    assert positions[:, 1].min() == pytest.approx(110.0)
    assert shapely.LineString(positions).distance(shapely.box(140, 60, 160, 140)) >= 15.0
    assert heights[0] == 60.0
    assert heights[-1] == 90.0
    assert (np.diff(heights) > 0.0).all()


def test_the_other_way_round_is_the_same_way() -> None:
    site = make_site(flat, obstacles=Obstacles(prisms=(MAST,), clearance_beside_m=15.0))
    there, _ = around_obstacles(site, LINE, np.array([60.0, 60.0]), apart_m=0.0)
    back, _ = around_obstacles(site, LINE[::-1], np.array([60.0, 60.0]), apart_m=0.0)
    assert shapely.LineString(there).equals_exact(shapely.LineString(back[::-1]), 1e-6)


def test_without_anything_too_tall_the_line_stays_as_it_is() -> None:
    site = make_site(flat, obstacles=Obstacles(prisms=(LOW,)))
    heights = np.array([60.0, 60.0])
    positions, wanted = around_obstacles(site, LINE, heights, apart_m=0.0)
    assert positions is LINE
    assert wanted is heights


def test_corners_too_near_move_out() -> None:
    site = make_site(flat, obstacles=Obstacles(prisms=(MAST,)))
    positions, _ = around_obstacles(site, np.array([[0.0, 100.0], [145.0, 100.0]]), np.array([60.0, 60.0]), apart_m=0.0)
    assert positions[-1].tolist() == pytest.approx([129.95, 100.0])


@pytest.mark.parametrize("ups", [flat, hills])
def test_a_boustrophedon_among_towers_keeps_every_limit(ups) -> None:  # type: ignore[no-untyped-def]
    towers = Obstacles(prisms=(MAST, LOW, tower(200, 20, 230, 40, 130), tower(225, 30, 240, 60, 140)))
    site = make_site(ups, obstacles=towers, limits={"max_climb_angle_deg": 45.0})
    route = fly_layout(site, regular_layout(angle_rad=0.0, lines=5, height_agl_m=80.0, inset=0.0, tolerance_m=10.0))
    assert find_problems(site, route.waypoints_m, lowest_agl_m=40.0, highest_agl_m=120.0) == []
    assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0


def test_over_a_low_obstacle_the_route_climbs() -> None:
    site = make_site(
        flat, obstacles=Obstacles(prisms=(tower(140, 60, 160, 140, 85),)), limits={"max_climb_angle_deg": 45.0}
    )
    laid = lay_over_terrain(site, LINE, np.array([50.0, 50.0]), tolerance_m=2.0)
    assert laid[:, 2].max() >= 95.0
    assert find_problems(site, laid, lowest_agl_m=40.0, highest_agl_m=120.0) == []
