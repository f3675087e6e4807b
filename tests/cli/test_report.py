from pathlib import Path

from tests.cli.conftest import Cli


def test_a_flown_run(cli: Cli, flown: Path, tmp_path: Path) -> None:
    (flown / "report.html").unlink(missing_ok=True)
    document = cli("report", flown, "--json", "--figures", tmp_path / "figures").document
    assert document["report"] == str(flown / "report.html")
    assert document["passed"] in {True, False}
    assert {Path(figure).name for figure in document["figures"]} == {"side-view.png", "top-view.png"}
    first = (flown / "report.html").read_text()
    assert len(first.encode()) < 3_000_000
    assert cli("report", flown).code == 0
    assert (flown / "report.html").read_text() == first
    ended = cli("report", flown, "--figures", tmp_path / "figures")
    assert ended.code == 2
    assert "--force" in ended.err


def test_a_plan_alone_and_another_file(cli: Cli, planned: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    document = cli("report", planned, "-o", page, "--json").document
    assert document["passed"] is None
    assert "not flown yet" in page.read_text()
    ended = cli("report", planned, "-o", page)
    assert ended.code == 2
    assert "would be overwritten" in ended.error
    assert cli("report", planned, "-o", page, "--force").code == 0


def test_another_log(cli: Cli, flown: Path) -> None:
    ended = cli("report", flown, "--log", flown / "flight.rrd", "--log", flown / "track.csv")
    assert ended.code == 0
    assert "seen, of the area, flight.rrd" in (flown / "report.html").read_text()


def test_errors(cli: Cli, tmp_path: Path, flown: Path) -> None:
    assert "uavcover plan" in cli("report", tmp_path).error
    (flown / "plan.json").write_text("{}")
    assert cli("report", flown).code == 2
