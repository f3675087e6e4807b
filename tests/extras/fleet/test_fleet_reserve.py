"""A vehicle flies home in time: at its landing the reserve is there, whatever the wind makes of the battery."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.extras.fleet.scripted_fleet import SITE
from uavcover.extras.fleet.sortie import ReserveWatch
from uavcover.flight.watch import BatteryUse
from uavcover.model.vehicle import Vehicle

VEHICLE = Vehicle(endurance_s=600.0, reserve_fraction=0.2)


def flown(use: float, *, use_home: float, mission_s: float) -> tuple[float, float]:
    """Fly out for a third, across, and back; the battery at the landing in percent, and the share of the mission flown.

    Args:
        use: how much more the battery gives than the endurance says, on the mission.
        use_home: on the way home, after 20 s of stopping.
        mission_s: as planned, with 15 s for each of take-off and landing.
    """
    battery, left = BatteryUse(VEHICLE, 100.0 / 600.0), 100.0
    for second in range(math.ceil(mission_s)):
        away_s = min(second, mission_s - second, mission_s / 3.0)
        if second % 2 == 0:
            battery.take(math.floor(left), aloft_s=float(second))
            home_s = away_s + 15.0
            if not battery.allows_on(rest_s=mission_s - second, home_s=home_s):
                return left - (20.0 * use + home_s * use_home) / 6.0, second / mission_s
        left -= use / 6.0
    return left, 1.0


@pytest.mark.parametrize("use", [0.9, 1.0, 1.05, 1.1, 1.2, 1.4, 1.8])
@pytest.mark.parametrize("mission_s", [240.0, 400.0, 470.0, 480.0])
def test_the_reserve_is_there_at_the_landing(use: float, mission_s: float) -> None:
    left, _ = flown(use, use_home=1.2 * use, mission_s=mission_s)
    assert left >= 20.0


@pytest.mark.parametrize(("use", "mission_s"), [(0.9, 480.0), (1.0, 440.0), (1.2, 370.0)])
def test_a_flight_that_keeps_it_is_flown_to_the_end(use: float, mission_s: float) -> None:
    assert flown(use, use_home=use, mission_s=mission_s)[1] == 1.0


def test_it_does_not_come_home_much_too_early() -> None:
    left, fraction = flown(1.3, use_home=1.3, mission_s=480.0)
    assert left <= 45.0
    assert fraction >= 0.25


def test_no_way_home_is_shorter_than_the_mission_itself() -> None:
    battery = BatteryUse(VEHICLE, 100.0 / 600.0)
    battery.take(95, aloft_s=30.0)
    battery.take(10, aloft_s=400.0)
    assert battery.allows_on(rest_s=60.0, home_s=50.0)
    assert not battery.allows_on(rest_s=160.0, home_s=50.0)


def watch(monkeypatch: pytest.MonkeyPatch, percent: int | None, *, free: bool = True) -> ReserveWatch:
    monkeypatch.setattr("uavcover.extras.fleet.sortie.return_path", lambda *_: (np.zeros((2, 3)), 60.0))
    status = None if percent is None else SimpleNamespace(battery_remaining_percent=percent)
    connected: Any = SimpleNamespace(monitor=SimpleNamespace(latest=lambda _: status))
    traffic: Any = SimpleNamespace(
        lands_s=lambda _: 200.0,
        position_m=lambda _: np.zeros(3),
        give_return=lambda *_, within_s: free and within_s == 80.0,
    )
    job: Any = SimpleNamespace(name="001", site=SITE, battery_used=0.8, timeline=SimpleNamespace(duration_s=240.0))
    return ReserveWatch(job, connected, traffic)


def test_it_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    said = watch(monkeypatch, 45).must_go_home(0.0, aloft_s=100.0)
    assert said is not None
    assert said.startswith(
        "the battery has 45 % left and loses 20.0 % per minute: the return takes 60 s and the remaining"
    )
    assert "would use the reserve of 20 %" in said


def test_a_vehicle_that_tells_nothing_of_its_battery_flies_on(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watch(monkeypatch, None).must_go_home(0.0, aloft_s=100.0) is None
    assert watch(monkeypatch, 90).must_go_home(0.0, aloft_s=100.0) is None


def test_while_its_way_home_is_not_free_it_flies_on(monkeypatch: pytest.MonkeyPatch) -> None:
    assert watch(monkeypatch, 45, free=False).must_go_home(0.0, aloft_s=100.0) is None


def test_a_battery_that_tells_of_no_use_is_taken_to_be_used_as_planned() -> None:
    battery = BatteryUse(VEHICLE, 100.0 / 600.0)
    battery.take(100, aloft_s=30.0)
    battery.take(100, aloft_s=120.0)
    assert battery.each_s == 100.0 / 600.0
    assert battery.may_wait_s(60.0) == pytest.approx(79.0 * 6.0 - 1.05 * 60.0)
