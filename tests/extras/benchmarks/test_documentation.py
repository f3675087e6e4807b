"""The examples in docstrings are true."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize("module", ["mmf.runs", "rank_tests", "runs"])
def test_examples_in_docstrings(module: str) -> None:
    result = doctest.testmod(importlib.import_module(f"uavcover.extras.benchmarks.{module}"))
    assert result.attempted > 0
    assert result.failed == 0
