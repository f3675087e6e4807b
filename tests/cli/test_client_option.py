"""``--client mavsdk``: the same commands by another client, and what it cannot do said before anything begins."""

import json
from pathlib import Path

import pytest

from mission_io.formats.wpl import write_mission
from tests.cli.conftest import Cli, mock_vehicle
from tests.flight.scene import HOME, mission

pytest.importorskip("mavsdk", reason="MAVSDK is not installed")


def test_what_one_client_uploads_the_other_downloads(cli: Cli, tmp_path: Path) -> None:
    file = tmp_path / "mission.waypoints"
    file.write_text(write_mission(mission()))
    with mock_vehicle("--home", f"{HOME.lat_deg},{HOME.lon_deg},{HOME.alt_amsl_m}") as (port, _):
        url = f"udpout://127.0.0.1:{port}"
        ended = cli("upload", file, "--to", url, "--client", "mavsdk", "--json", "-q", code=0)
        assert ended.document["passed"] is True
        for client in ("native", "mavsdk"):
            out = tmp_path / f"{client}.plan"
            cli("download", "--from", url, "-o", out, "--type", "all", "--client", client, code=0)
    assert (tmp_path / "native.plan").read_bytes() == (tmp_path / "mavsdk.plan").read_bytes()
    assert len(json.loads((tmp_path / "native.plan").read_text())["mission"]["items"]) == len(mission().items)


def test_a_run_is_uploaded_and_flown(cli: Cli, planned: Path) -> None:
    cli("plan-upload", planned, "--to", "mock:", "--client", "mavsdk", "-q", code=0)
    ended = cli("fly", planned, "--to", "mock:", "--client", "mavsdk", "--mock-speed", "50", "--json", "-q", "--force")
    assert (ended.code, ended.document["ending"]) == (0, "landed"), ended.err


@pytest.mark.parametrize(
    ("options", "telling"),
    [
        (("--client", "qgc"), "must be native or mavsdk, not 'qgc'"),
        (("--client", "mavsdk", "--signing-key", "some.key"), "MAVSDK cannot sign"),
        (("--client", "mavsdk", "--link", "satellite"), "timeouts are fixed"),
    ],
)
def test_bad_usage(cli: Cli, tmp_path: Path, options: tuple[str, ...], telling: str) -> None:
    assert telling in cli("plan-upload", tmp_path, "--to", "mock:", *options, code=2).error
