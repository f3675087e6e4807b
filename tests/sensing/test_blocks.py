"""Cells in blocks are the cells of the whole, and see the same: no seams."""

import dataclasses
import itertools

import numpy as np
import pytest

from tests.planner.sites import CAMERA, hills, make_site, tower
from uavcover.errors import ScenarioError
from uavcover.model.limits import Obstacles
from uavcover.scenario.site import Site
from uavcover.sensing import coverage_map
from uavcover.sensing.cells import lattice_shape, make_cells, make_sampled_cells
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_block, judging_map, row_blocks

HOLE = ((120.0, 60.0), (180.0, 60.0), (180.0, 120.0), (120.0, 120.0))
TOWERS = Obstacles(prisms=(tower(40.0, 40.0, 70.0, 60.0, 30.0), tower(200.0, 100.0, 215.0, 170.0, 45.0)))


def rough(east, north):
    # Steep enough for rays to be stopped.
    return hills(east, north) + 40.0 * np.abs(np.sin(east / 17.0) * np.sin(north / 23.0))


def hard_site(sensor=CAMERA, **options) -> Site:
    return make_site(rough, holes=(HOLE,), obstacles=TOWERS, cell_m=7.0, sensor=sensor, **options)


def blocks(rows: int, step: int) -> list[range]:
    return [range(first, min(first + step, rows)) for first in range(0, rows, step)]


@pytest.mark.parametrize(("cut", "step"), list(itertools.product((make_cells, make_sampled_cells), (1, 5, 11))))
def test_a_cell_is_the_same_in_a_block_to_the_last_bit(cut, step) -> None:
    site = hard_site()
    whole = cut(site, 7.0)
    rows, columns = lattice_shape(site, 7.0)
    assert whole.cells.lattice.shape == (rows, columns)
    pieces = [cut(site, 7.0, rows=each) for each in blocks(rows, step)]
    for name in ("centre_m", "normal", "horizon"):
        assert np.array_equal(
            np.concatenate([getattr(piece.cells, name) for piece in pieces]), getattr(whole.cells, name)
        )
    assert np.array_equal(np.concatenate([piece.weight_m2 for piece in pieces]), whole.weight_m2)
    assert np.array_equal(np.vstack([piece.cells.lattice >= 0 for piece in pieces]), whole.cells.lattice >= 0)
    assert np.allclose(np.vstack([piece.middles_m for piece in pieces]), whole.middles_m, atol=1e-9)


@pytest.mark.parametrize("step", [1, 4, 13])
def test_blocks_see_what_the_whole_sees(step) -> None:
    site = hard_site()
    line = np.array([[-50.0, 20.0], [310.0, 60.0], [310.0, 130.0], [-20.0, 190.0]])
    route = np.column_stack([line, site.ground.ups_m(line, 60.0)])
    whole = judging_map(site)
    pieces = [judging_block(site, each) for each in blocks(whole.grid.cells.lattice.shape[0], step)]
    observed = np.concatenate([piece.observed(route) for piece in pieces])
    assert np.array_equal(observed, whole.observed(route))
    assert 0.1 < observed.mean() < 0.95
    assert np.array_equal(np.concatenate([piece.coverable for piece in pieces]), whole.coverable)


def test_an_area_of_several_pieces_has_blocks_without_cells() -> None:
    far = ((0.0, 320.0), (300.0, 320.0), (300.0, 400.0), (0.0, 400.0))
    site = make_site(hills, more_parts=(far,), cell_m=10.0)
    whole = judging_map(site)
    pieces = [judging_block(site, each) for each in row_blocks(site, cells=60)]
    counts = [piece.grid.count for piece in pieces]
    assert 0 in counts
    assert sum(counts) == whole.grid.count
    route = np.array([[0.0, 100.0, 90.0], [300.0, 350.0, 90.0]])
    assert np.array_equal(np.concatenate([piece.observed(route) for piece in pieces]), whole.observed(route))


def test_row_blocks_are_all_rows_once() -> None:
    site = make_site(cell_m=10.0)  # 30 x 20 cells
    for cells in (1, 30, 59, 60, 100, 10**9):
        found = row_blocks(site, cells=cells)
        assert [row for each in found for row in each] == list(range(20))
        assert all(len(each) * 30 <= max(cells, 30) for each in found)
    assert len(row_blocks(site, cells=60)) == 10


def test_what_can_be_seen_does_not_depend_on_how_many_cells_are_looked_at_together(monkeypatch) -> None:
    wanted = {"requirements": {"looks": 2, "look_distance_m": 15.0}}
    points = dataclasses.replace(CAMERA, sensing="at-waypoints", range_m=90.0)
    fence = ((-100.0, -10.0), (170.0, -10.0), (170.0, 210.0), (-100.0, 210.0))
    for site in (hard_site(fence=fence), hard_site(points, fence=fence, **wanted)):
        together = CoverageMap(site, cell_size_m=9.0).coverable
        assert 0.2 < together.mean() < 1.0
        monkeypatch.setattr(coverage_map, "_AT_A_TIME", 170)
        assert np.array_equal(CoverageMap(site, cell_size_m=9.0).coverable, together)
        # With a stop at every sixtieth question whether the time is over.
        stopping, stops = CoverageMap(site, cell_size_m=9.0), itertools.cycle([False] * 59 + [True])
        assert not stopping.knows_coverable(lambda: True)
        tries = 1
        while not stopping.knows_coverable(stops.__next__):
            tries += 1
        assert tries > 1
        assert np.array_equal(stopping.coverable, together)
        monkeypatch.undo()


def test_too_many_cells_for_one_map_fit_into_blocks(monkeypatch) -> None:
    site = make_site(cell_m=10.0)
    monkeypatch.setattr("uavcover.sensing.cells.MAX_CELLS", 100)
    with pytest.raises(ScenarioError, match="600 cells, but the limit is 100"):
        make_cells(site, 10.0)
    assert sum(make_cells(site, 10.0, rows=each).count for each in row_blocks(site, cells=100)) == 600
