"""The link benchmark: trials, vehicles behind lossy ports, workers, tables."""

import multiprocessing
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions
from uavcover.errors import InputError
from uavcover.extras.benchmarks.link import runs
from uavcover.extras.benchmarks.link.peers import (
    TransferOutcome,
    Transferred,
    Trial,
    cells_of,
    conditions_of,
    items_on,
    markdown,
    mission_items,
    outcome_of,
    run_real,
    run_simulated,
    serve,
)
from uavcover.extras.benchmarks.link.runs import OUTCOMES, read_outcomes, run_missing, run_over_udp, trials

UPLOAD = Trial("native", "px4", "upload", 0.0, 0.0, 0)


def trial(client: str = "simulated", **changes: object) -> Trial:
    return Trial(**{"client": client, "vehicle": "px4", "direction": "upload", "delay_s": 0.001, "loss": 0.0, "seed": 0,
                    **changes})  # type: ignore[arg-type]  # fmt: skip


@pytest.mark.parametrize("vehicle", ["ardupilot", "px4"])
@pytest.mark.parametrize("direction", ["upload", "download"])
def test_a_simulated_trial_works_and_takes_as_long_as_the_link(vehicle: str, direction: str) -> None:
    outcome = run_simulated(trial(vehicle=vehicle, direction=direction))
    assert (outcome.claimed, outcome.correct, outcome.error) == (True, True, "")
    assert 0.09 < outcome.time_s < 0.22, "a round trip of 2 ms an item, or half of it"
    lossy = trial(vehicle=vehicle, direction=direction, loss=0.3, seed=4)
    assert run_simulated(lossy) == run_simulated(lossy), "by seed"
    assert run_simulated(lossy).time_s > 0.5


def test_the_mission_is_one_that_no_mistake_leaves_unchanged() -> None:
    items = mission_items()
    assert len({(item.lat_deg, item.lon_deg, item.alt_m) for item in items}) == 100
    assert items_on("px4") == items
    assert items_on("ardupilot") == items
    assert all(abs(item.lat_deg - item.lon_deg) > 1.0 for item in items)


def test_what_a_client_claims_and_what_is_so_are_two_things() -> None:
    held = items_on("px4")
    assert outcome_of(UPLOAD, Transferred(True, 1.0), held).correct
    assert not outcome_of(UPLOAD, Transferred(True, 1.0), held[:-1]).correct
    late = outcome_of(UPLOAD, Transferred(False, 1.0, error="TIMEOUT"), held)
    assert (late.claimed, late.correct, late.error) == (False, True, "TIMEOUT")
    download = trial("native", direction="download")
    assert outcome_of(download, Transferred(True, 1.0, received=held), held).correct
    assert not outcome_of(download, Transferred(True, 1.0, received=()), held).correct


def test_outcomes_survive_the_file() -> None:
    outcome = TransferOutcome(trial(loss=0.05), True, False, 1.0 / 3.0, 'said "no", twice')
    assert TransferOutcome.of_row(outcome.row()) == outcome


@pytest.fixture
def vehicles() -> Iterator[Connection]:
    """The vehicles' loop in a thread."""
    ours, theirs = multiprocessing.Pipe()
    thread = threading.Thread(target=serve, args=(theirs,), daemon=True)
    thread.start()
    yield ours
    ours.send(None)
    thread.join(60.0)
    assert not thread.is_alive()


@pytest.mark.parametrize("client", ["native", "mavsdk"])
@pytest.mark.parametrize("direction", ["upload", "download"])
def test_a_client_over_udp(vehicles: Connection, client: str, direction: str) -> None:
    if client == "mavsdk":
        pytest.importorskip("mavsdk", reason="MAVSDK is not installed")
    wanted = trial(client, direction=direction, delay_s=0.0005)
    vehicles.send(wanted)
    port = vehicles.recv()
    transferred = run_real(wanted, port)
    vehicles.send(port)
    outcome = outcome_of(wanted, transferred, vehicles.recv())
    assert (outcome.claimed, outcome.correct, outcome.error) == (True, True, "")


def test_a_port_that_loses_much(vehicles: Connection) -> None:
    wanted = trial("native", loss=0.2, delay_s=0.0)
    assert conditions_of(wanted) == Conditions(loss=0.2, delay_s=0.0)
    vehicles.send(wanted)
    port = vehicles.recv()
    assert run_real(wanted, port).claimed
    vehicles.send(port)
    assert vehicles.recv() == items_on("px4")


def test_an_unknown_client_is_refused() -> None:
    with pytest.raises(MisuseError, match="native, mavsdk"):
        run_real(trial("pigeon"), 1)


def test_processes_run_trials_and_a_client_that_fails_is_an_outcome() -> None:
    wanted = [UPLOAD, trial("native", direction="download", loss=0.1), trial("pigeon")]
    outcomes = {outcome.trial: outcome for outcome in run_over_udp(wanted, at_a_time=2)}
    assert outcomes[wanted[0]].correct
    assert outcomes[wanted[1]].correct
    failed = outcomes[wanted[2]]
    assert (failed.claimed, failed.correct, "MisuseError" in failed.error) == (False, False, True)


def test_a_client_that_hangs_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "LONGEST_S", 0.0)
    outcomes = list(run_over_udp([UPLOAD, trial("native", seed=1)], at_a_time=1))
    assert [(o.claimed, o.error) for o in outcomes] == [(False, "did not respond for 0 s")] * 2


def test_the_grid_has_every_cell_and_first_seeds_first() -> None:
    wanted = trials(clients=("simulated", "native"), losses=(0.0, 0.4), delay_s=0.001, seeds=3)
    assert len(wanted) == len(set(wanted)) == 2 * 2 * 2 * 2 * 3
    assert [t.seed for t in wanted] == sorted(t.seed for t in wanted)


def test_what_is_there_is_not_run_again_and_half_a_line_is(tmp_path: Path) -> None:
    wanted = trials(clients=("simulated",), losses=(0.0,), delay_s=0.001, seeds=2)
    first = list(run_missing(tmp_path, wanted[:5], at_a_time=1))
    file = tmp_path / OUTCOMES
    file.write_text(file.read_text()[:-9])
    assert read_outcomes(tmp_path) == first[:4]
    rest = list(run_missing(tmp_path, wanted, at_a_time=1))
    assert [outcome.trial for outcome in rest] == wanted[4:]
    assert {outcome.trial for outcome in read_outcomes(tmp_path)} == set(wanted)
    assert list(run_missing(tmp_path, wanted, at_a_time=1)) == []


def test_real_trials_are_written_too(tmp_path: Path) -> None:
    wanted = [UPLOAD, trial("native", loss=0.1)]
    assert len(list(run_missing(tmp_path, wanted, at_a_time=2))) == 2
    assert {outcome.trial for outcome in read_outcomes(tmp_path)} == set(wanted)


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / OUTCOMES).write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="cannot read line 2"):
        read_outcomes(tmp_path)


def test_tables_by_hand() -> None:
    outcomes = [
        TransferOutcome(trial("native", loss=0.2, seed=0), True, True, 1.0),
        TransferOutcome(trial("native", loss=0.2, seed=1), True, True, 3.0),
        TransferOutcome(trial("native", loss=0.2, seed=2), True, False, 9.0),
        TransferOutcome(trial("mavsdk", loss=0.2, seed=0), False, True, 9.0, "TIMEOUT"),
        TransferOutcome(trial("native", vehicle="ardupilot", seed=0), True, True, 0.0123),
    ]
    cells = cells_of(outcomes)
    assert [(c.vehicle, c.client, c.runs, c.correct, c.wrong_unnoticed) for c in cells] == [
        ("ardupilot", "native", 1, 1, 0),
        ("px4", "native", 3, 2, 1),
        ("px4", "mavsdk", 1, 0, 0),
    ]
    assert (cells[1].median_s, cells[1].slowest_s) == (2.0, 3.0)
    lines = markdown(cells).splitlines()
    assert lines[2] == "| ardupilot | upload | 1 ms | 0% | 1/1 | 12.3 ms, 12.3 ms | - | - |"
    assert lines[3] == "| px4 | upload | 1 ms | 20% | 2/3, 1 wrong unnoticed | 2.00 s, 3.00 s | 0/1 | - |"
    assert {line.count("|") for line in lines} == {9}
