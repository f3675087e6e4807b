"""What the quick run keeps of tests with several axes of parameters."""

import itertools
import subprocess
import sys
from pathlib import Path

import pytest

from tests.thinned import needed


def cases_of(*sizes: int) -> list[dict[str, int]]:
    return [dict(zip("abcd", values, strict=False)) for values in itertools.product(*map(range, sizes))]


@pytest.mark.parametrize("strength", [1, 2])
@pytest.mark.parametrize("sizes", [(5,), (2, 12), (3, 2, 2), (2, 2, 2, 2), (4, 3, 3)], ids=str)
def test_every_value_and_every_pair_stays(sizes: tuple[int, ...], strength: int) -> None:
    cases = cases_of(*sizes)
    kept = [cases[k] for k in needed(cases, strength)]

    def groups(some: list[dict[str, int]]) -> set[object]:
        return {group for case in some for group in itertools.combinations(case.items(), min(strength, len(sizes)))}

    assert groups(kept) == groups(cases)
    widest = sorted(sizes)[-strength:]
    least = widest[0] * widest[-1] if strength == 2 and len(sizes) > 1 else widest[-1]
    assert least <= len(kept) <= least + 3


def test_the_others_are_long(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text("from tests.conftest import pytest_collection_modifyitems\n")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = long\n  thinned\n")
    (tmp_path / "test_it.py").write_text(
        "import pytest\n@pytest.mark.thinned\n@pytest.mark.parametrize('a', 'xyz')\n@pytest.mark.parametrize('b', 'uv')\n"
        "def test_it(a, b): pass\n"
    )

    def run(expression: str) -> set[str]:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", "-m", expression, tmp_path],
            capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        return {line.partition("[")[2] for line in done.stdout.splitlines() if "test_it[" in line}

    quick, long = run("not long"), run("long")
    assert len(quick) == len(long) == 3
    assert len(quick | long) == 6
    assert {name[0] for name in quick} == set("uv")
    assert {name[2] for name in quick} == set("xyz")
