"""What is tried: a reader with good files to start from; here of missions, fences, rally points and drawn areas."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mission_io import (
    Fence,
    FencePolygon,
    FramedPoint,
    GeoPoint,
    LatLon,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
)
from mission_io.autopilots.comparison import apply_diff, diff
from mission_io.errors import FormatError
from mission_io.formats import csv_tables, drawings, files, map_xml, plan, wpl
from mission_io.formats.text import MissionFile, text_from_bytes
from mission_io.formats.wpl import read_mission_dat, write_mission_dat
from mission_io.model.items import Frame, change_speed, land, same_item, takeoff, trigger_camera_every, waypoint

LONGEST_ERROR = 500


def check(condition: bool, what: str) -> None:
    """An input that is read must survive."""
    if not condition:
        raise AssertionError(what)


@dataclass(frozen=True, slots=True)
class Target:
    """One reader.

    Attributes:
        read: reads an input, and checks what was read; raises.
        seeds: good inputs.
        refusals: errors that say that an input is none of its format.
        shown: what becomes of such an error's text before anybody sees it.
    """

    read: Callable[[bytes], None]
    seeds: Sequence[bytes]
    refusals: tuple[type[Exception], ...] = (FormatError,)
    shown: Callable[[str], str] = str

    def attempt(self, data: bytes) -> None:
        """One input; anything but a refusal in one short line gets out."""
        try:
            self.read(data)
        except self.refusals as error:
            line = self.shown(str(error))
            check("\n" not in line and len(line) < LONGEST_ERROR, "an error is one short line")


def of_text(read: Callable[[str], None], seeds: Sequence[str]) -> Target:
    """A target of text, which is decoded as files are."""
    return Target(lambda data: read(text_from_bytes(data).text), [seed.encode() for seed in seeds])


def of_latin(read: Callable[[str], None], seeds: Sequence[str]) -> Target:
    """A target of bytes, which it takes as Latin-1."""
    return Target(lambda data: read(data.decode("latin-1")), [seed.encode("latin-1") for seed in seeds])


def try_wpl(text: str) -> None:
    """A ``.waypoints`` file."""
    read = wpl.read(text)
    read.doubts()
    mission = read.mission() if read.home is not None else Mission(GeoPoint(1.0, 2.0, 3.0), read.items)
    wpl.losses(mission)
    written = wpl.write_mission(mission)
    back = wpl.read(written)
    check(back.repairs == () or read.version == 120, "the strict form needs no repair")
    check(wpl.write_mission(back.mission()) == written, "writing is stable")
    check(apply_diff(diff(mission, back.mission()), mission) == back.mission(), "a difference loses nothing")
    plan.write(plan.PlanFile(mission, Fence(), RallyPoints(), 3))


def try_plan(text: str) -> None:
    """A ``.plan`` file."""
    read = plan.read_to_keep(text)
    read.doubts()
    written = plan.write(read)
    back = plan.read_to_keep(written)
    check(back == read, "what was read survives writing")
    check(plan.write(back) == written, "writing is stable")
    check(plan.write(read.with_mission(read.mission)) == written, "the same mission changes nothing")
    plan.write(read.with_mission(Mission(read.mission.home, read.mission.items[1:])))


def try_csv(text: str) -> None:
    """A CSV file."""
    read = csv_tables.read_csv(text)
    written = csv_tables.write_csv(read.mission)
    check(csv_tables.read_csv(written) == MissionFile(read.mission), "what was read survives writing")


def try_drawing(read_drawing: Callable[[str], Any]) -> Callable[[str], None]:
    """A file of areas."""

    def attempt(text: str) -> None:
        rings = [ring for area in read_drawing(text).areas for ring in (area.exterior, *area.holes)]
        fence = Fence(tuple(map(FencePolygon, rings)))
        written = wpl.write_fence(fence, GeoPoint(1.0, 2.0, 3.0))
        check(len(wpl.read(written).fence().polygons) == len(fence.polygons), "areas survive as a fence")

    return attempt


def try_poly(text: str) -> None:
    """A ``.poly`` file."""
    check(len(drawings.read_area_list(text).areas) == 1, "one area")


def try_fen(text: str) -> None:
    """A ``.fen`` file."""
    check(drawings.read_fence_list(text).fence is not None, "one fence")


def try_old(text: str) -> None:
    """QGroundControl's JSON from before ``.plan``."""
    read = plan.read_old_json(text)
    check((read.mission is None) + (read.fence is None) + (read.rally is None) == 2, "one list")
    mission = read.mission or Mission(None, ())
    lists = plan.PlanFile(
        Mission(GeoPoint(1.0, 2.0, 3.0), mission.items), read.fence or Fence(), read.rally or RallyPoints(), 3
    )
    again = plan.read(plan.write(lists))
    check((again.fence, again.rally) == (lists.fence, lists.rally), "fence and rally points survive as a plan")
    check(len(again.mission.items) == len(mission.items), "the items survive as a plan")
    check(all(map(same_item, again.mission.items, mission.items)), "every number survives as a plan")


def try_rally(text: str) -> None:
    """MAVProxy's old rally points."""
    rally = drawings.read_rally_list(text).rally
    check(len(wpl.read(wpl.write_rally(rally, None)).rally().points) == len(rally.points), "the points survive")


def try_file(text: str) -> None:
    """Whichever kind of file it is, named as another."""
    for suffix in (".plan", ".waypoints", ".txt", ".fen"):
        try:
            reader, surprise = files._reader_of(suffix, text)
            read = reader(text, None)
        except FormatError:
            continue
        check(len(surprise) <= 1, "one surprise")
        for mission_list in read.filled_lists:
            check(mission_list in read.lists, "a filled list is a list")


def try_mission_dat(text: str) -> None:
    """ArduPilot's mission file; the text is its bytes as Latin-1."""
    content = text.encode("latin-1")
    for kind in MissionType:
        try:
            items = read_mission_dat(content, kind)
        except FormatError:
            continue
        again = read_mission_dat(write_mission_dat(items, kind), kind)
        check(len(again) == len(items), "the items survive")
        check(all(map(same_item, items, again)), "every number survives")


def _seeds() -> dict[str, list[str]]:
    home = GeoPoint(33.21875, -98.1234567, 345.678)
    mission = Mission(
        home,
        (
            takeoff(33.21875, -98.1234567, 30.0, frame=Frame.ABOVE_HOME),
            change_speed(12.5),
            trigger_camera_every(25.0),
            waypoint(33.2191234, -98.1240001, 60.25, frame=Frame.ABOVE_TERRAIN, hold_s=2.0),
            land(33.21875, -98.1234567, frame=Frame.AMSL),
        ),
    )
    ring = (LatLon(33.1, -98.2), LatLon(33.3, -98.25), LatLon(33.35, -98.05))
    fence = Fence((FencePolygon(ring),), (), FramedPoint(33.2, -98.1, 0.0))
    rally = RallyPoints((FramedPoint(33.2, -98.1, 50.0),))
    whole = plan.write(plan.PlanFile(mission, fence, rally, 3))
    document = json.loads(whole)
    inner = document["mission"]["items"][3:4]
    survey = {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "TransectStyleComplexItem": {"Items": inner},
        "angle": 1.5,
    }
    landing = {"type": "ComplexItem", "complexItemType": "fwLandingPattern", "landCoordinate": [33.2, -98.1, 0],
               "landingApproachCoordinate": [33.3, -98.1, 50], "altitudesAreRelative": True, "loiterRadius": 75,
               "loiterClockwise": True}  # fmt: skip
    jump = {**document["mission"]["items"][1], "command": 177, "params": [1, 2, 0, 0, None, None, None]}
    document["mission"]["items"] += [survey, landing, {"type": "ComplexItem", "complexItemType": "StructureScan"}, jump]
    coordinates = [[point.lon_deg, point.lat_deg] for point in (*ring, ring[0])]
    shape = {"type": "Polygon", "coordinates": [coordinates, coordinates]}
    feature = {"type": "Feature", "geometry": shape, "properties": {"name": "a"}}
    positions = " ".join(f"{lon},{lat},0" for lon, lat in coordinates)
    linear = f"<LinearRing><coordinates>{positions}</coordinates></LinearRing>"
    polygon = (
        f"<Polygon><outerBoundaryIs>{linear}</outerBoundaryIs><innerBoundaryIs>{linear}</innerBoundaryIs></Polygon>"
    )
    first_json = {"MAV_AUTOPILOT": 3, "complexItems": [], "version": "1.0",
                  "plannedHomePosition": {"coordinate": [33.2, -98.1, 300]},
                  "items": [{"autoContinue": True, "command": command, "coordinate": [33.2, -98.1, 30], "frame": 3, "id": number,
                             "param1": 1, "param2": 0, "param3": 0, "param4": None, "type": "missionItem"}
                            for number, command in enumerate((22, 16, 177), start=1)]}  # fmt: skip
    old = [
        json.dumps(first_json),
        json.dumps({**json.loads(whole)["mission"], "fileType": "Mission"}),
        json.dumps({"fileType": "GeoFence", "version": 1, "polygon": [[1, 2], [1, 3], [2, 3]], "breachReturn": [1, 2]}),
        json.dumps({"fileType": "RallyPoints", "version": 1, "points": [[1, 2, 3]]}),
    ]
    old_parts = json.dumps({**document, "geoFence": json.loads(old[2]), "rallyPoints": json.loads(old[3])})
    listed = "33.1 -98.2\n33.3 -98.25\n33.35 -98.05\n33.12 -98.04\n33.1 -98.2\n"
    fen = f"33.21 -98.12\n{listed}"
    rally_text = "RALLY 33.2 -98.1 50.0 40.0 0.0 0\nRALLY 33.3 -98.2 55.5 0 0 0\n"
    items = (MissionItem(5100, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, 0.0), 33.2, -98.1, 50.0),)
    dats = [write_mission_dat(mission.items, MissionType.MISSION), write_mission_dat(items, MissionType.RALLY)]
    odd = (
        wpl.write_mission(mission)
        .replace("\t30\t1\n", "\t30\t1  # up\n")
        .replace("\t0\t33.2", "\tNan\t33.2")
        .replace("\t", " \u00a0")
    )
    return {
        "wpl": [wpl.write_mission(mission), wpl.write_fence(fence, home), wpl.write_mission(mission).replace("110", "120"),
                wpl.write_fence(fence, None), odd],
        "plan": [whole, json.dumps(document), old_parts],
        "csv": [csv_tables.write_csv(mission)],
        "kml": [map_xml.write_kml(Mission(home, mission.items[:3])), f"<kml><Placemark><name>a</name>{polygon}</Placemark></kml>",
                f"<kml><MultiGeometry>{linear}<Point><coordinates>1,2</coordinates></Point></MultiGeometry></kml>"],
        "geojson": [json.dumps({"type": "FeatureCollection", "features": [feature]}),
                    json.dumps({"type": "GeometryCollection", "geometries": [shape, {"type": "Point", "coordinates": [1, 2]}]})],
        "poly": [listed],
        "fen": [fen],
        "old": old,
        "rally": [rally_text],
        "file": [whole, wpl.write_fence(fence, None), rally_text, fen, *old],
        "mission_dat": [dat.decode("latin-1") for dat in dats],
    }  # fmt: skip


def targets() -> dict[str, Target]:
    """By name."""
    good = _seeds()
    readers = {
        "wpl": try_wpl,
        "plan": try_plan,
        "csv": try_csv,
        "kml": try_drawing(map_xml.read_kml_drawing),
        "geojson": try_drawing(drawings.read_geojson),
        "poly": try_poly,
        "fen": try_fen,
        "old": try_old,
        "rally": try_rally,
        "file": try_file,
    }
    return {
        **{name: of_text(read, good[name]) for name, read in readers.items()},
        "mission_dat": of_latin(try_mission_dat, good["mission_dat"]),
    }
