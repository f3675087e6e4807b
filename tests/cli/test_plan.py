import json
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import (
    EVALUATIONS,
    WATCHDOG_S,
    Cli,
    command,
    corner_of_the_demo,
    files,
    limited_to,
    started,
    wait_for_line,
)
from uavcover.model.route import RouteMetrics
from uavcover.planner.command import PlanRequest, plan_into
from uavcover.planner.plan_messages import progress_text, room_text, search_text
from uavcover.planner.planner import SearchProgress
from uavcover.run.user import Unattended
from uavcover.scenario.site import load_site

PLANNED = {
    "scenario.toml", "run.json", "pareto.csv", "pareto_routes.csv", "plan.json",
    "mission.waypoints", "mission.plan", "fence.waypoints",
    "rally.waypoints", "mission.kml",
}  # fmt: skip


def plan_of(folder: Path) -> dict[str, Any]:
    document = json.loads((folder / "plan.json").read_text())
    assert isinstance(document, dict)
    return document


def without_times(folder: Path) -> dict[str, Any]:
    return {key: value for key, value in plan_of(folder).items() if key != "wall_s"}


def test_equal_on_one_thread_two_threads_and_one_core(cli: Cli, tmp_path: Path) -> None:
    base = ("plan", corner_of_the_demo(tmp_path), "--evaluations", EVALUATIONS, "--seed", 7)
    assert cli(*base, "-o", tmp_path / "one", "--workers", 1, "--json", code=0).document["rule_met"] is True
    assert files(tmp_path / "one") == PLANNED
    cli(*base, "-o", tmp_path / "two", "--workers", 2, code=0)
    done = subprocess.run(
        ["taskset", "-c", "0", *command(*base, "-o", tmp_path / "core")], capture_output=True, timeout=300, check=False
    )
    assert done.returncode == 0
    assert without_times(tmp_path / "one") == without_times(tmp_path / "two") == without_times(tmp_path / "core")
    assert plan_of(tmp_path / "one")["seed"] == 7


def test_rule_that_cannot_be_met_writes_the_best_and_ends_with_1(cli: Cli, tmp_path: Path) -> None:
    scenario, rule = corner_of_the_demo(tmp_path), "coverage>=0.9,done<=30s"
    ended = cli("plan", scenario, "-o", tmp_path / "run", "--evaluations", EVALUATIONS, "--select", rule, code=1)
    assert f"no route meets {rule}; wrote the best one" in ended.err
    assert plan_of(tmp_path / "run")["rule_met"] is False


def test_bounds_of_few_waypoints_are_there_without_being_asked(cli: Cli, tmp_path: Path) -> None:
    base = ("plan", "paper-R2", "--algorithm", "imodbo", "--evaluations", 50, "-o", tmp_path / "run")
    assert "most coverage with 26 waypoints: at most 100.00 %, found 90.46 %, gap 9.54 %" in cli(*base, code=0).out
    entry = plan_of(tmp_path / "run")["bounds"]["fewest_waypoints"]
    assert (entry["at_least"], entry["found"], entry["gap"]) == (16.0, None, None)
    assert "--bounds: 'soon' is not a duration" in cli(*base, "--force", "--bounds", "soon").error


def test_scenario_without_a_place_plans_and_says_what_it_cannot(cli: Cli, nowhere_run: Path, tmp_path: Path) -> None:
    assert files(nowhere_run) == {"scenario.toml", "run.json", "pareto.csv", "pareto_routes.csv", "plan.json"}
    assert plan_of(nowhere_run)["origin"] is None
    for arguments in (
        ("export", nowhere_run, "--format", "plan", "-o", tmp_path / "x.plan"),
        ("plan-upload", nowhere_run, "--to", "mock:"),
        ("plan-upload", "paper-planar", "--to", "mock:", "-o", tmp_path / "new"),
        ("fly", nowhere_run, "--to", "mock:"),
    ):
        assert re.search("no (place|position) on Earth", cli(*arguments, code=2).error)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        (("--budget", "3x"), "--budget"),
        (("--budget", "0s"), "--budget"),
        (("--evaluations", "0"), "evaluations"),
        (("--select", "best"), "select"),
        (("--algorithm", "beetle"), "imodbo, modbo"),
        (("--autopilot", "dji"), "--autopilot"),
        (("--workers", "0"), "workers"),
    ],
)
def test_bad_values_leave_nothing(cli: Cli, tmp_path: Path, arguments: tuple[str, ...], telling: str) -> None:
    assert telling in cli("plan", "jacksboro", "-o", tmp_path / "run", "-q", *arguments, code=2).error
    assert not (tmp_path / "run").exists()


def test_three_mistakes_are_one_line_with_three_keys(cli: Cli, tmp_path: Path) -> None:
    scenario = tmp_path / "wrong.toml"
    text = Path("uavcover/scenarios/jacksboro.toml").read_text()
    for right, wrong in (
        ("cruise_speed_m_s = 10.0", "cruise_sped_m_s = 10.0"),
        ("min_height_agl_m = 40.0", 'min_height_agl_m = "low"'),
        ("cell_size_m = 5.0", "cell_size_m = -5.0"),
    ):
        assert right in text
        text = text.replace(right, wrong)
    scenario.write_text(text)
    ended = cli("plan", scenario, "-o", tmp_path / "run", code=2)
    for key in ("vehicle.cruise_sped_m_s", "limits.min_height_agl_m", "area.cell_size_m"):
        assert key in ended.error
    assert "did you mean cruise_speed_m_s" in ended.error


def test_unknown_scenario(cli: Cli, tmp_path: Path) -> None:
    assert "jacksboro" in cli("plan", "nosuch", "-o", tmp_path / "run", code=2).error


def test_folder_that_cannot_be_made(cli: Cli) -> None:
    ended = cli("plan", "jacksboro", "-o", "/proc/run", "-q", code=2)
    assert ended.error.startswith("error: /proc/run: the file cannot be written")
    assert ended.error.rstrip().endswith("; choose another folder")


def test_full_disk_leaves_the_older_plan(flown: Path, tmp_path: Path) -> None:
    scenario = corner_of_the_demo(tmp_path)
    before = {path.name: path.read_bytes() for path in flown.iterdir()}
    done = subprocess.run(
        [*limited_to(4), *command("plan", scenario, "-o", flown, "--force", "--evaluations", EVALUATIONS, "-q")],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert "File too large" in done.stderr
    assert {path.name: path.read_bytes() for path in flown.iterdir()} == before


def test_force_moves_the_older_plan_and_its_flight_away(cli: Cli, flown: Path, tmp_path: Path) -> None:
    scenario = corner_of_the_demo(tmp_path)
    cli("plan", scenario, "-o", flown, "--evaluations", EVALUATIONS, code=2)
    ended = cli("plan", scenario, "-o", flown, "--evaluations", EVALUATIONS, "--seed", 3, "--force", code=0)
    assert "older-1" in ended.err
    assert files(flown) == PLANNED | {"older-1"}
    assert plan_of(flown)["seed"] == 3
    assert cli("verify", flown / "older-1").code != 2, "what was flown is a run folder of its own"
    assert "no such" not in cli("verify", flown).error


def test_two_planners_in_one_folder(cli: Cli, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with started(command("plan", corner_of_the_demo(tmp_path), "-o", folder, "--budget", "60s")) as first:
        wait_for_line(first, "planning")
        second = cli(
            "plan", tmp_path / "corner.toml", "-o", folder, "--force", "--evaluations", EVALUATIONS, "-q", code=2
        )
        assert "another uavcover process is using this folder" in second.error
        first.send_signal(signal.SIGINT)
        first.communicate(timeout=WATCHDOG_S)
    assert plan_of(folder)["interrupted"] is True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupt_writes_the_best_so_far(tmp_path: Path, number: signal.Signals) -> None:
    with started(command("plan", corner_of_the_demo(tmp_path), "-o", tmp_path / "run", "--budget", "60s")) as process:
        wait_for_line(process, "planning")
        process.send_signal(number)
        _, err = process.communicate(timeout=WATCHDOG_S)
    assert process.returncode == 130
    assert f"the best route so far was written to {tmp_path / 'run'}" in err
    assert files(tmp_path / "run") == PLANNED
    assert plan_of(tmp_path / "run")["waypoints"]


def test_third_interrupt_aborts(tmp_path: Path) -> None:
    with started(command("plan", corner_of_the_demo(tmp_path), "-o", tmp_path / "run", "--budget", "60s")) as process:
        wait_for_line(process, "planning")
        for _ in range(3):
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout=0.1)  # two that come at once are one
        _, err = process.communicate(timeout=WATCHDOG_S)
    # One that comes while the interpreter shuts down ends it by the signal, which a shell shows as 130 too.
    assert process.returncode in {130, -signal.SIGINT}
    assert "Traceback" not in err
    assert not (tmp_path / "run").exists() or plan_of(tmp_path / "run")["interrupted"]


def test_infeasible_plan_ends_with_4(cli: Cli, tmp_path: Path) -> None:
    scenario = corner_of_the_demo(tmp_path)
    text = scenario.read_text()
    scenario.write_text(text.replace("max_climb_angle_deg = 30.0", "max_climb_angle_deg = 1.0"))
    cli("plan", scenario, "-o", tmp_path / "run", "--evaluations", EVALUATIONS, "-q", code=4)
    assert not list((tmp_path / "run").glob("mission.*"))


def test_progress_bar_only_on_a_terminal_and_after_two_seconds(cli: Cli, tmp_path: Path) -> None:
    arguments = command("plan", corner_of_the_demo(tmp_path), "-o", tmp_path / "long", "--budget", "6s")
    observed = subprocess.run(
        ["script", "-qec", " ".join(arguments), str(tmp_path / "typescript")],
        capture_output=True, text=True, timeout=300, check=False, stdin=subprocess.DEVNULL,
        env={"PATH": "/usr/bin:/bin", "TERM": "xterm", "HOME": str(tmp_path)},
    )  # fmt: skip
    assert observed.returncode == 0
    assert "━" in observed.stdout
    assert re.search(r"\d %, \d+ s", observed.stdout), "coverage, and the time of the mission"
    piped = cli("plan", tmp_path / "corner.toml", "-o", tmp_path / "piped", "--evaluations", EVALUATIONS)
    assert "━" not in piped.out + piped.err
    assert piped.err == "" or all(line.startswith("warning:") for line in piped.err.splitlines())


@pytest.mark.parametrize(
    ("shortest_m", "least_m", "words"),
    [
        (None, 5000.0, "97.2 %"),
        (7250.0, None, "97.2 %, 7250 m"),
        (7250.0, 0.0, "97.2 %, 7250 m"),
        (6250.0, 5000.0, "97.2 %, 6250 m, gap 25.0 %"),
    ],
)
def test_progress_tells_coverage_length_and_gap(shortest_m: float | None, least_m: float | None, words: str) -> None:
    assert progress_text(SearchProgress(10, 20, 0.972, shortest_m), "m", least_m) == words


@pytest.mark.parametrize(
    ("lowest_m", "highest_m", "room"), [(40.0, 100.0, "0.0"), (60.0, 118.5, "1.5"), (48.0, 112.0, None)]
)
def test_a_route_at_the_ends_of_its_height_band_is_told(lowest_m: float, highest_m: float, room: str | None) -> None:
    limits = load_site("ridge-obstacles").scenario.limits
    metrics = RouteMetrics(0.99, 0.99, 100, 7000.0, 700.0, lowest_m, highest_m, 7000.0)
    words = room_text(limits, metrics)
    if room is None:
        assert words is None
    else:
        assert f"within {room} m of the limits of its height above ground (40 to 120 m)" in str(words)


def test_request_is_all_that_planning_needs(tmp_path: Path) -> None:
    request = PlanRequest(
        scenario="paper-planar", folder=tmp_path / "run", command=sys.argv, force=False, evaluations=100, seed=2
    )
    outcome = plan_into(request, Unattended(), check_site=lambda _: None)
    assert outcome.exit_code == 0
    assert outcome.compiled is None


def test_two_vehicles(cli: Cli, tmp_path: Path) -> None:
    run = tmp_path / "run"
    ended = cli(
        "plan", corner_of_the_demo(tmp_path), "-o", run, "--evaluations", EVALUATIONS, "--vehicles", 2, "--json", code=0
    )
    fleet = ended.document["fleet"]
    assert fleet == json.loads((run / "plan.json").read_text())["fleet"]
    assert fleet["vehicles"] == 2
    assert "vehicles = 2" in (run / "scenario.toml").read_text()
    assert "completed after " in ended.err
    # Another choice, and the same one again, keep the vehicles.
    cli("select", run, "index:0", code=0)
    assert json.loads((run / "plan.json").read_text())["fleet"]["vehicles"] == 2


def test_a_number_of_vehicles_that_cannot_be(cli: Cli, tmp_path: Path) -> None:
    ended = cli("plan", corner_of_the_demo(tmp_path), "-o", tmp_path / "run", "--vehicles", 0, code=2)
    assert "vehicles: must be between 1 and 50, not 0" in ended.error
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("parts", ["0", "-1", "two", "1.5", "", "\u0663"])
def test_parts_are_a_number_or_auto(cli: Cli, tmp_path: Path, parts: str) -> None:
    result = cli("plan", "jacksboro", "-o", tmp_path / "run", f"--parts={parts}", code=2)
    assert f"--parts: must be auto or a number of parts (at least 1), not {parts!r}" in result.err
    assert not (tmp_path / "run").exists()


def test_rally_is_home_or_auto(cli: Cli, tmp_path: Path) -> None:
    result = cli("plan", "jacksboro", "-o", tmp_path / "run", "--rally", "everywhere")
    assert (result.code, "--rally: must be auto or home, not 'everywhere'" in result.err) == (2, True)


def test_a_search_without_time_is_said_so():
    assert search_text(300, "memetic", beaten=False) == "300 evaluations of memetic"
    assert search_text(1, "memetic", beaten=True) == "1 evaluation of memetic found no better route"
    assert search_text(0, "memetic", beaten=True) == "memetic had no time to search; increase --budget"
    assert search_text(0, "gap-closing", beaten=False) == "0 evaluations of gap-closing"
