import contextlib
import json
import shutil
import signal
import socket
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import EVALUATIONS, WATCHDOG_S, Cli, command, corner_of_the_demo, mock_vehicle, started
from tests.cli.relay import Relay
from uavcover.planner import command as plan


def test_run_folder_to_a_vehicle_in_another_process(cli: Cli, planned: Path) -> None:
    with mock_vehicle() as (port, _):
        ended = cli("plan-upload", planned, "--to", f"udpout://127.0.0.1:{port}", "--json")
    assert ended.code == 0
    assert ended.document["passed"] is True
    written = json.loads((planned / "upload.json").read_text())
    assert {**written, "run": str(planned)} == ended.document
    assert [part["mission_type"] for part in written["lists"]] == ["mission", "fence", "rally"]
    assert all(len(part["sent"]) == len(part["received"]) for part in written["lists"])
    assert all(difference["why"] for part in written["lists"] for difference in part["differences"])


def test_ctrl_c_when_the_search_is_over_uploads_nothing(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compile_flights = plan.compile_flights

    def interrupted(*arguments: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        return compile_flights(*arguments, **options)

    monkeypatch.setattr(plan, "compile_flights", interrupted)
    run = tmp_path / "run"
    scenario = corner_of_the_demo(tmp_path)
    ended = cli("plan-upload", scenario, "--to", "mock:", "-o", run, "--evaluations", EVALUATIONS, code=130)
    assert "interrupted after the search; the complete plan was written" in ended.err
    assert "nothing was uploaded" in ended.err
    assert (run / "mission.waypoints").exists()
    assert not (run / "upload.json").exists()
    assert json.loads((run / "plan.json").read_text())["interrupted"] is False


def test_px4_vehicle_and_lossy_link(cli: Cli, planned: Path) -> None:
    with mock_vehicle("--autopilot", "px4", "--loss", 0.05) as (port, _):
        ended = cli("plan-upload", planned, "--to", f"udpout://127.0.0.1:{port}")
    assert ended.code == 0, ended.err
    assert "PX4" in ended.out


def test_scenario_is_planned_first(cli: Cli, tmp_path: Path) -> None:
    run = tmp_path / "run"
    scenario = corner_of_the_demo(tmp_path)
    ended = cli("plan-upload", scenario, "--to", "mock:", "-o", run, "--evaluations", EVALUATIONS, "--json", code=0)
    assert ended.document["run"] == str(run)
    assert (run / "mission.waypoints").exists()


def test_planning_options_do_nothing_for_a_run_folder(cli: Cli, planned: Path) -> None:
    ended = cli("plan-upload", planned, "--to", "mock:", "--seed", 3, "--select", "knee", code=2)
    assert "--select, --seed would have no effect" in ended.error


@pytest.mark.parametrize("name", ["plan-upload", "fly"])
def test_vehicle_that_never_answers(cli: Cli, planned: Path, name: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        ended = cli(name, planned, "--to", f"udpout://127.0.0.1:{silent.getsockname()[1]}", "--timeout", 1)
    assert ended.code == 3
    assert "no vehicle sent a heartbeat within 1 s" in ended.error
    assert not (planned / "track.csv").exists()


def test_vehicle_that_stops_in_the_middle_of_an_upload(flown: Path, tmp_path: Path) -> None:
    """Killed, and stopped: both at once, because each takes as long as the upload is patient."""
    numbers = (signal.SIGKILL, signal.SIGSTOP)
    with contextlib.ExitStack() as stack:
        uploads = []
        for number in numbers:
            run = Path(shutil.copytree(flown, tmp_path / number.name))
            port, vehicle = stack.enter_context(mock_vehicle())
            relay = stack.enter_context(Relay(port, partial(end_at_the_fifth_item, vehicle, number)))
            url = f"udpout://127.0.0.1:{relay.port}"
            uploads.append((run, stack.enter_context(started(command("plan-upload", run, "--to", url, "-q")))))
        for run, upload in uploads:
            out, err = upload.communicate(timeout=WATCHDOG_S)
            assert (upload.returncode, out) == (3, ""), err
            assert err.startswith("error: upload of the mission")
            assert len(err.splitlines()) == 1
            assert not (run / "upload.json").exists(), "the older upload is no longer what the vehicle holds"


def end_at_the_fifth_item(vehicle: subprocess.Popen[str], number: signal.Signals, items: int) -> None:
    if items == 5:
        vehicle.send_signal(number)


def test_vehicle_at_another_place_is_refused(cli: Cli, planned: Path) -> None:
    with mock_vehicle("--home", "36.4772,-84.2160,485.4") as (port, _):
        ended = cli("plan-upload", planned, "--to", f"udpout://127.0.0.1:{port}", "-q")
    assert ended.code == 3
    assert "from the planned home" in ended.error
    assert not (planned / "upload.json").exists()


@pytest.mark.parametrize("seconds", ["0", "-1", "nan"])
def test_bad_timeout(cli: Cli, planned: Path, seconds: str) -> None:
    assert "timeout" in cli("plan-upload", planned, "--to", "mock:", "--timeout", seconds, code=2).error


def test_bad_url(cli: Cli, planned: Path) -> None:
    assert "udpout://HOST:PORT" in cli("plan-upload", planned, "--to", "carrier-pigeon://x", code=2).error


def test_several_vehicles_of_a_plan_for_one(cli: Cli, planned: Path) -> None:
    ended = cli("plan-upload", planned, "--to", "mock:", "--to", "mock:", code=2)
    assert (
        "the plan is for one vehicle, but --to is given 2 times; plan again with: uavcover plan SCENARIO --vehicles 2"
        in ended.error
    )
    ended = cli("plan-upload", planned, "--to", "mock:", "--to", "mock:", "--sortie", 1, code=2)
    assert "--sortie cannot be combined with more than one --to" in ended.error


def test_several_vehicles_are_planned_for_and_uploaded_to(cli: Cli, tmp_path: Path) -> None:
    run, scenario = tmp_path / "run", corner_of_the_demo(tmp_path)
    text = scenario.read_text()
    scenario.write_text(text.replace("[vehicle]\n", "[vehicle]\nendurance_s = 250.0\n"))
    ended = cli(
        "plan-upload", scenario, "--to", "mock:", "--to", "mock:", "-o", run,
        "--evaluations", EVALUATIONS, "--json",
    )  # fmt: skip
    fleet = json.loads((run / "plan.json").read_text())["fleet"]
    assert fleet["vehicles"] == 2
    assert len(fleet["by_vehicle"]) == 2
    assert ended.code == 0, ended.err
    assert [document["vehicle"] for document in ended.document["vehicles"]] == [1, 2]
    assert all((Path(document["run"]) / "upload.json").exists() for document in ended.document["vehicles"])


def test_one_vehicle_lands_between_the_parts_of_others_only_for_a_new_battery(cli: Cli, tmp_path: Path) -> None:
    run = tmp_path / "run"
    cli("plan", corner_of_the_demo(tmp_path), "--vehicles", 2, "-o", run, "--evaluations", EVALUATIONS, code=0)
    plan = json.loads((run / "plan.json").read_text())
    times_s = [each["flight_time_s"] for each in plan["sorties"]]
    assert len(plan["fleet"]["parts"]) == len(times_s) == 2
    assert plan["fleet"]["one_vehicle_s"] == pytest.approx(sum(times_s))
    assert 0.5 <= plan["fleet"]["of_one_vehicle"] < 1.0


def test_what_one_vehicle_does_as_soon_is_uploaded_to_one(cli: Cli, tmp_path: Path) -> None:
    """Two were planned for a small area, with landings apart; with more than are needed nothing was uploaded to any."""
    run, scenario = tmp_path / "run", corner_of_the_demo(tmp_path)
    scenario.write_text(scenario.read_text() + "\n[fleet]\npad_spacing_m = 0.0\n")
    ended = cli(
        "plan-upload", scenario, *("--to", "mock:") * 3, "-o", run, "--evaluations", EVALUATIONS,
        "--json",
     code=0)  # fmt: skip
    fleet = json.loads((run / "plan.json").read_text())["fleet"]
    assert (fleet["vehicles"], len(fleet["by_vehicle"])) == (3, 1)
    assert "warning: the plan does not use mock:, mock:; uploading nothing there" in ended.err
    (reported,) = ended.document["vehicles"]
    assert (reported["vehicle"], reported["sortie"], Path(reported["run"])) == (1, 1, run)
    assert (run / "upload.json").exists()
    assert f"Next: uavcover fly {run} --to mock:" in ended.err
    again = cli("plan-upload", run, "--to", "mock:", "--to", "mock:", code=2)
    assert "more vehicles would not finish sooner; use --to once" in again.error
