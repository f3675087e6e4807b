"""ArduPilot's terrain grid step by step in single precision, as a small autopilot reckons it."""

import numpy as np

f32 = np.float32
M_PER_E7 = f32(0.011131884502145034)
E7_PER_M = f32(89.83204953368922)


def scale(lat_e7: int) -> np.float32:
    return max(f32(np.cos(np.radians(f32(lat_e7) * f32(1e-7)))), f32(0.01))


def look_up(lat_e7: int, lon_e7: int, spacing_m: int) -> dict[str, int]:
    """Degree, block and corner of a place; the corner in 1e-7 degrees."""
    south_e7 = int(np.floor(lat_e7 / 1e7)) * 10_000_000
    west_e7 = int(np.floor(lon_e7 / 1e7)) * 10_000_000
    north_m = f32(lat_e7 - south_e7) * M_PER_E7
    east_m = f32(lon_e7 - west_e7) * M_PER_E7 * scale((lat_e7 + south_e7) // 2)
    row, column = int(north_m / f32(spacing_m)), int(east_m / f32(spacing_m))
    north, east = row // 24, column // 28
    off_lat = int(f32(north * 24 * spacing_m) * E7_PER_M)
    off_lon = int(f32(east * 28 * spacing_m) * E7_PER_M / scale(south_e7 + off_lat // 2))
    lon = west_e7 + off_lon
    return {
        "south": south_e7 // 10_000_000, "west": west_e7 // 10_000_000, "north": north, "east": east,
        "lat_e7": south_e7 + off_lat, "lon_e7": lon - 3_600_000_000 if lon > 1_800_000_000 else lon,
        "row": row - north * 24, "column": column - east * 28,
    }  # fmt: skip


def height(lat_e7: int, lon_e7: int, spacing_m: int, parts: dict[int, tuple[int, ...]]) -> float:
    """The height that an autopilot makes of the parts of the block that a place belongs to."""
    here = look_up(lat_e7, lon_e7, spacing_m)
    north_m = float(f32(lat_e7 - here["south"] * 10_000_000) * M_PER_E7)
    mid_e7 = (lat_e7 + here["south"] * 10_000_000) // 2
    east_m = float(f32(lon_e7 - here["west"] * 10_000_000) * M_PER_E7 * scale(mid_e7))
    u = north_m / spacing_m - here["north"] * 24 - here["row"]
    v = east_m / spacing_m - here["east"] * 28 - here["column"]

    def at(row: int, column: int) -> int:
        return parts[row // 4 * 8 + column // 4][row % 4 * 4 + column % 4]

    row, column = here["row"], here["column"]
    south = (1 - v) * at(row, column) + v * at(row, column + 1)
    north = (1 - v) * at(row + 1, column) + v * at(row + 1, column + 1)
    return (1 - u) * south + u * north
