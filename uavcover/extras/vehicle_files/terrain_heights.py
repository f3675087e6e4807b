"""Terrain heights for a vehicle: sent when it asks, and written into the files of its card."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mission_io.client.client import Client, answer_terrain_requests
from mission_io.data_tables import data_table
from mission_io.model.items import EQUATOR_M_PER_DEG
from mission_io.model.plain_text import counted
from mission_io.protocol.terrain import (
    PART_COUNT,
    STEP_NORTH,
    Heights,
    Part,
    Position,
    TerrainAnswers,
    TerrainBlock,
    TerrainCounts,
    dat_bytes,
    dat_name,
    parts_of_block,
    position_in_block,
    positions_of_block,
    wrapped_deg,
)
from uavcover.errors import InputError, OutputError, TerrainError
from uavcover.run.file_group import write_file
from uavcover.run.user import User
from uavcover.terrain.frames import Bounds


@dataclass(frozen=True, slots=True, kw_only=True)
class _Terrain:
    poll_s: float
    tell_every_s: float
    ask_again_s: float
    max_blocks: int


TERRAIN = data_table(_Terrain, "uavcover/data/flight.toml", "terrain")


def serve_terrain(client: Client, heights: Heights, user: User) -> TerrainCounts:
    """Answer the vehicle's requests for terrain heights until the user stops it; returns their number."""
    answers = TerrainAnswers(heights, say=user.warn)
    reported, report_at_s, ask_at_s = TerrainCounts(), client.clock.now() + TERRAIN.tell_every_s, -math.inf
    with user.stop_requests("stopping") as stop:
        while not stop.any():
            now = client.clock.now()
            if now >= ask_at_s:  # the vehicle may have been switched off and on
                ask_at_s = now + TERRAIN.ask_again_s
                answer_terrain_requests(client, answers)
            client.poll(TERRAIN.poll_s)
            counts = answers.counts
            if counts != reported and now >= report_at_s:
                reported, report_at_s = counts, now + TERRAIN.tell_every_s
                blocks, parts = counted(counts.blocks, "terrain block"), counted(counts.parts_sent, "part")
                user.say(f"the vehicle requested {blocks}; sent {parts}")
    client.services.remove(answers)
    return answers.counts


def write_terrain_files(
    heights: Heights, around: Bounds, folder: Path, *, spacing_m: int, force: bool, user: User
) -> dict[str, int]:
    """Write ArduPilot's terrain files of all blocks that touch a box.

    Args:
        heights: the ground.
        around: west, south, east, north in degrees; east may be above 180.
        folder: where to; made when it is not there.
        spacing_m: TERRAIN_SPACING of the vehicle.
        force: whether files that are there may be replaced.
        user: receives a message where data is missing.

    Returns:
        How many blocks each file has.

    Raises:
        InputError: a spacing that the vehicle cannot have, or a box with too many blocks.
        TerrainError: there is no height in any block.
        OutputError: a file already exists, or cannot be written.
    """
    blocks = _blocks_in(around, spacing_m)
    known = {block: parts_of_block(positions_of_block(*_corner_deg(block), spacing_m), heights) for block in blocks}
    lacking = sum(part is None for parts in known.values() for part in parts)
    if lacking == PART_COUNT * len(known):
        raise TerrainError("the elevation data contains no height in any terrain block around the area")
    if lacking:
        user.warn(
            f"no elevation data for {lacking} of {PART_COUNT * len(known)} parts of {counted(len(known), 'block')}: they "
            "are omitted, and the vehicle will request them"
        )
    files: dict[str, dict[TerrainBlock, tuple[Part | None, ...]]] = {}
    for block, parts in known.items():
        if any(part is not None for part in parts):
            files.setdefault(dat_name(block.south_deg, block.west_deg), {})[block] = parts
    there = [name for name in files if (folder / name).exists()]
    if there and not force:
        raise OutputError(f"{folder / there[0]} already exists; use --force to overwrite it, or choose another folder")
    for name, content in files.items():
        write_file(folder / name, dat_bytes(content))
    return {name: len(content) for name, content in files.items()}


def _corner_deg(block: TerrainBlock) -> Position:
    lat_e7, lon_e7 = block.corner_e7
    return lat_e7 / 1e7, lon_e7 / 1e7


def _blocks_in(around: Bounds, spacing_m: int) -> list[TerrainBlock]:
    """The blocks that touch a box, found by positions closer together than the sides of a block."""
    if not 10 <= spacing_m <= 1000:
        raise InputError(f"--spacing: must be 10 to 1000 m, not {spacing_m} m; use the vehicle's TERRAIN_SPACING")
    west, south, east, north = around
    step_deg = 0.9 * STEP_NORTH * spacing_m / EQUATOR_M_PER_DEG
    scale = max(0.01, math.cos(math.radians(max(abs(south), abs(north)))))
    rows = np.append(np.arange(south, north, step_deg), north)
    columns = np.append(np.arange(west, east, step_deg / scale), east)
    rows, columns = _with_edges(rows), _with_edges(columns)
    if len(rows) * len(columns) > TERRAIN.max_blocks:
        raise InputError(
            f"the area takes about {len(rows) * len(columns)} blocks of terrain; the limit is {TERRAIN.max_blocks}; "
            "use a part of the area, or a larger --spacing"
        )
    found = {position_in_block(float(lat), wrapped_deg(float(lon)), spacing_m).block for lat in rows for lon in columns}
    return sorted(found, key=lambda block: (block.south_deg, block.west_deg, block.north, block.east))


def _with_edges(degrees: np.ndarray) -> np.ndarray:
    """Degrees with both sides of every whole degree between them, where terrain grids begin and end."""
    whole = np.arange(math.ceil(degrees.min()), math.floor(degrees.max()) + 1, dtype=float)
    return np.concatenate([degrees, whole, whole[whole > degrees.min()] - 1e-7])
