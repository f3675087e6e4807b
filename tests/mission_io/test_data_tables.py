"""Tables of numbers: what is read, and what is refused with file and key."""

import ast
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from mission_io.data_tables import read_document, data_table, table_of

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """One field of each type."""

    wait_s: float
    tries: int
    late_share: float
    title: str
    quick: bool
    box_m: tuple[float, float]
    steps_s: tuple[float, ...]


GOOD = {
    "wait_s": 2, "tries": 3, "late_share": 0.5, "title": "slow", "quick": True, "box_m": [1.0, 2], "steps_s": [0.1, 0.2, 0.3],
}  # fmt: skip


def test_a_table_is_read_with_the_types_of_its_fields() -> None:
    assert table_of(Kind, GOOD, where="x.toml: link") == Kind(
        wait_s=2.0, tries=3, late_share=0.5, title="slow", quick=True, box_m=(1.0, 2.0), steps_s=(0.1, 0.2, 0.3)
    )
    assert isinstance(table_of(Kind, GOOD, where="x").wait_s, float)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("wait_s", "2", "'2' is not of type float"),
        ("wait_s", True, "True is not of type float"),
        ("wait_s", float("nan"), "nan is not finite"),
        ("tries", 3.0, "3.0 is not of type int"),
        ("tries", False, "False is not of type int"),
        ("late_share", 1.5, "1.5 is not between 0 and 1"),
        ("title", 1, "1 is not of type str"),
        ("quick", 1, "1 is not of type bool"),
        ("box_m", [1.0], "[1.0] is not a list of the expected length"),
        ("box_m", 1.0, "1.0 is not a list of the expected length"),
        ("steps_s", [0.1, float("inf")], "inf is not finite"),
        ("steps_s", ["a"], "'a' is not of type float"),
        ("wiat_s", 2.0, "unknown key"),
    ],
)
def test_a_wrong_value_names_file_and_key(key: str, value: object, says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"x.toml: link.{key}: {says}")):
        table_of(Kind, {**GOOD, key: value}, where="x.toml: link")


@pytest.mark.parametrize("key", GOOD)
def test_a_missing_key_is_named(key: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"x.toml: link.{key}: missing key")):
        table_of(Kind, {name: value for name, value in GOOD.items() if name != key}, where="x.toml: link")


def test_a_missing_section_is_named() -> None:
    with pytest.raises(ValueError, match=r"^uavcover/data/flight\.toml: nowhere: no such section$"):
        data_table(Kind, "uavcover/data/flight.toml", "nowhere")


def read_sections() -> dict[str, set[str]]:
    """The sections that the code reads, by file."""
    found: dict[str, set[str]] = {}
    for path in (*(ROOT / "uavcover").rglob("*.py"), *(ROOT / "mission_io").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "data_table":
                file, section = (argument.value for argument in node.args[1:] if isinstance(argument, ast.Constant))
                assert isinstance(file, str)
                assert isinstance(section, str)
                found.setdefault(file, set()).add(section)
    return found


def test_every_section_of_a_table_is_read() -> None:
    read = read_sections()
    assert "uavcover/data/flight.toml" in read
    assert {file: set(read_document(file)) for file in read} == read
