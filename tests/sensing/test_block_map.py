"""A map made of blocks says what the map in one piece says, to the last bit, whoever looks at the blocks."""

import dataclasses
import pickle

import numpy as np
import pytest

from tests.planner.sites import hills, make_site
from tests.sensing.test_blocks import hard_site
from uavcover.errors import ScenarioError
from uavcover.extras.bounds.bounds import are_quick, farthest_looks_m, least_path_length_m
from uavcover.scenario.site import Site
from uavcover.sensing import site_maps
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import BlockMap, in_blocks, judging_map, look_at_all, look_at_block, one_after_the_other


def lines(site: Site) -> list[np.ndarray]:
    paths = (
        [[-50.0, 20.0], [310.0, 60.0], [310.0, 130.0]],
        [[-20.0, 190.0], [40.0, 150.0]],
        [[900.0, 900.0], [950.0, 900.0]],
    )
    return [np.column_stack([path, site.ground.ups_m(np.array(path), 60.0)]) for path in map(np.array, paths)]


@pytest.fixture
def of_blocks(monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.setattr(site_maps, "_MOST_AT_ONCE", 100)
    monkeypatch.setattr(site_maps, "_BLOCK_CELLS", 250)
    site = in_blocks(hard_site())
    made = judging_map(site)
    assert isinstance(made, BlockMap)
    assert len(list(made.blocks())) > 4
    return site


@pytest.fixture(scope="module")
def whole() -> CoverageMap:
    return judging_map(hard_site())


def test_it_sees_what_the_whole_sees(of_blocks: Site, whole: CoverageMap) -> None:
    made = judging_map(of_blocks)
    for route in lines(of_blocks):
        observed = made.observed(route)
        assert np.array_equal(observed, whole.observed(route))
        assert made.fraction(observed) == whole.fraction(observed)
        assert made.fraction_of_coverable(observed) == whole.fraction_of_coverable(observed)
    assert 0.1 < made.observed(lines(of_blocks)[0]).mean() < 0.9
    assert made.knows_coverable(lambda: True)
    assert np.array_equal(made.coverable, whole.coverable)
    assert np.array_equal(made.grid.weight_m2, whole.grid.weight_m2)
    observations = made.observations(lines(of_blocks)[0])
    assert np.array_equal(made.first_observed(observations), whole.first_observed(observations))
    assert np.array_equal(made.observed_by(observations), whole.observed_by(observations))


def test_bounds_are_the_same(of_blocks: Site, whole: CoverageMap) -> None:
    made = judging_map(of_blocks)
    assert np.array_equal(farthest_looks_m(made), farthest_looks_m(whole))
    assert least_path_length_m(made, 0.9) == least_path_length_m(whole, 0.9) > 0.0
    assert are_quick(made) == are_quick(whole)


def test_its_cells_are_made_only_when_they_are_asked_for(
    of_blocks: Site, whole: CoverageMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = judging_map(of_blocks)
    rows, _ = whole.grid.cells.lattice.shape
    largest = 0
    real = site_maps.judging_block

    def watched(site: Site, wanted: range) -> CoverageMap:
        nonlocal largest
        largest = max(largest, len(wanted))
        return real(site, wanted)

    monkeypatch.setattr(site_maps, "judging_block", watched)
    least_path_length_m(made, 0.9)
    made.observed(lines(of_blocks)[0])
    assert 0 < largest < rows
    assert np.array_equal(made.grid.cells.centre_m, whole.grid.cells.centre_m)
    assert np.array_equal(made.grid.middles_m, whole.grid.middles_m)
    assert largest == rows


def test_whoever_looks_at_a_block_gives_the_same_once(of_blocks: Site, whole: CoverageMap) -> None:
    calls = []

    def elsewhere(site: Site, tasks):
        # Through a wire, from the last to the first, on a site that knows nothing yet.
        calls.append(len(tasks))
        there = pickle.loads(pickle.dumps(dataclasses.replace(site)))
        for task in reversed(tasks):
            yield task, pickle.loads(pickle.dumps(look_at_block(there, pickle.loads(pickle.dumps(task)))))

    made, routes = judging_map(of_blocks), lines(of_blocks)
    look_at_all(made, routes, elsewhere)
    assert calls
    calls.clear()
    look_at_all(made, routes, elsewhere)
    assert [made.observed(route).tolist() for route in routes] == [whole.observed(route).tolist() for route in routes]
    assert np.array_equal(made.coverable, whole.coverable)
    assert made.grid.hidden_m2 == whole.grid.hidden_m2
    assert not calls
    look_at_all(whole, routes, elsewhere)
    assert not calls


def test_a_short_route_is_looked_at_where_it_is(of_blocks: Site, whole: CoverageMap) -> None:
    required = []

    def here(site: Site, tasks):
        required.append([len(task.routes_m) for task in tasks])
        yield from one_after_the_other(site, tasks)

    made = judging_map(of_blocks)
    look_at_all(made, (), here)
    all_blocks = len(required.pop())
    long, short, far = lines(of_blocks)
    north = long + np.array([0.0, 250.0, 0.0])
    look_at_all(made, [north, far], here)
    assert 0 < len(required.pop()) < all_blocks
    look_at_all(made, [far + np.array([0.0, 900.0, 0.0])], here)
    assert required == [[]]
    for route in (north, far, short, long):
        assert np.array_equal(made.observed(route), whole.observed(route))


def test_small_areas_and_those_with_too_many_cells_are_looked_at_in_one_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    site = in_blocks(hard_site())
    assert not isinstance(judging_map(site), BlockMap)
    monkeypatch.setattr(site_maps, "_MOST_AT_ONCE", 100)
    monkeypatch.setattr(site_maps, "MAX_CELLS", 200)
    monkeypatch.setattr("uavcover.sensing.cells.MAX_CELLS", 200)
    site = in_blocks(hard_site())
    with pytest.raises(
        ScenarioError, match="7 m divides 300 x 200 m into 1,247 cells, but the limit is 200; use larger cells"
    ):
        judging_map(site)


def test_an_area_without_cells_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(site_maps, "_MOST_AT_ONCE", 0)
    # The centre of the only cell lies outside.
    site = make_site(hills, ring=((0.0, 0.0), (1.0, 0.0), (60.0, 59.0), (60.0, 60.0), (59.0, 60.0)), cell_m=150.0)
    site = in_blocks(site)
    with pytest.raises(ScenarioError, match="no 150 m cell is centred in the area; use smaller cells"):
        judging_map(site).observed(np.array([[0.0, 0.0, 60.0]]))
