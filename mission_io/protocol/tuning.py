"""Times, tries and limits of transfers; ``data/protocol.toml`` explains each."""

from dataclasses import dataclass

from mission_io.data_tables import data_table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Transfers:
    restarts: int
    clear_tries: int
    readings: int
    stale_read_back_s: float
    clean_answers: int
    cancels_on_a_bad_link: int
    thanks_on_a_bad_link: int
    count_changes: int
    proven_items: int
    cheap_restart_s: float
    errors_at_an_item: int
    fresh_starts: int
    doubtful_items: int
    cancels: int
    deaf_tries: int
    stale_tries: int
    other_link_ratio: float
    first_doubtful_trips: int
    doubtful_trips: int


@dataclass(frozen=True, slots=True, kw_only=True)
class _Files:
    gaps_of_silence: float
    first_gap_s: float
    burst_most_wait_s: float
    hasty_bursts: int
    beyond_a_burst: int
    recent_answers: int
    tries_of_crc: int
    most_failures: int
    few_pieces: int
    small_share: float
    proving_pieces: int
    least_wait_s: float
    most_wait_s: float
    first_wait_s: float
    overtaking_answers: int
    least_control_wait_s: float
    hasty_tries: int
    most_entries: int
    burst: int
    quiet_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Values:
    most_refusals: int
    max_waiting: int
    reported_blocks: int
    latest_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _Calls:
    answer_s: float
    item_limit_s: float
    resend_s: float
    heartbeat_s: float
    time_answers_per_s: float
    catch_up_s: float
    ardupilot_window: int
    list_again_s: float
    list_id_answer_s: float
    poll_s: float
    ask_again_s: float
    ask_version_s: float
    old_heartbeats: int
    listen_s: float
    terrain_every_s: float
    terrain_answer_s: float


TRANSFERS = data_table(_Transfers, "mission_io/data/protocol.toml", "transfers")
FILES = data_table(_Files, "mission_io/data/protocol.toml", "files")
VALUES = data_table(_Values, "mission_io/data/protocol.toml", "values")
CALLS = data_table(_Calls, "mission_io/data/protocol.toml", "calls")
