"""Surveys, corridors, structure scans and landing patterns in ``.plan`` files: kept as they are, flown as items."""

import copy
import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.errors import FormatError
from mission_io.formats import plan
from mission_io.formats.plan_items import read_simple
from mission_io.formats.text import Node
from mission_io.model.items import Command, Frame, Mission, MissionItem, MissionType, delay, same_item, waypoint
from tests.mission_io.formats.samples import HOME, MISSION
from tests.mission_io.vehicle import VehiclePeer, connected


def simple(number: int, command: int, params: list[float | None], frame: int = 3, **more: Any) -> dict[str, Any]:
    return {
        "autoContinue": True, "command": command, "doJumpId": number, "frame": frame, "params": params,
        "type": "SimpleItem", **more,
    }  # fmt: skip


def transects(first: int) -> dict[str, Any]:
    return {
        "CameraCalc": {"CameraName": "Manuell – ohne Daten", "DistanceToSurface": 49.99999999999999, "version": 2},
        "CameraShots": 12,
        "FollowTerrain": False,
        "Items": [
            simple(first, 16, [0, 0, 0, None, 33.2191234, -98.1240001, 50]),
            simple(first + 1, 206, [25, 0, 1, 0, 0, 0, 0], frame=2),
            simple(first + 2, 16, [0, 0, 0, None, 33.2201234, -98.1250002, 50.0]),
        ],
        "VisualTransectPoints": [[33.2191234, -98.1240001], [33.2201234, -98.1250002]],
        "version": 2,
    }


SURVEY = {
    "type": "ComplexItem", "complexItemType": "survey", "version": 5, "angle": 27.000000000000004,
    "polygon": [[33.1, -98.2], [33.3, -98.25], [33.35, -98.05]], "TransectStyleComplexItem": transects(2),
}  # fmt: skip
CORRIDOR = {
    "type": "ComplexItem", "complexItemType": "CorridorScan", "version": 2, "CorridorWidth": 50,
    "polyline": [[33.1, -98.2], [33.3, -98.25]], "TransectStyleComplexItem": transects(5),
}  # fmt: skip
STRUCTURE = {
    "type": "ComplexItem", "complexItemType": "StructureScan", "version": 3, "Layers": 2, "StructureHeight": 25,
    "polygon": [[33.1, -98.2], [33.3, -98.25], [33.35, -98.05]],
}  # fmt: skip
LANDING = {
    "type": "ComplexItem", "complexItemType": "vtolLandingPattern", "version": 1, "altitudesAreRelative": True,
    "landCoordinate": [33.21, -98.12, 0], "landingApproachCoordinate": [33.22, -98.13, 40], "loiterClockwise": False,
    "loiterRadius": 75, "stopTakingPhotos": True, "stopVideoPhotos": True, "useLoiterToAlt": True,
}  # fmt: skip
CALCULATED = simple(5, 16, [0, 0, 0, None, 33.22, -98.13, 410.25], frame=0, Altitude=50, AltitudeMode=3,
                    AMSLAltAboveTerrain=410.25)  # fmt: skip


def document(*items: dict[str, Any]) -> dict[str, Any]:
    return {
        "fileType": "Plan", "version": 1, "groundStation": "AnotherStation", "madeBy": {"tool": "x", "é": [1e-7, -0.0]},
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2, "note": 5},
        "mission": {
            "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5,
            "globalPlanAltitudeMode": 1, "plannedHomePosition": [HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m],
            "items": [simple(1, 22, [0, 0, 0, None, 33.21875, -98.1234567, 30]), *copy.deepcopy(items)],
        },
    }  # fmt: skip


def test_everything_that_qgroundcontrol_writes_survives_a_round_trip() -> None:
    before = document(SURVEY, CORRIDOR, CALCULATED, STRUCTURE, LANDING)
    read = plan.read_to_keep(json.dumps(before))
    text = plan.write(read)
    assert json.loads(text) == before
    assert "49.99999999999999" in text
    assert "27.000000000000004" in text
    assert plan.read_to_keep(text) == read
    assert [entry.kind for entry in read.entries] == [
        "SimpleItem", "survey", "CorridorScan", "SimpleItem", "StructureScan", "vtolLandingPattern",
    ]  # fmt: skip


def test_a_survey_is_flown_as_the_items_in_the_file() -> None:
    read = plan.read(json.dumps(document(SURVEY, CORRIDOR, CALCULATED)))
    items = read.mission.items
    assert [item.command for item in items] == [22, 16, 206, 16, 16, 206, 16, 16]
    wanted = MissionItem(16, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, math.nan), 33.2201234, -98.1250002, 50.0)
    assert same_item(items[3], wanted)
    assert (items[7].frame, items[7].alt_m) == (Frame.AMSL, 410.25)


def test_a_landing_pattern_is_flown_as_qgroundcontrol_sends_it() -> None:
    items = plan.read(json.dumps(document(LANDING))).mission.items[1:]
    assert [item.command for item in items] == [189, 206, 2001, 2501, 31, 85]
    assert items[4].params == (1.0, -75.0, 0.0, 1.0)
    assert (items[4].lat_deg, items[4].lon_deg, items[4].alt_m, items[4].frame) == (
        33.22,
        -98.13,
        40.0,
        Frame.ABOVE_HOME,
    )
    assert (items[5].lat_deg, items[5].alt_m) == (33.21, 0.0)
    fixed_wing = {**LANDING, "complexItemType": "fwLandingPattern", "altitudesAreRelative": False,
                  "useLoiterToAlt": False, "stopTakingPhotos": False, "stopVideoPhotos": False}  # fmt: skip
    start, approach, land = plan.read(json.dumps(document(fixed_wing))).mission.items[1:]
    assert (start.command, approach.command, land.command) == (189, 16, 21)
    assert math.isnan(approach.params[3])
    assert approach.frame is land.frame is Frame.AMSL


def test_an_older_landing_pattern_has_a_height_frame_for_each_place() -> None:
    older = {
        key: value for key, value in LANDING.items() if key not in ("altitudesAreRelative", "landingApproachCoordinate")
    }
    older |= {"loiterCoordinate": [33.22, -98.13, 40], "loiterAltitudeRelative": True, "landAltitudeRelative": True,
              "loiterClockwise": True}  # fmt: skip
    items = plan.read(json.dumps(document(older))).mission.items
    assert (items[-2].params[1], items[-1].frame) == (75.0, Frame.ABOVE_HOME)
    with pytest.raises(FormatError, match=r"items\[1\]: the heights of approach and landing refer to different datums"):
        plan.read(json.dumps(document({**older, "landAltitudeRelative": False})))


def test_what_cannot_be_flown_is_kept_but_not_read_for_flying() -> None:
    text = json.dumps(document(SURVEY, STRUCTURE))
    with pytest.raises(
        FormatError, match="after mission item 4: the file does not contain the items of a StructureScan"
    ):
        plan.read(text)
    assert json.loads(plan.write(plan.read_to_keep(text))) == json.loads(text)
    nested = copy.deepcopy(SURVEY)
    nested["TransectStyleComplexItem"]["Items"].append(STRUCTURE)  # type: ignore[index]
    with pytest.raises(FormatError, match=r"Items\[3\]: nested complex items"):
        plan.read(json.dumps(document(nested)))


def test_another_mission_keeps_the_forms_that_it_leaves_alone() -> None:
    read = plan.read(json.dumps(document(SURVEY, CALCULATED, LANDING)))
    before = document(SURVEY, CALCULATED, LANDING)["mission"]["items"]
    items = read.mission.items
    longer = read.with_mission(Mission(HOME, (items[0], delay(2.0), *items[1:])))
    written = json.loads(plan.write(longer))["mission"]["items"]
    assert [entry.get("complexItemType") for entry in written] == [None, None, "survey", None, "vtolLandingPattern"]
    assert (written[2], written[4]) == (before[1], before[3])
    assert written[3]["doJumpId"] == 6
    inside = read.with_mission(Mission(HOME, (*items[:2], delay(2.0), *items[2:])))
    assert [entry.kind for entry in inside.entries] == ["SimpleItem", "vtolLandingPattern"]
    shorter = read.with_mission(Mission(HOME, items[1:]))
    assert [entry.first for entry in shorter.entries] == [0, 4]
    assert read.with_mission(read.mission) == read
    with pytest.raises(
        FormatError, match="the survey kept from the file no longer flies the mission's items from 2 on"
    ):
        plan.write(replace(read, mission=Mission(HOME, (items[0], items[3], *items[2:]))))
    with pytest.raises(FormatError, match="kept from the file"):
        plan.write(replace(read, entries=read.entries[::-1]))


def test_jumps_go_by_the_number_of_the_item_and_in_the_file_by_its_id() -> None:
    jump = simple(77, 177, [5, 3, 0, 0, 0, 0, 0], frame=2)
    after = simple(5, 16, [0, 0, 0, 0, 33.22, -98.13, 40], Altitude=40, AltitudeMode=1, AMSLAltAboveTerrain=None)
    ordered = document(SURVEY, after, jump)
    read = plan.read(json.dumps(ordered))
    assert read.mission.items[5].params[:2] == (5.0, 3.0)
    assert json.loads(plan.write(read)) == ordered
    other_ids = document(SURVEY, {**after, "doJumpId": 40}, {**jump, "params": [40, 3, 0, 0, 0, 0, 0]})
    read = plan.read(json.dumps(other_ids))
    assert read.mission.items[5].params[:2] == (5.0, 3.0)
    assert json.loads(plan.write(read)) == other_ids
    with pytest.raises(FormatError, match=r"items\[3\].params\[0\]: the jump leads to 3, but no simple item has"):
        plan.read(json.dumps(document(SURVEY, after, {**jump, "params": [3, 3, 0, 0, 0, 0, 0]})))


def test_speeds_are_whole_numbers_and_what_is_rounded_is_listed() -> None:
    whole = plan.PlanFile(MISSION, plan.Fence(), plan.RallyPoints(), 3, cruise_speed_m_s=12.5)
    assert json.loads(plan.write(whole))["mission"]["cruiseSpeed"] == 12
    assert plan.losses(whole) == ("mission.cruiseSpeed: rounded 12.5 to 12",)


def test_unknown_keys_within_a_fence_are_listed() -> None:
    before = document()
    polygon = {"inclusion": True, "version": 1, "polygon": [[1.0, 2.0], [1.0, 3.0], [2.0, 3.0]], "colour": "red"}
    before["geoFence"]["polygons"] = [polygon]
    del before["rallyPoints"]["version"]
    assert plan.read(json.dumps(before)).repairs == (
        "plan.geoFence.polygons[0]: ignored 'colour'", "plan.rallyPoints.version: the key is missing; read as version 2",
    )  # fmt: skip


_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**53), 2**53)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=6)
)
_JSON = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


def same_json(a: Any, b: Any) -> bool:
    """Equal in value and kind of value, so that 1, 1.0 and true are three things."""
    return json.dumps(a, sort_keys=True) == json.dumps(b, sort_keys=True)


@settings(derandomize=True, max_examples=150)
@given(st.dictionaries(st.text(max_size=8), _JSON, max_size=4), st.dictionaries(st.text(max_size=8), _JSON, max_size=4))
@pytest.mark.no_cover
def test_whatever_a_form_holds_is_kept_to_the_bit(form: dict[str, Any], extra: dict[str, Any]) -> None:
    form.pop("TransectStyleComplexItem", None)
    structure = {**form, **STRUCTURE}
    before = document(structure, {**form, **SURVEY})
    before = {**extra, **before}
    after = json.loads(plan.write(plan.read_to_keep(json.dumps(before))))
    assert same_json(after["mission"]["items"][1:], before["mission"]["items"][1:])
    assert same_json({key: after[key] for key in extra}, {key: before[key] for key in extra})


def test_a_jump_survives_a_round_trip() -> None:
    assert Command.DO_JUMP == 177
    jump = MissionItem(177, Frame.COMMAND, (1.0, 2.0, 0.0, 0.0))
    assert plan.read(plan.write(plan.PlanFile(Mission(HOME, (waypoint(1.0, 2.0, 3.0, frame=Frame.AMSL), jump)),
                     plan.Fence(), plan.RallyPoints(), 3))).mission.items[1] == jump  # fmt: skip


@settings(derandomize=True, max_examples=150)
@given(
    st.lists(st.none() | _SCALARS | st.just(10**400) | st.just(-(10**309)) | st.just(1e301), min_size=7, max_size=7),
    st.integers(0, 12),
)
def test_the_quick_way_to_read_an_item_and_the_careful_one_agree(params: list[Any], frame: int) -> None:
    """The careful way is taken when ``autoContinue`` is missing, which stands for true."""
    results = []
    for entry in (simple(1, 16, params, frame), {**simple(1, 16, params, frame)}):
        if results:
            del entry["autoContinue"]
        try:
            results.append(repr(read_simple(Node(entry, "entry"))))
        except FormatError as error:
            results.append(str(error))
    assert results[0] == results[1]


def test_an_item_that_is_no_object_is_refused() -> None:
    with pytest.raises(FormatError, match="entry: expected an object"):
        read_simple(Node(5, "entry"))


def test_an_entry_too_deep_to_be_written_is_one_error() -> None:
    deep: list[Any] = []
    for _ in range(100_000):
        deep = [deep]
    read = plan.read_to_keep(json.dumps(document(STRUCTURE)))
    entry = replace(read.entries[-1], document={**STRUCTURE, "deep": deep})
    with pytest.raises(FormatError, match="plan: a kept entry is nested too deeply"):
        plan.write(replace(read, entries=(*read.entries[:-1], entry)))
    while deep:  # or taking it apart would recurse as deep
        deep = deep.pop()


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_a_survey_is_uploaded_read_back_and_saved_again(autopilot: Autopilot) -> None:
    jump = simple(6, 177, [5, 2, 0, 0, 0, 0, 0], frame=2)
    read = plan.read(json.dumps(document(SURVEY, CALCULATED, jump)))
    client = connected(VehiclePeer(autopilot))
    result = client.upload_and_verify(read.mission)
    assert result.passed, [difference for difference in result.differences if not difference.acceptable]
    back = client.download_list(MissionType.MISSION)
    assert isinstance(back, Mission)
    assert [item.command for item in back.items] == [22, 16, 206, 16, 16, 177]
    assert back.items[5].params[:2] == (5.0, 2.0)
    again = read.with_mission(Mission(HOME, back.items))
    assert len(json.loads(plan.write(again))["mission"]["items"]) >= 3
