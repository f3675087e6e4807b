import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings

from mission_io.errors import FormatError
from mission_io.formats import plan
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    Mission,
    MissionItem,
    RallyPoints,
    same_item,
)
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, MISSIONS, NAN_YAW, RALLY

CORNERS = (LatLon(1.0, 2.0), LatLon(1.0, 3.0), LatLon(2.0, 3.0))
PLAN = plan.PlanFile(MISSION, FENCE, RALLY, mav_autopilot=3)


@settings(derandomize=True, max_examples=100)
@given(MISSIONS)
def test_round_trip(mission: Mission) -> None:
    whole = replace(PLAN, mission=mission)
    if all(
        item.command != Command.DO_JUMP or item.params[0] in range(1, len(mission.items) + 1) for item in mission.items
    ):
        assert plan.read(plan.write(whole)) == whole
    else:
        with pytest.raises(FormatError, match="a jump to"):
            plan.write(whole)


@pytest.mark.parametrize("target", [-1.0, 0.0, 1.0, 1.5, 8.0, 9.0, 10.0, 1e30, math.nan, math.inf])
def test_a_jump_is_written_where_it_can_be_read_again(target: float) -> None:
    """Regression: a jump to no item was written, and the file was refused by the reader."""
    jump = MissionItem(Command.DO_JUMP, Frame.COMMAND, (target, 2.0, 0.0, 0.0))
    whole = replace(PLAN, mission=replace(MISSION, items=(*MISSION.items, jump)))
    if target in range(1, 10):
        assert plan.read(plan.write(whole)) == whole
    else:
        with pytest.raises(FormatError, match=r"mission item 9, param 1: the jump leads to .* \.waypoints file"):
            plan.write(whole)


def test_the_document_is_what_qgroundcontrol_writes() -> None:
    document = json.loads(plan.write(PLAN))
    assert (document["fileType"], document["version"]) == ("Plan", 1)
    mission = document["mission"]
    assert (mission["version"], mission["firmwareType"], mission["cruiseSpeed"]) == (2, 3, 15)
    assert mission["plannedHomePosition"] == [HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m]
    assert [item["doJumpId"] for item in mission["items"]] == list(range(1, 9))
    assert all(len(item["params"]) == 7 for item in mission["items"])
    assert [item.get("AltitudeMode") for item in mission["items"]] == [1, None, None, 1, 2, 1, 1, None]
    assert document["geoFence"]["polygons"][1]["inclusion"] is False
    assert document["geoFence"]["circles"][0]["circle"] == {"center": [33.2, -98.15], "radius": 150.5}
    assert document["rallyPoints"]["points"][0] == [33.2, -98.13, 50.0]
    empty = json.loads(plan.write(plan.PlanFile(MISSION, plan.Fence(), plan.RallyPoints(), mav_autopilot=12)))
    assert empty["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert empty["rallyPoints"] == {"points": [], "version": 2}


def test_nan_is_null() -> None:
    text = plan.write(replace(PLAN, mission=Mission(HOME, (NAN_YAW,))))
    assert json.loads(text)["mission"]["items"][0]["params"][3] is None
    assert same_item(plan.read(text).mission.items[0], NAN_YAW)


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        (replace(PLAN, mission=replace(MISSION, home=None)), "no home"),
        (replace(PLAN, mission=Mission(HOME, (replace(NAN_YAW, alt_m=math.nan),))), "mission item 1"),
        (replace(PLAN, mission=Mission(replace(HOME, lat_deg=math.nan), ())), "a finite"),
        (replace(PLAN, rally=plan.RallyPoints((FramedPoint(1.0, 2.0, 3.0, Frame.AMSL),))), r"points\[0\]"),
        (replace(PLAN, fence=plan.Fence((), (), FramedPoint(1.0, 2.0, 3.0, Frame.AMSL))), "breachReturn"),
    ],
)
def test_what_the_format_cannot_hold_is_refused(bad: plan.PlanFile, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        plan.write(bad)


def changed(path: str, value: Any) -> str:
    """The sample with the value at a dotted path replaced, or removed by ``...``."""
    document = json.loads(plan.write(PLAN))
    *keys, last = [int(key) if key.isdigit() else key for key in path.split(".")]
    node: Any = document
    for key in keys:
        node = node[key]
    if value is ...:
        del node[last]
    else:
        node[last] = value
    return json.dumps(document)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "line 1: cannot read the file as JSON"),
        ("[]", "plan: expected an object"),
        ("[" * 100_000, "nested too deeply"),
        ('{"fileType": NaN}', "cannot read a number"),
        ('{"fileType": ' + "9" * 5000 + "}", "cannot read a number"),
        ('{"fileType": "Parameters"}', r"plan\.fileType: this is not a plan"),
        (changed("mission", ...), r"plan\.mission: the key is missing"),
        (changed("mission.items", {}), r"plan\.mission\.items: expected"),
        (changed("mission.plannedHomePosition", [1.0, 2.0]), r"plan\.mission\.plannedHomePosition: expected 3 numbers"),
        (changed("mission.plannedHomePosition.1", "7"), r"plannedHomePosition\[1\]: expected a number, not '7'"),
        (changed("mission.items.0.type", "ComplexItem"), r"items\[0\]\.complexItemType: the key is missing"),
        (changed("mission.items.0.type", "Item"), r"items\[0\].type: 'Item' is neither"),
        (
            changed("mission.items.0.command", 65536),
            r"items\[0\].command: the command must be between 0 and 65535, not 65536",
        ),
        (changed("version", 2), "plan.version: unknown version 2"),
        (changed("mission.version", 1), "plan.mission.version: unknown version 1"),
        (changed("mission", []), r"plan\.mission: expected an object"),
        (changed("mission.items.0.params", [0.0] * 6), r"items\[0\].params: expected 7 numbers, not 6"),
        (changed("mission.items.0.params.4", None), "latitude, longitude and height are required"),
        (changed("mission.items.0.params.1", True), "expected a number"),
        (changed("mission.items.0.command", 16.5), "expected a whole number"),
        (changed("mission.items.0.frame", 1), r"items\[0\].frame: unknown frame 1"),
        (changed("mission.items.0.autoContinue", 1), "true or false"),
        (changed("geoFence.polygons.0.polygon.0", [1.0]), r"plan\.geoFence\.polygons\[0\]\.polygon\[0\]: expected"),
        (changed("rallyPoints.points", ...), r"rallyPoints\.points: the key is missing"),
        (changed("mission.firmwareType", 10**400), "expected a number"),
    ],
)
def test_what_cannot_be_read_is_one_error_with_its_place(text: str, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        plan.read(text)


def test_what_may_be_missing() -> None:
    document = json.loads(plan.write(PLAN))
    for part in ("geoFence", "rallyPoints"):
        del document[part]
    for part in ("vehicleType", "cruiseSpeed", "hoverSpeed"):
        del document["mission"][part]
    document["mission"]["items"][1]["params"][4:] = [None] * 3
    back = plan.read("\ufeff" + json.dumps(document))
    assert (back.fence, back.rally) == (plan.Fence(), plan.RallyPoints())
    assert back.mission == MISSION
    assert back.repairs == (
        "removed a byte order mark", "plan.geoFence is missing; the plan was read without it",
        "plan.rallyPoints is missing; the plan was read without it",
    )  # fmt: skip


def test_a_home_without_height_is_kept_and_not_used() -> None:
    text = changed("mission.plannedHomePosition.2", None)
    found = plan.read(text)
    assert found.mission.home is None
    assert found.repairs == (
        "plan.mission.plannedHomePosition: the position has no height, so the mission has no home",
    )
    again = plan.write(found)
    assert json.loads(again)["mission"]["plannedHomePosition"] == json.loads(text)["mission"]["plannedHomePosition"]
    assert plan.read(again) == found
    with_home = found.with_mission(replace(found.mission, home=HOME))
    assert plan.read(plan.write(with_home)).mission.home == HOME


@pytest.mark.parametrize(
    ("part", "old"),
    [
        ("geoFence", {"version": 1}),
        ("geoFence", {"polygon": [], "version": 1}),
        ("geoFence", {"polygons": [], "circles": [], "version": 1}),
        ("rallyPoints", {"version": 1}),
        ("rallyPoints", {"points": [], "version": 1}),
    ],
)
def test_an_empty_part_of_the_old_version_is_none(part: str, old: dict[str, Any]) -> None:
    found = plan.read(changed(part, old))
    assert found.repairs == (f"plan.{part}: this is the old version 1; it will be written as version 2",)
    assert (found.fence if part == "geoFence" else found.rally) in (plan.Fence(), plan.RallyPoints())
    assert plan.read(plan.write(found)).mission == found.mission


@pytest.mark.parametrize(
    ("part", "old", "read"),
    [
        (
            "geoFence",
            {"polygon": [[1.0, 2.0], [1.0, 3.0], [2.0, 3.0]], "breachReturn": [1.5, 2.5], "version": 1},
            Fence((FencePolygon(CORNERS),), (), FramedPoint(1.5, 2.5, 0.0)),
        ),
        (
            "geoFence",
            {"polygons": [{"polygon": [[1, 2], [1, 3], [2, 3]], "inclusion": False}], "breachReturn": [1, 2, 3], "version": 1},
            Fence((FencePolygon(CORNERS, inclusion=False),), (), FramedPoint(1.0, 2.0, 3.0)),
        ),
        ("rallyPoints", {"points": [[1.0, 2.0, 3.0]], "version": 1}, RallyPoints((FramedPoint(1.0, 2.0, 3.0),))),
    ],
)  # fmt: skip
def test_a_part_of_the_old_version_is_read_and_written_in_the_new_one(
    part: str, old: dict[str, Any], read: Fence | RallyPoints
) -> None:
    without_others = plan.read(changed(part, old))
    of_another = plan.read(changed(part, {"polygons": [], "points": [], "polygon": [1], "version": 2}))
    assert of_another.extras[part]["polygon"] == [1], "only version 1 has a meaning for it"
    assert plan.read(plan.write(without_others)) == without_others
    found = plan.read(changed(part, {**old, "other": 7}))
    assert (found.fence if part == "geoFence" else found.rally) == read
    again = plan.read(plan.write(found))
    assert (again.fence, again.rally, again.repairs) == (found.fence, found.rally, ())
    document = json.loads(plan.write(found))[part]
    assert (document["version"], document["other"], "polygon" in document) == (2, 7, False)


@pytest.mark.parametrize(
    ("part", "other"),
    [
        ("geoFence", {"version": True}),
        ("geoFence", {"version": "1"}),
        ("rallyPoints", {"points": [], "version": 3}),
    ],
)
def test_other_versions_are_refused(part: str, other: dict[str, Any]) -> None:
    with pytest.raises(FormatError, match=f"plan.{part}.version: unknown version ('1'|3|True)"):
        plan.read(changed(part, other))


def test_four_parameters_and_a_coordinate_are_seven() -> None:
    """What QGroundControl 3.0 to 3.2 wrote."""
    document = json.loads(plan.write(PLAN))
    entry = document["mission"]["items"][0]
    entry["coordinate"], entry["params"] = entry["params"][4:], entry["params"][:4]
    found = plan.read(json.dumps(document))
    assert found.mission == MISSION
    assert plan.read(plan.write(found)) == found
    entry["coordinate"].pop()
    with pytest.raises(FormatError, match=r"items\[0\]\.params: expected 7 numbers, not 6"):
        plan.read(json.dumps(document))


def test_null_where_a_command_has_no_place_is_nothing_and_where_it_has_one_is_an_error() -> None:
    """Programs give commands without a place the frame of the waypoints around them, and null for the place."""
    document = json.loads(plan.write(PLAN))
    document["mission"]["items"][1].update(command=93, frame=3, params=[60.0, None, None, None, None, None, None])
    found = plan.read(json.dumps(document))
    item = found.mission.items[1]
    assert (item.lat_deg, item.lon_deg, item.alt_m, item.params[0]) == (0.0, 0.0, 0.0, 60.0)
    document["mission"]["items"][1]["command"] = 84
    with pytest.raises(FormatError, match="latitude, longitude and height are required"):
        plan.read(json.dumps(document))


@pytest.mark.parametrize("part", ["", "mission", "geoFence", "rallyPoints"])
@pytest.mark.parametrize("value", [7, None, "text", [1], {"a": [[]]}])
def test_a_key_of_another_program_may_be_called_items(part: str, value: object) -> None:
    """Regression: the key ``items`` outside of the mission was written as a mission's items, a fault."""
    if part == "mission":
        whole = replace(PLAN, extras={"mission": {"items": value}})
        assert plan.read(plan.write(whole)).mission == MISSION
        return
    found = plan.read(changed(f"{part}.items" if part else "items", value))
    assert plan.read(plan.write(found)) == found
    assert found.extras[part] == {"items": value}


@pytest.mark.parametrize(
    "wrong",
    [
        {"cruise_speed_m_s": math.inf},
        {"hover_speed_m_s": math.nan},
        {"extras": {"": {"a": {1, 2}}}},
        {"extras": {"": {"a": math.nan}}},
        {"extras": {"mission": {"a": b"bytes"}}},
    ],
)
def test_what_json_does_not_have_is_the_formats_own_error(wrong: dict[str, Any]) -> None:
    with pytest.raises(FormatError):
        plan.write(replace(PLAN, **wrong))


def _one_item(**changes):
    item = {
        "type": "SimpleItem", "command": 16, "frame": 3, "autoContinue": True, "doJumpId": 1,
        "params": [0, 0, 0, None, 46.5, 8.5, 50.0], "Altitude": 50.0, "AltitudeMode": 1, "AMSLAltAboveTerrain": None,
    }  # fmt: skip
    part = {"version": 2}
    fence = changes.pop("fence", {})
    mission = {
        "version": 2, "firmwareType": 3, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5, "items": [item | changes],
        "plannedHomePosition": [46.5, 8.5, 500.0],
    }  # fmt: skip
    return plan.read(
        json.dumps({
            "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission,
            "geoFence": {**part, "circles": [], "polygons": [], **fence}, "rallyPoints": {**part, "points": []},
        })
    )  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({}, []),
        ({"Altitude": 80.0}, ["Altitude is 80, but params[6] is 50; 50 m was used"]),
        ({"AltitudeMode": 2}, ["AltitudeMode 2 is AMSL, but its frame is ABOVE_HOME (used)"]),
        ({"AltitudeMode": 4}, ["AltitudeMode 4 is ABOVE_TERRAIN, but its frame is ABOVE_HOME (used)"]),
        ({"frame": 0, "AltitudeMode": 3, "AMSLAltAboveTerrain": 50.0, "Altitude": 20.0}, []),
        (
            {"frame": 0, "AltitudeMode": 3, "AMSLAltAboveTerrain": 570.0, "Altitude": 20.0},
            ["AMSLAltAboveTerrain is 570, but params[6] is 50; 50 m was used"],
        ),
        ({"Altitude": None, "AltitudeMode": None}, []),
        ({"AltitudeMode": 0}, []),
        ({"Altitude": 50.004}, []),
    ],
)
def test_what_an_item_says_twice_and_differently_is_named(changes, named):
    read = _one_item(**changes)
    assert [repair.partition(": ")[2] for repair in read.repairs] == named
    assert all(repair.startswith("plan.mission.items[0]: ") for repair in read.repairs)


SQUARE = {"polygon": [[46.0, 8.0], [46.0, 9.0], [47.0, 9.0], [47.0, 8.0]], "inclusion": True, "version": 1}
HOLE = {"polygon": [[46.4, 8.4], [46.4, 8.6], [46.6, 8.6], [46.6, 8.4]], "inclusion": False, "version": 1}
ISLAND = {"circle": {"center": [48.0, 8.0], "radius": 500.0}, "inclusion": True, "version": 1}


@pytest.mark.parametrize(
    ("point", "polygons", "circles", "named"),
    [
        ([46.2, 8.2, 50.0], [SQUARE], [], ""),
        (
            [47.2, 8.2, 50.0],
            [SQUARE],
            [],
            "outside the fence, so a vehicle that flies there after a breach leaves the fence again",
        ),
        ([46.2, 9.2, 50.0], [SQUARE], [ISLAND], "outside the fence"),
        ([48.001, 8.0, 50.0], [SQUARE], [ISLAND], ""),
        ([46.5, 8.5, 50.0], [SQUARE, HOLE], [], "in an area that the fence excludes"),
        ([46.5, 8.5, 50.0], [HOLE], [], "in an area that the fence excludes"),
        ([10.0, 10.0, 50.0], [HOLE], [], ""),
    ],
)
def test_a_return_point_where_the_vehicle_must_not_be_is_named(point, polygons, circles, named):
    read = _one_item(fence={"breachReturn": point, "polygons": polygons, "circles": circles})
    doubts = [doubt for doubt in read.doubts() if "return point" in doubt]
    assert len(doubts) == bool(named)
    assert not named or named in doubts[0]
