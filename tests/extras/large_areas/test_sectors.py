import itertools
import math

import numpy as np
import pytest
import shapely

from uavcover.extras.large_areas.sortie_parts import Sector, Swath, rays_rad

SWATH = Swath(width_m=100.0, spacing_m=100.0, inset_m=45.0)
SQUARE = shapely.box(-2000, -2000, 2000, 2000)
L_WITH_HOLE = shapely.Polygon(
    [(-1500, -1500), (2500, -1500), (2500, 0), (0, 0), (0, 2500), (-1500, 2500)],
    [[(-900, -900), (-900, -400), (-400, -400), (-400, -900)]],
)
TWO = shapely.MultiPolygon([shapely.box(-1500, -1000, 500, 1000), shapely.box(700, -700, 2000, 1300)])
AREAS = {"square": SQUARE, "L": L_WITH_HOLE, "two": TWO}


def sectors_of(area, home, count: int, layers: int, *, turned: bool = False) -> list[Sector]:
    sides = np.linspace(0.3, 0.3 + 2.0 * math.pi, count + 1)
    return [Sector(area, home, *pair, layers, SWATH, turned=turned) for pair in itertools.pairwise(sides)]


@pytest.mark.parametrize("name", AREAS)
@pytest.mark.parametrize("home", [(0.0, 0.0), (-700.0, 300.0), (2600.0, 100.0)])
@pytest.mark.parametrize(("count", "layers"), [(4, 1), (7, 2), (9, 3)])
def test_pieces_are_the_area_and_none_is_there_twice(name, home, count, layers) -> None:
    area, pieces = AREAS[name], []
    for sector in sectors_of(area, home, count, layers):
        if not sector.is_empty:
            bounds_m = sector.bounds_m([1.0 + k for k in range(layers)])
            own = sector.pieces(bounds_m)
            assert sum(piece.area for piece in own) == pytest.approx(sector.piece.area, rel=1e-6)
            pieces += own
    assert all(piece.is_valid for piece in pieces)
    for one, other in itertools.combinations(pieces, 2):
        assert one.intersection(other).area < 1e-6 * area.area
    assert max(piece.difference(area).area for piece in pieces) < 1e-6 * area.area
    assert sum(piece.area for piece in pieces) == pytest.approx(area.area, rel=1e-6)


def test_layers_have_their_shares_of_the_ground() -> None:
    sector = Sector(SQUARE, (0.0, 0.0), 0.0, 0.7, 3, SWATH)
    bounds_m = sector.bounds_m([3.0, 2.0, 1.0])
    assert np.all(np.diff(bounds_m) > 0.0)
    middle = np.array([math.cos(0.35), math.sin(0.35)])
    ground = []
    for near_m, far_m in itertools.pairwise(bounds_m):
        across = 5000.0 * np.array([-middle[1], middle[0]])
        band = shapely.Polygon(
            [near_m * middle - across, near_m * middle + across, far_m * middle + across, far_m * middle - across]
        )
        ground.append(sector.piece.intersection(band).area)
    assert np.array(ground) / sector.piece.area == pytest.approx([1 / 6, 2 / 6, 3 / 6], abs=0.01)


@pytest.mark.parametrize("turned", [False, True])
def test_a_flight_sees_its_layer_on_a_round_from_home(turned) -> None:
    layers = 2
    sector = Sector(SQUARE, (0.0, 0.0), 0.2, 0.9, layers, SWATH, turned=turned)
    bounds_m = sector.bounds_m([1.0, 1.0])
    for layer, piece in enumerate(sector.pieces(bounds_m), start=1):
        best = min(
            (sector.lines(layer, bounds_m, more=more, other_end=end) for more in (0, 1) for end in (False, True)),
            key=lambda line: shapely.LineString(line).length,
        )
        assert np.hypot(*best[[0, -1]].T).max() < 1.0 * SWATH.width_m
        flown = shapely.LineString(best)
        assert flown.buffer(0.5 * SWATH.width_m).intersection(piece).area > 0.93 * piece.area
        # What is flown is little more than what it takes: the strips near home lie over each other.
        assert flown.length < 1.35 * piece.area / SWATH.width_m
        out, back = (0.2, 0.9) if not turned else (0.9, 0.2)
        angles = np.arctan2(best[:, 1], best[:, 0])
        early, late = angles[1], angles[-2]
        assert abs(early - out) < abs(early - back)
        assert abs(late - back) < abs(late - out)


def test_the_layers_of_a_sector_by_hand() -> None:
    # From 0 to 2 atan(1 / 2) around the x axis, 1000 m long: 100 m strips at the sides until they meet.
    half = math.atan(0.5)
    area = shapely.Polygon([(0, 0), (1000, -500), (1000, 500)])
    sector = Sector(area, (0.0, 0.0), -half, half, 1, SWATH)
    line = sector.lines(1, sector.bounds_m([1.0]), more=0, other_end=False)
    meet_m = 100.0 / math.sin(half)  # 223.6 m: the sector is as wide as two strips there
    across = line[1:-3]
    assert across[0, 0] == pytest.approx(meet_m + 0.5 * (1000.0 - meet_m) / 8, abs=1e-3)
    assert len(across) == 2 * 8
    # The first line is as short as what lies between the strips; the way back is in the middle of its own.
    middle = np.array([math.sin(half), -math.cos(half)])
    assert line[-3:-1] @ middle == pytest.approx([50.0, 50.0], abs=1e-3)
    assert line[-3, 0] == pytest.approx(1000.0 - 45.0 * math.cos(half), abs=1e-3)
    assert line[-2, 0] == pytest.approx(meet_m, abs=1e-3)


def test_rays_know_how_much_ground_is_before_them() -> None:
    angles, ground_m2 = rays_rad(SQUARE, (0.0, 0.0), 0.0, 2.0 * math.pi)
    assert np.interp([0.5 * math.pi, math.pi, 2.0 * math.pi], angles, ground_m2) == pytest.approx([4e6, 8e6, 16e6])
    outside, ground_m2 = rays_rad(SQUARE, (4000.0, 0.0), math.pi - 0.8, 1.6)
    assert ground_m2[-1] == pytest.approx(16e6)
    assert np.interp(math.pi, outside, ground_m2) == pytest.approx(8e6)
