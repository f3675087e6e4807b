"""Vehicles of a fleet that are lost, come home early or do not start: who flies what they leave, and when."""

import itertools
from dataclasses import replace
from pathlib import Path

import pytest

from tests.extras.fleet.scripted_fleet import ENDURANCE_S, FLEET, Ends, fly_script, job
from tests.extras.fleet.test_fleet_traffic import out_and_back
from uavcover.errors import InfeasibleError
from uavcover.extras.fleet.jobs import Job, OnLoss, require_gain
from uavcover.model.route import Route
from uavcover.model.track import Ending

FELL = Ends(Ending.CRASHED, 0.5)
GONE = Ends(Ending.LINK_LOST, 0.5, down=False)
EARLY = Ends(Ending.RESERVE_KEPT, 0.6)


@pytest.fixture(autouse=True)
def rest_is_half(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of a flight is the second half of its route."""

    def rest_of(flown: Job, *_: object) -> Job:
        timeline = out_and_back(75.0, home=tuple(flown.timeline.position_m[0]))
        route = Route(flown.route.waypoints_m[len(flown.route) // 2 :])
        return replace(flown, name=f"{flown.name}+", route=route, timeline=timeline, is_rest=True)

    monkeypatch.setattr("uavcover.extras.fleet.sortie.rest_of", rest_of)


def jobs_of(folder: Path) -> list[Job]:
    """Three vehicles; the second one has two sorties."""
    return [job(folder, 1, 1, 0.0), job(folder, 2, 2, 5.0), job(folder, 3, 3, 10.0), job(folder, 4, 2, 250.0)]


def test_without_a_loss_all_is_flown_as_planned(tmp_path: Path) -> None:
    reported = fly_script(jobs_of(tmp_path), {})
    assert reported.landed() == {"001", "002", "003", "004"}
    assert reported.record("004").began_s == pytest.approx(250.0, abs=2.0)
    assert reported.flight.work.left == []


def test_the_others_fly_what_a_lost_one_leaves(tmp_path: Path) -> None:
    reported = fly_script(jobs_of(tmp_path), {"002": FELL})
    assert reported.landed() == {"001", "002+", "003", "004"}
    assert {reported.record("002+").vehicle, reported.record("004").vehicle} == {1, 3}
    assert reported.flight.work.left == []


def test_what_a_lost_one_leaves_becomes_gaps(tmp_path: Path) -> None:
    reported = fly_script(jobs_of(tmp_path), {"002": FELL}, on_loss=OnLoss.GAPS)
    assert reported.landed() == {"001", "003"}
    assert sorted(reported.flight.work.left) == ["002", "004"]
    assert not any(" instead: " in line for line in reported.lines)


def test_two_lost_and_the_third_flies_it_all(tmp_path: Path) -> None:
    reported = fly_script(jobs_of(tmp_path), {"002": FELL, "001": replace(FELL, fraction=0.7)})
    assert reported.landed() == {"001+", "002+", "003", "004"}
    flown = sorted((r for r in reported.flight.flown if r.vehicle == 3), key=lambda r: r.began_s or 0.0)
    assert flown[0].job.name == "003"
    for before, after in itertools.pairwise(flown):
        assert before.began_s is not None
        assert after.began_s is not None
        assert after.began_s >= before.began_s + before.job.timeline.duration_s + FLEET.turnaround_s - 2.0


@pytest.mark.parametrize("on_loss", list(OnLoss))
def test_all_lost(tmp_path: Path, on_loss: OnLoss) -> None:
    names = ("001", "002", "003", "004", "001+", "002+", "003+")
    reported = fly_script(jobs_of(tmp_path), dict.fromkeys(names, FELL), on_loss=on_loss)
    assert reported.landed() == set()
    assert {name.rstrip("+") for name in reported.flight.work.left} == {"001", "002", "003", "004"}


def test_nobody_starts_while_one_may_be_in_the_air_unheard(tmp_path: Path) -> None:
    """It may fly its mission to the end, or come back: until its battery must be empty the air is not free."""
    reported = fly_script(jobs_of(tmp_path), {"002": GONE})
    assert reported.landed() == {"001", "002+", "003", "004"}
    lost = reported.record("002")
    assert lost.began_s is not None
    lost_s = lost.began_s + 0.5 * lost.job.timeline.duration_s
    for name in ("002+", "004"):
        began_s = reported.record(name).began_s
        assert began_s is not None
        assert began_s >= lost_s + ENDURANCE_S - 2.0
        assert reported.record(name).vehicle != 2


def test_one_that_is_heard_again_on_the_ground_frees_the_air(tmp_path: Path) -> None:
    reported = fly_script(jobs_of(tmp_path), {"002": replace(GONE, heard_after_s=40.0)})
    assert reported.landed() == {"001", "002+", "003", "004"}
    lost = reported.record("002")
    assert lost.began_s is not None
    down_s = lost.began_s + 0.5 * lost.job.timeline.duration_s + 40.0
    began_s = [reported.record(name).began_s or 0.0 for name in ("002+", "004")]
    assert down_s <= min(began_s) < down_s + 0.5 * ENDURANCE_S
    assert reported.record("002+").vehicle != 2


def test_lost_in_the_take_off(tmp_path: Path) -> None:
    """Those that have not started wait as long as it may be above home."""
    reported = fly_script(jobs_of(tmp_path), {"001": replace(GONE, fraction=0.01)})
    assert reported.landed() == {"001+", "002", "003", "004"}
    assert all((reported.record(name).began_s or 0.0) >= ENDURANCE_S for name in ("002", "003"))


@pytest.mark.parametrize("on_loss", list(OnLoss))
def test_one_that_came_home_for_its_battery_flies_on(tmp_path: Path, on_loss: OnLoss) -> None:
    reported = fly_script(jobs_of(tmp_path), {"002": EARLY}, on_loss=on_loss)
    assert reported.record("004").vehicle == 2
    assert reported.record("002").error == ""
    rest = {"002+"} if on_loss is OnLoss.SHARE else set()
    assert reported.landed() == {"001", "003", "004"} | rest
    assert reported.flight.work.left == ([] if rest else ["002"])


def test_the_only_vehicle_flies_its_own_rests(tmp_path: Path) -> None:
    reported = fly_script([job(tmp_path, 1, 1, 0.0)], {"001": EARLY, "001+": EARLY})
    assert reported.landed() == {"001++"}
    assert [r.vehicle for r in reported.flight.flown] == [1, 1, 1]


def test_a_battery_that_brings_nothing_on_is_not_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uavcover.extras.fleet.sortie.rest_of", lambda flown, *_: replace(flown, name=f"{flown.name}+"))
    reported = fly_script([job(tmp_path, 1, 1, 0.0)], {"001": EARLY, "001+": EARLY, "001++": EARLY})
    assert reported.flight.work.left == ["001"]
    assert any(
        "remains unflown, as a gap: one battery is enough only for the transits" in line for line in reported.lines
    )


def test_a_gain_is_a_waypoint_or_a_part_of_a_leg(tmp_path: Path) -> None:
    flown = job(tmp_path, 1, 1, 0.0)
    points = flown.route.waypoints_m
    require_gain(flown, replace(flown, route=Route(points[1:])))
    nearer = points.copy()
    nearer[0] += 0.5 * (points[1] - points[0])
    require_gain(flown, replace(flown, route=Route(nearer)))
    with pytest.raises(InfeasibleError):
        require_gain(flown, flown)


def test_an_empty_battery_does_not_keep_the_others_waiting(tmp_path: Path) -> None:
    """Before the first take-off none starts; later its sorties go to the others."""
    reported = fly_script(jobs_of(tmp_path), {}, percent={2: 40})
    assert sum("for sortie 2; change the battery" in line for line in reported.lines) == 1
    assert reported.landed() == {"001", "002+", "003", "004"}
    assert reported.record("002").began_s is None
    reported = fly_script(jobs_of(tmp_path / "b"), {}, percent={1: 40})
    assert reported.landed() == set()
    assert reported.flight.called_off
    assert "one vehicle is not ready, so no vehicle was started" in reported.lines
