"""docs/reference/links.md: its example runs, and the facts in it are the code's."""

import re
from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.links.datagrams import FORGOTTEN_AFTER_S
from mission_io.links.opening import parse_link_url
from mission_io.links.stream import MOST_PEERS, QUIET_S, SEND_BUFFER_BYTES, TcpListeningLink
from mission_io.wire.codec import LARGEST_FRAME
from mission_io.wire.signing import Signing, SigningKey, SystemClock, UnsavedTimestamps
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.test_signing import private
from tests.mission_io.vehicle import VehiclePeer

TEXT = (Path(__file__).parents[3] / "docs" / "reference" / "links.md").read_text()


def test_the_example_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    key = SigningKey.from_file(private(tmp_path / "vehicle.key", b"correct horse\n"))
    monkeypatch.chdir(tmp_path)
    vehicle, peer = TcpListeningLink(), VehiclePeer(PX4)
    peer.codec.signing = Signing(key, clock=SystemClock(), store=UnsavedTimestamps())
    code = code.replace("5760", str(vehicle.local_port))
    with flying_on(vehicle, peer):
        exec(compile(code, "links.md", "exec"), {})
    assert capsys.readouterr().out.startswith("vehicle 1 of 1: ")
    assert (tmp_path / "vehicle.key.timestamp").exists()


def test_every_url_in_the_table_is_understood() -> None:
    urls = [url for cell in re.findall(r"^\| (`.*?`) \|", TEXT, re.MULTILINE) for url in re.findall("`(.*?)`", cell)]
    for url in urls:
        if not url.startswith("NAME"):
            assert parse_link_url(url.replace("HOST", "127.0.0.1").replace("PORT", "14550"))
    assert len(urls) == 11


def test_the_figures_are_the_codes() -> None:
    for figure in (
        f"within {FORGOTTEN_AFTER_S:g} s",
        f"up to {MOST_PEERS} may connect",
        f"{SEND_BUFFER_BYTES // 1024} KiB wait",
        f"fewer than {LARGEST_FRAME} bytes",
    ):
        assert figure in TEXT
    assert QUIET_S == 0.5
