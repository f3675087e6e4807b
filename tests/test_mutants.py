"""The mutants of ``scripts/attack/mutate_judgement.py``: what is changed, and that a change is noticed."""

import ast
import importlib.util
import re
import sys
from pathlib import Path

import pytest

from scripts.attack import mutants, mutate_judgement

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


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    (tmp_path / "code.py").write_text(SOURCE)
    return "code.py"


def test_each_change_is_one_and_of_every_kind(module: str) -> None:
    every = mutants.mutants_of(module)
    assert [mutant.number for mutant in every] == list(range(len(every)))
    said = " | ".join(mutant.change for mutant in every)
    for what in (
        "2.0 -> 4.0", "True -> False", "and <-> or", "Lt -> LtE", "Lt -> GtE", "without Not", "Sub -> Add", "1 -> 2",
        "statement left out", "max -> min", "always the first", "always the second", "0 -> 1",
    ):  # fmt: skip
        assert what in said
    assert "Words" not in said
    assert "Add -> Sub" not in said  # stands in words for people
    texts = {ast.unparse(mutants.mutated(mutant)) for mutant in every}
    assert ast.unparse(ast.parse(SOURCE)) not in texts
    assert len(texts) == len(every)


def test_a_mutant_knows_the_lines_of_its_own_statement(module: str) -> None:
    lines = {mutant.change: mutant.lines for mutant in mutants.mutants_of(module)}
    assert lines["value < LIMIT: Lt -> GtE"] == (8, 8)
    assert lines["value - 1: Sub -> Add"] == (9, 9)


def test_who_is_drawn_does_not_depend_on_other_code(module: str, tmp_path: Path) -> None:
    def chosen() -> list[str]:
        return [mutant.change for mutant in mutants.drawn(mutants.mutants_of(module), 5, seed=3)]

    before = chosen()
    assert len(before) == 5
    assert before != [mutant.change for mutant in mutants.drawn(mutants.mutants_of(module), 5, seed=4)]
    (tmp_path / module).write_text("\n\n" + SOURCE)
    assert chosen() == before


def test_a_changed_module_is_imported_and_the_file_stays(module: str, tmp_path: Path) -> None:
    mutant = next(mutant for mutant in mutants.mutants_of(module) if "Lt -> GtE" in mutant.change)
    finder = mutate_judgement._Finder("code_to_mutate", mutants.mutated(mutant), str(tmp_path / module))
    assert not finder.loader.loaded
    spec = finder.find_spec("code_to_mutate")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    assert finder.loader.loaded
    assert loaded.judged([1.0, 5.0], strict=False) == [4.0]
    assert finder.find_spec("another") is None
    assert (tmp_path / module).read_text() == SOURCE


class Project:
    """A module of its own, and tests of it."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        for position in (mutants, mutate_judgement):
            monkeypatch.setattr(position, "ROOT", folder)
        monkeypatch.setattr(mutate_judgement, "TESTS", {"mutated_code.py": ["test_mutated_code.py"]})
        monkeypatch.setattr(mutate_judgement, "NAMED", {})
        monkeypatch.setattr(mutate_judgement, "_warm_up", lambda: None)
        monkeypatch.setenv("PYTHONPATH", str(folder))
        monkeypatch.syspath_prepend(folder)
        monkeypatch.chdir(folder)
        (folder / "mutated_code.py").write_text(
            "def double(x: float) -> float:\n    return x * 2\n\ndef unused(x: int) -> int:\n    return x + 3\n"
        )
        self.test("assert double(3) == 6")

    def add_a_loop(self) -> None:
        """Mutants that go on for ever take the whole time that they are given."""
        with (self.folder / "mutated_code.py").open("a") as file:
            file.write("\ndef count_down(x: int) -> int:\n    while x > 0:\n        x -= 1\n    return x\n")
        self.test("assert double(3) == 6 and mutated_code.count_down(2) == 0")

    def test(self, claim: str) -> None:
        (self.folder / "test_mutated_code.py").write_text(
            f"import mutated_code\nfrom mutated_code import double\n\ndef test_it() -> None:\n    {claim}\n"
        )

    def run(self, *arguments: str) -> dict[str, str]:
        """The outcome of each mutant."""
        mutate_judgement.main(["-o", "page.md", "-j", "1", "--sample", "0", "--timeout", "3", *arguments])
        rows = mutate_judgement.kept_rows(self.folder / "page.csv")
        return {change: row.outcome for (_, change, _), row in rows.items()}


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Project:
    return Project(tmp_path, monkeypatch)


def test_mutants_are_killed_by_tests_or_by_time_and_survive_where_no_test_looks(project: Project) -> None:
    project.add_a_loop()
    outcomes = project.run()
    assert outcomes["x * 2: Mult -> Div"] == "killed"
    assert outcomes["x + 3: Add -> Sub"] == "survived"
    assert outcomes["x -= 1: statement left out"] == "timeout"
    assert "test_mutated_code.py::test_it" in (project.folder / "page.csv").read_text()
    page = (project.folder / "page.md").read_text()
    assert "- mutated_code.py:5: `x + 3: Add -> Sub`" in page.partition("## Survivors")[2]
    assert re.search(r"- mutated_code.py:9: `x -= 1: statement left out`", page.partition("## Killed by time")[2])
    assert "mutated_code" not in sys.modules


def test_tests_that_fail_as_the_code_is_prove_nothing(project: Project) -> None:
    project.test("assert double(3) == 7")
    with pytest.raises(SystemExit, match=r"test_mutated_code.py fails as the code is \(exit 1\)"):
        project.run()


def test_survivors_are_tried_again_when_asked_to_and_not_where_a_reason_stands(project: Project) -> None:
    project.test("assert double(0) == 0")
    assert project.run()["x * 2: Mult -> Div"] == "survived"
    project.test("assert double(3) == 6")
    assert project.run()["x * 2: Mult -> Div"] == "survived"
    rows = (project.folder / "page.csv").read_text().splitlines()
    reported = [row + "equivalent: nobody calls it" if "x + 3: Add -> Sub" in row else row for row in rows]
    (project.folder / "page.csv").write_text("\n".join(reported) + "\n")
    assert project.run("--survivors")["x * 2: Mult -> Div"] == "killed"
    assert "`x + 3: Add -> Sub`: equivalent: nobody calls it" in (project.folder / "page.md").read_text()


def test_every_module_has_tests_that_are_there() -> None:
    for pattern in mutate_judgement.TESTS:
        paths = [path for path in mutants.ROOT.glob(pattern) if path.name != "__init__.py"]
        assert paths, pattern
        for path in paths:
            tests = mutate_judgement.tests_of(str(path.relative_to(mutants.ROOT)))
            assert tests, path
            assert all((mutants.ROOT / test).is_file() for test in tests)
    assert len(mutate_judgement.named_mutants()) == len(mutate_judgement.NAMED)


def test_what_was_tried_is_not_tried_again(tmp_path: Path) -> None:
    rows = [
        mutate_judgement.Row("a.py", 7, "x: Lt -> LtE", 0, "killed", 2.5, "tests/test_a.py::test_x"),
        mutate_judgement.Row("a.py", 8, "y: 0 -> 1", 1, "survived", 3.0, "", "equivalent: y is multiplied by 0"),
    ]
    out = tmp_path / "mutants.md"
    mutate_judgement.write(out, rows, "words")
    assert list(mutate_judgement.kept_rows(out.with_suffix(".csv")).values()) == rows
    page = out.read_text()
    assert "| a.py | 2 | 1 | 0 | 1 |" in page
    assert "- a.py:8: `y: 0 -> 1`: equivalent: y is multiplied by 0" in page
    assert mutate_judgement.kept_rows(tmp_path / "none.csv") == {}
