"""Tolerances of the judge; ``data/verification.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Attitude:
    most_unexplained_m_s2: float
    most_unexplained_in_block_m_s2: float
    block_s: float
    most_noise_m_s2: float
    most_sideways_deg: float
    most_backwards_deg: float
    window_s: float
    longest_s: float
    moves_m_s: float
    enough_blocks: int
    enough_in_block: int
    own_share: float
    max_age_s: float
    max_tilt_deg: float
    stuck_s: float
    turned_deg: float
    course_s: float
    most_radians: float
    agrees_deg: float
    differs_deg: float
    course_m_s: float
    brisk_m_s2: float
    least_lean_share: float
    enough_windows: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lean:
    sure_deviations: float
    smallest_signal: float
    gust_lean_m_s2: float
    model_share: float
    most_late_s: float
    slow_s: float
    step_s: float
    noise_ratio: float
    least_m_s: float
    longest_half_s: float
    window_s: float
    enough_windows: int
    least_share: float
    model_error: float
    axes_from_s: float
    quiet_s: float
    quiet_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _SameFlight:
    agree_m: float
    receiver_m: float
    one_vehicle_m: float
    percentile: float
    enough_fraction: float
    least_s: float
    least_share: float
    step_s: float
    moves_m_s: float
    probes: int
    candidates: int
    bin_s: float
    max_gap_s: float
    near_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ends:
    still_s: float
    still_level_m_s: float
    still_vertical_m_s: float
    noise_medians: float
    near_terrain_m: float
    same_height_m: float
    drift_m: float
    same_place_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Velocity:
    deviations: float
    reset_m_s: float
    skew_s: float
    stamp_s: float
    longest_step_s: float
    rounding_m: float
    rounding_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Safety:
    speed_window_s: float
    sustained_s: float
    under_way: float
    too_slow: float
    speed_tolerance: float
    fence_step_m: float
    on_the_fence_m: float
    ground_m: float
    shifts: int
    separation_longest_s: float
    overtaken_s: float
    lateness_s: float
    kept_at_least: float
    order_of: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Track:
    max_contradiction_m: float
    reported_height_m: float
    roll_m: float
    place_margin_m: float
    max_impossible_moves: int
    around_s: float
    most_legs: int
    moments: int
    max_unobserved_ways_fraction: float
    shown: int
    fewest_samples: int
    spreads: float
    largest_turn_deg: float
    same_view_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Clock:
    disagrees_s: float
    jump_s: float
    clock_step_s: float
    clocks_compared_s: float
    alike_s: float
    window_s: float
    head_bytes: int
    unreleased_versions: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Logs:
    picture_place_error_m: float
    picture_time_error_s: float
    clock_spread_s: float
    most_lean_cos: float
    max_attitude_gap_s: float
    max_velocity_gap_s: float


ATTITUDE = data_table(_Attitude, "uavcover/data/verification.toml", "attitude")
LEAN = data_table(_Lean, "uavcover/data/verification.toml", "lean")
SAME_FLIGHT = data_table(_SameFlight, "uavcover/data/verification.toml", "same_flight")
ENDS = data_table(_Ends, "uavcover/data/verification.toml", "ends")
VELOCITY = data_table(_Velocity, "uavcover/data/verification.toml", "velocity")
SAFETY = data_table(_Safety, "uavcover/data/verification.toml", "safety")
TRACK = data_table(_Track, "uavcover/data/verification.toml", "track")
CLOCK = data_table(_Clock, "uavcover/data/verification.toml", "clock")
LOGS = data_table(_Logs, "uavcover/data/verification.toml", "logs")
