"""Steps and tolerances of the checks; ``data/check.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Path:
    leg_step_m: float
    terrain_step_m: float
    spline_step_m: float
    step_deg: float
    back_deg: float
    circle_points: int
    straight_deg: float
    about_deg: float
    spline_factor: float
    highest_m: float
    widest_m: float
    most_turns: float
    fastest_m_s: float
    same_home_m: float
    endless_passes: int
    max_steps: int
    home_difference_m: float
    near_deg: float
    most_photos: int
    cells: int
    finest_cell_m: float
    view_around_m: float
    most_oblique_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Checks:
    boundary_tolerance_m: float
    boundary_step_m: float
    clearance_tolerance_m: float
    landed_m: float
    return_step_s: float
    return_step_m: float
    ground_tolerance_m: float
    far_m: float
    return_line_step_m: float
    return_line_piece_m: float
    directions: int
    least_speed_m_s: float
    fastest_multirotor_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _World:
    around_m: float
    eye_m: float
    slack_m: float
    most_m: float
    reach_deg: float
    flown_deg: float
    flown_around_deg: float
    most_suspects: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Repair:
    spare_m: float
    near_m: float
    rounds: int
    at_home_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Page:
    pad_m: float
    profile_steps: int
    circle_corners: int
    most_legs: int


PATH = data_table(_Path, "uavcover/data/check.toml", "path")
CHECKS = data_table(_Checks, "uavcover/data/check.toml", "checks")
WORLD = data_table(_World, "uavcover/data/check.toml", "world")
REPAIR = data_table(_Repair, "uavcover/data/check.toml", "repair")
PAGE = data_table(_Page, "uavcover/data/check.toml", "page")
