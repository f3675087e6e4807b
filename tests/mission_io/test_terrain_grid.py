import math
from random import Random

import pyproj
import pytest

from mission_io.protocol.terrain import (
    PART_COUNT,
    block_with_corner,
    blocks_east,
    parts_of_block,
    place_in_block,
    places_of_block,
)
from tests.naive import terrain_grid as naive

GEOD = pyproj.Geod(ellps="WGS84")
SPACINGS = [30, 50, 100, 250]
EDGES = [
    (-60.5, 12.9999999), (-33.0000001, -70.0), (47.9999999, 8.0000001), (0.0, 0.0), (-0.0000001, -0.0000001),
    (51.5, 179.9999), (-16.5, 179.99999), (-16.5, -180.0), (71.2, -179.99), (-89.95, 40.5), (89.5, 100.99), (60.99, 10.99),
]  # fmt: skip


def places(seed: int, count: int) -> list[tuple[float, float]]:
    rng = Random(seed)
    made = [
        (math.degrees(math.asin(rng.uniform(-0.9999, 0.9999))), rng.uniform(-180.0, 179.9999999)) for _ in range(count)
    ]
    return [*((round(lat, 7), round(lon, 7)) for lat, lon in made), *EDGES]


@pytest.mark.parametrize("spacing_m", SPACINGS)
def test_blocks_are_those_of_an_autopilot_with_single_precision(spacing_m: int) -> None:
    compared = 0
    for lat, lon in places(spacing_m, 300):
        found = place_in_block(lat, lon, spacing_m)
        twin = naive.look_up(round(lat * 1e7), round(lon * 1e7), spacing_m)
        at_edge = min(found.row % 1.0, 1.0 - found.row % 1.0, found.column % 1.0, 1.0 - found.column % 1.0) * spacing_m
        if at_edge < 0.5:
            continue  # rounding decides
        compared += 1
        block = found.block
        assert (block.south_deg, block.west_deg, block.north, block.east) == (
            twin["south"], twin["west"], twin["north"], twin["east"],
        )  # fmt: skip
        assert (math.floor(found.row), math.floor(found.column)) == (twin["row"], twin["column"])
        corner = block.corner_e7
        # ArduPilot takes corners within 5 cm for the same (TERRAIN_MARGIN).
        assert abs(corner[0] - twin["lat_e7"]) <= 5
        assert abs(corner[1] - twin["lon_e7"]) * math.cos(math.radians(lat)) <= 5
    assert compared > 200


REQUESTED = [
    (-60.0082543, 12.9195561), (-60.0298139, 12.9709655), (-60.0298139, 13.0), (-60.0, 12.955813), (-60.0, 13.0),
    (60.9701861, 10.9700731), (60.9486264, 10.9187112), (60.9917457, 10.9703956), (60.9917457, 11.0),
    (71.1940372, 179.9316874), (71.1724775, -180.0), (71.2155969, 179.9321998),
    (-33.4178884, -70.0021872), (-33.3963287, -70.0325454), (-33.4178884, -70.0),
]  # fmt: skip
"""Corners that ArduCopter 4.7.0-dev requested in the simulator, at 100 m between heights."""


@pytest.mark.parametrize(("lat", "lon"), REQUESTED)
def test_corners_that_arducopter_requests_are_corners_of_the_grid(lat: float, lon: float) -> None:
    block = block_with_corner(lat, lon, 100)
    assert block is not None
    assert abs(block.corner_e7[0] - round(lat * 1e7)) <= 1
    # Far north ArduPilot's single precision is a unit worse: 7 mm.
    assert abs((block.corner_e7[1] - round(lon * 1e7) + 1_800_000_000) % 3_600_000_000 - 1_800_000_000) <= 2


@pytest.mark.parametrize("spacing_m", SPACINGS)
def test_a_block_is_found_again_by_its_corner(spacing_m: int) -> None:
    for lat, lon in places(7 + spacing_m, 300):
        block = place_in_block(lat, lon, spacing_m).block
        corner = block.corner_e7
        assert block_with_corner(corner[0] / 1e7, corner[1] / 1e7, spacing_m) == block
        assert block_with_corner(lat + 0.00013, lon, spacing_m) is None


@pytest.mark.parametrize("spacing_m", SPACINGS)
def test_heights_are_placed_where_the_autopilot_looks_them_up(spacing_m: int) -> None:
    """The independent autopilot reads a hill off our parts; only rounding to metres and the grid itself remain."""
    for lat, lon in places(11 + spacing_m, 40):
        if abs(lat) > 85.0:
            continue
        block = place_in_block(lat, lon, spacing_m).block
        corner = block.corner_e7[0] / 1e7, block.corner_e7[1] / 1e7
        m_per_deg_east = 111_320.0 * math.cos(math.radians(lat))

        def hill(place: tuple[float, float], lat=lat, lon=lon, east=m_per_deg_east) -> float:  # a plane of 45 degrees
            off = (place[1] - lon + 180.0) % 360.0 - 180.0
            return 900.0 + (place[0] - lat) * 111_320.0 * 0.6 - off * east * 0.8

        known = parts_of_block(places_of_block(*corner, spacing_m), lambda at: [hill(place) for place in at])
        parts = {number: part for number, part in enumerate(known) if part is not None}
        assert len(parts) == PART_COUNT
        read = naive.height(round(lat * 1e7), round(lon * 1e7), spacing_m, parts)
        assert read == pytest.approx(hill((lat, lon)), abs=1.2)


def test_places_counted_from_a_blocks_own_corner_would_be_tens_of_metres_off() -> None:
    block = place_in_block(60.98, 10.98, 100).block
    south, west = (value / 1e7 for value in block.corner_e7)
    place = block.place(0, 31)
    scale = math.cos(math.radians(south))
    east_deg = 3100.0 / (111_318.845 * scale)
    off_m = GEOD.inv(place[1], place[0], west + east_deg, south)[2]
    assert 20.0 < off_m < 50.0


def test_blocks_of_older_firmware_are_placed_from_their_own_corner() -> None:
    at = places_of_block(47.00312, 8.51234, 100)
    assert at[0] == (pytest.approx(47.00312, abs=1e-12), pytest.approx(8.51234, abs=1e-12))
    row_3 = at[12]
    assert GEOD.inv(at[0][1], at[0][0], row_3[1], row_3[0])[2] == pytest.approx(300.0, rel=0.005)


def test_an_unknown_height_leaves_out_its_part_alone() -> None:
    at = places_of_block(47.0, 8.0, 100)
    hole = at[16 * 9 + 5]
    parts = parts_of_block(at, lambda places: [math.nan if place == hole else 412.5 + 0.1 for place in places])
    assert [number for number, part in enumerate(parts) if part is None] == [9]
    assert set(parts[0] or ()) == {413}


@pytest.mark.parametrize("height", [math.inf, -math.inf, math.nan, 32768.0, -40000.0])
def test_what_does_not_fit_is_unknown(height: float) -> None:
    assert set(parts_of_block(places_of_block(47.0, 8.0, 100), lambda at: [height] * len(at))) == {None}


def test_nobody_is_asked_for_places_beyond_a_pole() -> None:
    def ground(at: list[tuple[float, float]]) -> list[float]:
        assert all(abs(lat) <= 90.0 and -180.0 <= lon <= 180.0 for lat, lon in at)
        return [2835.0] * len(at)

    block = place_in_block(89.9999, 12.0, 100).block
    parts = parts_of_block(places_of_block(block.corner_e7[0] / 1e7, block.corner_e7[1] / 1e7, 100), ground)
    assert None in parts


def test_the_files_have_room_for_every_block_of_their_degree() -> None:
    for south in range(-89, 89, 3):
        most = max(place_in_block(south + up, 9.9999999, 100).block.east for up in (0.0, 0.5, 0.9999999))
        assert most < blocks_east(south, 100)
