"""Times and distances of flights of several vehicles; ``data/fleet.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fleet:
    look_s: float
    table_every_s: float
    least_step_s: float
    ready_before_s: float
    new_battery_s: float
    least_gain_m: float
    recent_s: float
    less_at_start: float
    knows_home_s: float
    reserve_every_s: float
    step_s: float
    holds_within_s: float


FLEET = data_table(_Fleet, "uavcover/data/fleet.toml", "fleet")
