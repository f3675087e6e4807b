"""Numbers of the mock vehicle's behaviour; ``data/mock.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Body:
    step_s: float
    same_place_m: float
    tumbled_rad: float
    touch_m: float
    comes_up_s: float
    same_m_s: float
    battery_cells: int
    full_v: float
    empty_v: float
    sag_v: float
    receiver_s: float
    recovery_s: float
    drift_m_s: float
    position_timeout_s: float
    failsafe_low_charge: float
    failsafe_critical_charge: float
    fault_charge: float
    upwind_deg: float
    glitch_s: float
    arming_charge: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Guidance:
    braking_share: float
    corner_share: float
    cross_track_gain_1_s: float
    approach_gain_1_s: float
    follow_gain_1_s: float
    velocity_gain_1_s: float
    lag_m: float
    stands_lag_m: float
    height_radius_m: float
    longer_ratio: float
    late_share: float
    kept_share: float
    least_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Flight:
    slow_landing_below_m: float
    settled_m: float
    circle_radius_m: float
    circle_leg_m: float
    repeat_s: float
    report_s: float
    climb_from_m: float
    terrain_step_m: float
    return_settled_m: float
    above_start_m: float
    trail_timeout_s: float
    routine_points: int
    low_space: int
    simplify_share: float
    prune_share: float
    disarm_after_landing_s: float
    check_every: int
    disarm_when_idle_s: float
    tolerance_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link:
    ask_every_s: float
    ahead_s: float
    ask_again_s: float
    unanswered_s: float
    most_places: int
    datagram_bytes: int
    peer_tick_s: float
    most_connections: int
    tick_s: float
    longest_tick_s: float
    stale_s: float
    terrain_ask_every_s: float
    terrain_around_spacings: int


BODY = data_table(_Body, "uavcover/data/mock.toml", "body")
GUIDANCE = data_table(_Guidance, "uavcover/data/mock.toml", "guidance")
FLIGHT = data_table(_Flight, "uavcover/data/mock.toml", "flight")
LINK = data_table(_Link, "uavcover/data/mock.toml", "link")
