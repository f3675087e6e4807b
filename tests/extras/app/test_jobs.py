"""Commands of the page: processes of their own, found again by the next server, stopped and paused by signals."""

import base64
import io
import json
import os
import select
import shutil
import signal
import subprocess
import sys
from contextlib import redirect_stderr, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image
from websockets.sync.client import connect

from tests.extras.app.conftest import EXAMPLES, WATCHDOG_S, Client, serving
from uavcover.cli.console import EventConsole
from uavcover.errors import InputError
from uavcover.extras.app import jobs as jobs_module
from uavcover.extras.app.jobs import Job, Jobs
from uavcover.extras.app.live import LiveFlight, Observed
from uavcover.extras.app.scene import Scenes
from uavcover.extras.app.server import Server
from uavcover.extras.app.workspace import Workspace
from uavcover.extras.fleet.board import Board, VehicleUser
from uavcover.run.provenance import process_of


def wait_for_end(job: Job) -> None:
    """Wait for the end of a job's process, under a watchdog."""
    with suppress(ProcessLookupError), open(os.pidfd_open(job._process()["pid"]), "rb", buffering=0) as process:
        assert select.select([process], [], [], WATCHDOG_S)[0], "the watchdog"


@pytest.fixture
def sleeper(tmp_path: Path) -> Jobs:
    """Jobs whose process has written two events and waits for signals: one to pause, and one to end."""
    program = tmp_path / "program.py"
    program.write_text(
        "import signal, sys, pathlib\n"
        "from uavcover.extras.app.jobs import detach\n"
        "folder = pathlib.Path(sys.argv[-1])\n"
        "awaited = signal.SIGINT, signal.SIGUSR1, signal.SIGTERM\n"
        "signal.pthread_sigmask(signal.SIG_BLOCK, awaited)\n"
        'print(\'{"say": "begun"}\', file=sys.stderr, flush=True)\n'
        "print('not json', file=sys.stderr, flush=True)\n"
        "detach(folder)\n"
        "while signal.sigwait(awaited) == signal.SIGUSR1:\n"
        '    print(\'{"say": "paused"}\', file=sys.stderr, flush=True)\n'
        "(folder / 'code').write_text('130')\n"
    )
    return Jobs(tmp_path, program=(sys.executable, str(program)))


def test_a_job_is_found_by_the_next_server_and_stopped(sleeper: Jobs, tmp_path: Path) -> None:
    job = sleeper.start("plan", ["plan", "x"], run="run")
    assert job.events()[0] == [{"say": "begun"}, {"say": "not json"}]
    (again,) = Jobs(tmp_path).all()
    assert again == job
    assert again.code is None
    assert again.document()["command"] == ["uavcover", "plan", "x", "--json", "--events"]
    assert again.signal(signal.SIGUSR1)
    with pytest.raises(InputError, match="another command is using this run folder"):
        Jobs(tmp_path).start("verify", ["verify", "run"], run="run")
    assert again.signal(signal.SIGTERM)  # of two signals that wait, the lower number is taken first
    wait_for_end(job)
    assert again.code == 130
    assert again.events()[0][2:] == [{"say": "paused"}]
    assert not again.signal(signal.SIGINT)


def test_a_command_that_has_not_made_its_folder_yet_keeps_its_name(served: Client, sleeper: Jobs) -> None:
    served.server.jobs = sleeper
    runs = [served.post("/api/jobs", {"kind": "plan", "scenario": "valley.toml"})["run"] for _ in range(3)]
    assert runs == ["valley", "valley-2", "valley-3"]


def test_events_are_read_from_where_one_was_and_only_whole_ones(tmp_path: Path) -> None:
    job = Job(tmp_path, "plan", (), "")
    assert job.events() == ([], 0)
    (tmp_path / "events").write_bytes(b'{"say": "a"}\n{"say":')
    events, end = job.events()
    assert events == [{"say": "a"}]
    with (tmp_path / "events").open("ab") as file:
        file.write(b' "b"}\n\xff\xfe\n')
    assert job.events(end)[0] == [{"say": "b"}, {"say": "\ufffd\ufffd"}]


def test_a_process_that_was_killed_is_no_job_that_runs(sleeper: Jobs) -> None:
    job = sleeper.start("plan", ["plan", "x"])
    os.kill(job._process()["pid"], signal.SIGKILL)
    wait_for_end(job)
    assert job.code == -1


def test_a_number_that_was_given_again_is_another_process(tmp_path: Path) -> None:
    job = Job(tmp_path, "plan", (), "")
    (tmp_path / "process.json").write_text(json.dumps(process_of(os.getpid()) | {"started": 0}))
    assert job.code == -1
    assert not job.signal(signal.SIGINT)


def test_ended_jobs_are_forgotten_the_oldest_first(monkeypatch: pytest.MonkeyPatch, sleeper: Jobs) -> None:
    monkeypatch.setattr(jobs_module, "KEPT", 2)
    started = []
    for _ in range(4):
        job = sleeper.start("plan", ["plan", "x"])
        job.signal(signal.SIGINT)
        wait_for_end(job)
        started.append(job.id)
    sleeper.start("plan", ["plan", "x"]).signal(signal.SIGKILL)
    assert {job.id for job in sleeper.all()} & set(started) == {started[3]}


def test_a_process_that_has_not_told_its_number_yet_is_no_ended_one(tmp_path: Path) -> None:
    (tmp_path / "job.json").write_text("{}")
    assert Job(tmp_path, "plan", (), "").code is None
    os.utime(tmp_path / "job.json", (1.0, 1.0))
    assert Job(tmp_path, "plan", (), "").code == -1


@pytest.mark.parametrize("name", ["", "../x", "1-2", "x" * 40, "1795909878295-b11736cd"])
def test_a_job_that_is_none(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="no such job"):
        Jobs(tmp_path).get(name)


def test_a_whole_command(served: Client) -> None:
    begun = served.post("/api/jobs", {"kind": "plan", "scenario": "valley.toml", "evaluations": 60, "seed": 3})
    wait_for_end(served.server.jobs.get(begun["id"]))
    job = served.get(f"/api/jobs/{begun['id']}")
    assert job["code"] == 0, served.server.jobs.get(begun["id"]).events()
    assert job["result"]["run"] == "valley"
    assert any("progress" in event for event in served.server.jobs.get(begun["id"]).events()[0])
    scene = served.get("/api/scene?name=valley")
    assert len(scene["route"]) == job["result"]["waypoint_count"]
    # The page's check of the plan's own route finds nothing, and what it sees is what the plan says.
    check = served.post("/api/route/check", {"run": "valley", "waypoints": scene["route"]})
    assert check["legs"] == []
    observed = served.post("/api/route/coverage", {"run": "valley", "waypoints": scene["route"]})
    assert observed["coverage"] == pytest.approx(scene["plan"]["metrics"]["coverage_of_coverable"], abs=2e-4)
    high = [[lon, lat, 500.0] for lon, lat, _ in scene["route"]]
    assert served.post("/api/route/check", {"run": "valley", "waypoints": high})["legs"] != []
    # An edited plan is a plan like any other; one that breaks a limit is refused by the command.
    edit(served, scene["route"][:-1], code=0)
    assert served.get("/api/scene?name=valley-edited")["plan"]["made_by"] == "edited"
    edit(served, high, code=4)
    assert not (served.root / "valley-edited-2").exists()


def edit(served: Client, waypoints: list[list[float]], *, code: int) -> None:
    begun = served.post("/api/route/save", {"run": "valley", "waypoints": waypoints})
    wait_for_end(served.server.jobs.get(begun["id"]))
    job = served.get(f"/api/jobs/{begun['id']}")
    assert job["code"] == code, served.server.jobs.get(begun["id"]).events()


@pytest.mark.parametrize("waypoints", [None, [], [[1]], [["a", 1, 2]], [[1, 2, None]], "x", [[1e400, 0, 0]]], ids=repr)
def test_waypoints_that_are_none(served: Client, planned: Path, waypoints: object) -> None:
    shutil.copytree(planned, served.root / "run")
    assert "waypoints" in served.error("POST", "/api/route/check", {"run": "run", "waypoints": waypoints})


def test_a_flight_is_followed_as_it_grows_and_from_its_beginning_when_it_is_replaced(flown: Path) -> None:
    track = flown / "track.csv"
    whole = track.read_bytes()
    track.unlink()
    scene = Scenes().of(flown)
    observed = Observed(scene)
    live = LiveFlight(observed, flown)
    live.poll()
    assert live.samples == []
    patched, known = None, 0
    with track.open("wb") as file:
        for begin in range(0, len(whole), 4001):  # cuts lines anywhere
            file.write(whole[begin : begin + 4001])
            file.flush()
            live.poll()
            live.look()
            if observed.version > known:
                patched = taken(patched, observed.since(known))
                known = observed.version
    assert known > 3
    assert (patched == taken(None, observed.since(0))).all(), "rectangles add up to the whole"
    rows = [line for line in whole.decode().splitlines() if not line.startswith("#")]
    assert len(live.samples) == len(rows) - 1
    assert observed.covered > 0.9
    lon_lat = np.array(live.samples)[:, :2]
    assert np.abs(scene.east_north(lon_lat)).max() < 2000.0
    track.unlink()
    track.write_bytes(b"".join(line + b"\n" for line in whole.splitlines()[:30]))
    live.poll()
    live.look()
    assert 0 < len(live.samples) < 40
    assert observed.covered < 0.5
    assert (taken(patched, observed.since(known)) == taken(None, observed.since(0))).all()


def taken(image: np.ndarray | None, document: dict[str, Any]) -> np.ndarray:
    """The picture that a browser has after a message."""
    width, height = document["size"]
    assert document["whole"] is (image is None)
    out = np.zeros((height, width, 4), dtype=np.uint8) if image is None else image.copy()
    for patch in document["patches"]:
        pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(patch["image"].partition(",")[2]))))
        out[patch["y"] : patch["y"] + pixels.shape[0], patch["x"] : patch["x"] + pixels.shape[1]] = pixels
    return out


def test_flights_of_one_plan_add_up(served: Client, flown: Path) -> None:
    for name in ("run", "run/sortie-1", "run/sortie-2"):
        shutil.copytree(flown, served.root / name, ignore=shutil.ignore_patterns("sortie-*"))
    first, second = (served.server.live(f"run/sortie-{number}") for number in (1, 2))
    assert first.observed is second.observed
    lines = (served.root / "run/sortie-1/track.csv").read_bytes().splitlines(keepends=True)
    (served.root / "run/sortie-1/track.csv").write_bytes(b"".join(lines[: len(lines) // 2]))
    fractions = []
    for live in (first, second):
        live.poll()
        live.look()
        fractions.append(live.observed.covered)
    assert 0.0 < fractions[0] < fractions[1]


def test_browsers_get_what_they_lack(served: Client, flown: Path) -> None:
    shutil.copytree(flown, served.root / "run")
    headers = {"Cookie": f"uavcover-{served.port}={served.token}"}
    for begin in (0, 100):
        with connect(f"ws://{served.host}/ws", origin=f"http://{served.host}", additional_headers=headers) as socket:  # type: ignore[arg-type]
            socket.send(json.dumps({"watch": "run", "from": begin}))
            while "samples" not in (message := json.loads(socket.recv(timeout=WATCHDOG_S))):
                pass
            assert message["from"] == begin
            assert len(message["samples"]) > 200


def test_the_incumbent_is_drawn_while_it_is_searched_for(capfd: pytest.CaptureFixture[str]) -> None:
    with EventConsole().progress("planning", 4) as bar:
        bar.draw(lambda: [[8.123456789, 47.0], [8.2, 47.1]])
        bar.draw(lambda: pytest.fail("once a second is enough"))
        bar.update(1.0)
        bar.update(4.0, note="done")
    events = [json.loads(line) for line in capfd.readouterr().err.splitlines()]
    assert {"route": [[8.1234568, 47.0], [8.2, 47.1]]} in events
    assert events[-1] == {"progress": {"what": "planning", "done": 4.0, "total": 4, "note": "done"}}


def test_the_limits_of_a_vehicle_are_values_for_the_page(capfd: pytest.CaptureFixture[str]) -> None:
    row = {"what": "speed", "planned": 5.0, "vehicle": 4.0, "weight": "warning"}
    EventConsole().show_limits("limits:", [row])
    board = Board(EventConsole(), 2)
    VehicleUser(board, 2, stops=lambda: 0, pauses=lambda: False).show_limits("  limits:", [row])
    alone, of_fleet = (json.loads(line) for line in capfd.readouterr().err.splitlines())
    assert alone == {"say": "limits:", "limits": [row]}
    assert of_fleet == {"say": "vehicle 2: limits:", "limits": [{**row, "what": "vehicle 2: speed"}]}


@pytest.mark.parametrize("kind", ["plan", "fly"])
def test_a_server_that_is_killed_takes_no_command_with_it(tmp_path: Path, planned: Path, kind: str) -> None:
    """The server gets SIGKILL while it plans or flies; the command goes on, and the next server shows its end."""
    root = tmp_path / "served"
    shutil.copytree(EXAMPLES, root)
    shutil.copytree(planned, root / "run")
    command = [sys.executable, "-m", "uavcover", "serve", str(root), "--port", "0", "--no-browser", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        assert server.stdout is not None
        address = urlsplit(json.loads(server.stdout.readline())["url"])
        port = int(address.port or 0)
        client = Client(port, address.query.partition("=")[2], root, Server(Workspace(root)))
        requested = {
            "plan": {"scenario": "valley.toml", "evaluations": 300},
            "fly": {"run": "run", "mock_speed": "40"},
        }[kind]
        begun = client.post("/api/jobs", {"kind": kind, **requested})
        job = client.server.jobs.get(begun["id"])
        with subprocess.Popen(["tail", "-f", "-n", "+1", job.folder / "events"], stdout=subprocess.PIPE) as tail:
            assert tail.stdout is not None
            assert any(b'"progress"' in line for line in tail.stdout)
            tail.kill()
        server.kill()
        server.wait(WATCHDOG_S)
    assert job.code is None
    wait_for_end(job)
    for again in serving(root):
        found = again.get(f"/api/jobs/{job.id}")
        assert found["code"] == 0, job.events()
        assert any(event.get("limits") for event in job.events()[0]) is (kind == "fly")
        scene = again.get(f"/api/scene?name={'valley' if kind == 'plan' else 'run'}")
    assert scene["route"]
    assert bool(scene["tracks"]) is (kind == "fly")


def test_escape_sequences_and_markup_of_a_vehicle_are_plain_text_in_the_events(tmp_path: Path) -> None:
    """What a vehicle says reaches the page as one event of JSON, whatever is in it."""
    said = '\x1b[2J\x1b]0;owned\x07<img src=x onerror=alert(1)>\n{"route": [[0, 0]]}\u202e'
    console = EventConsole()
    with (tmp_path / "events").open("w", encoding="utf-8") as file, redirect_stderr(file):
        console.say(said)
        console.warn(said)
    events, _ = Job(tmp_path, "fly", (), "").events()
    assert [*events[0], *events[1]] == ["say", "warn"]
    assert len(events) == 2, "no line of it is an event of its own"
    for event in events:
        (text,) = event.values()
        assert "\x1b" not in text
        assert "\x07" not in text
