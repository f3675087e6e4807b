import csv
import io

from sitl_tests.__main__ import main
from sitl_tests.case import Finding
from sitl_tests.matrix import load_matrix
from sitl_tests.results import Circumstances, csv_text, markdown_text
from sitl_tests.run import Result, kept_result

#

ONE = ["--vehicle", "mock-px4", "--capability", "connect", "--client", "native"]


def test_a_case_that_was_run_is_taken_from_its_folder(tmp_path, capsys):
    out, logs = tmp_path / "results" / "sitl.md", tmp_path / "logs"
    arguments = ["-o", str(out), "--logs", str(logs), *ONE]
    assert main(arguments) == 0
    first = out.read_text()
    assert "| connect | native | works |" in first
    assert "1 of 1 as expected" in capsys.readouterr().err
    (logs / "mock-px4-connect-native" / "console.txt").write_text("untouched")
    assert main(arguments) == 0
    assert (logs / "mock-px4-connect-native" / "console.txt").read_text() == "untouched"
    assert out.with_suffix(".csv").read_text().count("\n") == 2


def test_a_case_that_was_stopped_in_the_middle_is_run_again(tmp_path):
    folder = tmp_path / "logs" / "mock-px4-connect-native"
    folder.mkdir(parents=True)
    (folder / "half.txt").write_text("")
    assert main(["-o", str(tmp_path / "x.md"), "--logs", str(tmp_path / "logs"), *ONE]) == 0
    assert not (folder / "half.txt").exists()
    cell = next(cell for cell in load_matrix() if cell.name == folder.name)
    kept = kept_result(cell, folder)
    assert kept is not None
    assert kept.as_expected


def test_no_fitting_cell_is_bad_usage(tmp_path, capsys):
    assert main(["-o", str(tmp_path / "x.md"), "--vehicle", "submarine"]) == 2
    assert "no cell of the matrix fits" in capsys.readouterr().err


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
