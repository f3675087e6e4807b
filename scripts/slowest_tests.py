"""Which tests take long, and why each is worth it: `python scripts/slowest_tests.py TIMES...`.

As a plugin of pytest (`-p scripts.slowest_tests`, in every worker) it adds a line for each test to the file named by
`TEST_TIMES`: processor seconds of the process and of those that it started and waited for, and seconds by the clock.
`scripts/test.sh` leaves `.test_times.jsonl`. Shared fixtures count for the test that comes first.

`--long` writes `tests/long_tests.txt`: what takes half a second or more of the processor without its fixtures. Tests that the
given runs did not have stay as they are there.
"""

import argparse
import json
import os
import resource
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numba
import pytest

from scripts.options import existing_file

SHOWN = 50
LONG_S = 0.5
LONG_TESTS = Path(__file__).parents[1] / "tests" / "long_tests.txt"
PLAIN, TRACED, INTERPRETED = "", "traced", "without the JIT"

REASONS = {
    "": "",
    "tests/test_setup.py": "a new user's first command, in a clean clone: set-up, plan, flight, verdict",
    "tests/test_wheel.py": "what is installed from a wheel has all data and flies; nothing of the clone helps it",
    "tests/test_public_api.py": "the chain of the package's docstring, line by line as it stands",
    "tests/test_notebooks.py": "each notebook of the documentation runs in a kernel of its own",
    "tests/test_mutants.py": "the mutation runner starts pytest for each change; a mutant killed by time needs that time",
    "tests/test_same_examples.py": "hypothesis draws the same examples whatever a process has imported, with a control",
    "tests/test_falsify.py": "every way to falsify a flight changes its record, the same way for a seed",
    "tests/test_falsify_judged.py": "falsified flights of all families are judged, and none passes",
    "tests/test_honest_flights.py": "honest flights with faults, pauses and resumption pass, the same twice",
    "tests/test_docs.py": "every command, option and example of the documentation is tried",
    "tests/test_architecture.py": "the figures of the architecture page are counted anew",
    "tests/run/test_pipeline.py": "the Python API's page runs as it stands; a saved plan reads back",
    "tests/run/": "run folders by the workflows that write them",
    "tests/cli/test_fly.py": "flights of a process that is interrupted, killed, or loses its vehicle",
    "tests/cli/test_gaps.py": "what a torn flight missed is found, flown, and both tracks together reach the plan",
    "tests/cli/test_plan.py::test_equal": "equal plans with one thread, two threads and one core",
    "tests/cli/test_plan.py::test_progress": "the bar comes after two seconds, and only on a terminal",
    "tests/cli/test_plan.py": "planning commands that are interrupted, refused, or run into a full disk",
    "tests/cli/test_plan_upload.py": "plan and upload as one command, with vehicles that stop in the middle",
    "tests/cli/test_client_option.py": "MAVSDK as the client: its server is a process of its own, with its own time-outs",
    "tests/cli/test_bench": "benchmarks stopped hard and resumed give the same sets",
    "tests/cli/test_mock_vehicle.py": "the vehicle of a program that is killed ends too",
    "tests/cli/": "whole commands on a flown run: the first one waits for the demo that all share",
    "tests/extras/benchmarks/": "benchmark runs from seeds to tables, small ones",
    "tests/scenario/test_height_claims.py": "bundled scenarios' height claims, recomputed from the file by independent code",
    "tests/scenario/": "scenarios and elevation files, read and refused",
    "tests/extras/check/": "each kind of fault in other people's missions is found, and none where there is none",
    "tests/test_thinned.py": "what the quick run keeps of many cases shows every value and every pair",
    "tests/verification/": "honest and falsified flights, judged as a user's would be",
    "tests/report/": "the report's page, drawn from a flown run",
    "tests/recording/": "a recording is written and read with the viewer's own library",
    "tests/flight/": "the clients get missions across lossy links and follow flights",
    "tests/mock/": "the mock vehicle behaves as the autopilots that were observed",
    "tests/sitl_tests/": "the harness of the simulators, tried with the mock vehicle",
    "sitl_tests/": "a cell of the vehicle matrix on the mock: the harness works before a simulator is started",
    "tests/kernels/test_cache.py": "machine code is never older than its sources: each change is compiled by a new process",
    "tests/kernels/test_route_state.py::test_the_cells": "what a leg sees, against every sample of it and every cell",
    "tests/kernels/test_route_state.py::test_hot": "thousands of hot changes keep every limit of the legs",
    "tests/kernels/test_route_state.py::test_cold": "changes that are kept make the route better by its naive energy",
    "tests/kernels/test_route_state.py": "counts that are kept up change by change equal a full recount, for each kind of sensor",
    "tests/kernels/test_route_state_cost.py": "cold changes never cost more, for each kind of cost",
    "tests/kernels/test_open_tour.py": "tours against all orders and against LKH",
    "tests/kernels/test_set_cover.py": "covers against all subsets of small cases",
    "tests/kernels/test_route.py": "terrain following keeps band, slope and tolerance, against its definition",
    "tests/kernels/test_obstacles.py": "lines past obstacles, against shapely",
    "tests/kernels/test_surface.py": "heights above the ground, against exact fractions",
    "tests/kernels/": "a kernel against its naive twin, or against its definition",
    "tests/planner/test_memetic.py::test_the_papers": "sixteen waypoints see all of the paper's scenario: the method's claim",
    "tests/planner/test_memetic.py": "whole plans keep the limits, are non-dominated, and equal on any number of threads",
    "tests/planner/test_rotation.py": "a scenario turned by a quarter is planned as well: three seeds each, as seeds differ",
    "tests/planner/test_planner.py": "no plan is worse than a baseline; equal seeds give equal plans",
    "tests/planner/test_closing.py": "whole plans of a canyon, and of nearly everything, have their gaps closed",
    "tests/planner/test_gap_route.py": "gap missions see what is asked for by a way near the shortest",
    "tests/planner/test_snapshots.py": "looking at a search changes nothing; pymoo's optimizers plan too",
    "tests/planner/test_own_optimizer.py": "optimizers that are not ours plan, the same twice",
    "tests/planner/test_tour_with_neighbourhoods.py": "tours through neighbourhoods are shorter than through centres",
    "tests/planner/test_set_cover.py": "covers are feasible routes, and no plan is worse than the cover that it began with",
    "tests/planner/": "searches on small sites",
    "tests/optimizers/": "optimizers on problems with a known answer",
    "tests/sensing/": "coverage maps against their definition",
    "tests/test_terrain_kinds.py": "whole plans, recomputed by code that shares nothing with the planner",
    "tests/mission_io/test_presets.py": "long missions over slow links in the time the protocol allows, in constant memory",
    "tests/mission_io/formats/": "every reader on thousands of damaged files, in linear time",
    "tests/mission_io/test_mavsdk_peers.py": "MAVSDK as the other side: a foreign implementation of the protocol",
    "tests/mission_io/": "the mission protocol, on a simulated clock and against foreign implementations",
}  # fmt: skip
"""The longest beginning of a test's name counts."""


@dataclass(frozen=True, slots=True)
class Timed:
    """One test.

    Attributes:
        test: its name for pytest.
        how: whether its lines were traced, and whether its kernels were interpreted.
        processor_s: of its process and of ended ones that it started.
        wall_s: by the clock.
        alone_s: of the processor, without fixtures.
    """

    test: str
    how: str
    processor_s: float
    wall_s: float
    alone_s: float

    @property
    def reason(self) -> str:
        """Why it is worth it; empty when REASONS has none."""
        if self.how == INTERPRETED:
            return "reaches the kernel's lines: only interpreted can its coverage be measured"
        return REASONS[max((name for name in REASONS if self.test.startswith(name)), key=len)]


def _processor_s() -> float:
    usages = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


_ALONE = pytest.StashKey[float]()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Take the time of one test without its fixtures."""
    processor_s = _processor_s()
    yield
    item.stash[_ALONE] = _processor_s() - processor_s


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Take the times of one test with its fixtures."""
    processor_s, wall_s = _processor_s(), time.monotonic()
    yield
    traced = TRACED if item.config.pluginmanager.hasplugin("_cov") else PLAIN
    timed = (
        item.nodeid, INTERPRETED if numba.config.DISABLE_JIT else traced,
        round(_processor_s() - processor_s, 3), round(time.monotonic() - wall_s, 3),
        round(item.stash.get(_ALONE, 0.0), 3),
    )  # fmt: skip
    if "TEST_TIMES" in os.environ:
        with Path(os.environ["TEST_TIMES"]).open("a", encoding="utf-8") as file:
            file.write(json.dumps(timed) + "\n")


def read(paths: list[Path]) -> list[Timed]:
    """The slowest first, by the processor's time."""
    rows = [Timed(*json.loads(line)) for path in paths for line in path.read_text(encoding="utf-8").splitlines()]
    return sorted(rows, key=lambda row: (-row.processor_s, row.test, row.how))


def long_tests(rows: list[Timed], before: frozenset[str]) -> list[str]:
    """Names of the tests of half a second or more, in order.

    Args:
        rows: as measured; those without the JIT say nothing of the others.
        before: names that stay where they were not measured.
    """
    alone_s: dict[str, float] = defaultdict(float)
    for row in rows:
        if row.how != INTERPRETED:
            alone_s[row.test] = max(alone_s[row.test], row.alone_s)
    return sorted({*(before - alone_s.keys()), *(test for test, s in alone_s.items() if s >= LONG_S)})


def table(rows: list[Timed]) -> Iterator[str]:
    """The rows of the page."""
    yield "| processor s | clock s | test | worth it, because |"
    yield "|---:|---:|---|---|"
    for row in rows[:SHOWN]:
        name = row.test.replace("|", "\\|") + (f" ({row.how})" if row.how else "")
        yield f"| {row.processor_s:.1f} | {row.wall_s:.1f} | {name} | {row.reason} |"


def totals(rows: list[Timed]) -> Iterator[str]:
    """The sums of the parts."""
    sums: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        sums[row.how].append(row.processor_s)
    yield "| part | tests | processor min |"
    yield "|---|---:|---:|"
    words = {PLAIN: "not traced", TRACED: "lines traced", INTERPRETED: "kernels without the JIT, traced"}
    for how, parts in sums.items():
        yield f"| {words.get(how, how)} | {len(parts)} | {sum(parts) / 60.0:.1f} |"
    yield f"| together | {len(rows)} | {sum(row.processor_s for row in rows) / 60.0:.1f} |"


def main() -> None:
    """Print the tables, or write the list of long tests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("times", nargs="+", type=existing_file)
    parser.add_argument("--long", action="store_true", help=f"write {LONG_TESTS.name} and nothing else")
    arguments = parser.parse_args()
    rows = read(arguments.times)
    if arguments.long:
        before = frozenset(LONG_TESTS.read_text(encoding="utf-8").splitlines())
        LONG_TESTS.write_text("".join(f"{name}\n" for name in long_tests(rows, before)), encoding="utf-8")
        return
    print("\n".join(totals(rows)), "\n".join(table(rows)), sep="\n\n")
    if unexplained := [row.test for row in rows[:SHOWN] if not row.reason]:
        print(f"make these cheaper, or say in REASONS why each is worth it: {', '.join(unexplained)}", file=sys.stderr)


if __name__ == "__main__":
    main()
