"""The command itself: usage, a vehicle and a ground station over UDP of this machine, tables and JSON."""

import json
import os
import signal
import threading
from pathlib import Path

import pytest

from mission_io.client.client import Client
from mission_io.conformance.__main__ import VEHICLE_CASES, main
from mission_io.conformance.case import sample
from mission_io.conformance.client_cases import CLIENT_CASES
from mission_io.conformance.fake_vehicle import FakeVehicle
from mission_io.conformance.run import serve
from mission_io.links.datagrams import UdpLink
from mission_io.model.items import MissionType

WATCHDOG_S = 300.0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "URL"),
        (["udpin://127.0.0.1:0"], "--yes"),
        (["udpin://127.0.0.1:0", "--yes", "--case", "no-such"], "no-such"),
        (["nonsense", "--yes"], "nonsense"),
        (["udpin://127.0.0.1:0", "--serve", "--quiet", "0"], "--quiet"),
        (["udpin://127.0.0.1:0", "--serve", "--system", "999"], "--system"),
    ],
)
def test_wrong_use_is_one_line(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert main(arguments) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("error: ")
    assert says in error


def test_a_port_that_is_taken_is_exit_code_3(capsys: pytest.CaptureFixture[str]) -> None:
    with UdpLink.listening() as link:
        assert main([f"udpin://127.0.0.1:{link.local_port}", "--yes"]) == 3
    assert "cannot listen" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "cases"), [([], VEHICLE_CASES), (["--serve"], CLIENT_CASES)])
def test_the_list(option: list[str], cases: tuple[object, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list", *option]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(cases)


def test_a_vehicle_is_asked_and_the_json_says_what(capsys: pytest.CaptureFixture[str]) -> None:
    link, vehicle, stopped = UdpLink.listening(), FakeVehicle(CLIENT_CASES[-1:]), threading.Event()
    thread = threading.Thread(target=serve, args=(link, vehicle), kwargs={"stopped": stopped.is_set}, daemon=True)
    thread.start()
    try:
        code = main([f"udpout://127.0.0.1:{link.local_port}", "--yes", "--json", "--case", "clear-t*"])
    finally:
        stopped.set()
        thread.join(WATCHDOG_S)
        link.close()
    said = capsys.readouterr()
    answer = json.loads(said.out)
    assert code == 0
    assert answer["passed"]
    assert [(r["case"], r["result"], r["section"]) for r in answer["results"]] == [
        ("clear-twice", "pass", "Clear Missions")
    ]
    assert "overwrites the mission" in said.err
    assert "has its previous lists again (mission 4, fence 4, rally points 4 items)" in said.err
    (kept,) = [Path(word.rstrip(",")) for word in said.err.split() if "kept-missions-" in word]
    assert not kept.exists()


def _upload(port: int) -> None:
    with Client(UdpLink.connecting("127.0.0.1", port)) as client:
        client.wait_for_vehicle(60.0)
        client.upload(MissionType.MISSION, sample(MissionType.MISSION, 5, first=30))


def test_a_ground_station_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    with UdpLink.listening() as free:
        port = free.local_port
    station = threading.Thread(target=_upload, args=(port,), daemon=True)
    station.start()
    url = f"udpin://127.0.0.1:{port}"
    code = main(["--serve", url, "--case", "upload-count-lost", "--quiet", "0.5", "--as", "ardupilot"])
    station.join(WATCHDOG_S)
    lines = capsys.readouterr().out.splitlines()
    assert code == 0
    assert any("upload-count-lost" in line and "| pass" in line for line in lines)


def test_a_stopped_server_says_what_was_not_asked(capsys: pytest.CaptureFixture[str]) -> None:
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGTERM)).start()
    assert main(["--serve", "udpin://127.0.0.1:0", "--case", "clear-lost"]) == 130
    assert "not asked: clear-lost" in capsys.readouterr().err
