import itertools

import pytest
import shapely

from uavcover.planner.division import FlightWork, divide

SQUARE = shapely.box(0, 0, 3000, 3000)
L_WITH_HOLE = shapely.Polygon(
    [(0, 0), (4000, 0), (4000, 1500), (1500, 1500), (1500, 4000), (0, 4000)],
    [[(400, 400), (400, 900), (900, 900), (900, 400)]],
)
TWO = shapely.MultiPolygon([shapely.box(0, 0, 2000, 1000), shapely.box(2500, 300, 3500, 2300)])


@pytest.mark.parametrize("area", [SQUARE, L_WITH_HOLE, TWO], ids=["square", "L", "two"])
@pytest.mark.parametrize("home", [None, (1500.0, 1400.0), (5000.0, 500.0)], ids=["no home", "inside", "outside"])
def test_parts_are_the_area_and_share_its_work(area, home) -> None:
    work = FlightWork(150.0, home)
    parts = divide(area, 5, work)
    assert len(parts) == 5
    assert shapely.union_all(parts).symmetric_difference(area).area < 1e-6 * area.area
    for one, other in itertools.combinations(parts, 2):
        assert one.intersection(other).area < 1e-6 * area.area
    fractions = [work.of(part, 1) for part in parts]
    # Ways differ from part to part of a piece: work is shared cut by cut.
    assert max(fractions) < (1.01 if home is None else 1.35) * min(fractions)


@pytest.mark.parametrize("area", [SQUARE, L_WITH_HOLE, TWO], ids=["square", "L", "two"])
def test_work_is_shared_in_the_proportions_asked_for(area) -> None:
    wanted = [1.0, 0.2, 3.0, 0.7]
    parts = divide(area, 4, FlightWork(150.0), wanted)
    assert [part.area / area.area for part in parts] == pytest.approx([w / sum(wanted) for w in wanted], rel=0.02)
    assert divide(area, 3, FlightWork(150.0), [2.0, 2.0, 2.0]) == divide(area, 3, FlightWork(150.0))


def test_around_home_every_part_begins_near_it() -> None:
    work = FlightWork(150.0, (1500.0, 1500.0))
    paths = [work.transit_m(part) for part in divide(SQUARE, 4, work)]
    assert max(paths) < 600.0


def test_one_part_is_the_area() -> None:
    assert divide(SQUARE, 1, FlightWork(150.0)) == [SQUARE]


def test_without_home_parts_of_a_square_are_squares() -> None:
    parts = divide(SQUARE, 4, FlightWork(150.0))
    assert [part.length for part in parts] == pytest.approx([6000.0] * 4, rel=0.01)
