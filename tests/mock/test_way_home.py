"""The mock's own return, against the prediction that shares no code with it; seeds and parameters as scripts/fly_failsafes.py."""

import pytest

from sitl_tests.returns import FailsafeCase, compare, fly_on_mock, make_case
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


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_many_returns_are_flown_as_predicted(autopilot: AutopilotName) -> None:
    ended = [flown(seed, autopilot) for seed in range(100, 200)]
    assert any(crashed for _, crashed in ended)
