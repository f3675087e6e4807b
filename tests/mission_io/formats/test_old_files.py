"""Files of former years: QGroundControl before ``.plan``, MAVProxy before ``.waypoints``, and files named as something else."""

import json
from pathlib import Path
from typing import Any

import pytest

from mission_io.errors import FormatError
from mission_io.formats import plan, wpl
from mission_io.formats.drawings import read_rally_list
from mission_io.formats.files import mission_text, read_file, read_mission
from mission_io.formats.plan import read_old_json as read
from mission_io.model.items import (
    Command,
    Fence,
    FencePolygon,
    Frame,
    FramedPoint,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
)
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, RALLY, fen_text

PLAN = plan.write(plan.PlanFile(MISSION, Fence(), RallyPoints(), 3))
RING = FENCE.polygons[0].vertices
OLD_FENCE = Fence((FencePolygon(RING),), (), FramedPoint(33.21, -98.12, 0.0))


def item_of_version_1(number: int, item: MissionItem, **others: object) -> dict[str, Any]:
    return {
        "autoContinue": item.autocontinue, "command": int(item.command), "frame": int(item.frame), "id": number,
        "coordinate": [item.lat_deg, item.lon_deg, item.alt_m], "type": "missionItem",
        **{f"param{n}": value for n, value in enumerate(item.params, start=1)}, **others,
    }  # fmt: skip


def version_1(items: tuple[MissionItem, ...] = MISSION.items, **others: object) -> dict[str, Any]:
    home = MissionItem(16, Frame.AMSL, (0.0, 0.0, 0.0, 0.0), HOME.lat_deg, HOME.lon_deg, HOME.alt_amsl_m)
    return {
        "MAV_AUTOPILOT": 12, "complexItems": [], "groundStation": "QGroundControl", "version": "1.0",
        "items": [item_of_version_1(number, item) for number, item in enumerate(items, start=1)],
        "plannedHomePosition": item_of_version_1(0, home), **others,
    }  # fmt: skip


def version_2() -> dict[str, Any]:
    mission = json.loads(plan.write(plan.PlanFile(MISSION, FENCE, RALLY, 3)))["mission"]
    for entry in mission["items"]:
        entry["coordinate"], entry["params"] = entry["params"][4:], entry["params"][:4]
    return {**mission, "fileType": "Mission"}


@pytest.mark.parametrize("document", [version_1(), version_2(), version_1(version=1)])
def test_a_mission_from_before_plans(document: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "a.mission").write_text(json.dumps(document))
    file = read_file(tmp_path / "a.mission")
    assert file.mission == MISSION
    assert (file.fence, file.rally, file.repairs) == (None, None, ("this is a QGroundControl file older than .plan",))
    (tmp_path / "a.plan").write_text(json.dumps(document))
    assert read_mission(tmp_path / "a.plan") == MISSION


def test_home_may_be_missing_or_without_height() -> None:
    document = version_1()
    document["plannedHomePosition"]["coordinate"][2] = None
    assert read(json.dumps(document)).mission == Mission(None, MISSION.items)
    del document["plannedHomePosition"]
    assert read(json.dumps(document)).mission == Mission(None, MISSION.items)
    document["plannedHomePosition"] = [1.0, 2.0, 3.0]
    assert read(json.dumps(document)).mission == Mission(GeoPoint(1.0, 2.0, 3.0), MISSION.items)


def test_jumps_of_version_1_go_to_ids() -> None:
    document = version_1((*MISSION.items, MissionItem(Command.DO_JUMP, Frame.COMMAND, (40.0, 2.0, 0.0, 0.0))))
    document["items"][3]["id"] = 40
    mission = read(json.dumps(document)).mission
    assert mission is not None
    assert mission.items[-1].params == (4.0, 2.0, 0.0, 0.0)
    document["items"][3]["id"] = 41
    with pytest.raises(FormatError, match="the jump leads to 40, but no item"):
        read(json.dumps(document))


def test_fence_and_rally_points_from_before_plans() -> None:
    corners = [[c.lat_deg, c.lon_deg] for c in RING]
    fence = {
        "fileType": "GeoFence",
        "version": 1,
        "polygon": corners,
        "breachReturn": [33.21, -98.12],
        "parameters": [],
    }
    assert read(json.dumps(fence)).fence == OLD_FENCE
    rally = {"fileType": "RallyPoints", "version": 1, "points": [[33.2, -98.13, 50.0], [33.23, -98.14, 55.5]]}
    assert read(json.dumps(rally)).rally == RALLY


@pytest.mark.parametrize(
    ("document", "what"),
    [
        (version_1(complexItems=[{"id": 3}]), "the file does not contain the items of the survey"),
        (
            {**version_2(), "items": [{"type": "ComplexItem", "complexItemType": "survey"}]},
            "the file does not contain the items of the survey",
        ),
        (version_1(version=3), "file.version: unknown version 3"),
        (version_1(version=True), "file.version: unknown version True"),
        ({**version_1(), "items": 7}, r"file\.items: expected"),
        ({"MAV_AUTOPILOT": 3}, "file: the JSON is not a mission"),
        ({"fileType": "Parameters", "items": []}, "file: the JSON is not a mission"),
        ({**version_1(), "items": [{"type": "missionItem"}]}, r"file\.items\[0\]\.param1: the key is missing"),
    ],
)
def test_what_cannot_be_read_is_one_error(document: dict[str, Any], what: str) -> None:
    with pytest.raises(FormatError, match=what):
        read(json.dumps(document))


def test_rally_lines(tmp_path: Path) -> None:
    text = "# points\nRALLY 33.2\t-98.13\t50.0\t40.0\t0.0\t0\r\n\nRALLY 33.23 -98.14 55.5 0 0 0  # last\n"
    file = read_rally_list(text)
    assert file.rally == RALLY
    assert file.repairs == (
        "changed the line ends to LF", "line 2: break altitude, landing direction and flags were dropped",
    )  # fmt: skip
    path = tmp_path / "rally.txt"
    path.write_text(text.replace("\r", "").replace("  # last", ""))
    assert read_file(path).rally == RALLY


@pytest.mark.parametrize(
    ("line", "what"),
    [
        (
            "RALLY 1 2 3",
            "line 2: the row has 4 columns and begins with 'RALLY'; a rally point must consist of RALLY and 6 numbers",
        ),
        ("PLACE 1 2 3 0 0 0", "line 2: 7 columns beginning with 'PLACE'"),
        ("RALLY 91 2 3 0 0 0", "line 2: latitude 91, longitude 2 is not a valid position"),
        ("RALLY 1 nan 3 0 0 0", "line 2: 'nan' is not a finite number"),
    ],
)
def test_a_bad_rally_line_is_named(line: str, what: str) -> None:
    with pytest.raises(FormatError, match=what):
        read_rally_list("RALLY 1 2 3 0 0 0\n" + line)


@pytest.mark.parametrize(
    ("name", "text", "surprise"),
    [
        ("a.plan", wpl.write_mission(MISSION), ("the file is .waypoints, not a .plan file",)),
        ("a.waypoints", PLAN, ("the file is JSON, not a .waypoints file",)),
        ("a.txt", PLAN, ()),
        ("a.mission", wpl.write_mission(MISSION), ()),
        ("a", "\ufeff\n# mine\n" + wpl.write_mission(MISSION), None),
    ],
)  # fmt: skip
def test_a_file_is_read_as_what_it_is(name: str, text: str, surprise: tuple[str, ...] | None, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    file = read_file(tmp_path / name)
    assert file.mission == MISSION
    assert surprise is None or file.repairs == surprise


@pytest.mark.parametrize("name", ["fence.txt", "fence", "fence.waypoints"])
def test_a_list_of_places_is_a_fence(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(fen_text(OLD_FENCE))
    file = read_file(tmp_path / name)
    assert file.fence == OLD_FENCE
    assert "read as an old fence file: the first position is the return point" in file.repairs
    with pytest.raises(FormatError, match="the file contains no mission; request the list that the file contains"):
        read_file(tmp_path / name, mission_type=MissionType.MISSION)


def test_a_fence_file_named_fen_needs_no_word(tmp_path: Path) -> None:
    (tmp_path / "a.fen").write_text(fen_text(OLD_FENCE))
    assert (read_file(tmp_path / "a.fen").fence, read_file(tmp_path / "a.fen").repairs) == (OLD_FENCE, ())


def test_mavproxys_lists_have_no_home_row_and_are_not_empty() -> None:
    lists = plan.PlanFile(MISSION, FENCE, RALLY, 3)
    assert wpl.read(mission_text("mavproxy-fence", lists)).fence() == FENCE
    assert wpl.read(mission_text("mavproxy-rally", lists)).rally() == RALLY
    for kind in ("fence", "rally"):
        assert "\t16\t" not in mission_text(f"mavproxy-{kind}", lists)
        with pytest.raises(FormatError, match=f"there is no {kind} to write"):
            mission_text(f"mavproxy-{kind}", plan.PlanFile(MISSION, Fence(), RallyPoints(), 3))


def test_fence_and_rally_files_without_a_home_row(tmp_path: Path) -> None:
    for kind, text, expected in (
        ("fence", wpl.write_fence(FENCE, None), FENCE),
        ("rally", wpl.write_rally(RALLY, None), RALLY),
    ):
        path = tmp_path / f"{kind}.waypoints"
        path.write_text(text)
        file = read_file(path)
        assert (file.fence or file.rally) == expected
        assert file.repairs == ("the first row is not home, so the mission has no home",)
        assert wpl.read(text).home is None
    assert wpl.read(wpl.write_fence(FENCE, HOME)).items == wpl.read(wpl.write_fence(FENCE, None)).items
