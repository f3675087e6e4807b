"""ArduPilot's terrain files against bytes put together from the description of the format alone."""

import math
from random import Random

import pytest

from mission_io.errors import MisuseError
from mission_io.protocol.terrain import PART_COUNT, Part, TerrainBlock, dat_bytes, dat_name, position_in_block
from tests.naive.terrain_grid import look_up


def crc16(data: bytes) -> int:
    """CCITT, from 0, bit by bit."""
    crc = 0
    for byte in data:
        for bit in range(7, -1, -1):
            carry = crc >> 15 ^ byte >> bit & 1
            crc = (crc << 1 & 0xFFFF) ^ (0x1021 if carry else 0)
    return crc


def little(value: int, size: int) -> bytes:
    return value.to_bytes(size, "little", signed=value < 0)


def described(block: TerrainBlock, parts: tuple[Part | None, ...]) -> bytes:
    """A block byte by byte."""
    head = little(sum(1 << n for n, part in enumerate(parts) if part is not None), 8)
    corner = block.corner_e7
    head += little(corner[0], 4) + little(corner[1], 4)
    rest = little(1, 2) + little(block.spacing_m, 2)
    for row in range(28):
        for column in range(32):
            part = parts[row // 4 * 8 + column // 4]
            rest += little(0 if part is None else part[row % 4 * 4 + column % 4], 2)
    rest += little(block.north, 2) + little(block.east, 2) + little(block.west_deg, 2) + little(block.south_deg, 1)
    used = head + little(crc16(head + b"\0\0" + rest), 2) + rest
    assert len(used) == 1821
    return used + bytes(2048 - 1821)


def random_parts(rng: Random, known: float) -> tuple[Part | None, ...]:
    return tuple(
        tuple(rng.randrange(-32768, 32768) for _ in range(16)) if rng.random() < known else None
        for _ in range(PART_COUNT)
    )


@pytest.mark.parametrize("known", [1.0, 0.6, 0.02])
@pytest.mark.parametrize("position", [(47.31, 8.56), (-33.42, -70.73), (0.2, 179.6), (-89.3, -180.0), (71.9, -0.4)])
def test_blocks_are_byte_for_byte_what_is_described(position: tuple[float, float], known: float) -> None:
    rng = Random(f"{position} {known}")
    spacing = rng.choice([30, 100, 200])
    blocks = {}
    for _ in range(4):
        at = (position[0] + rng.uniform(-0.05, 0.05), position[1] + rng.uniform(0.0, 0.09))
        blocks[position_in_block(*at, spacing).block] = random_parts(rng, known)
    data = dat_bytes(blocks)
    assert len(data) % 2048 == 0
    filled = {at for at in range(0, len(data), 2048) if any(data[at : at + 2048])}
    stride = {(data[at + 1814 : at + 1816], at) for at in filled}
    assert len(stride) == len([parts for parts in blocks.values() if any(part is not None for part in parts)])
    for block, parts in blocks.items():
        if any(part is not None for part in parts):
            assert described(block, parts) in {data[at : at + 2048] for at in filled}


def test_a_block_lies_where_the_autopilot_looks_for_it() -> None:
    """Room for two blocks more than the degree is wide at its south edge, counted independently."""
    for lat, lon in ((47.31, 8.56), (-33.42, -70.73), (60.98, 10.99), (0.5, 0.5), (-60.2, 5.7)):
        twin = look_up(round(lat * 1e7), round(lon * 1e7), 100)
        width_m = 111_318.845 * math.cos(math.radians(twin["south"]))
        wide = int((width_m + 2 * 100 * 32) / (100 * 28))
        block = position_in_block(lat, lon, 100).block
        data = dat_bytes({block: random_parts(Random(1), 1.0)})
        assert len(data) == 2048 * (wide * twin["north"] + twin["east"] + 1)


def test_unknown_blocks_are_left_out_and_shorten_the_file() -> None:
    first, last = TerrainBlock(47, 8, 0, 0, 100), TerrainBlock(47, 8, 40, 5, 100)
    parts = random_parts(Random(2), 1.0)
    assert len(dat_bytes({first: parts, last: (None,) * PART_COUNT})) == 2048


@pytest.mark.parametrize(
    ("south", "west", "name"),
    [
        (47, 8, "N47E008.DAT"),
        (-1, -1, "S01W001.DAT"),
        (0, 0, "N00E000.DAT"),
        (-34, 179, "S34E179.DAT"),
        (71, -180, "N71W180.DAT"),
    ],
)
def test_names(south: int, west: int, name: str) -> None:
    assert dat_name(south, west) == name


@pytest.mark.parametrize(
    "other", [TerrainBlock(48, 8, 0, 0, 100), TerrainBlock(47, 9, 0, 0, 100), TerrainBlock(47, 8, 1, 0, 30)]
)
def test_one_degree_and_one_spacing_a_file(other: TerrainBlock) -> None:
    parts = random_parts(Random(3), 1.0)
    with pytest.raises(MisuseError, match="one degree at one spacing"):
        dat_bytes({TerrainBlock(47, 8, 0, 0, 100): parts, other: parts})
    with pytest.raises(MisuseError, match="one degree"):
        dat_bytes({})
