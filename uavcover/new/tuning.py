"""Defaults of ``uavcover new``; ``data/new.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Survey:
    usual_ceiling_m: float
    lowest_top_m: float
    lowest_bottom_m: float
    slowest_m_s: float
    usual_speed_m_s: float
    speed_share: float
    trigger_slack: float
    flat_deg: float
    steep_deg: float
    usual_climb_deg: float
    climb_over_slope_deg: float
    steepest_climb_deg: float
    cells: int
    finest_cell_m: float
    oblique_pitch_deg: float
    oblique_sample: float
    largest_pitch_difference: float
    pixels_for_half: float
    finest_ratio: float
    coarsest_ratio: float
    ratio_steps: int
    most_values: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Text:
    transit_clearance_m: float
    step_m: float
    no_fly_margin_m: float
    coverage: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Terrain:
    grid: int
    gap_grid: int
    round_m: float
    rim_share: float
    edge_steps: int
    slope_reach_m: float
    home_slope_deg: float
    largest_km: float
    hides_m: float
    surface_grid: int
    around_m: float
    max_tiles: int
    least_scale: float
    farthest_home_m: float
    beside_zones_m: float


SURVEY = data_table(_Survey, "uavcover/data/new.toml", "survey")
TEXT = data_table(_Text, "uavcover/data/new.toml", "text")
TERRAIN = data_table(_Terrain, "uavcover/data/new.toml", "terrain")
