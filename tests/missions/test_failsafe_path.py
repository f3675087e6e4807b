"""What ArduCopter and PX4 fly by themselves, each case reckoned by hand from the autopilots' sources."""

import numpy as np
import pytest
import shapely

from uavcover.errors import UavcoverError
from uavcover.missions.failsafe_path import direct_return, predict
from uavcover.missions.failsafes import (
    HOME,
    IN_PLACE,
    Destinations,
    FlightStates,
    _check,
    failsafe_parameter_groups,
    failsafe_settings,
)

HOME_M = np.array([0.0, 0.0, 400.0])


def states(*positions, velocity=(0.0, 0.0), leg=1):
    n = len(positions)
    return FlightStates(
        np.array(positions, float),
        np.tile(velocity, (n, 1)),
        np.arange(n, dtype=float),
        np.full(n, leg, dtype=np.int64),
    )


def to(*rally, **kwargs):
    route = kwargs.pop("route", [(0.0, 0.0, 430.0), (500.0, 0.0, 430.0), (0.0, 0.0, 430.0)])
    return Destinations(HOME_M, np.array(rally, float).reshape(-1, 3), np.array(route, float), **kwargs)


def flat(east_north_m):
    return np.full(len(east_north_m), 400.0)


def path(autopilot, parameters, position, *rally, ground=flat, velocity=(0.0, 0.0), **kwargs):
    """(j, 3) heights above home of the commanded return."""
    settings = failsafe_settings(autopilot, parameters)
    paths = direct_return(settings, states(position, velocity=velocity), to(*rally, **kwargs), ground)
    return paths.path_m(0) - [0.0, 0.0, 400.0], int(paths.destinations[0])


def test_arducopter_climbs_to_its_return_height_and_lands_at_home():
    line, number = path("ardupilot", {"RTL_ALT": 6000.0}, (300.0, 0.0, 430.0))
    assert number == HOME
    assert line.tolist() == [[300, 0, 30], [300, 0, 60], [0, 0, 60], [0, 0, 0]]
    line, _ = path("ardupilot", {}, (300.0, 0.0, 430.0))  # higher than RTL_ALT: stays at its height
    assert line.tolist() == [[300, 0, 30], [0, 0, 30], [0, 0, 0]]


def test_arducopter_climbs_by_rtl_climb_min_and_no_higher_than_its_cone():
    line, _ = path("ardupilot", {"RTL_ALT_M": 15.0, "RTL_CLIMB_MIN": 1000.0}, (300.0, 0.0, 430.0))
    assert line[1].tolist() == [300, 0, 40]
    line, _ = path("ardupilot", {"RTL_ALT": 9000.0}, (10.0, 0.0, 405.0))
    assert line[1].tolist() == [10, 0, 30]  # RTL_CONE_SLOPE 3
    line, _ = path("ardupilot", {"RTL_ALT": 9000.0, "RTL_CONE_SLOPE": 0.0}, (10.0, 0.0, 405.0))
    assert line[1].tolist() == [10, 0, 90]


def test_arducopters_fence_caps_the_return_but_never_makes_it_descend():
    fence = {"RTL_ALT": 15000.0, "FENCE_ENABLE": 1.0, "FENCE_ALT_MAX": 100.0, "FENCE_MARGIN": 2.0}
    line, _ = path("ardupilot", fence, (300.0, 0.0, 430.0))
    assert line[1].tolist() == [300, 0, 98]
    line, _ = path("ardupilot", fence, (300.0, 0.0, 530.0))
    assert line[1].tolist() == [0, 0, 130]


def test_arducopter_takes_the_nearest_rally_point_within_its_limit():
    near, far = (200.0, 0.0, 450.0), (900.0, 0.0, 450.0)
    _, number = path("ardupilot", {}, (350.0, 0.0, 430.0), near, far)
    assert number == 0
    _, number = path("ardupilot", {}, (550.0, 0.0, 430.0), near, far)  # 350 m from both, RALLY_LIMIT_KM is 0.3
    assert number == HOME
    _, number = path("ardupilot", {"RALLY_LIMIT_KM": 0.0}, (550.0, 0.0, 430.0), near, far)
    assert number == 0
    _, number = path("ardupilot", {}, (90.0, 0.0, 430.0), near)  # RALLY_INCL_HOME: home is nearer
    assert number == HOME
    _, number = path("ardupilot", {"RALLY_INCL_HOME": 0.0}, (90.0, 0.0, 430.0), near)
    assert number == 0


def test_a_rally_point_at_home_does_not_raise_arducopters_return():
    line, number = path("ardupilot", {}, (200.0, 0.0, 410.0), (0.0, 0.0, 490.0))
    assert number == HOME
    assert line[1].tolist() == [200, 0, 15]


def test_arducopter_returns_at_the_height_of_a_rally_point_that_is_higher():
    line, _ = path("ardupilot", {}, (350.0, 0.0, 430.0), (200.0, 0.0, 480.0))
    assert line.tolist() == [[350, 0, 30], [350, 0, 80], [200, 0, 80], [200, 0, 0]]


def test_arducopter_leaves_out_rally_points_outside_its_enabled_fence():
    fence = shapely.box(-100.0, -100.0, 100.0, 100.0)
    outside, inside = (200.0, 0.0, 430.0), (80.0, 60.0, 430.0)
    _, number = path("ardupilot", {"FENCE_ENABLE": 1.0}, (180.0, 0.0, 430.0), outside, inside, fence=fence)
    assert number == 1
    _, number = path("ardupilot", {}, (180.0, 0.0, 430.0), outside, inside, fence=fence)
    assert number == 0


def test_issue_31968_rtl_alt_final_counts_from_home_and_not_from_the_rally_point():
    line, _ = path(
        "ardupilot", {"RTL_ALT": 6000.0, "RTL_ALT_FINAL": 1000.0}, (350.0, 0.0, 430.0), (200.0, 0.0, 440.0),
        ground=lambda en: np.where(en[:, 0] > 100.0, 440.0, 400.0),
    )  # fmt: skip
    assert line[-1].tolist() == [200, 0, 10]  # 30 m below the ground there


def test_arducopter_over_terrain_keeps_its_height_above_it():
    settings = failsafe_settings("ardupilot", {"RTL_ALT": 3000.0, "RTL_ALT_TYPE": 1.0})
    hill = lambda en: 400.0 + np.where(abs(en[:, 0] - 150.0) < 60.0, 50.0, 0.0)  # noqa: E731
    over, without = [
        each for each in predict(settings, states((300.0, 0.0, 420.0)), to(), hill) if not each.responses[0].parameter
    ]
    assert over.path_m(0)[:, 2].max() == 480.0
    assert without.note
    assert without.path_m(0)[:, 2].max() == 430.0


def test_a_fast_arducopter_climbs_where_it_comes_to_rest():
    line, _ = path("ardupilot", {"RTL_ALT": 6000.0}, (300.0, 0.0, 430.0), velocity=(0.0, 10.0))
    assert line[1].tolist() == [300, 21.25, 30]  # v^2 / 2a + a / 2 kp^2
    assert line[2].tolist() == [300, 21.25, 60]


def test_px4_returns_above_the_destination_and_lands_or_waits_above_it():
    line, number = path("px4", {"RTL_RETURN_ALT": 60.0}, (300.0, 0.0, 430.0))
    assert number == HOME
    assert line.tolist() == [[300, 0, 30], [300, 0, 60], [0, 0, 60], [0, 0, 0]]
    line, _ = path("px4", {"RTL_LAND_DELAY": 5.0}, (300.0, 0.0, 420.0))  # rc.mc_defaults: 30 m and 10 m
    assert line.tolist() == [[300, 0, 20], [300, 0, 30], [0, 0, 30], [0, 0, 10], [0, 0, 0]]
    line, _ = path("px4", {"RTL_LAND_DELAY": -1.0}, (300.0, 0.0, 430.0))
    assert line[-1].tolist() == [0, 0, 10]


def test_px4_counts_its_heights_from_the_safe_point():
    line, number = path(
        "px4",
        {"RTL_LAND_DELAY": 5.0, "RTL_RETURN_ALT": 60.0, "RTL_DESCEND_ALT": 30.0},
        (350.0, 0.0, 430.0),
        (200.0, 0.0, 350.0),
    )
    assert number == 0
    assert line.tolist() == [[350, 0, 30], [200, 0, 30], [200, 0, -20], [200, 0, 0]]


def test_px4_ignores_safe_points_at_home_and_those_nearer_by_less_than_2_m():
    assert path("px4", {}, (300.0, 0.0, 430.0), (8.0, 0.0, 400.0))[1] == HOME
    assert path("px4", {}, (300.0, 0.0, 430.0), (12.0, 0.0, 400.0))[1] == 0
    assert path("px4", {}, (301.0, 0.0, 430.0), (600.0, 0.0, 400.0))[1] == HOME
    assert path("px4", {"RTL_TYPE": 1.0}, (10.0, 0.0, 430.0), (600.0, 0.0, 400.0))[1] == 0


@pytest.mark.parametrize(("distance_m", "up_m"), [(1.5, 3.0), (8.0, 8.0), (9.0, 9.0), (11.0, 60.0)])
def test_px4s_cone_holds_within_rtl_min_dist(distance_m, up_m):
    line, _ = path("px4", {"RTL_CONE_ANG": 45.0, "RTL_RETURN_ALT": 60.0}, (distance_m, 0.0, 401.0))
    assert line[1, 2] == pytest.approx(up_m)


def test_responses_follow_the_parameters_and_name_what_was_assumed():
    settings = failsafe_settings("ardupilot", {"FS_GCS_ENABLE": 5.0, "BATT_FS_CRT_ACT": 2.0, "FS_THR_ENABLE": 0.0})
    said = {str(one): one.action for one in settings.responses}
    assert said["commanded"] == "return"
    assert said["ground station lost (FS_GCS_ENABLE 5)"] == "land"
    assert said["battery critical (BATT_FS_CRT_ACT 2)"] == "return"
    assert said["position estimate lost (FS_EKF_ACTION 1, its default)"] == "land"
    assert not any(word.startswith(("remote", "fence")) for word in said)
    assert "RTL_ALT" in settings.assumed
    assert "FS_GCS_ENABLE" not in settings.assumed
    going_on = failsafe_settings("ardupilot", {"FS_GCS_ENABLE": 1.0, "FS_OPTIONS": 2.0})
    assert not any(one.parameter == "FS_GCS_ENABLE" for one in going_on.responses)
    assert ["RTL_ALT", "RTL_ALT_M"] in failsafe_parameter_groups("ardupilot")


def test_landing_in_place_and_retracing_are_paths_too():
    settings = failsafe_settings("ardupilot", {"FS_GCS_ENABLE": 3.0, "FS_EKF_ACTION": 1.0, "FS_THR_ENABLE": 0.0})
    found = predict(settings, states((300.0, 0.0, 430.0)), to(), flat)
    (down,) = [each for each in found if each.responses[0].action == "land"]
    assert down.destinations.tolist() == [IN_PLACE]
    assert down.path_m(0).tolist() == [[300, 0, 430], [300, 0, 400]]
    back, otherwise = [each for each in found if each.responses[0].action == "retrace"]
    assert back.path_m(0).tolist() == [[300, 0, 430], [0, 0, 430], [0, 0, 402], [0, 0, 400]]
    assert otherwise.note


def test_px4_holds_before_a_failsafe_and_brakes_there():
    settings = failsafe_settings(
        "px4",
        {"NAV_DLL_ACT": 2.0, "NAV_RCL_ACT": 0.0, "COM_POS_LOW_ACT": 0.0, "GF_ACTION": 0.0, "RTL_RETURN_ALT": 60.0},
    )
    commanded, failsafe = predict(settings, states((300.0, 0.0, 430.0), velocity=(0.0, 6.0)), to(), flat)
    stop_m = 6.0 * (6.0 / 6.0 + 3.0 / 4.0)
    assert failsafe.path_m(0)[2].tolist() == [300, stop_m, 460]
    assert commanded.path_m(0)[3].tolist() == [300, 0, 460]
    assert failsafe.duration_s[0] > commanded.duration_s[0]


def test_px4_flies_to_the_missions_landing_when_its_type_says_so():
    settings = failsafe_settings("px4", {"RTL_TYPE": 3.0, "RTL_RETURN_ALT": 60.0})
    positions = to(landing=2)
    first = predict(settings, states((300.0, 0.0, 430.0)), positions, flat)[0]
    assert first.path_m(0).tolist() == [[300, 0, 430], [300, 0, 460], [0, 0, 460], [0, 0, 400]]  # as to home


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"actions": {"1": "fly away"}}, "'fly away' is not an action"),
        ({"surprise": 1}, "keys are actions, continues"),
    ],
)
def test_a_table_that_is_not_understood_is_refused(change, words):
    rule = {"trigger": "t", "parameter": "P", "default": 0, "other": "none", "actions": {"0": "none"}}
    _check("px4", {"settings": {}, "failsafes": [rule]})
    with pytest.raises(UavcoverError, match=words):
        _check("px4", {"settings": {}, "failsafes": [{**rule, **change}]})
    with pytest.raises(UavcoverError, match=r"px4\.settings\.height_m: set names"):
        _check("px4", {"settings": {"height_m": {"names": {}, "default": 1.0}}, "failsafes": []})
