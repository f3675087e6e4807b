import dataclasses

import numpy as np
import pytest
import shapely

from uavcover.errors import ScenarioError, TerrainError
from uavcover.model.limits import Home
from uavcover.model.scenario import Origin
from uavcover.scenario.scenario_file import load_scenario, terrain_source
from uavcover.scenario.site import build_site
from uavcover.sensing.cells import make_cells


def jacksboro(*, area=None, limits=None, **changes):
    scenario = load_scenario("jacksboro")
    return dataclasses.replace(
        scenario, area=dataclasses.replace(scenario.area, **(area or {})),
        limits=dataclasses.replace(scenario.limits, **(limits or {})), **changes,
    )  # fmt: skip


def build(scenario):
    return build_site(scenario, terrain_file=terrain_source(scenario.terrain).files[0])


def test_the_demo_lies_where_it_should():
    site = build(jacksboro())
    assert site.area.area == pytest.approx(1.0e6, rel=0.02)
    assert site.fence.covers(site.area)
    assert site.fence.covers(shapely.Point(site.home_m))
    # Home is the origin, at the ground's own height; between pixels of 90 m the Earth's curvature is a quarter of a millimetre.
    np.testing.assert_allclose(site.home_m, 0.0, atol=3e-4)
    assert site.alts_amsl_m(site.home_m)[0] == pytest.approx(site.alt_amsl_offset_m, abs=3e-4)
    up = make_cells(site, 20.0).cells.centre_m[:, 2]
    assert 500.0 < np.ptp(up) < 560.0


def test_the_ridge_is_the_window_with_the_most_relief():
    scenario = load_scenario("ridge-25km2")
    site = build_site(scenario, terrain_file=terrain_source(scenario.terrain).files[0])
    cells = make_cells(site, scenario.area.cell_size_m).cells
    assert len(cells.centre_m) == 250_000
    assert np.ptp(cells.centre_m[:, 2]) == pytest.approx(805.0, abs=2.0)
    # Home is on low ground: three quarters of the area and more lie above it.
    assert np.mean(cells.centre_m[:, 2] > site.home_m[2]) > 0.75


def test_the_paper_has_no_place_on_earth():
    site = build_site(load_scenario("paper-R2"))
    assert (site.frame, site.home_m, site.alt_amsl_offset_m) == (None, None, 0.0)
    assert site.alts_amsl_m(np.array([[1.0, 2.0, 3.0]])).tolist() == [3.0]


SWAPPED = ((36.476, -84.227), (36.476, -84.216), (36.485, -84.216))
MAP = ((740_000.0, 4_040_000.0), (741_000.0, 4_040_000.0), (741_000.0, 4_041_000.0))
POSITION = Origin(lat_deg=36.4762, lon_deg=-84.216, alt_amsl_m=320.0)


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"area": {"polygon_lon_lat_deg": SWAPPED}}, ScenarioError, "area.polygon_lon_lat_deg: .* swapped"),
        ({"limits": {"fence_lon_lat_deg": SWAPPED}}, ScenarioError, "home: the take-off position is outside|swapped"),
        ({"home": Home(lat_deg=-84.216, lon_deg=36.4762)}, TerrainError, "home: .*no elevation data.* swapped"),
        (
            {"area": {"polygon_lon_lat_deg": None, "polygon_east_north_m": MAP}, "origin": POSITION, "home": None},
            ScenarioError, r"area\.polygon_east_north_m: the position is 4041 km from the origin of the local frame; the",
        ),
        (
            {"limits": {"fence_east_north_m": ((-9.0, -9.0), (9.0, 9.0), (9.0, -9.0), (-9.0, 9.0))}},
            ScenarioError, "limits.fence_east_north_m: Self-intersection",
        ),
        (
            {"limits": {"fence_east_north_m": ((100.0, 0.0), (900.0, 0.0), (900.0, 900.0))}},
            ScenarioError, "home: the take-off position is outside limits.fence",
        ),
    ],
)  # fmt: skip
def test_places_that_do_not_fit_together(changes, error, words):
    with pytest.raises(error, match=words) as caught:
        build(jacksboro(**changes))
    assert "\n" not in str(caught.value)


def test_an_area_wider_than_its_fence_still_has_its_ground():
    # Regression: terrain was read for the fence alone.
    fence = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))
    site = build(jacksboro(limits={"fence_east_north_m": fence}))
    assert make_cells(site, 20.0).count > 2000


def test_an_area_beyond_the_data_is_refused_with_its_place():
    beyond = ((-84.22684, 36.40), (-84.21566, 36.40), (-84.21566, 36.49))
    site = build(jacksboro(area={"polygon_lon_lat_deg": beyond}))
    with pytest.raises(
        TerrainError, match=r"^area: there is no elevation data in .* % of its cells, first at latitude 36.4"
    ):
        make_cells(site, 20.0)


def test_parts_are_united_and_the_fence_holds_all_of_them():
    square = ((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))
    hole = ((20.0, 20.0), (40.0, 20.0), (40.0, 40.0), (20.0, 40.0))
    touching = tuple((east + 100.0, north) for east, north in square)
    apart = tuple((east + 400.0, north + 300.0) for east, north in square)
    parts = ((square, hole), (touching,), (apart,), (apart,))
    area = {"polygon_lon_lat_deg": None, "polygons_east_north_m": parts}
    site = build(jacksboro(area=area, origin=POSITION, home=Home(east_m=50.0, north_m=-10.0)))
    assert site.area.area == pytest.approx(30_000.0 - 400.0)
    assert len(site.area.geoms) == 2
    assert site.fence.covers(site.area.convex_hull)
    cells = make_cells(site, 10.0)
    assert cells.count == 296


def test_a_home_in_metres_and_an_origin():
    ring = ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0))
    hole = ((50.0, 10.0), (90.0, 10.0), (90.0, 40.0))
    area = {"polygon_lon_lat_deg": None, "polygon_east_north_m": ring}
    site = build(
        jacksboro(area={**area, "holes_east_north_m": (hole,)}, origin=POSITION, home=Home(east_m=20.0, north_m=10.0))
    )
    assert site.area.area == pytest.approx(45_000.0 - 600.0)
    assert site.home_m[:2].tolist() == [20.0, 10.0]
    assert site.home_m[2] == site.ground.heights_m([20.0, 10.0])[0]
    with pytest.raises(ScenarioError, match="the holes cover the whole area"):
        build(jacksboro(area={**area, "holes_east_north_m": (ring,)}, origin=POSITION, home=None))
