"""Fuzz the readers of files and of the wire: nothing but a FormatError, no hang, and what was read survives writing.

Usage: python scripts/fuzz_formats.py --seconds 60 --seed 1 [--target plan] [--engine atheris|mutations] [--keep DIR]

With ``atheris`` installed (``pip install atheris``) coverage leads the way to new inputs; without it, seeded files are
mutated blindly. A finding is printed with the file that causes it, and the exit code is 1. Each target has its own process.
"""

import argparse
import importlib.util
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import FrameType
from typing import Any

HANG_S = 10
_LARGEST = 20_000
_ATHERIS = importlib.util.find_spec("atheris") is not None

if "--child" in sys.argv and "atheris" in sys.argv:
    import atheris

    _watched: Any = atheris.instrument_imports(include=["mission_io", "uavcover.scenario.airspace"])
else:
    _watched = nullcontext()

with _watched:
    from mission_io.errors import FormatError
    from mission_io.formats import (
        csv,
        files,
        geojson,
        gpx_route,
        kml,
        kml_route,
        litchi_reader,
        old_qgc_json,
        plan,
        poly,
        rally_lines,
        wpl,
        wpml_reader,
    )  # fmt: skip
    from mission_io.formats.drawings import DrawnArea, fence_from_areas
    from mission_io.formats.mission_dat import read_mission_dat, write_mission_dat
    from mission_io.formats.point_route import PointRoute
    from mission_io.formats.text import text_from_bytes
    from mission_io.model.areas import Fence, FencePolygon, FramedPoint, LatLon, RallyPoints
    from mission_io.model.diff import apply_diff, diff
    from mission_io.model.items import (
        Frame,
        GeoPoint,
        Mission,
        MissionItem,
        MissionType,
        change_speed,
        land,
        same_item,
        takeoff,
        trigger_camera_every,
        waypoint,
    )
    from mission_io.protocol.ftp import FtpMessage
    from mission_io.wire import messages as wire
    from mission_io.wire.codec import Codec
    from mission_io.wire.framing import LARGEST_FRAME, Framer
    from mission_io.wire.mission_items import item_from_message, message_from_item
    from uavcover.errors import InputError
    from uavcover.scenario.airspace.zone_file import _of_text as read_zone_text


def check(condition: bool, what: str) -> None:
    """An input that is read must survive."""
    if not condition:
        raise AssertionError(what)


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
    read = csv.read_mission(text)
    written = csv.write_mission(read.mission)
    check(csv.read_mission(written) == csv.CsvFile(read.mission, ()), "what was read survives writing")


def try_drawing(read_drawing: Callable[[str], Any]) -> Callable[[str], None]:
    """A file of areas."""

    def attempt(text: str) -> None:
        fence = fence_from_areas(read_drawing(text).areas)
        written = wpl.write_fence(fence, GeoPoint(1.0, 2.0, 3.0))
        check(len(wpl.read(written).fence().polygons) == len(fence.polygons), "areas survive as a fence")

    return attempt


def try_poly(text: str) -> None:
    """A ``.poly`` file."""
    written = poly.write_area(poly.read_area(text).area)
    check(poly.write_area(poly.read_area(written).area) == written, "writing is stable")


def try_fen(text: str) -> None:
    """A ``.fen`` file."""
    written = poly.write_fence(poly.read_fence(text).fence)
    check(poly.write_fence(poly.read_fence(written).fence) == written, "writing is stable")


def try_old(text: str) -> None:
    """QGroundControl's JSON from before ``.plan``."""
    read = old_qgc_json.read(text)
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
    rally = rally_lines.read_rally(text).rally
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


def try_route(read_route: Callable[[str], PointRoute]) -> Callable[[str], None]:
    """A route of points."""

    def attempt(text: str) -> None:
        read = read_route(text)
        items = read.mission.items
        check(all(items[number - 1].command == 16 for number in read.numbers), "every point is a waypoint")
        written = csv.write_mission(Mission(GeoPoint(1.0, 2.0, 3.0), items))
        check(csv.read_mission(written).mission.items == items, "the route survives as a table")

    return attempt


def try_zones(suffix: str) -> Callable[[str], None]:
    """No-fly zones as authorities and glider pilots publish them."""

    def attempt(text: str) -> None:
        try:
            read = read_zone_text(text, suffix)
        except InputError as error:
            raise FormatError(str(error)) from None
        for zone in read.zones if read is not None else ():
            check(bool(zone.polygons) != (zone.circle is not None), "a zone is an outline or a circle")

    return attempt


def try_codec(text: str) -> None:
    """Bytes off a link, as one datagram and as a stream in pieces; the text is the bytes as Latin-1."""
    data = text.encode("latin-1")
    whole, pieces = Framer(), Framer()
    frames = [*whole.feed(data), *whole.end()]
    step = 1 + len(data) % 37
    found = [frame for at in range(0, len(data), step) for frame in pieces.feed(data[at : at + step])]
    check(pieces.unfinished_bytes < LARGEST_FRAME, "little is kept")
    check([*found, *pieces.end()] == frames, "the frames do not depend on the pieces")
    counted = whole.counts.garbage_bytes + sum(len(frame.data) for frame in frames)
    check(counted == len(data), "every byte is in a frame or garbage")
    ground, sender = Codec(system_id=255, component_id=190), Codec(system_id=1, component_id=1)
    for received in ground.decode(data):
        again = sender.encode(received.message)
        back = Codec(system_id=255, component_id=190).decode(again)
        check(len(back) == 1 and repr(back[0].message) == repr(received.message), "a message survives sending")
        _try_message(received.message)


def _try_message(message: wire.Message) -> None:
    """A message of the wire in the hands of what reads it further."""
    if isinstance(message, wire.FileTransfer):
        FtpMessage.answer(message.payload)
    if isinstance(message, wire.MissionItemInt | wire.MissionItemFloat):
        try:
            item = item_from_message(message)
        except FormatError:
            return
        if isinstance(message, wire.MissionItemInt):
            again = message_from_item(item, 1, mission_type=MissionType.MISSION, target_system=1, target_component=1)
            check((again.x, again.y) == (message.x, message.y), "a place survives")


TARGETS: dict[str, Callable[[str], None]] = {
    "wpl": try_wpl,
    "plan": try_plan,
    "csv": try_csv,
    "kml": try_drawing(kml.read_drawing),
    "geojson": try_drawing(geojson.read_drawing),
    "poly": try_poly,
    "fen": try_fen,
    "old": try_old,
    "rally": try_rally,
    "file": try_file,
    "mission_dat": try_mission_dat,
    "gpx": try_route(gpx_route.read_route),
    "kml_route": try_route(kml_route.read_route),
    "wpml": try_route(wpml_reader.read_route),
    "litchi": try_route(litchi_reader.read_route),
    "openair": try_zones(".txt"),
    "zones": try_zones(".json"),
    "codec": try_codec,
}
BINARY = frozenset({"mission_dat", "codec"})
"""Targets that are not text."""


def seeds(target: str) -> list[bytes]:
    """Good files to start from."""
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
    places = " ".join(f"{lon},{lat},0" for lon, lat in coordinates)
    linear = f"<LinearRing><coordinates>{places}</coordinates></LinearRing>"
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
    rally_text = "RALLY 33.2 -98.1 50.0 40.0 0.0 0\nRALLY 33.3 -98.2 55.5 0 0 0\n"
    items = (MissionItem(5100, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, 0.0), 33.2, -98.1, 50.0),)
    dats = [write_mission_dat(mission.items, MissionType.MISSION), write_mission_dat(items, MissionType.RALLY)]
    odd = (
        wpl.write_mission(mission)
        .replace("\t30\t1\n", "\t30\t1  # up\n")
        .replace("\t0\t33.2", "\tNan\t33.2")
        .replace("\t", " \u00a0")
    )
    texts = {
        "wpl": [wpl.write_mission(mission), wpl.write_fence(fence, home), wpl.write_mission(mission).replace("110", "120"),
                wpl.write_fence(fence, None), odd],
        "plan": [whole, json.dumps(document), old_parts],
        "csv": [csv.write_mission(mission)],
        "kml": [kml.write_mission(Mission(home, mission.items[:3])), f"<kml><Placemark><name>a</name>{polygon}</Placemark></kml>",
                f"<kml><MultiGeometry>{linear}<Point><coordinates>1,2</coordinates></Point></MultiGeometry></kml>"],
        "geojson": [json.dumps({"type": "FeatureCollection", "features": [feature]}),
                    json.dumps({"type": "GeometryCollection", "geometries": [shape, {"type": "Point", "coordinates": [1, 2]}]})],
        "poly": [poly.write_area(DrawnArea(ring))],
        "fen": [poly.write_fence(fence)],
        "old": old,
        "rally": [rally_text],
        "file": [whole, wpl.write_fence(fence, None), rally_text, poly.write_fence(fence), *old],
        "mission_dat": [dat.decode("latin-1") for dat in dats],
        **_route_seeds(),
        **_zone_seeds(),
        "codec": _wire_seeds(),
    }  # fmt: skip
    return [text.encode("latin-1" if target in BINARY else "utf-8") for text in texts[target]]


def _route_seeds() -> dict[str, list[str]]:
    points = ((33.2, -98.1, 30.5), (33.25, -98.15, 41.0), (33.3, -98.05, 25.0))
    places = " ".join(f"{lon},{lat},{up}" for lat, lon, up in points)
    rows = "".join(f'<rtept lat="{lat}" lon="{lon}"><ele>{up}</ele></rtept>' for lat, lon, up in points)
    line = f"<LineString><altitudeMode>absolute</altitudeMode><coordinates>{places}</coordinates></LineString>"
    marks = "".join(
        f"<Placemark><Point><coordinates>{lon},{lat}</coordinates></Point><index>{n}</index>"
        f"<executeHeight>{up}</executeHeight><waypointSpeed>{n + 3}</waypointSpeed></Placemark>"
        for n, (lat, lon, up) in enumerate(points)
    )
    folder = f"<executeHeightMode>relativeToStartPoint</executeHeightMode><autoFlightSpeed>5</autoFlightSpeed>{marks}"
    config = "<finishAction>goHome</finishAction><takeOffSecurityHeight>20</takeOffSecurityHeight>"
    table = "".join(f"{lat},{lon},{up},90,0.2,0,7.5\n" for lat, lon, up in points)
    return {
        "gpx": [f"<gpx><rte>{rows}</rte></gpx>", f"<gpx><trk><trkseg>{rows.replace('rtept', 'trkpt')}</trkseg></trk></gpx>"],
        "kml_route": [f"<kml><Placemark>{line}</Placemark></kml>", f"<kml>{line.replace('absolute', 'relativeToGround')}</kml>"],
        "wpml": [f"<kml><missionConfig>{config}</missionConfig><Folder>{folder}</Folder></kml>"],
        "litchi": [f"latitude,longitude,altitude(m),heading(deg),curvesize(m),altitudemode,speed(m/s)\n{table}"],
    }  # fmt: skip


def _zone_seeds() -> dict[str, list[str]]:
    openair = (
        "AC R\nAN Range\nAL SFC\nAH 2500ft MSL\nDP 33:10:00 N 098:05:00 W\nDP 33:20:00 N 098:05:00 W\n"
        "V D=+\nV X=33:15:00 N 098:10:00 W\nDA 2.5,10,200\n\nAC D\nAN Circle\nAL 500ft AGL\nAH FL65\n"
        "V X=33:15:00 N 098:10:00 W\nDC 3.0\n"
    )
    ring = [[-98.2, 33.1], [-98.1, 33.1], [-98.1, 33.2], [-98.2, 33.1]]
    volume = {"uomDimensions": "M", "lowerLimit": 0, "lowerVerticalReference": "AGL", "upperLimit": 120,
              "upperVerticalReference": "AMSL", "horizontalProjection": {"type": "Polygon", "coordinates": [ring]}}  # fmt: skip
    circle = {**volume, "horizontalProjection": {"type": "Circle", "center": [-98.2, 33.1], "radius": 900.0}}
    old = {"features": [{"identifier": "A1", "name": "One", "restriction": "PROHIBITED", "geometry": [volume, circle],
                         "applicability": [{"startDateTime": "2026-01-01T00:00:00Z", "endDateTime": "2026-02-01T00:00:00Z",
                                            "permanent": "NO"}]}]}  # fmt: skip
    layer = {"upper": 120, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "m"}
    shapes = [{"type": "Polygon", "coordinates": [ring], "layer": layer},
              {"type": "Point", "coordinates": [-98.2, 33.1], "extent": {"subType": "Circle", "radius": 90.0}}]  # fmt: skip
    new = {"type": "FeatureCollection", "features": [
        {"type": "Feature", "geometry": {"type": "GeometryCollection", "geometries": shapes},
         "properties": {"identifier": "B2", "type": "PROHIBITED"}}]}  # fmt: skip
    return {"openair": [openair], "zones": [json.dumps(old), json.dumps(new)]}


def _wire_seeds() -> list[str]:
    ground = Codec(system_id=255, component_id=190)
    old = Codec(system_id=1, component_id=1)
    old.version = 1
    item = wire.MissionItemInt(1, 1, 3, 6, 16, (1.0, 0.0, 0.0, float("nan")), 332191234, -981240001, 60.25)
    sent = [
        wire.Heartbeat(3, 2, system_status=4), wire.MissionCount(1, 1, 40), item, wire.MissionRequestInt(255, 190, 3),
        wire.MissionAck(255, 190, 0), wire.ParamValue("RTL_ALT", 1500.0, 9, 1200, 7), wire.StatusText(6, "a line"),
        wire.FileTransfer(1, 1, bytes(251)), wire.LogData(1, 90, 90, (7,) * 90), wire.CommandLong(1, 1, 400, (1.0,) * 7),
    ]  # fmt: skip
    frames = [ground.encode(message) for message in sent]
    frames += [old.encode(message) for message in (sent[0], sent[5], sent[9])]
    return [b"".join(frames).decode("latin-1"), *(frame.decode("latin-1") for frame in frames)]


WORDS = [
    b"nan", b"inf", b"1e308", b"1e999", b"-0", b"-1", b"1_0", b"99999", b"9" * 400, b"null", b"[", b"]", b"{", b"}", b'"',
    b"\t", b"\n", b"\r\n", b",", b"#", b"\0", b"\xef\xbb\xbf", b"\xff\xfe", b"\xe9", b"\\ud800", b"<!DOCTYPE a>",
    b"&amp;", b"<name>",
]  # fmt: skip


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, moved, doubled, left out or replaced by words that programs stumble over."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        a, b = sorted(rng.randrange(len(result) + 1) for _ in range(2))
        b = min(b, a + rng.choice((1, 4, 40, 400)))
        match rng.randrange(6):
            case 0:
                result[a:b] = rng.choice(WORDS)
            case 1:
                del result[a:b]
            case 2:
                result[a:a] = result[a:b] * rng.choice((1, 2, 50))
            case 3:
                result[a:b] = rng.randbytes(min(b - a, 4))
            case 4:
                result[a:a] = rng.choice(WORDS) * rng.choice((1, 1, 3000))
            case _ if a < len(result):
                result[a] ^= 1 << rng.randrange(8)
        del result[_LARGEST:]
    return bytes(result)


def text_of(target: str, data: bytes) -> str:
    """An input as its target takes it: text, decoded as files are, or the bytes as Latin-1."""
    return data.decode("latin-1") if target in BINARY else text_from_bytes(data).text


def attempt(target: str, data: bytes) -> None:
    """One input; anything but a FormatError gets out."""
    try:
        TARGETS[target](text_of(target, data))
    except FormatError as error:
        check("\n" not in str(error) and len(str(error)) < 500, "an error is one short line")


def fuzz_by_mutations(target: str, seconds: float, seed: int, finding: Path) -> int:
    """The number of inputs tried; raises what an input raised, which is in ``finding``."""

    def too_long(_: int, __: FrameType | None) -> None:
        raise TimeoutError(f"no answer for {HANG_S} s")

    signal.signal(signal.SIGALRM, too_long)
    rng, good = random.Random(seed), seeds(target)
    runs, end = 0, time.process_time() + seconds
    while time.process_time() < end:
        data = mutated(rng.choice(good), rng)
        signal.alarm(HANG_S)
        try:
            attempt(target, data)
        except BaseException:
            finding.write_bytes(data)
            raise
        finally:
            signal.alarm(0)
        runs += 1
    return runs


def fuzz_by_coverage(target: str, seconds: float, seed: int, finding: Path) -> None:
    """Never returns: atheris ends the process."""
    corpus = Path(tempfile.mkdtemp(prefix=f"corpus-{target}-"))
    for number, data in enumerate(seeds(target)):
        (corpus / f"seed{number}").write_bytes(data)
    words = corpus.parent / f"{corpus.name}.dict"
    words.write_text("".join('"' + "".join(f"\\x{byte:02x}" for byte in word[:60]) + '"\n' for word in WORDS))
    options = [f"-seed={seed}", f"-timeout={HANG_S}", f"-max_len={_LARGEST}", f"-dict={words}",
               f"-exact_artifact_path={finding}", str(corpus)]  # fmt: skip
    runs, end = 0, time.process_time() + seconds

    def try_next(data: bytes) -> None:
        nonlocal runs
        if time.process_time() >= end:
            print("executed_units:", runs, flush=True)
            os._exit(0)
        runs += 1
        attempt(target, data)

    atheris.Setup([sys.argv[0], *options], try_next)
    atheris.Fuzz()


def run_child(target: str, engine: str, seconds: float, seed: int, finding: Path) -> tuple[int, str]:
    """How many inputs a target's own process tried, and what it found: empty for nothing."""
    command = [
        sys.executable,
        __file__,
        "--child",
        engine,
        "--target",
        target,
        "--seconds",
        str(seconds),
        "--seed",
        str(seed),
    ]
    done = subprocess.run(
        [*command, "--keep", str(finding)], capture_output=True, text=True, errors="replace", check=False
    )
    output = done.stdout + done.stderr
    units = [line.split()[-1] for line in output.splitlines() if "executed_units" in line]
    return int(units[-1]) if units else 0, "" if done.returncode == 0 else output[-3000:]


def _processor_s() -> float:
    """Processor time of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Run every target for the given time each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time, for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", choices=sorted(TARGETS), action="append")
    parser.add_argument("--engine", choices=["atheris", "mutations"], default="atheris" if _ATHERIS else "mutations")
    parser.add_argument("--keep", type=Path, default=Path("findings"), help="folder for inputs that break something")
    parser.add_argument("--child", choices=["atheris", "mutations"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        if options.child == "atheris":
            fuzz_by_coverage(options.target[0], options.seconds, options.seed, options.keep)
        try:
            runs = fuzz_by_mutations(options.target[0], options.seconds, options.seed, options.keep)
        except BaseException:
            traceback.print_exc()
            return 1
        print("executed_units:", runs)
        return 0
    options.keep.mkdir(parents=True, exist_ok=True)
    found = 0
    print("| target | engine | seconds | processor s | inputs | finding |\n|---|---|---|---|---|---|")
    for target in options.target or TARGETS:
        finding = options.keep / f"{target}.bin"
        start, before_s = time.monotonic(), _processor_s()
        runs, problem = run_child(target, options.engine, options.seconds, options.seed, finding)
        times = f"{time.monotonic() - start:.0f} | {_processor_s() - before_s:.0f}"
        print(f"| {target} | {options.engine} | {times} | {runs} | {finding if problem else 'none'} |", flush=True)
        if problem:
            found += 1
            print(problem, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
