import csv
import io

from sitl_tests.case import Finding
from sitl_tests.matrix import load_matrix
from sitl_tests.results import Circumstances, csv_text, markdown_text
from sitl_tests.run import Result

CIRCUMSTANCES = Circumstances("2026-11-21 12:00 UTC", "python -m sitl_tests -o x.md", {"Python": "3.11"})


def results():
    cells = {cell.name: cell for cell in load_matrix()}
    return [
        Result(cells["mock-px4-connect-native"], Finding("works", "version 1"), "mock", 0.5, {}),
        Result(cells["px4-refused-mission-native"], Finding("accepted", "a|b"), "PX4", 2.0, {}),
        Result(
            cells["px4-fly-square-native"], Finding("failed", "it fell"), "PX4", 9.0, {"a.ulg": "00ff", "b.ulg": "11"}
        ),
    ]


def test_the_csv_has_a_row_for_each_log_and_one_for_a_cell_without():
    rows = list(csv.DictReader(io.StringIO(csv_text(results()))))
    assert [row["log"] for row in rows] == ["", "", "a.ulg", "b.ulg"]
    assert rows[2]["log_sha256"] == "00ff"
    assert [row["as_expected"] for row in rows] == ["True", "True", "False", "False"]
    assert rows[1]["why"].startswith("PX4 stores any number")


def test_the_table_marks_what_was_not_expected_and_says_who_was_missing():
    text = markdown_text(results(), {"arducopter": "no ArduCopter: set X"}, CIRCUMSTANCES)
    assert "2 of 3 cells came out as expected" in text
    assert "- arducopter: not run: no ArduCopter: set X" in text
    assert "| capability | client | mock-px4 | px4 |" in text
    assert "| connect | native | works | - |" in text
    assert "| refused-mission | native | - | accepted |" in text
    assert "| fly-square | native | - | **failed** (expected works) |" in text
    assert "a\\|b (PX4 stores any number" in text
    assert "| px4 | fly-square | native | a.ulg | `00ff` |" in text
