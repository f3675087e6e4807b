from pathlib import Path

from mission_io.formats import plan, wpl
from tests.cli.conftest import Cli, mock_vehicle


def test_what_was_uploaded_comes_back(cli: Cli, planned: Path, tmp_path: Path) -> None:
    with mock_vehicle() as (port, _):
        url = f"udpout://127.0.0.1:{port}"
        assert cli("upload", planned / "mission.plan", "--to", url).code == 0
        every = cli("download", "--from", url, "-o", tmp_path / "all.plan", "--type", "all", "--json")
        assert every.code == 0
        for kind in ("mission", "fence", "rally"):
            assert cli("download", "--from", url, "-o", tmp_path / f"{kind}.waypoints", "--type", kind).code == 0
        again = cli("upload", tmp_path / "all.plan", "--to", url, "--json")
        assert again.document["passed"] is True
    sent = wpl.read((planned / "mission.waypoints").read_text()).mission()
    got = wpl.read((tmp_path / "mission.waypoints").read_text()).mission()
    assert [item.command for item in got.items] == [item.command for item in sent.items]
    for there, back in zip(sent.items, got.items, strict=True):
        assert abs(there.lat_deg - back.lat_deg) <= 1e-7
        assert abs(there.lon_deg - back.lon_deg) <= 1e-7
        assert abs(there.alt_m - back.alt_m) <= 0.011
    whole = plan.read((tmp_path / "all.plan").read_text())
    assert len(whole.mission.items) == len(sent.items)
    assert whole.fence.areas if hasattr(whole.fence, "areas") else whole.fence
    assert len(whole.rally.points) == 1
    assert every.document["items"] > len(sent.items)


def test_bad_usage(cli: Cli, tmp_path: Path) -> None:
    taken = tmp_path / "taken.plan"
    taken.write_text("mine")
    for out, kind, telling in (
        (taken, "all", "--force"),
        (tmp_path / "x.txt", "mission", ".waypoints or .plan"),
        (tmp_path / "x.waypoints", "all", "one list"),
        (tmp_path / "x.plan", "geofence", "--type"),
    ):
        ended = cli("download", "--from", "mock:", "-o", out, "--type", kind)
        assert ended.code == 2
        assert telling in ended.error
    assert taken.read_text() == "mine"


def test_unwritable_place(cli: Cli) -> None:
    ended = cli("download", "--from", "mock:", "-o", "/proc/x.plan", "--type", "all")
    assert ended.code == 2
    assert "/proc/x.plan: the file cannot be written" in ended.error
