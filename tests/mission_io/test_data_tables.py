"""Tables of numbers: what is read, and what is refused with file and key."""

import ast
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from mission_io.data_tables import data_table, read_document, table_of
from mission_io.model.enums import Severity

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Line:
    """A table inside of a table."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One field of each type."""

    wait_s: float
    tries: int
    late_fraction: float
    title: str
    quick: bool
    box_m: tuple[float, float]
    steps_s: tuple[float, ...]
    lines: tuple[Line, ...]


GOOD = {
    "wait_s": 2, "tries": 3, "late_fraction": 0.5, "title": "slow", "quick": True, "box_m": [1.0, 2], "steps_s": [0.1, 0.2, 0.3],
    "lines": [{"severity": "INFO", "text": "ready"}],
}  # fmt: skip


def test_a_table_is_read_with_the_types_of_its_fields() -> None:
    assert table_of(Kind, GOOD, where="x.toml: link") == Kind(
        wait_s=2.0, tries=3, late_fraction=0.5, title="slow", quick=True, box_m=(1.0, 2.0), steps_s=(0.1, 0.2, 0.3),
        lines=(Line(Severity.INFO, "ready"),),
    )  # fmt: skip
    assert isinstance(table_of(Kind, GOOD, where="x").wait_s, float)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("wait_s", "2", "expected a value of type float, not '2'"),
        ("wait_s", True, "expected a value of type float, not True"),
        ("wait_s", float("nan"), "must be finite, not nan"),
        ("tries", 3.0, "expected a value of type int, not 3.0"),
        ("tries", False, "expected a value of type int, not False"),
        ("late_fraction", 1.5, "must be between 0 and 1, not 1.5"),
        ("title", 1, "expected a value of type str, not 1"),
        ("quick", 1, "expected a value of type bool, not 1"),
        ("box_m", [1.0], "expected a list of another length, not [1.0]"),
        ("box_m", 1.0, "expected a list of another length, not 1.0"),
        ("steps_s", [0.1, float("inf")], "must be finite, not inf"),
        ("steps_s", ["a"], "expected a value of type float, not 'a'"),
        ("lines", ["ready"], "expected a value of type Line, not 'ready'"),
        ("wiat_s", 2.0, "unknown key"),
    ],
)
def test_a_wrong_value_names_file_and_key(key: str, value: object, says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"x.toml: link.{key}: {says}")):
        table_of(Kind, {**GOOD, key: value}, where="x.toml: link")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ({"severity": "LOUD", "text": "ready"}, "lines.severity: expected a value of type Severity, not 'LOUD'"),
        ({"severity": 6, "text": "ready"}, "lines.severity: expected a value of type Severity, not 6"),
        ({"severity": "INFO"}, "lines.text: missing key"),
    ],
)
def test_a_wrong_value_in_a_table_inside_names_its_key(line: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"x.toml: link.{says}")):
        table_of(Kind, {**GOOD, "lines": [line]}, where="x.toml: link")


@pytest.mark.parametrize("key", GOOD)
def test_a_missing_key_is_named(key: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"x.toml: link.{key}: missing key")):
        table_of(Kind, {name: value for name, value in GOOD.items() if name != key}, where="x.toml: link")


@dataclass(frozen=True, slots=True)
class Positive:
    """Checks itself."""

    wait_s: float

    def __post_init__(self) -> None:
        if self.wait_s <= 0.0:
            raise ValueError(f"wait_s {self.wait_s} is not above 0")


def test_a_check_of_the_dataclass_names_file_and_section() -> None:
    with pytest.raises(ValueError, match=re.escape("x.toml: link: wait_s 0.0 is not above 0")):
        table_of(Positive, {"wait_s": 0.0}, where="x.toml: link")


def test_a_missing_section_is_named() -> None:
    with pytest.raises(ValueError, match=r"^uavcover/data/flight\.toml: the section nowhere is missing$"):
        data_table(Kind, "uavcover/data/flight.toml", "nowhere")


def read_sections() -> dict[str, set[str]]:
    """The sections that the code reads, by file."""
    found: dict[str, set[str]] = {}
    for path in (*(ROOT / "uavcover").rglob("*.py"), *(ROOT / "mission_io").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "data_table":
                file, section = node.args[1:]
                assert isinstance(file, ast.Constant)
                assert isinstance(file.value, str)
                if isinstance(section, ast.Constant):  # else by the names of an enum
                    found.setdefault(file.value, set()).add(str(section.value))
    return found


def test_every_section_of_a_table_is_read() -> None:
    read = read_sections()
    assert "uavcover/data/flight.toml" in read
    assert {file: set(read_document(file)) for file in read} == read
