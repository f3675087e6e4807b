"""Tuned numbers of the flight; ``data/flight.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Preparation:
    telemetry_tries: int
    ask_why_s: float
    arming_answer_s: float
    arming_tries: int
    reached_items: int
    place_each_s: float
    parameter_each_s: float
    most_unanswered: int
    list_each_s: float
    limit_answer_s: float
    first_limit_answer_s: float
    least_quiet_s: float
    quiet_answers: float
    limits_at_once: int
    limit_rounds: int
    home_slack_m: float
    late_ratio: float
    proof_answer_s: float
    proof_again_s: float
    after_restart_s: float
    shown_items: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Reserve:
    rounding_percent: float
    climb_s: float
    measured_s: float
    use_home_ratio: float
    use_on_ratio: float
    to_turn_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Monitor:
    late_s: float
    step_s: float
    longest_step_s: float
    fastest_ratio: float
    agreeing_stamps: int
    agreeing_rare_stamps: int
    gap_s: float
    max_terrain_asked: int
    doubt_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Evidence:
    old_beat_s: float
    behind_s: float
    ask_s: float
    ask_again_s: float
    unanswered_s: float
    agreeing_beats: int
    remembered: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Watch:
    repeat_s: float
    settle_s: float
    cause_within_s: float
    low_battery_percent: int
    bad_variance: float
    jump_m: float
    most_signs: int
    failsafe_gap_s: float
    sign_within_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Guard:
    every_s: float
    busy_share: float
    longest_s: float
    again_s: float
    look_s: float
    settle_s: float
    doubt_s: float
    off_doubt_s: float
    off_route_radii: float
    leans_deg: float
    comes_back_m_s: float
    cause_within_s: float
    warned_within_s: float
    band_slack_m: float
    fence_slack_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Progress:
    unseen_s: float
    trust_s: float
    step_m: float
    slack_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Following:
    moved_m: float
    going_on_s: float
    evidence_s: float
    most_holds: int
    comes_to_rest_s: float
    look_s: float
    drift_m: float
    calm_s: float
    at_rest_m_s: float
    most_ways_home: int
    aside_m: float
    home_samples: int
    poll_s: float
    unknown_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ground:
    settle_s: float
    still_sink_m_s: float
    still_speed_m_s: float
    still_height_m: float
    moves_sink_m_s: float
    moves_speed_m_s: float
    near_m: float
    falls_m_s: float
    fallen_m: float
    before_s: float
    old_s: float
    keep_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fall:
    least_fall_m_s: float
    fall_ratio: float
    lean_deg: float
    tumbles_s: float
    still_m_s: float
    near_m: float
    lies_m: float
    aloft_m: float
    lies_s: float
    hit_still_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Resume:
    near_radii: float
    unseen_s: float
    corridor_radii: float
    overlap_radii: float
    overlap_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Schedule:
    late_s: float
    late_ratio: float
    look_every_s: float
    fewest_photos: int
    by_chance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Terrain:
    poll_s: float
    tell_every_s: float
    ask_again_s: float
    max_blocks: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Records:
    state_every_s: float
    line_every_s: float
    line_every_flown_s: float
    max_attitude_age_s: float


PREPARATION = data_table(_Preparation, "uavcover/data/flight.toml", "preparation")
RESERVE = data_table(_Reserve, "uavcover/data/flight.toml", "reserve")
MONITOR = data_table(_Monitor, "uavcover/data/flight.toml", "monitor")
EVIDENCE = data_table(_Evidence, "uavcover/data/flight.toml", "evidence")
WATCH = data_table(_Watch, "uavcover/data/flight.toml", "watch")
GUARD = data_table(_Guard, "uavcover/data/flight.toml", "guard")
PROGRESS = data_table(_Progress, "uavcover/data/flight.toml", "progress")
FOLLOWING = data_table(_Following, "uavcover/data/flight.toml", "following")
GROUND = data_table(_Ground, "uavcover/data/flight.toml", "ground")
FALL = data_table(_Fall, "uavcover/data/flight.toml", "fall")
RESUME = data_table(_Resume, "uavcover/data/flight.toml", "resume")
SCHEDULE = data_table(_Schedule, "uavcover/data/flight.toml", "schedule")
TERRAIN = data_table(_Terrain, "uavcover/data/flight.toml", "terrain")
RECORDS = data_table(_Records, "uavcover/data/flight.toml", "records")
