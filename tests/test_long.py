"""The tests of half a second or more exist, and so do those of them that the quick run keeps."""

import subprocess
import sys
from pathlib import Path

import pytest

from scripts.slowest_tests import INTERPRETED, PLAIN, TRACED, Timed, long_tests
from tests.long import KEPT, listed


@pytest.mark.parametrize("name", [*KEPT, *sorted({name.partition("[")[0] for name in listed()})])
def test_it_exists(name: str) -> None:
    file, *rest = name.partition("[")[0].split("::")
    # Some files take tests from a contract beside them.
    text = "".join(path.read_text(encoding="utf-8") for path in (Path(file), *Path(file).parent.glob("*contract*.py")))
    assert all(part in text for part in rest)


def test_what_was_measured_decides_and_what_was_not_stays() -> None:
    rows = [
        Timed("quick", PLAIN, 5.0, 5.0, 0.49),
        Timed("long", PLAIN, 1.1, 1.1, 0.5),
        Timed("traced", PLAIN, 0.4, 0.4, 0.4),
        Timed("traced", TRACED, 1.4, 1.4, 1.4),
        Timed("kernel", INTERPRETED, 9.0, 9.0, 9.0),
        Timed("now quick", PLAIN, 0.1, 0.1, 0.1),
    ]
    assert long_tests(rows, frozenset({"now quick", "elsewhere"})) == ["elsewhere", "long", "traced"]


def test_the_matrix_alone_has_its_long_cells() -> None:
    """``sh scripts/test.sh -m long sitl_tests`` ran none of them: the marks came with the folder ``tests`` only."""
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", "sitl_tests"]
    reported = subprocess.run([*collect, "-m", "long"], capture_output=True, text=True, check=True).stdout
    assert {name for name in listed() if name.startswith("sitl_tests/")} <= set(reported.splitlines())
