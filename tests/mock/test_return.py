"""The mock's own return, against the prediction that shares no code with it; seeds and parameters as fly_failsafes.py."""

import math

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, Mode
from mission_io.wire import messages as m
from sitl_tests.compared_returns import compare
from sitl_tests.returns import HOME, FailsafeCase, fly_on_mock, make_case, make_return_case
from uavcover.mock.body import Trail
from uavcover.mock.itinerary import Step, StepKind
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.vehicle import AutopilotName

TRIGGERS = ("commanded", "ground station", "fence", "battery")


def flown(seed: int, autopilot: AutopilotName) -> tuple[FailsafeCase, bool]:
    case = make_case(seed, autopilot, triggers=TRIGGERS)
    track = fly_on_mock(case)
    compared = compare(case, track, flat=False)
    assert compared.is_near, (case, compared)
    assert compared.is_foretold, (case, compared)
    return case, track.crashed


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_returns_are_flown_as_predicted(autopilot: AutopilotName) -> None:
    cases = [flown(seed, autopilot)[0] for seed in (0, 2, 4, 6)]
    assert {case.trigger for case in cases} == set(TRIGGERS)
    assert any(case.rally for case in cases)


@pytest.mark.long
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_many_returns_are_flown_as_predicted(autopilot: AutopilotName) -> None:
    ended = [flown(seed, autopilot) for seed in range(90, 190)]
    assert any(crashed for _, crashed in ended)


PATHS: list[tuple[AutopilotName, float]] = [("px4", float(kind)) for kind in (1, 2, 3, 4)]
PATHS += [("ardupilot", 1.0), ("ardupilot", 2.0)]


def flown_path(seed: int, autopilot: AutopilotName, kind: float) -> FailsafeCase:
    case = make_return_case(seed, autopilot, kind=kind)
    compared = compare(case, fly_on_mock(case), flat=False)
    assert compared.is_near, (case, compared)
    assert compared.is_foretold, (case, compared)
    return case


@pytest.mark.parametrize(("autopilot", "kind"), PATHS)
def test_returns_along_the_mission_or_the_flown_path_are_flown_as_predicted(
    autopilot: AutopilotName, kind: float
) -> None:
    cases = [flown_path(seed, autopilot, kind) for seed in (0, 3, 5)]
    assert len({(case.trigger, case.ends) for case in cases}) > 1


@pytest.mark.long
@pytest.mark.parametrize(("autopilot", "kind"), PATHS)
def test_many_returns_along_the_mission_or_the_flown_path_are_flown_as_predicted(
    autopilot: AutopilotName, kind: float
) -> None:
    for seed in range(200, 240):
        flown_path(seed, autopilot, kind)


def aloft(**parameters: float) -> MockVehicle:
    """An ArduCopter in the air, 30 m above home, that has flown 80 m to the east and 60 m to the north."""
    vehicle = MockVehicle(ARDUPILOT, HOME, MockConfig())
    vehicle.advance(5.0)
    for name, value in parameters.items():
        vehicle.parameters.put(name, value)
    vehicle.control.set_mode(Mode.GUIDED)
    vehicle.control.arm()
    speeds = vehicle.settings.speeds
    positions = [(0.0, 0.0, 30.0), (80.0, 0.0, 30.0), (80.0, 60.0, 30.0)]
    vehicle.follow([Step(None, StepKind.GO, speeds, position, 1.0) for position in positions])
    vehicle.advance(45.0)
    vehicle.outgoing()
    return vehicle


def words(vehicle: MockVehicle) -> list[str]:
    return [message.text for message in vehicle.outgoing() if isinstance(message, m.StatusText)]


def lands_at(vehicle: MockVehicle) -> tuple[float, list[tuple[float, float, float]]]:
    """How far from home it lands, and its way there."""
    now, path = vehicle.powered_s, []
    while vehicle.flying and now < 400.0:
        now += 1.0
        vehicle.advance(now)
        path.append(vehicle.body.point.position_m)
    return math.hypot(*vehicle.body.point.position_m[:2]), path


@pytest.mark.parametrize(
    ("parameter", "value", "unavailable", "mode", "said"),
    [
        ("BATT_FS_LOW_ACT", 3, False, 21, "changed to SmartRTL Mode"),
        ("BATT_FS_CRT_ACT", 4, False, 21, "changed to SmartRTL Mode"),
        ("FENCE_ACTION", 3, False, 21, "changed to SmartRTL Mode"),
        ("FENCE_ACTION", 5, True, 9, "changed to LAND Mode"),
        ("FS_GCS_ENABLE", 4, False, 21, "changed to SmartRTL Mode"),
        ("BATT_FS_LOW_ACT", 3, True, 6, "SmartRTL Unavailable, Trying RTL Mode"),
        ("FS_GCS_ENABLE", 4, True, 9, "SmartRTL Unavailable, Using Land Mode"),
    ],
)
def test_failsafes_choose_smartrtl_and_fall_back_where_it_is_not_available(
    parameter: str, value: float, unavailable: bool, mode: int, said: str
) -> None:
    vehicle = aloft(**({"SRTL_POINTS": 0.0} if unavailable else {}), **{parameter: value})
    match parameter:
        case "FENCE_ACTION":
            for name, limit in (("FENCE_ENABLE", 1.0), ("FENCE_TYPE", 1.0), ("FENCE_ALT_MAX", 20.0)):
                vehicle.parameters.put(name, limit)
        case "FS_GCS_ENABLE":
            vehicle.receive(m.Received(m.Heartbeat(8, 6), 255, 190), vehicle.powered_s)
            vehicle.advance(vehicle.powered_s + 6.0)
        case _:
            vehicle.parameters.put("BATT_LOW_MAH" if "LOW" in parameter else "BATT_CRT_MAH", 1e6)
    vehicle.advance(vehicle.powered_s + 1.0)
    assert vehicle.custom_mode == mode
    assert any(said in text for text in words(vehicle))


def test_smartrtl_flies_its_own_track_back_and_cuts_across_where_that_meets_itself() -> None:
    vehicle = aloft()
    vehicle.control.set_mode(Mode.RETURN, number=21)
    off_m, path = lands_at(vehicle)
    assert off_m < 1.0
    assert min(math.dist(position, (80.0, 0.0, 30.0)) for position in path) < 8.0, "back around the corner"
    vehicle = aloft()
    speeds = vehicle.settings.speeds
    loop = [(80.0, 60.0, 30.0), (-40.0, 60.0, 30.0), (-40.0, -30.0, 30.0), (40.0, -30.0, 30.0), (40.0, 30.0, 30.0)]
    vehicle.follow([Step(None, StepKind.GO, speeds, position, 1.0) for position in loop])
    vehicle.advance(vehicle.powered_s + 90.0)
    vehicle.control.set_mode(Mode.RETURN, number=21)
    off_m, path = lands_at(vehicle)
    assert off_m < 1.0
    assert max(position[1] for position in path) < 35.0, "the loop over the north is left out"


def test_smartrtl_ends_with_a_position_that_is_lost_and_with_a_full_buffer() -> None:
    trail = Trail()
    trail.begin((0.0, 0.0, 0.0), 0.0, accuracy_m=2.0, most=300.0)
    assert [trail.note(None, now) for now in (10.0, 16.0)] == [None, "SmartRTL deactivated: bad position"]
    trail.begin((0.0, 0.0, 0.0), 0.0, accuracy_m=2.0, most=20.0)
    rng, now = np.random.default_rng(0), 0.0
    said = None
    while said is None and now < 300.0:
        now += 1.0
        east, north, up = (100.0 * rng.random(3)).tolist()
        said = trail.note((east, north, 50.0 * now + up), now)  # nothing to simplify, no loops
    assert said == "SmartRTL deactivated: buffer full"
    assert not trail.is_active
