"""Areas of few cells are judged on smaller ones, so that a coverage is no small sample."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.terrain_kinds import write_scenario
from uavcover.model.scenario import Scenario
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.cells import MOST_POSITIONS, evenness, is_judged_on_smaller_cells, judged_cell_size_m
from uavcover.sensing.site_maps import finer_map, judging_block, judging_map, judging_maps, row_blocks


@pytest.fixture(scope="module")
def canyon(tmp_path_factory: pytest.TempPathFactory) -> Site:
    return load_site(str(write_scenario(tmp_path_factory.mktemp("canyon"), "canyon", "nadir")))


def lines(site: Site) -> np.ndarray:
    layout = regular_layout(angle_rad=0.4, lines=4, height_agl_m=85.0, inset=0.3, tolerance_m=15.0)
    return fly_layout(site, layout).waypoints_m


def restricted_to(scenario: Scenario, fewest_places: int) -> Site:
    return load_site(
        dataclasses.replace(scenario, area=dataclasses.replace(scenario.area, fewest_places=fewest_places))
    )


@pytest.mark.parametrize("name", ["paper-R2", "paper-planar", "jacksboro", "ridge-obstacles"])
def test_what_has_enough_cells_is_judged_on_them(name: str) -> None:
    site = load_site(name)
    assert judged_cell_size_m(site) == site.scenario.area.cell_size_m
    assert not is_judged_on_smaller_cells(site)
    assert judging_map(site).grid.size_m == site.scenario.area.cell_size_m


@pytest.mark.parametrize(("terrain", "sensor"), [("hectare", "nadir"), ("40 m", "survey"), ("L with holes", "nadir")])
def test_few_cells_are_made_more(terrain: str, sensor: str, tmp_path: Path) -> None:
    site = load_site(str(write_scenario(tmp_path, terrain, sensor)))
    assert 0.98 * 25_000 < judging_map(site).grid.count < 1.1 * 25_000
    assert is_judged_on_smaller_cells(site)
    own = restricted_to(site.scenario, 0)
    assert judging_map(own).grid.size_m == own.scenario.area.cell_size_m
    more = restricted_to(site.scenario, 30_000)
    assert judging_map(more).grid.count > judging_map(site).grid.count


def test_cliffs_that_hold_much_of_the_ground_get_more(canyon: Site) -> None:
    assert evenness(canyon) < 0.4
    weight = judging_map(canyon).grid.weight_m2
    assert 0.8 * 25_000 < weight.sum() ** 2 / (weight**2).sum() < 1.2 * 25_000
    assert 60_000 < weight.size <= MOST_POSITIONS
    most = restricted_to(canyon.scenario, 100_000)
    assert most.area.area / judged_cell_size_m(most) ** 2 == pytest.approx(MOST_POSITIONS)


def test_a_coverage_is_the_same_at_other_places_in_a_canyon(canyon: Site) -> None:
    """The sample of a canyon's own 8,500 cells was off by half a point: cliffs one pixel wide hold a quarter of its ground."""
    route = lines(canyon)
    own, other = judging_map(canyon), finer_map(canyon)
    assert other is not None
    assert not np.array_equal(own.grid.cells.centre_m, other.grid.cells.centre_m)
    assert own.grid.size_m == other.grid.size_m
    assert own.fraction(own.observed(route)) == pytest.approx(other.fraction(other.observed(route)), abs=0.002)
    assert judging_maps(canyon) == [own]
    assert finer_map(canyon) is other


@pytest.mark.parametrize("name", ["jacksboro", "ridge-obstacles"])
def test_finer_cells_have_the_places_of_the_judged_ones(name: str) -> None:
    site = load_site(name)
    own, finer = judging_map(site).grid, finer_map(site)
    assert finer is not None
    assert finer.grid.size_m == 0.5 * own.size_m
    assert finer.grid.count > 3.9 * own.count
    apart_m, _ = cKDTree(finer.grid.cells.centre_m).query(own.cells.centre_m)
    assert apart_m.max() < 1e-6
    assert len(np.unique(finer.grid.cells.centre_m.round(6), axis=0)) == finer.grid.count


def test_blocks_have_the_cells_that_are_judged(canyon: Site) -> None:
    whole = judging_map(canyon)
    blocks = [judging_block(canyon, rows) for rows in row_blocks(canyon, cells=30_000)]
    assert len(blocks) > 2
    joined = np.vstack([block.grid.cells.centre_m for block in blocks])
    assert np.array_equal(joined, whole.grid.cells.centre_m)


def test_an_impossible_number_is_refused() -> None:
    area = load_site("jacksboro").scenario.area
    with pytest.raises(ValueError, match="fewest_places"):
        dataclasses.replace(area, fewest_places=-1)


def test_a_few_routes_are_tested_without_what_decides_most_rays(canyon: Site) -> None:
    """Finding it took as long as 6 routes, and up to 75 for other sensors."""
    others = finer_map(canyon)
    assert others is not None
    assert len(judging_map(canyon).grid.cells.rise) == judging_map(canyon).grid.count
    assert len(others.grid.cells.rise) == 0
    route_m = lines(canyon)
    looks = others.flown_observations(route_m)
    before = others.observed_by(looks)
    others.expect_many_routes()
    assert len(others.grid.cells.rise) == others.grid.count
    np.testing.assert_array_equal(others.observed_by(looks), before)
    grid = others.grid
    others.expect_many_routes()
    assert others.grid is grid
