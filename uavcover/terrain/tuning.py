"""Sizes and tolerances of elevation files; ``data/terrain.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Files:
    max_nodes: int
    max_error_m: float
    checked_blocks: int
    pixels_of_block: float
    places_of_block: int
    above_m: float
    most_pixels: int
    harmless_zip_bytes: int
    max_gzip_bytes: int
    max_tiles: int
    around_deg: float
    off_grid: float
    water_m: float
    most_suspects: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pixels:
    straight_within_m: float
    lattice: int
    wider: float
    longest_piece_m: float
    curve_length_m: float
    safe: float
    strip_nodes: int
    up_degree: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Suspects:
    tip_pixels: int
    least_squares: int
    rim_pixels: int
    slope_pixels: int
    rim_times: float
    rim_m: float
    rim_share: float
    roof_m: float
    spike_times: float
    spike_m: float
    alone_times: float
    alone_pixels: int
    alone_slope: float
    step_pixels: int
    step_m: float
    step_errors: float
    step_times: float
    step_share: float
    strip_pixels: int
    around_pixels: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Relief:
    light_azimuth_deg: float
    light_elevation_deg: float
    ambient: float
    smooth_steps: float


FILES = data_table(_Files, "uavcover/data/terrain.toml", "files")
PIXELS = data_table(_Pixels, "uavcover/data/terrain.toml", "pixels")
SUSPECTS = data_table(_Suspects, "uavcover/data/terrain.toml", "suspects")
RELIEF = data_table(_Relief, "uavcover/data/terrain.toml", "relief")
