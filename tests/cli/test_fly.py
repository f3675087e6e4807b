import fcntl
import json
import os
import pty
import select
import signal
import subprocess
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymavlink import mavutil

from tests.cli.conftest import WATCHDOG_S, Cli, command, files, limited_to, mock_vehicle, started, wait_for_line
from uavcover.recording.layout import read_recorded_track
from uavcover.run.documents import LINK
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import inspect_inputs
from uavcover.run.provenance import note_files, sha256_of
from uavcover.run.track_file import read_track


def test_whole_flight_on_the_mock_of_this_process(cli: Cli, flown: Path) -> None:
    before = (flown / "track.csv").read_bytes()
    (flown / "resumed-1").mkdir()
    (flown / "resumed-1" / "track.csv").write_bytes(before)
    link = {LINK: {"track_sha256": sha256_of(flown / "track.csv")}}
    (flown / "resumed-1" / "run.json").write_text(json.dumps(link))
    note_files(RunFolder(flown), "fly --resume", ["resumed-1/track.csv"], command=["test"])
    cli("fly", flown, "--to", "mock:", code=2)
    assert (flown / "track.csv").read_bytes() == before
    ended = cli("fly", flown, "--to", "mock:", "--mock-speed", 200, "--force", "--json", code=0)
    assert ended.document["ending"] == "landed"
    assert ended.document["simulated_by"] == "uavcover's mock vehicle"
    assert (flown / "track.csv").read_bytes() != before
    assert not (flown / "verification.json").exists(), "it spoke of the older track"
    assert len(read_recorded_track(flown / "flight.rrd")) == ended.document["samples"]
    assert (flown / "older-1" / "resumed-1" / "track.csv").read_bytes() == before
    for folder in (flown, flown / "older-1"):
        assert inspect_inputs(RunFolder(folder), [folder / "track.csv"]).changes == (), (
            "a flight that is moved is not missed"
        )


def test_what_was_heard_and_sent_is_in_a_telemetry_log(cli: Cli, flown: Path) -> None:
    by_track = cli("verify", flown, "--json").document
    by_log = cli("verify", flown, "--log", flown / "flight.tlog", "--json").document
    assert by_log["track"] == "flight.tlog"
    assert by_log["passed"] == by_track["passed"]
    assert by_log["coverage_fraction"] == pytest.approx(by_track["coverage_fraction"], abs=0.01)
    log = mavutil.mavlogfile(str(flown / "flight.tlog"))
    sent = set()
    while (message := log.recv_match(type=["COMMAND_LONG", "SET_MODE", "HEARTBEAT"])) is not None:
        sent.add((message.get_type(), message.get_srcSystem()))
    log.close()
    assert {("COMMAND_LONG", 255), ("HEARTBEAT", 255), ("HEARTBEAT", 1)} <= sent
    assert [name for name in files(flown) if name.startswith(".flight")] == []


def test_a_terminal_that_is_closed_brings_it_home(cli: Cli, planned: Path) -> None:
    with mock_vehicle("--speed", 30) as (port, _):
        url = upload(cli, planned, port)
        ours, theirs = pty.openpty()
        process = subprocess.Popen(
            command("fly", planned, "--to", url), stdin=theirs, stdout=theirs, stderr=theirs,
            start_new_session=True, preexec_fn=_own_terminal,
        )  # fmt: skip
        try:
            os.close(theirs)
            said = b""
            while b"in the air" not in said:
                said += os.read(ours, 4096)
            os.close(ours)
            process.wait(timeout=WATCHDOG_S)
        finally:
            process.kill()
            process.wait()
    assert json.loads((planned / "run.json").read_text())["flight"]["ending"] == "returned"
    assert process.returncode == 130
    assert len(read_recorded_track(planned / "flight.rrd")) == len(read_track(planned / "track.csv"))


def _own_terminal() -> None:
    """In the new process; under nohup it would ignore that its terminal is closed."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def test_total_link_loss_at_speed_is_found(cli: Cli, planned: Path) -> None:
    """Time synchronisation got through an outage, so that a vehicle faster than real time was never silent."""
    with mock_vehicle("--speed", 30, "--fault", "link-outage:8@20s") as (port, _):
        url = upload(cli, planned, port)
        ended = cli("fly", planned, "--to", url, "--deadman", 0.5, "--link-lost", 2)
    assert ended.code == 3
    assert json.loads((planned / "run.json").read_text())["flight"]["ending"] == "link_lost"
    assert "no messages from vehicle 1 for 2" in ended.err.splitlines()[-1]
    assert "to the end: link_lost: no messages from vehicle 1 for" in ended.out


def upload(cli: Cli, run: Path, port: int) -> str:
    url = f"udpout://127.0.0.1:{port}"
    cli("plan-upload", run, "--to", url, code=0)
    return url


@contextmanager
def in_the_air(cli: Cli, run: Path, *, speed: int = 30) -> Iterator[subprocess.Popen[str]]:
    """``uavcover fly`` in a process of its own, once its vehicle has taken off."""
    with mock_vehicle("--speed", speed) as (port, _):
        url = upload(cli, run, port)
        with started(command("fly", run, "--to", url)) as process:
            wait_for_line(process, "in the air")
            yield process


def test_interrupt_brings_it_home(cli: Cli, planned: Path) -> None:
    with in_the_air(cli, planned) as process:
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=WATCHDOG_S)
    assert process.returncode == 130, err
    assert "returning along checked legs" in out
    assert "returned along checked legs, landed and disarmed" in out
    assert json.loads((planned / "run.json").read_text())["flight"]["ending"] == "returned"
    track = read_track(planned / "track.csv")
    assert len(read_recorded_track(planned / "flight.rrd")) == len(track)


def test_second_interrupt_leaves_it_holding(cli: Cli, planned: Path) -> None:
    with in_the_air(cli, planned) as process:
        process.send_signal(signal.SIGINT)
        wait_for_line(process, "commanding the vehicle to hold")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=WATCHDOG_S)
    assert process.returncode == 130, err
    assert "the user stopped the flight a second time: the vehicle holds in guided mode, armed and in the air" in out
    assert len(read_track(planned / "track.csv")) > 10
    assert (planned / "flight.rrd").exists()


def test_vehicle_that_dies_in_flight(cli: Cli, planned: Path) -> None:
    with mock_vehicle("--speed", 30) as (port, vehicle):
        url = upload(cli, planned, port)
        with started(command("fly", planned, "--to", url, "--json", "--link-lost", 5)) as process:
            assert process.stderr is not None
            observed = next(line for line in process.stderr if "in the air" in line)
            vehicle.kill()
            out, err = process.communicate(timeout=WATCHDOG_S)
    assert observed
    assert process.returncode == 3
    assert "warning: no messages from vehicle 1 for 3." in err
    document = json.loads(out)
    assert document["exit_code"] == 3
    assert document["ending"] == "link_lost"
    assert [incident["kind"] for incident in document["incidents"]] == ["link_lost"]
    assert document["error"].startswith("link lost: no messages from vehicle 1 for 5")
    assert json.loads((planned / "run.json").read_text())["flight"]["ending"] == "link_lost"
    assert len(read_track(planned / "track.csv")) > 10
    assert (planned / "flight.rrd").exists()


def test_vehicle_without_the_mission_is_not_armed(cli: Cli, flown: Path) -> None:
    before = (flown / "track.csv").read_bytes()
    with mock_vehicle("--speed", 30) as (port, _):
        ended = cli("fly", flown, "--to", f"udpout://127.0.0.1:{port}", "--force", "-q")
    assert ended.code == 3
    assert "not armed" in ended.error
    assert (flown / "track.csv").read_bytes() == before, "the older flight is there until a new one begins"


def test_a_disk_without_room_for_the_record_keeps_it_on_the_ground(planned: Path) -> None:
    before = files(planned)
    fly = command("fly", planned, "--to", "mock:", "--mock-speed", 200)
    done = subprocess.run([*limited_to(200), *fly], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 2, done.stderr
    assert "not enough disk space for the flight record, which may need" in done.stderr.splitlines()[-1]
    assert "armed" not in done.stdout
    assert files(planned) == before
    assert "flight" not in json.loads((planned / "run.json").read_text())


@pytest.mark.parametrize("name", [".flight.rrd.growing", ".flight.tlog.growing"])
def test_a_record_that_cannot_be_written_keeps_it_on_the_ground(name: str, cli: Cli, planned: Path) -> None:
    (planned / name).mkdir()
    (planned / name / "something").touch()
    ended = cli("fly", planned, "--to", "mock:", "--mock-speed", 200, "--force")
    assert ended.code in (2, 3)
    assert name.removeprefix(".").removesuffix(".growing") in ended.error
    assert "in the air" not in ended.out
    assert "flight" not in json.loads((planned / "run.json").read_text())


def test_pause_makes_it_wait_and_go_on(cli: Cli, planned: Path) -> None:
    with in_the_air(cli, planned, speed=60) as process:
        process.send_signal(signal.SIGUSR1)
        wait_for_line(process, "paused: the vehicle holds its position")
        process.send_signal(signal.SIGUSR1)
        out, err = process.communicate(timeout=WATCHDOG_S)
    assert process.returncode == 0, err
    assert "the vehicle continues its mission" in out
    assert "mission completed" in out


def test_bad_usage(cli: Cli, tmp_path: Path) -> None:
    assert "no such run folder" in cli("fly", tmp_path / "nope", "--to", "mock:", code=2).error


def test_a_run_of_which_nothing_was_flown_is_not_resumed_on_the_ground(cli: Cli, planned: Path) -> None:
    ended = cli("fly", planned, "--resume", "--to", "mock:", code=2)
    assert "the vehicle is on the ground; run fly without --resume" in ended.error


def test_a_killed_flight_is_resumed_in_the_air(cli: Cli, planned: Path) -> None:
    # Slow enough not to land in the seconds that a busy machine takes from SIGCONT until the vehicle is told to hold.
    with mock_vehicle("--speed", 20) as (port, vehicle):
        url = upload(cli, planned, port)
        with started(command("fly", planned, "--to", url)) as process:
            wait_for_line(process, "in the air")
            track = planned / "track.csv"
            while track.stat().st_size < 100_000:
                assert process.poll() is None
                select.select([], [], [], 0.05)
            assert json.loads((planned / "run.json").read_text())["flight"]["ending"] == "flying"
            process.kill()
            process.wait()
        # Nobody waits for it now, and on a slow machine it would have landed before it is judged: its time stands still.
        vehicle.send_signal(signal.SIGSTOP)
        cut_off = cli("verify", planned, "--json")
        vehicle.send_signal(signal.SIGCONT)
        assert "track.csv: this flight was interrupted" in cut_off.err
        assert json.loads((planned / "run.json").read_text())["flight"]["ending"] == "interrupted"
        ended = cli("fly", planned, "--to", url, "--resume", "--json")
    assert ended.code == 0, ended.err
    assert ended.document["ending"] == "landed"
    assert ended.document["resumed_at_waypoint"] >= 1
    assert "the vehicle is in the air and will continue from its current position" in ended.err
    verdict = cli("verify", planned, "--json")
    assert verdict.document["track"] == "track.csv, resumed-1/track.csv"
    assert verdict.document["coverage_fraction"] > 0.97, verdict.document["reasons"]
    assert verdict.document["violations"] == []
    assert cli("fly", planned, "--to", "mock:", "--resume", "--json", code=0).document["waypoints_left"] == 0


def test_the_map_of_a_flight_is_a_process_of_its_own_that_ends_with_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from uavcover.cli import fly

    done: list[object] = []

    class Page:
        def __init__(self, words: list[str], **more: object) -> None:
            done.append((words[1:], more["start_new_session"]))

        def terminate(self) -> None:
            done.append("terminated")

        def wait(self, _limit_s: float) -> None:
            raise subprocess.TimeoutExpired("serve", 5.0)

    ends: list[Callable[[], None]] = []
    monkeypatch.setattr(fly.subprocess, "Popen", Page)
    monkeypatch.setattr(fly.atexit, "register", ends.append)
    fly.show_page(tmp_path)
    assert done == [(["-m", "uavcover", "serve", str(tmp_path), "--port", "0"], True)]
    ends[0]()
    assert done[1:] == ["terminated"]
