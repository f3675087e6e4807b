"""The ground as vehicles want it: elevation data behind the answers to TERRAIN_REQUEST, and in ArduPilot's terrain files."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np

from mission_io.client.client import Client, answer_terrain_requests
from mission_io.model.places import EQUATOR_M_PER_DEG
from mission_io.model.plain_text import counted
from mission_io.protocol.terrain import (
    PART_COUNT,
    STEP_NORTH,
    Heights,
    Part,
    Place,
    TerrainAnswers,
    TerrainBlock,
    TerrainCounts,
    dat_bytes,
    dat_name,
    parts_of_block,
    place_in_block,
    places_of_block,
    wrapped_deg,
)
from uavcover.errors import InputError, OutputError, TerrainError
from uavcover.flight.tuning import TERRAIN
from uavcover.model.area import HeightUnit, RasterTerrain
from uavcover.new.quantities import water_height_m
from uavcover.new.terrain_look import possible_datums
from uavcover.run.file_group import write_file
from uavcover.run.user import User
from uavcover.scenario.scenario_file import surface_source, terrain_source
from uavcover.scenario.site import Site
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.file_heights import ELLIPSOID, datum_named
from uavcover.terrain.terrain_source import Bounds, TerrainSource, find_tiles

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class ElevationData:
    """Elevation files as the user names them, beside any scenario."""

    names: tuple[str, ...]  # files, folders or patterns of tiles
    vertical_datum: str | None = None  # "EGM96", "EGM2008" or "ellipsoid"; None: what the files say, or EGM96
    crs: str | None = None  # coordinate system, where the files name none
    height_unit: str | None = None  # "m", "dm", "cm", "ft" or "us-ft", where the files do not say
    band: str | None = None  # number or name of the band with the heights
    water_height: str | None = None  # of open water above sea level, as "0m"; None: places without data have no height
    option: str = "--dem"  # that names them, for errors


def open_elevation_data(data: ElevationData, *, around: Bounds | None = None) -> tuple[TerrainSource, str]:
    """The files, and the datum of their heights.

    Args:
        data: what the user named.
        around: west, south, east, north in degrees of what is needed; of several files only those near it are taken.

    Raises:
        InputError: no file, or a unit or a datum that is not known.
        TerrainError: the files cannot be used.
    """
    if not data.names:
        raise InputError(f"{data.option}: specify elevation data, such as a raster, a folder or a pattern of tiles")
    unit = None if data.height_unit is None else data.height_unit.casefold()
    if unit not in (None, *get_args(HeightUnit)):
        raise InputError(f"--height-unit: unknown unit {data.height_unit!r}; use m, dm, cm, ft or us-ft")
    source = TerrainSource(
        find_tiles(data.names, folder=Path(), around=around),
        crs=data.crs,
        band=data.band,
        height_unit=unit,
        water_height_m=water_height_m(data.water_height),
        key=data.option,
    )
    fitting = possible_datums(source)
    if data.vertical_datum is None:
        return source, fitting[0]
    wanted = datum_named(data.vertical_datum)
    if wanted not in fitting and not (wanted == ELLIPSOID and len(fitting) > 1):
        raise InputError(f"--vertical-datum: the option is {wanted}, but {source} is {fitting[0]}; omit this option")
    return source, wanted


def heights_of_files(source: TerrainSource, vertical_datum: str, say: Callable[[str], None]) -> Heights:
    """The ground of elevation files; unknown without data there, or once the files are unreadable.

    Args:
        source: the files.
        vertical_datum: what their heights are above.
        say: receives the reason when the files are unreadable.
    """

    def heights_amsl_m(places: Sequence[Place]) -> Sequence[float]:
        lat_deg, lon_deg = np.array(places, dtype=float).reshape(-1, 2).T
        try:
            return [float(height) for height in read_heights_amsl_m(source, vertical_datum, lat_deg, lon_deg)]
        except TerrainError as error:
            say(f"cannot send terrain heights to the vehicle: {error}")
            return [float("nan")] * len(places)

    return heights_amsl_m


def heights_of_site(site: Site, say: Callable[[str], None]) -> Heights | None:
    """Ground below a site's flights, within its elevation files; none without a position on Earth."""
    if site.frame is None:
        return None
    terrain = site.scenario.terrain
    if isinstance(terrain, RasterTerrain):
        ground = heights_of_files(terrain_source(terrain), terrain.vertical_datum, say)
        source = surface_source(terrain)
        if source is None:
            return ground
        return _higher(ground, heights_of_files(source, terrain.surface_vertical_datum or terrain.vertical_datum, say))

    def heights_amsl_m(places: Sequence[Place]) -> Sequence[float]:
        heights = [site.ground_alt_amsl_m(*place) for place in places]
        return [float("nan") if height is None else height for height in heights]

    return heights_amsl_m


def _higher(ground: Heights, surface: Heights) -> Heights:
    """The higher of both; unknown where the surface is."""

    def heights_amsl_m(places: Sequence[Place]) -> Sequence[float]:
        low, high = np.array(ground(places), dtype=float), np.array(surface(places), dtype=float)
        return [float(height) for height in np.where(np.isfinite(low), np.maximum(low, high), high)]

    return heights_amsl_m


def answer_from_site(client: Client, site: Site) -> None:
    """Answer the vehicle's requests for terrain heights from a site's elevation data whenever the client waits."""
    heights = heights_of_site(site, _log.warning)
    if heights is not None:
        answer_terrain_requests(client, TerrainAnswers(heights, say=_log.warning))


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
        OutputError: a file is there already, or cannot be written.
    """
    blocks = _blocks_in(around, spacing_m)
    known = {block: parts_of_block(places_of_block(*_corner_deg(block), spacing_m), heights) for block in blocks}
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


def _corner_deg(block: TerrainBlock) -> Place:
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
    found = {place_in_block(float(lat), wrapped_deg(float(lon)), spacing_m).block for lat in rows for lon in columns}
    return sorted(found, key=lambda block: (block.south_deg, block.west_deg, block.north, block.east))


def _with_edges(degrees: np.ndarray) -> np.ndarray:
    """Degrees with both sides of every whole degree between them, where terrain grids begin and end."""
    whole = np.arange(math.ceil(degrees.min()), math.floor(degrees.max()) + 1, dtype=float)
    return np.concatenate([degrees, whole, whole[whole > degrees.min()] - 1e-7])
