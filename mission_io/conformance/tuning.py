"""Times and numbers of the conformance cases; ``data/conformance.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Probe:
    other_system: int
    absent_system: int
    answer_s: float
    tries: int
    idle_s: float
    longest_rest_s: float
    unmeasured_s: float
    longest_late_s: float
    same_deg: float
    same_m: float
    current_s: float
    new_items: int
    few_items: int
    gives_up_s: float
    slow_s: float
    listed_items: int
    free_s: float
    strange_type: int
    stops_s: float
    unknown_frame: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Station:
    resend_s: float
    item_resend_s: float
    retries: int
    crossing_s: float
    quiet_s: float
    longest_s: float
    tick_s: float


PROBE = data_table(_Probe, "mission_io/data/conformance.toml", "probe")
STATION = data_table(_Station, "mission_io/data/conformance.toml", "station")
