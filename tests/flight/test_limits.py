"""The table before arming: what is reported, what keeps the vehicle on the ground, what is set and put back.

Also told: from where the vehicle's own return is unsafe, by the vehicle's real parameters.
"""

import dataclasses
import itertools
import random
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.errors import VehicleSilentError
from mission_io.model.items import FramedPoint
from mission_io.wire import messages as m
from tests.flight.scene import HOME, make_scene, mission, plan_for
from tests.missions.compiled_routes import compiled, route
from tests.planner.sites import make_site, ridge
from uavcover.flight.limits import limit_table, parameter_groups, read_parameters, return_warnings
from uavcover.flight.orders import FlightTimeouts, OnBreach, OperatingVolume, PlanNeeds, Precautions
from uavcover.flight.parameter_rules import Weight
from uavcover.flight.session import Session
from uavcover.kernels.flight_time import Pace
from uavcover.missions.return_advice import OwnReturns
from uavcover.mock.behaviour import Settings
from uavcover.mock.faults import parse_fault
from uavcover.model.track import Ending, EventKind, FlightEvent, FlightFailedError

AUTOPILOTS = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
FINE = {
    False: {
        "WPNAV_SPEED": 1000.0, "WPNAV_SPEED_UP": 400.0, "WPNAV_SPEED_DN": 300.0, "WPNAV_ACCEL": 250.0, "WPNAV_JERK": 1.0,
        "RTL_ALT": 6000.0,
        "FENCE_ENABLE": 1.0, "FENCE_TYPE": 7.0, "FENCE_ACTION": 1.0, "FENCE_ALT_MAX": 120.0, "FENCE_RADIUS": 400.0,
        "BATT_FS_LOW_ACT": 2.0, "BATT_FS_CRT_ACT": 1.0, "FS_GCS_ENABLE": 1.0,
    },
    True: {
        "MPC_XY_CRUISE": 10.0, "MPC_Z_V_AUTO_UP": 4.0, "MPC_Z_V_AUTO_DN": 3.0, "MPC_ACC_HOR": 3.0, "MPC_JERK_AUTO": 4.0,
        "RTL_RETURN_ALT": 60.0,
        "GF_ACTION": 2.0, "GF_MAX_VER_DIST": 120.0, "GF_MAX_HOR_DIST": 400.0, "COM_LOW_BAT_ACT": 3.0, "NAV_DLL_ACT": 2.0,
    },
}  # fmt: skip


def the_plan(**changes):
    needs = PlanNeeds(pace=Pace(8.0, 4.0, 3.0), return_height_m=60.0, fence=True, **changes)
    around = OperatingVolume(
        ground_up_m=lambda _e, _n: 12.5,
        outside_fence_m=lambda _e, _n: 0.0,
        min_height_agl_m=40.0,
        max_height_agl_m=80.0,
    )
    return dataclasses.replace(plan_for(mission()), max_climb_m_s=4.0, max_descent_m_s=3.0, needs=needs, volume=around)


def table(px4: bool, plan=None, *, home_off_m: float = 0.0, **changes: float | None):
    values = {k: v for k, v in {**FINE[px4], **changes}.items() if v is not None}
    home_m = HOME.alt_amsl_m + home_off_m
    rows = limit_table(values, plan or the_plan(longest_flight_s=600.0), px4=px4, home_alt_amsl_m=home_m)
    return {row.parameter or row.what: row for row in rows}


@pytest.mark.parametrize("px4", [False, True], ids=["ArduPilot", "PX4"])
def test_a_vehicle_that_is_set_as_planned_has_a_whole_table_and_no_warning(px4):
    rows = table(px4)
    assert {r.weight for r in rows.values()} <= {Weight.NONE}
    assert set(FINE[px4]) <= set(rows)
    assert {"flight time", "home altitude above sea level"} <= set(rows)
    assert all(row.line.count(" | ") == 3 for row in rows.values())


@pytest.mark.parametrize(
    ("px4", "changes", "name", "weight", "wanted"),
    [
        (False, {"WPNAV_SPEED_UP": 250.0}, "WPNAV_SPEED_UP", Weight.WARNING, 400.0),
        (True, {"MPC_Z_V_AUTO_DN": 1.5}, "MPC_Z_V_AUTO_DN", Weight.WARNING, 3.0),
        (False, {"RTL_ALT": 1500.0}, "RTL_ALT", Weight.WARNING, 6000.0),
        (True, {"RTL_RETURN_ALT": 30.0}, "RTL_RETURN_ALT", Weight.WARNING, 60.0),
        (False, {"FENCE_ENABLE": 0.0}, "FENCE_ENABLE", Weight.WARNING, 1.0),
        (False, {"FENCE_TYPE": 3.0}, "FENCE_TYPE", Weight.WARNING, 7.0),
        (False, {"FENCE_ALT_MAX": 69.0}, "FENCE_ALT_MAX", Weight.REFUSED, 81.0),
        (False, {"FENCE_ALT_MAX": 69.0, "FENCE_ACTION": 0.0}, "FENCE_ALT_MAX", Weight.NOTE, None),
        (False, {"FENCE_ALT_MAX": 69.0, "FENCE_ENABLE": 0.0}, "FENCE_ALT_MAX", Weight.NOTE, 81.0),
        (False, {"FENCE_RADIUS": 100.0}, "FENCE_RADIUS", Weight.REFUSED, 212.0),
        (True, {"GF_MAX_VER_DIST": 69.0}, "GF_MAX_VER_DIST", Weight.REFUSED, 81.0),
        (True, {"GF_MAX_HOR_DIST": 100.0}, "GF_MAX_HOR_DIST", Weight.REFUSED, 212.0),
        (True, {"GF_MAX_VER_DIST": 69.0, "GF_ACTION": 1.0}, "GF_MAX_VER_DIST", Weight.NOTE, 81.0),
        (True, {"GF_ACTION": 0.0}, "GF_ACTION", Weight.WARNING, 2.0),
        (False, {"BATT_FS_LOW_ACT": 0.0}, "BATT_FS_LOW_ACT", Weight.NOTE, None),
        (True, {"NAV_DLL_ACT": 0.0}, "NAV_DLL_ACT", Weight.NOTE, None),
    ],
)  # fmt: skip
def test_each_difference_has_its_weight_and_what_the_plan_needs(px4, changes, name, weight, wanted):
    row = table(px4, **changes)[name]
    assert (row.weight, row.wanted) == (weight, wanted)


@pytest.mark.parametrize("px4", [False, True], ids=["ArduPilot", "PX4"])
def test_parameters_that_the_vehicle_does_not_have_make_no_row(px4):
    for name in FINE[px4]:
        assert name not in table(px4, **{name: None})


def test_newer_names_in_other_units_are_known():
    older = ("WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN", "WPNAV_ACCEL", "RTL_ALT")
    newer = {"WP_SPD": 10.0, "WP_SPD_UP": 2.5, "WP_SPD_DN": 3.0, "WP_ACC": 2.5, "RTL_ALT_M": 15.0}
    rows = table(False, **dict.fromkeys(older), **newer)
    assert set(newer) <= set(rows)
    assert (rows["WP_SPD_UP"].vehicle, rows["WP_SPD_UP"].wanted) == (2.5, 4.0)
    assert (rows["RTL_ALT_M"].vehicle, rows["RTL_ALT_M"].wanted) == (15.0, 60.0)
    assert {name for group in parameter_groups(px4=False) for name in group} >= {*older, *newer}


@pytest.mark.parametrize("px4", [False, True], ids=["ArduPilot", "PX4"])
@pytest.mark.parametrize("seed", range(20))
def test_endurance_is_judged_by_the_vehicles_own_values(px4, seed):
    rng = random.Random(seed)
    up, down, acceleration = rng.uniform(0.5, 6.0), rng.uniform(0.5, 6.0), rng.uniform(0.5, 5.0)
    scale = 1.0 if px4 else 100.0
    names = (
        ("MPC_Z_V_AUTO_UP", "MPC_Z_V_AUTO_DN", "MPC_ACC_HOR")
        if px4
        else ("WPNAV_SPEED_UP", "WPNAV_SPEED_DN", "WPNAV_ACCEL")
    )
    values = dict(zip(names, (up * scale, down * scale, acceleration * scale), strict=True))
    time_s = table(px4, the_plan(longest_flight_s=1e6), **values)["flight time"].vehicle
    still_s = table(px4, the_plan(longest_flight_s=1e6), **{**values, names[2]: None})["flight time"].vehicle
    assert time_s > still_s
    for endurance_s, weight in (
        (time_s + 0.2, Weight.NONE), (time_s - 0.2, Weight.WARNING),
        (still_s + 0.2, Weight.WARNING), (still_s - 0.2, Weight.REFUSED),
    ):  # fmt: skip
        assert table(px4, the_plan(longest_flight_s=endurance_s), **values)["flight time"].weight is weight


@pytest.mark.parametrize(
    ("off_m", "reported"), [(2.9, None), (-2.9, None), (3.1, "43.1 to 83.1"), (-8.0, "32.0 to 72.0")]
)
def test_home_in_height_says_what_it_does_to_the_band(off_m, reported):
    row = table(False, home_off_m=off_m)["home altitude above sea level"]
    assert row.weight is (Weight.NONE if reported is None else Weight.WARNING)
    assert reported is None or f"a band of 40 to 80 m becomes {reported} m" in row.matters


# In a flight.


def scene_with(autopilot, *faults: str, **parameters: float):
    scene = make_scene(autopilot, faults=[parse_fault(fault) for fault in faults])
    scene.upload(mission())
    for name, value in parameters.items():
        scene.vehicle.parameters.put(name, value)
    return scene


class Keeper:
    """Agrees, and remembers what it was told to keep."""

    def __init__(self, *, agrees: bool = True) -> None:
        self.agrees, self.requested, self.kept = agrees, [], [{}]

    def agree(self, text: str) -> bool:
        self.requested.append(text)
        return self.agrees

    def keep(self, values: Mapping[str, float]) -> None:
        self.kept.append(dict(values))

    def precautions(self, **options) -> Precautions:
        return Precautions(apply_limits=True, on_breach=OnBreach.TELL, agree=self.agree, keep=self.keep, **options)


LOW = {
    ARDUPILOT.name: {"RTL_ALT": 1500.0, "FENCE_ENABLE": 0.0, "FENCE_ALT_MAX": 50.0, "WPNAV_SPEED_UP": 250.0},
    PX4.name: {"RTL_RETURN_ALT": 30.0, "GF_ACTION": 1.0, "GF_MAX_VER_DIST": 50.0, "MPC_Z_V_AUTO_UP": 2.5},
}
SET = {
    ARDUPILOT.name: {"RTL_ALT": 6000.0, "FENCE_ENABLE": 1.0, "FENCE_ALT_MAX": 81.0, "WPNAV_SPEED_UP": 400.0},
    PX4.name: {"RTL_RETURN_ALT": 60.0, "GF_ACTION": 2.0, "GF_MAX_VER_DIST": 81.0, "MPC_Z_V_AUTO_UP": 4.0},
}


def values_of(scene, names) -> dict[str, float]:
    return {name: scene.vehicle.parameters[name] for name in names}


@AUTOPILOTS
def test_the_table_is_told_and_is_in_the_outcome(autopilot):
    scene = scene_with(autopilot, **LOW[autopilot.name])
    outcome = scene.fly(plan=the_plan())
    assert outcome.ending is Ending.LANDED
    rows = {row["parameter"]: row for row in outcome.as_json()["limits"]}
    for name in LOW[autopilot.name]:
        assert any(name in text and text.count(" | ") == 3 for text in scene.reported(EventKind.STAGE))
        assert rows[name]["weight"] in ("warning", "note")
    assert values_of(scene, LOW[autopilot.name]) == pytest.approx(LOW[autopilot.name])


@AUTOPILOTS
def test_a_fence_in_force_that_is_too_low_keeps_it_on_the_ground(autopilot):
    low = {"FENCE_ENABLE": 1.0, "FENCE_ALT_MAX": 60.0} if autopilot is ARDUPILOT else {"GF_MAX_VER_DIST": 60.0}
    scene = scene_with(autopilot, **low)
    with pytest.raises(
        FlightFailedError,
        match="the vehicle would interrupt it; the vehicle was not armed: set the parameter, or add --apply",
    ) as caught:
        scene.fly(plan=the_plan())
    assert caught.value.outcome.ending is Ending.NOT_ARMED
    assert not scene.vehicle.armed
    assert scene.samples == []


ENDS = {
    "landed": [], "stopped": [], "pilot lands it": ["pilot-mode:land@20s"], "failsafe": ["battery-failsafe:land@20s"],
    "arming refused": ["arming-refused@boot+6s"],
}  # fmt: skip


@AUTOPILOTS
@pytest.mark.parametrize("end", list(ENDS))
def test_what_the_plan_needs_is_set_and_put_back_however_it_ends(autopilot, end):
    scene, keeper = scene_with(autopilot, *ENDS[end], **LOW[autopilot.name]), Keeper()
    stops, in_flight = [0], {}

    def listen(event: FlightEvent) -> None:
        scene.events.append(event)
        if event.text == "in the air":
            in_flight.update(values_of(scene, LOW[autopilot.name]))
        if event.waypoint == 1 and end == "stopped":
            stops[0] = 1

    options = {"plan": the_plan(), "precautions": keeper.precautions(), "on_event": listen, "stop": lambda: stops[0]}
    if end in ("landed", "stopped"):
        scene.fly(**options)
    else:
        with pytest.raises(FlightFailedError):
            scene.fly(**options)
    if end != "arming refused":
        assert in_flight == pytest.approx(SET[autopilot.name])
    assert values_of(scene, LOW[autopilot.name]) == pytest.approx(LOW[autopilot.name])
    [requested] = keeper.requested
    assert all(name in requested for name in LOW[autopilot.name])
    assert keeper.kept[1] == pytest.approx(LOW[autopilot.name])
    assert keeper.kept[-1] == {}


@AUTOPILOTS
def test_who_does_not_agree_has_nothing_changed(autopilot):
    scene, keeper = scene_with(autopilot, **LOW[autopilot.name]), Keeper(agrees=False)
    assert scene.fly(plan=the_plan(), precautions=keeper.precautions()).ending is Ending.LANDED
    assert keeper.kept == [{}]
    assert values_of(scene, LOW[autopilot.name]) == pytest.approx(LOW[autopilot.name])


@AUTOPILOTS
def test_what_cannot_be_put_back_is_said_kept_and_put_back_by_the_next_flight(autopilot):
    scene, keeper = scene_with(autopilot, **LOW[autopilot.name]), Keeper()
    write = scene.client.set_parameter

    def refuse_on_ground(name, value, **options):
        if scene.vehicle.took_off_at_s is not None:
            raise VehicleSilentError(f"the vehicle did not report the parameter {name}")
        return write(name, value, **options)

    scene.client.set_parameter = refuse_on_ground
    assert scene.fly(plan=the_plan(), precautions=keeper.precautions()).ending is Ending.LANDED
    assert keeper.kept[-1] == pytest.approx(LOW[autopilot.name])
    [left] = [e.text for e in scene.events if e.text.startswith("some parameters on the vehicle remain changed")]
    assert all(f"{name} was {value:g}" in left for name, value in LOW[autopilot.name].items())
    assert values_of(scene, LOW[autopilot.name]) == pytest.approx(SET[autopilot.name])

    scene.client.set_parameter = write
    scene.fly(plan=the_plan(), precautions=Precautions(keep=keeper.keep, left_changed=keeper.kept[-1]))
    assert keeper.kept[-1] == {}
    assert values_of(scene, LOW[autopilot.name]) == pytest.approx(LOW[autopilot.name])


def test_a_vehicle_left_in_the_air_keeps_what_its_flight_needs():
    scene, keeper = scene_with(ARDUPILOT, **LOW[ARDUPILOT.name]), Keeper()
    stops = itertools.chain([0] * 200, itertools.repeat(2))
    outcome = scene.fly(
        plan=the_plan(), precautions=keeper.precautions(), stop=lambda: next(stops) if scene.samples else 0
    )
    assert outcome.ending is Ending.LEFT_HOLDING
    assert values_of(scene, LOW[ARDUPILOT.name]) == pytest.approx(SET[ARDUPILOT.name])
    assert keeper.kept[-1] == pytest.approx(LOW[ARDUPILOT.name])
    assert any(
        "some parameters on the vehicle remain changed (the vehicle is in the air" in e.text and e.alarm
        for e in scene.events
    )


def test_a_parameter_that_the_vehicle_counts_by_itself_is_not_taken_for_an_answer():
    """ArduPilot broadcasts STAT_RUNTIME every 30 s, which in flight was reported as changed by somebody."""
    scene = make_scene()
    scene.client.wait_for_vehicle()
    poll = scene.client.poll

    def with_counter(timeout_s: float) -> list[m.Received]:
        counter = m.ParamValue("STAT_RUNTIME", 123.0, 9, 1, 0)
        heard = poll(timeout_s)
        return [replace(heard[0], message=counter), *heard] if heard else heard

    scene.client.poll = with_counter
    session = Session(
        scene.client, scene.monitor, timeouts=FlightTimeouts(), on_event=scene.events.append, stop=lambda: 0
    )
    assert set(read_parameters(session, [["FENCE_ENABLE"]])) == {"FENCE_ENABLE"}


def test_a_flight_that_the_vehicles_own_speeds_make_longer_is_a_warning() -> None:
    slow = {"WPNAV_SPEED": 800.0, "WPNAV_SPEED_UP": 60.0, "WPNAV_SPEED_DN": 60.0}
    row = table(False, the_plan(), **slow)["flight time"]
    assert row.weight is Weight.WARNING
    assert "climb 0.6 of 4 m/s, descent 0.6 of 3 m/s" in row.matters


ROUTE = route((20, 150, 160), (200, 150, 160), (260, 150, 80), (260, 50, 80), (200, 50, 80))


def returns() -> OwnReturns:
    site = make_site(
        ridge(140.0, 100.0), vehicle={"return_height_m": 130.0},
        limits={"max_climb_angle_deg": 80.0, "max_height_agl_m": 180.0},
    )  # fmt: skip
    return compiled(site, ROUTE).own_returns


def test_the_plans_own_height_is_safe() -> None:
    assert returns().advice({}).sentences == ()


def test_the_vehicles_real_return_height_is_not() -> None:
    advice = returns().advice({"RTL_ALT": 6000.0})
    assert advice.return_height_m == 60.0
    words = return_warnings(advice)
    assert any("below the ground" in one and "from waypoint" in one for one in words)
    assert "set the autopilot's return height to at least" in words[-1]
    assert 115.0 < advice.needed_height_m <= 125.0


def test_parameters_that_change_are_judged_again() -> None:
    own = returns()
    assert own.advice({"RTL_ALT": 13000.0}).sentences == ()
    assert own.advice({"RTL_ALT": 13000.0, "FENCE_ENABLE": 1.0, "FENCE_ALT_MAX": 90.0}).sentences


def test_rally_points_that_the_vehicle_holds_count() -> None:
    own = returns()
    beside = FramedPoint(*own_lat_lon(own, 230.0, 100.0), 40.0)
    low = {"RTL_ALT": 6000.0}
    assert own.advice(low).unsafe_waypoints == (2, 3, 4)
    assert own.advice(low, rally=[beside]).unsafe_waypoints == (
        4,
    )  # where the point is farther than RALLY_LIMIT_KM, or home nearer
    sunk = own.advice(
        {"RTL_ALT": 13000.0, "RTL_ALT_FINAL": 500.0}, rally=[FramedPoint(*own_lat_lon(own, 140.0, 100.0), 120.0)]
    )
    assert any("descends" in one for one in sunk.sentences)


def own_lat_lon(own: OwnReturns, east_m: float, north_m: float) -> tuple[float, float]:
    assert own.site.frame is not None
    lat, lon, _ = own.site.frame.geodetic_from_enu(np.array([[east_m, north_m, 0.0]]))
    return float(lat[0]), float(lon[0])


def warnings(autopilot, settings, **planned):
    scene = make_scene(autopilot, settings=settings)
    scene.upload(mission())
    scene.fly(plan=dataclasses.replace(plan_for(mission()), **planned))
    return [text for text in scene.reported(EventKind.WARNING) if "but the plan assumes" in text]


@pytest.mark.parametrize(("autopilot", "name"), [(ARDUPILOT, "WPNAV_SPEED_UP"), (PX4, "MPC_Z_V_AUTO_UP")])
def test_a_vehicle_that_climbs_slower_than_planned_is_told(autopilot, name):
    reported = warnings(autopilot, Settings(climb_m_s=2.5, descent_m_s=5.0), max_climb_m_s=5.0, max_descent_m_s=5.0)
    assert reported == [
        f"the vehicle climbs at 2.5 m/s ({name}), but the plan assumes 5 m/s: the flight takes longer than planned; "
        "plan with the vehicle's speed, or set the parameter"
    ]


def test_a_vehicle_that_is_as_fast_as_planned_is_not_told():
    assert warnings(ARDUPILOT, Settings(climb_m_s=5.0, descent_m_s=5.0), max_climb_m_s=5.0, max_descent_m_s=5.0) == []


def test_a_plan_that_does_not_say_is_not_compared():
    assert warnings(ARDUPILOT, Settings(climb_m_s=1.0)) == []
