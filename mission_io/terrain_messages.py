"""MAVLink messages about terrain: a vehicle asks for heights of the ground, a ground station answers.

Heights come in blocks of 7 times 8 parts; a part is 4 times 4 heights, ``spacing_m`` apart, the first at the south-west
corner, row by row to the east.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TerrainRequest:
    """Asks for parts of a block of heights.

    Attributes:
        lat_deg: Latitude of the block's south-west corner.
        lon_deg: Longitude of the block's south-west corner.
        spacing_m: Distance of neighbouring heights.
        mask: Bit n is set when part n is wanted; 8 parts to the east, then the next row to the north.
    """

    lat_deg: float
    lon_deg: float
    spacing_m: int
    mask: int


@dataclass(frozen=True, slots=True)
class TerrainData:
    """One part of a block.

    Attributes:
        lat_deg: Latitude of the block's south-west corner, as it was asked for.
        lon_deg: Longitude of the block's south-west corner, as it was asked for.
        spacing_m: Distance of neighbouring heights.
        part: Its number, the bit in the request.
        heights_amsl_m: 16 whole metres above mean sea level: 4 to the east, then the next row to the north.
    """

    lat_deg: float
    lon_deg: float
    spacing_m: int
    part: int
    heights_amsl_m: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class TerrainReport:
    """What a vehicle knows of the ground; ``pending`` parts are asked for, ``loaded`` are there."""

    lat_deg: float
    lon_deg: float
    spacing_m: int
    terrain_alt_amsl_m: float
    height_above_terrain_m: float
    pending: int
    loaded: int
