"""Tests that the quick run leaves out; ``sh scripts/test.sh -m long`` runs them.

They take half a second or more (``long_tests.txt``, measured by ``scripts/slowest_tests.py TIMES... --long``), or are further
cases of a thinned test (``thinned.py``). A name without brackets stands for all cases of a test.
"""

from collections.abc import Iterable
from pathlib import Path

import numba
import pytest

LIST = Path(__file__).with_name("long_tests.txt")

KEPT = {
    "tests/test_setup.py": "a new user's first command, in a clean clone",
    "tests/cli/test_fly.py::test_interrupt_brings_it_home": "Ctrl-C in flight",
    "tests/cli/test_plan_upload.py::test_run_folder_to_a_vehicle_in_another_process": "the mission over UDP to another process",
    "tests/cli/test_verify.py::test_a_gap_mission_from_where_the_vehicle_is": "what was missed becomes the next mission",
    "tests/cli/test_plan.py::test_interrupt_writes_the_best_so_far": "Ctrl-C while planning",
    "tests/cli/test_verify.py::test_shifted_by_200_m_does_not_pass": "a flight that was not flown here",
    "tests/cli/test_client_option.py::test_a_run_is_uploaded_and_flown": "a whole flight by MAVSDK's client",
    "tests/cli/test_report.py::test_a_flown_run": "the report of a flight",
    "tests/planner/test_no_fly.py::test_no_leg_of_a_plan_enters_a_zone[0-<lambda>]": "a plan beside zones",
    "tests/extras/bounds/test_bounds.py": "bounds that are proved",
    "tests/planner/test_tour_with_neighbourhoods.py::test_a_tour_ends_where": "tours through neighbourhoods",
    "tests/planner/test_parallel_lines.py::test_lines_have_their_heading": "lines of a fixed heading",
    "tests/planner/test_memetic.py::test_equal_seed": "equal plans on any number of threads",
    "tests/flight/test_fly.py": "whole flights on a simulated clock",
    "tests/flight/test_resume.py::test_after_the_client_was_killed_in_the_air": "a killed flight goes on",
}
"""Beginnings of names that the quick run keeps however long they take, each with what would otherwise not be in it."""


def listed() -> frozenset[str]:
    """Names of the long tests."""
    return frozenset(LIST.read_text(encoding="utf-8").splitlines())


def mark_long_what_is_listed(items: Iterable[pytest.Item]) -> None:
    """Give the marker ``long`` to what is listed and not kept. Without the JIT other tests take long."""
    names = frozenset() if numba.config.DISABLE_JIT else listed()
    for item in items:
        if {item.nodeid, item.nodeid.partition("[")[0]} & names and not item.nodeid.startswith(tuple(KEPT)):
            item.add_marker(pytest.mark.long)
