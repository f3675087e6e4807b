import doctest
import importlib
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "optimizers.md"


@pytest.mark.parametrize(
    "module",
    [
        "uavcover.kernels.dominance",
        "uavcover.optimizers.imodbo",
        "uavcover.optimizers.rivals",
        "uavcover.extras.benchmarks.indicators",
        "uavcover.optimizers.pymoo.adapters",
    ],
)
def test_examples_in_docstrings(module):
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


def test_the_examples_of_the_page_run(capsys):
    ask_and_tell, _, ours_in_pymoo, problems_in_pymoo, pymoo_in_ours = re.findall(
        r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    for example, start in (
        (ask_and_tell, "50 True"),
        (ours_in_pymoo, "(50, 2) True"),
        (problems_in_pymoo, "0.005 False"),
        (pymoo_in_ours, "(40, 2)"),
    ):
        exec(compile(example, str(PAGE), "exec"), {})
        assert capsys.readouterr().out.startswith(start)
