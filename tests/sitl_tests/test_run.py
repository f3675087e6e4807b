from sitl_tests.__main__ import main
from sitl_tests.matrix import load_matrix
from sitl_tests.run import kept_result

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
