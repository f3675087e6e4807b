"""The tests that the quick run leaves out exist, and what is said to show the same exists too."""

import re
from pathlib import Path

import pytest

from tests.slow import SLOW


@pytest.mark.parametrize("name", SLOW)
def test_a_slow_test_and_what_stands_for_it_exist(name: str) -> None:
    file, *_, function = name.partition("[")[0].split("::")
    text = Path(file).read_text(encoding="utf-8")
    assert f"def {function}(" in text
    for other in re.findall(r"tests/\w+/\w+\.py|tests/\w+\.py", SLOW[name]):
        assert Path(other).exists()
    for other in re.findall(r"\btest_\w+\b(?!\.py)", SLOW[name]):
        assert f"def {other}(" in text or other == Path(file).stem


def test_the_quick_run_leaves_them_out(pytestconfig: pytest.Config) -> None:
    assert pytestconfig.getini("addopts")[-1] == "not slow and not long"
