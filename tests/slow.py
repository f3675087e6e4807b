"""Tests that the quick run leaves out, with what shows the same kind of thing there; ``sh scripts/test.sh -m slow`` runs them.

A name without brackets stands for all cases of a test.
"""

from collections.abc import Iterable

import pytest

SLOW = {
    "sitl_tests/test_matrix.py::test_the_vehicle_does_what_the_matrix_says[mock-px4-link-loss-native]": "the same cell of ArduPilot",
    "tests/cli/test_fly.py::test_a_killed_flight_is_resumed_in_the_air": "tests/flight/test_resume.py resumes killed flights",
    "tests/cli/test_fly.py::test_a_terminal_that_is_closed_brings_it_home": "test_interrupt_brings_it_home",
    "tests/cli/test_fly.py::test_vehicle_that_dies_in_flight": "tests/flight/test_faults.py loses vehicles",
    "tests/cli/test_fly.py::test_second_interrupt_leaves_it_holding": "tests/flight/test_stop.py; one in test_interrupt_brings_it_home",
    "tests/cli/test_fly.py::test_pause_makes_it_wait_and_go_on": "the signal in tests/cli/test_pausing.py, the flight in tests/flight/test_faults.py",
    "tests/extras/vehicle_files/test_terrain_server.py::test_serves_until_it_is_told_to_stop_and_says_how_much[15]": "the same with SIGINT",
    "tests/cli/test_mock_vehicle.py::test_tells_its_port_and_ends_when_told[15]": "the same with SIGINT",
    "tests/extras/benchmarks/test_bench_link.py::test_stopped_and_resumed[9]": "the same with SIGINT; tests/extras/benchmarks/test_bench_mmf.py with SIGKILL",
    "tests/test_docs_commands.py::test_the_commands_of_a_page_work_one_after_the_other[quick_start]": "its other pages",
    "tests/test_notebooks.py::test_the_notebook_runs[judge_a_log]": "its other cases; tests/cli/test_verify.py judges logs",
    "tests/test_notebooks.py::test_the_notebook_runs[paper_benchmark]": "its other cases; tests/extras/benchmarks/test_mmf_bench.py",
    "tests/flight/test_limits.py::test_what_cannot_be_put_back_is_said_kept_and_put_back_by_the_next_flight[PX4]": "the same with ArduPilot",
    "tests/extras/mavsdk/test_mavsdk_client.py::test_a_whole_flight_by_mavsdk[PX4]": "the same with ArduPilot",
    "tests/cli/test_plan.py::test_interrupt_writes_the_best_so_far[15]": "the same with SIGINT",
    "tests/extras/benchmarks/test_bench_mmf.py::test_stopped_hard_in_the_middle_and_resumed_gives_the_same_sets[2]": "the same with SIGKILL",
    "tests/cli/test_new.py::test_the_overlap_that_was_asked_for_holds_up_to_the_edge[60/50-4-False]": "75/70, with a hole",
    "tests/cli/test_pictures.py::test_a_plan_claims_what_its_pictures_show[volcano, ahead]": "its other cases",
    "tests/cli/test_pictures.py::test_a_plan_claims_what_its_pictures_show[volcano, overlap]": "its other cases",
    "tests/test_falsify.py::test_each_changes_the_record_the_same_way_for_a_seed_and_leaves_the_original_alone": (
        "tests/test_falsify_judged.py judges a few of all families"
    ),
    "tests/test_honest_flights.py::test_it_passes[1]": "its other flights",
    "tests/test_honest_flights.py::test_it_passes[2]": "its other flights",
    "tests/test_mutants.py::test_mutants_are_killed_by_tests_or_by_time_and_survive_where_no_test_looks": (
        "test_survivors_are_tried_again_when_asked_to_and_not_where_a_reason_stands"
    ),
    "tests/scenario/test_height_claims.py::test_no_leg_leaves_the_band_that_it_claims[ridge-obstacles]": "jacksboro",
    "tests/verification/test_pictures.py::test_every_planned_waypoint_has_its_picture_in_the_record[px4-0.0]": "its other cases",
    "tests/flight/test_resume.py::test_after_a_failsafe_that_brought_it_back[px4]": "the same with ArduPilot",
    "tests/flight/test_resume.py::test_left_holding_it_closes_the_gaps_from_where_it_is_and_lands[px4]": "the same with ArduPilot",
    "tests/flight/test_resume.py::test_after_the_client_was_killed_in_the_air[px4]": "the same with ArduPilot",
    "tests/run/test_api.py::test_the_example_of_the_page_runs": "the chain of the docstring in tests/test_public_api.py",
    "tests/extras/benchmarks/test_coverage_bench.py::test_from_runs_to_files_and_nothing_twice": (
        "the same by the command in tests/extras/benchmarks/test_bench_coverage.py"
    ),
    "tests/extras/bounds/test_bounds.py::test_the_larger_of_both_path_bounds_is_reported": (
        "each of both in tests/extras/bounds/test_bounds.py and test_ground_prices.py"
    ),
    "tests/planner/test_memetic.py::test_the_papers_scenario_with_sixteen_waypoints": (
        "test_every_member_keeps_the_limits_and_none_beats_another, free order"
    ),
    "tests/extras/bounds/test_ground_prices.py::test_no_path_gains_more_than_its_length_and_one_look[sphere-3]": "its other cases",
    "tests/extras/bounds/test_ground_prices.py::test_no_path_gains_more_than_its_length_and_one_look[frame-3]": "its other cases",
    "tests/optimizers/test_ablation_niching.py::test_the_shadow_of_the_scouts_is_missed_where_local_sets_are_wanted_and_only_there": (
        "the variants themselves in tests/optimizers/test_contract.py"
    ),
    "tests/optimizers/test_own.py::TestPymoo::test_every_algorithm_by_name_works_or_says_why_not": (
        "TestBenchmark in the same file, and tests/optimizers/test_pymoo.py"
    ),
}
"""By their pytest names."""


def mark_slow_what_is_listed(items: Iterable[pytest.Item]) -> None:
    """Give the tests of SLOW, and the matrix's cells by MAVSDK but its first capability, the marker ``slow``."""
    for item in items:
        name = item.nodeid
        by_mavsdk = name.startswith("sitl_tests/") and name.endswith("-mavsdk]") and "mission-round-trip" not in name
        if by_mavsdk or name in SLOW or name.partition("[")[0] in SLOW:
            item.add_marker(pytest.mark.slow)
