"""The mutants of ``scripts/mutate_judgement.py``: what is changed, and that a change is noticed."""

import ast
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "mutate_judgement.py"
SOURCE = '''
LIMIT: float = 2.0

def judged(values: list[float], *, strict: bool = True) -> list[float]:
    """Words."""
    found = []
    for value in values:
        if value < LIMIT and not strict:
            found.append(value - 1)
    return found if max(values) > 0 else [f"{LIMIT + 1}"]
'''


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("mutate_judgement", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutate_judgement"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def module(script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(script, "ROOT", tmp_path)
    (tmp_path / "code.py").write_text(SOURCE)
    return "code.py"


def test_each_change_is_one_and_of_every_kind(script: ModuleType, module: str) -> None:
    mutants = script.mutants_of(module)
    assert [mutant.number for mutant in mutants] == list(range(len(mutants)))
    said = " | ".join(mutant.change for mutant in mutants)
    for what in (
        "2.0 -> 4.0", "True -> False", "and <-> or", "Lt -> LtE", "Lt -> GtE", "without Not", "Sub -> Add", "1 -> 2",
        "statement left out", "max -> min", "always the first", "always the second", "0 -> 1",
    ):  # fmt: skip
        assert what in said
    assert "Words" not in said
    assert "Add -> Sub" not in said  # stands in words for people
    texts = {ast.unparse(script.mutated(mutant)) for mutant in mutants}
    assert ast.unparse(ast.parse(SOURCE)) not in texts
    assert len(texts) == len(mutants)


def test_a_changed_module_is_imported_and_the_file_stays(script: ModuleType, module: str, tmp_path: Path) -> None:
    mutant = next(mutant for mutant in script.mutants_of(module) if "Lt -> GtE" in mutant.change)
    finder = script._Finder("code_to_mutate", script.mutated(mutant), str(tmp_path / module))
    spec = finder.find_spec("code_to_mutate")
    assert spec is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    assert loaded.judged([1.0, 5.0], strict=False) == [4.0]
    assert finder.find_spec("another") is None
    assert (tmp_path / module).read_text() == SOURCE


def test_every_module_has_tests_that_are_there(script: ModuleType) -> None:
    for pattern in script.TESTS:
        paths = [path for path in script.ROOT.glob(pattern) if path.name != "__init__.py"]
        assert paths, pattern
        for path in paths:
            assert script.tests_of(str(path.relative_to(script.ROOT))), path
    assert all((script.ROOT / test).exists() for tests in script.TESTS.values() for test in tests)
    assert all((script.ROOT / test).exists() for tests in script.FIRST.values() for test in tests)


def test_what_was_tried_is_not_tried_again(script: ModuleType, tmp_path: Path) -> None:
    rows = [
        script.Row("a.py", 1, 7, "x: Lt -> LtE", "killed", 2.5),
        script.Row("a.py", 2, 8, "y: 0 -> 1", "survived", 3.0),
    ]
    out = tmp_path / "mutants.md"
    script.write(out, rows, "words")
    assert list(script.kept_rows(out.with_suffix(".csv")).values()) == rows
    page = out.read_text()
    assert "| a.py | 2 | 1 |" in page
    assert "- a.py:8: `y: 0 -> 1`" in page
    assert script.kept_rows(tmp_path / "none.csv") == {}
