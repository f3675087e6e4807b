"""``uavcover download`` and ``clear``."""

from pathlib import Path

import pytest

from mission_io.client.client import Client
from mission_io.formats import plan, wpl
from mission_io.links.opening import UdpLink
from mission_io.model.enums import ModeFlag
from mission_io.model.items import MissionType
from tests.cli.conftest import Cli, mock_vehicle
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


def test_what_was_uploaded_comes_back(cli: Cli, planned: Path, tmp_path: Path) -> None:
    with mock_vehicle() as (port, _):
        url = f"udpout://127.0.0.1:{port}"
        cli("upload", planned / "mission.plan", "--to", url, code=0)
        every = cli("download", "--from", url, "-o", tmp_path / "all.plan", "--type", "all", "--json", code=0)
        for kind in ("mission", "fence", "rally"):
            cli("download", "--from", url, "-o", tmp_path / f"{kind}.waypoints", "--type", kind, code=0)
        assert cli("upload", tmp_path / "all.plan", "--to", url, "--json").document["passed"] is True
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
        assert telling in cli("download", "--from", "mock:", "-o", out, "--type", kind, code=2).error
    assert taken.read_text() == "mine"


def test_unwritable_place(cli: Cli) -> None:
    ended = cli("download", "--from", "mock:", "-o", "/proc/x.plan", "--type", "all", code=2)
    assert "/proc/x.plan: the file cannot be written" in ended.error


def held(port: int) -> list[int]:
    with Client(UdpLink.connecting("127.0.0.1", port)) as client:
        client.wait_for_vehicle()
        return [len(client.download(mission_type)) for mission_type in MissionType]


def test_lists_are_emptied_as_asked(cli: Cli, planned: Path) -> None:
    with mock_vehicle() as (port, _):
        url = f"udpout://127.0.0.1:{port}"
        cli("upload", planned / "mission.plan", "--to", url, code=0)
        mission, fence, rally = held(port)
        assert min(mission, fence, rally) > 0
        ended = cli("clear", "--to", url, "--type", "fence", "--json")
        assert (ended.code, ended.document) == (0, {"cleared": ["fence"]})
        assert held(port) == [mission, 0, rally]
        assert cli("clear", "--to", url).out == "mission: cleared (read back as empty)\n"
        assert held(port) == [0, 0, rally]
        assert cli("clear", "--to", url, "--type", "all", "--json").document["cleared"] == ["mission", "fence", "rally"]
        assert held(port) == [0, 0, 0]


def test_an_armed_vehicle_is_left_alone_unless_it_is_meant(cli: Cli) -> None:
    peer = VehiclePeer()
    peer.base_mode = ModeFlag.SAFETY_ARMED
    link = UdpLink.listening()
    url = f"udpout://127.0.0.1:{link.local_port}"
    with flying_on(link, peer):
        ended = cli("clear", "--to", url)
        assert (ended.code, "is armed" in ended.error) == (2, True)
        cli("clear", "--to", url, "--in-flight", code=0)


def test_bad_usage_and_nobody_there(cli: Cli) -> None:
    assert "--type" in cli("clear", "--to", "mock:", "--type", "geofence").error
    ended = cli("clear", "--to", "mock:", "--link", "string")
    assert (ended.code, "default, telemetry-radio, satellite" in ended.error) == (2, True)
    ended = cli("clear", "--to", "udpin://127.0.0.1:0", "--timeout", "0.1")
    assert (ended.code, "no vehicle" in ended.error) == (3, True)


def test_ctrl_c_says_what_is_cleared(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    original = Client.clear

    def interrupted_at_the_fence(self: Client, mission_type: MissionType, *, in_flight: bool = False) -> None:
        if mission_type is MissionType.FENCE:
            raise KeyboardInterrupt
        original(self, mission_type, in_flight=in_flight)

    monkeypatch.setattr(Client, "clear", interrupted_at_the_fence)
    ended = cli("clear", "--to", "mock:", "--type", "all", code=130)
    assert "cleared: mission; possibly not cleared: fence, rally" in ended.err
