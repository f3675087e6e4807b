"""Fence, battery, ground station: the mock vehicle acts as its parameters say."""

import struct

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Mode
from mission_io.model.enums import CommandResult
from mission_io.model.items import Command, Fence, FenceCircle, FencePolygon, LatLon, MissionType, items_from_fence
from mission_io.wire import messages as m
from tests.flight.scene import HOME, above_home
from tests.mock.bench import Bench, go, ready
from uavcover.mock.dynamics import BatteryData

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
STATION = m.Heartbeat(8, 6)


def set_parameter(bench: Bench, name: str, value: float) -> None:
    whole = bench.vehicle.autopilot is PX4 and float(value).is_integer() and name not in ("GF_MAX_VER_DIST",)
    bench.send(m.ParamSet(1, 1, name, struct.unpack("<f", struct.pack("<i", int(value)))[0] if whole else value))
    assert bench.vehicle.parameters[name] == pytest.approx(value)


def box(half_m: float) -> FencePolygon:
    corners = [(-half_m, -half_m), (-half_m, half_m), (half_m, half_m), (half_m, -half_m)]
    return FencePolygon(tuple(LatLon(*above_home((e, n, 0.0))[:2]) for e, n in corners))


def keep_out() -> FenceCircle:
    return FenceCircle(LatLon(*above_home((0.0, 90.0, 0.0))[:2]), 20.0, inclusion=False)


def fenced(autopilot, fence: Fence, **options) -> Bench:
    bench = ready(autopilot, **options)
    bench.upload(items_from_fence(fence), MissionType.FENCE)
    if autopilot is ARDUPILOT:
        set_parameter(bench, "FENCE_ENABLE", 1)
    return bench


def texts(bench: Bench) -> str:
    return " | ".join(text.text for text in bench.heard(m.StatusText))


@BOTH
@pytest.mark.parametrize("fence", [Fence((box(60.0),)), Fence((), (keep_out(),))], ids=["polygon", "circle"])
def test_a_fence_breach_is_told_and_acted_on(autopilot, fence):
    bench = fenced(autopilot, fence)
    bench.take_off(go(0, 300, 20))
    bench.run(25.0)
    assert bench.vehicle.mode is (Mode.RETURN if autopilot is ARDUPILOT else Mode.HOLD)
    assert "fence breached" in texts(bench) or "Geofence violation" in texts(bench)
    assert bench.vehicle.body.point.position_m[1] < 95.0


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.MISSION), (1, Mode.RETURN), (2, Mode.LAND), (4, Mode.HOLD)])
def test_the_action_is_the_parameters(action, mode):
    bench = fenced(ARDUPILOT, Fence((box(60.0),)))
    set_parameter(bench, "FENCE_ACTION", action)
    bench.take_off(go(0, 300, 20))
    bench.run(15.0)
    assert bench.vehicle.mode is mode
    assert "Polygon fence breached" in texts(bench)


def test_ardupilot_minds_no_fence_that_is_not_enabled():
    bench = fenced(ARDUPILOT, Fence((box(60.0),)))
    set_parameter(bench, "FENCE_ENABLE", 0)
    bench.take_off(go(0, 300, 20))
    bench.run(25.0)
    assert bench.vehicle.mode is Mode.MISSION


@BOTH
def test_heights_and_distances_are_fences_too(autopilot):
    bench = fenced(autopilot, Fence())
    set_parameter(bench, "FENCE_ALT_MAX" if autopilot is ARDUPILOT else "GF_MAX_VER_DIST", 50)
    bench.take_off(go(0, 30, 90))
    bench.run(25.0)
    assert "Max Alt" in texts(bench)
    assert bench.vehicle.mode is not Mode.MISSION


@BOTH
def test_outside_of_its_fence_it_does_not_arm(autopilot):
    away = FencePolygon(tuple(LatLon(HOME.lat_deg + 0.01 + d, HOME.lon_deg + e) for d, e in ((0, 0), (0, 1), (1, 0))))
    bench = fenced(autopilot, Fence((away,)))
    bench.set_mode(Mode.GUIDED)
    assert bench.command(Command.COMPONENT_ARM_DISARM, 1.0) is not CommandResult.ACCEPTED
    assert "fence" in texts(bench).lower()


@BOTH
def test_a_battery_that_runs_low_is_told_and_brings_it_home_when_told_to(autopilot):
    bench = ready(autopilot, battery=BatteryData(endurance_s=100.0))
    if autopilot is ARDUPILOT:
        set_parameter(bench, "BATT_LOW_MAH", 0.3 * bench.vehicle.body.battery.capacity_mah)
        set_parameter(bench, "BATT_FS_LOW_ACT", 2)
    else:
        set_parameter(bench, "COM_LOW_BAT_ACT", 3)
    bench.take_off(go(0, 80, 20, hold_s=600.0))
    while bench.vehicle.armed:
        bench.run(1.0)
        assert bench.now < 200.0
    assert "Battery" in texts(bench) or "battery" in texts(bench)
    remaining = [status.battery_remaining_percent for status in bench.heard(m.SysStatus)]
    assert remaining == sorted(remaining, reverse=True)
    levels = [status.charge_state for status in bench.heard(m.BatteryStatus)]
    assert levels == sorted(levels)
    assert set(levels) == {1, 2, 3}


@BOTH
def test_an_empty_battery_lets_it_fall(autopilot):
    bench = ready(autopilot, battery=BatteryData(endurance_s=40.0))
    bench.take_off(go(0, 80, 20, hold_s=600.0))
    bench.run(60.0)
    assert bench.vehicle.body.crashed
    assert "Battery 1 is empty" in texts(bench)


@BOTH
def test_a_lost_ground_station_is_minded_only_when_told_to(autopilot):
    for reported in (False, True):
        bench = ready(autopilot)
        if reported:
            set_parameter(bench, "FS_GCS_ENABLE" if autopilot is ARDUPILOT else "NAV_DLL_ACT", 1 + (autopilot is PX4))
        bench.take_off(go(0, 900, 20))
        for _ in range(10):
            bench.send(STATION)
            bench.run(1.0)
        assert bench.vehicle.mode is Mode.MISSION
        bench.run(15.0)
        assert bench.vehicle.mode is (Mode.RETURN if reported else Mode.MISSION)
