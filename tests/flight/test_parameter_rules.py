"""The parameters that change what our commands or missions do: the data itself, and what it refuses."""

import copy
import dataclasses

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.model.items import Frame, Mission, trigger_camera_every
from tests.flight.scene import mission
from tests.flight.test_limits import the_plan
from uavcover.flight.limits import limit_table
from uavcover.flight.parameter_rules import CATEGORIES, Weight, parameter_table, read_table

BOTH = pytest.mark.parametrize("px4", [False, True], ids=["ArduPilot", "PX4"])
TURNS = "the camera turns with it: it does not observe the planned ground"


def judged(px4: bool, plan=None, **values: float):
    rows = limit_table(values, plan or the_plan(), px4=px4, home_alt_amsl_m=None)
    return {row.parameter: row for row in rows}


def turning_plan():
    plan = the_plan()
    return dataclasses.replace(plan, needs=dataclasses.replace(plan.needs, camera_turns=True))


@BOTH
def test_each_category_has_decisions_and_each_row_a_reason(px4):
    table = parameter_table(px4=px4)
    assert {row.category for row in table.rows} == set(CATEGORIES)
    assert all(row.why and row.what for row in table.rows)
    assert all(table.dismissed.values())


@pytest.mark.parametrize(
    ("px4", "values", "weight", "wanted", "said"),
    [
        (False, {"MIS_RESTART": 1}, Weight.WARNING, 0.0, "line of up to"),
        (False, {"MIS_RESTART": 0}, Weight.NONE, None, ""),
        (False, {"WP_YAW_BEHAVIOR": 0}, Weight.REFUSED, 1.0, TURNS),
        (False, {"WP_YAW_BEHAVIOR": 3}, Weight.NOTE, 1.0, "later in corners"),
        (False, {"WP_YAW_BEHAVIOR": 2}, Weight.NONE, None, ""),
        (True, {"MPC_YAW_MODE": 5}, Weight.REFUSED, 0.0, TURNS),
        (True, {"MPC_YAW_MODE": 4}, Weight.NOTE, 0.0, "longer"),
        (True, {"MPC_YAW_MODE": 0}, Weight.NONE, None, ""),
        (False, {"AUTO_OPTIONS": 131, "WVANE_ENABLE": 1}, Weight.REFUSED, 3.0, TURNS),
        (False, {"ATC_SLEW_YAW": 2000}, Weight.WARNING, 6000.0, "later in corners"),
        (False, {"FENCE_ALT_MIN": 45, "FENCE_TYPE": 15, "FENCE_ENABLE": 1}, Weight.REFUSED, 34.0, "interrupt it"),
        (False, {"FENCE_ALT_MIN": 45, "FENCE_TYPE": 8, "FENCE_AUTOENABLE": 3}, Weight.REFUSED, 34.0, "interrupt it"),
        (False, {"FENCE_ALT_MIN": 45, "FENCE_TYPE": 15}, Weight.NOTE, 34.0, "if the fence is active"),
        (False, {"FENCE_ALT_MIN": 30, "FENCE_TYPE": 15, "FENCE_ENABLE": 1}, Weight.NONE, None, ""),
        (False, {"WPNAV_RADIUS": 800}, Weight.WARNING, 300.0, "cuts corners"),
        (True, {"NAV_ACC_RAD": 8}, Weight.WARNING, 3.0, "corners are cut"),
        (True, {"COM_FLT_TIME_MAX": 30}, Weight.REFUSED, -1.0, "interrupt it"),
        (True, {"COM_FLT_TIME_MAX": -1}, Weight.NONE, None, ""),
        (True, {"GF_ACTION": 4}, Weight.WARNING, 2.0, "stops its motors"),
        (False, {"RTL_ALT_FINAL": 1000}, Weight.WARNING, 0.0, "does not land"),
        (False, {"MAV_GCS_SYSID": 250, "FS_GCS_ENABLE": 1}, Weight.WARNING, 255.0, "--own-system"),
        (False, {"EK3_SRC1_POSZ": 2}, Weight.REFUSED, 1.0, "rangefinder"),
        (True, {"COM_HOME_EN": 0}, Weight.REFUSED, 1.0, "no home"),
        (True, {"MIS_DIST_1WP": 5}, Weight.NOTE, 61.0, "warns"),
    ],
)  # fmt: skip
def test_a_setting_that_changes_the_mission_is_judged(px4, values, weight, wanted, said):
    name = next(iter(values))
    row = judged(px4, turning_plan(), **values).get(name)
    if row is None:
        assert weight is Weight.NONE
        return
    assert (row.weight, row.wanted) == (weight, wanted)
    assert said in row.matters


def test_the_heading_does_not_matter_to_a_sensor_without_one():
    assert "WP_YAW_BEHAVIOR" not in judged(False, WP_YAW_BEHAVIOR=0)
    assert "MPC_YAW_MODE" not in judged(True, MPC_YAW_MODE=5)


def test_what_the_mission_itself_has_decides_what_matters():
    plan = the_plan()
    triggered = dataclasses.replace(
        plan, mission=Mission(plan.mission.home, (*plan.mission.items, trigger_camera_every(16.0)))
    )
    assert judged(False, triggered, CAM1_TYPE=0)["CAM1_TYPE"].weight is Weight.WARNING
    assert judged(False, triggered, CAM1_INTRVAL_MIN=3)["CAM1_INTRVAL_MIN"].planned == 2.0
    assert "CAM1_TYPE" not in judged(False, CAM1_TYPE=0)
    items = tuple(
        dataclasses.replace(item, frame=Frame.ABOVE_TERRAIN) if item.has_position else item for item in mission().items
    )
    terrain = dataclasses.replace(plan, mission=Mission(plan.mission.home, items))
    assert judged(False, terrain, TERRAIN_ENABLE=0)["TERRAIN_ENABLE"].weight is Weight.REFUSED


def test_a_plan_without_needs_still_has_what_is_wrong():
    plan = dataclasses.replace(the_plan(), needs=None)
    assert set(judged(False, plan, MIS_RESTART=1, FENCE_ENABLE=1)) == {"MIS_RESTART"}


ROW = {"names": ["A/100"], "category": "mission", "what": "a", "why": "b"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"color": "red"}, "unknown key color"),
        ({"category": "weather"}, "category 'weather'"),
        ({"rule": "= 1"}, "must have both rule and worse"),
        ({"rule": "~ 1", "worse": [{"weight": "note", "says": "x"}]}, "'~' is not a comparison operator"),
        ({"rule": "= wind", "worse": [{"weight": "note", "says": "x"}]}, "unknown fact"),
        ({"rule": "= 1", "if": ["B = 1"], "worse": [{"weight": "note", "says": "x"}]}, "B is neither a key nor a fact"),
        ({"rule": "= 1", "worse": [{"weight": "grave", "says": "x"}]}, "grave"),
        ({"rule": "= 1", "worse": [{"weight": "note", "says": "x", "sets": "a lot"}]}, "neither a number nor a fact"),
        ({"names": ["A", "A"]}, "this name appears in two rows"),
        ({"planned": "wind"}, "wind is not a fact"),
    ],
)
def test_data_that_is_wrong_is_refused_with_its_place(change, said):
    document = {"row": [copy.deepcopy(ROW) | change], "dismissed": []}
    with pytest.raises(ValueError, match=said):
        read_table(document, "parameters_x.toml")


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_all_rows_have_names_by_which_a_vehicle_can_be_asked(autopilot):
    for row in parameter_table(px4=autopilot is PX4).rows:
        assert all(0 < len(name) <= 16 and name.isupper() for name, _ in row.names)
