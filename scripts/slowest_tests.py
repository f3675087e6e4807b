"""Which tests take long: `python scripts/slowest_tests.py TIMES...`.

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
    yield "| processor s | clock s | test |"
    yield "|---:|---:|---|"
    for row in rows[:SHOWN]:
        name = row.test.replace("|", "\\|") + (f" ({row.how})" if row.how else "")
        yield f"| {row.processor_s:.1f} | {row.wall_s:.1f} | {name} |"


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


if __name__ == "__main__":
    main()
