"""Cells whose rows and columns are moved against each other: no strip between them that nobody would miss."""

import numpy as np
import pytest

from tests.planner.sites import flat, hills, make_site
from uavcover.sensing.cells import make_cells, make_scattered_cells
from uavcover.sensing.coverage_map import CoverageMap

CELL_M = 10.0


def test_every_cell_has_a_place_in_it_and_no_two_rows_the_same():
    site = make_site(hills)
    regular, scattered = make_cells(site, CELL_M), make_scattered_cells(site, CELL_M)
    assert scattered.count == regular.count
    np.testing.assert_array_equal(scattered.cells.lattice, regular.cells.lattice)
    moved = scattered.cells.centre_m[:, :2] - regular.cells.centre_m[:, :2]
    assert np.abs(moved).max() <= 0.5 * CELL_M
    assert np.hypot(*moved.T).max() <= scattered.cells.scatter_m
    np.testing.assert_allclose(scattered.cells.centre_m[:, 2], site.ground.heights_m(scattered.cells.centre_m[:, :2]))
    rows, columns = scattered.cells.lattice.shape
    assert len(np.unique(np.round(moved[:, 0], 6))) == rows
    assert len(np.unique(np.round(moved[:, 1], 6))) == columns
    assert scattered.weight_m2.sum() == pytest.approx(regular.weight_m2.sum(), rel=0.01)


@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 45.0, 90.0, 135.0])
def test_a_narrow_strip_holds_its_share_of_the_places_wherever_it_lies(angle_deg):
    turn = np.radians(angle_deg)
    site = make_site(flat, ring=((0.0, 0.0), (600.0, 0.0), (600.0, 600.0), (0.0, 600.0)))
    fractions = {}
    for make in (make_cells, make_scattered_cells):
        positions = make(site, CELL_M).cells.centre_m[:, :2] - 300.0
        across = (positions @ (-np.sin(turn), np.cos(turn)))[np.abs(positions @ (np.cos(turn), np.sin(turn))) < 150.0]
        held = np.array([np.mean(np.abs(across - middle) < 1.5) for middle in np.arange(-80.0, 80.0, 0.5)])
        fractions[make] = held / held.mean()
    assert fractions[make_scattered_cells].min() > 0.35
    assert fractions[make_scattered_cells].max() < 1.8
    if angle_deg != 20.0:
        assert fractions[make_cells].min() == 0.0


def test_scattered_and_regular_cells_tell_much_the_same_of_a_route():
    site = make_site(hills)
    route = np.array([[0.0, 50.0, 110.0], [300.0, 60.0, 120.0], [290.0, 160.0, 120.0]])
    regular, scattered, fine = (
        CoverageMap(site, cell_size_m=size, cut=cut)
        for size, cut in ((CELL_M, make_cells), (CELL_M, make_scattered_cells), (1.0, make_cells))
    )
    truth = fine.fraction(fine.observed(route))
    assert 0.3 < truth < 0.95
    assert regular.fraction(regular.observed(route)) == pytest.approx(truth, abs=0.02)
    assert scattered.fraction(scattered.observed(route)) == pytest.approx(truth, abs=0.01)
