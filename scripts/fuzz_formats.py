"""Fuzz the file formats of mission_io: nothing but a FormatError, no hang, and what was read survives writing.

Usage: python scripts/fuzz_formats.py --seconds 60 --seed 1 [--target plan] [--engine atheris|mutations] [--keep DIR]

With ``atheris`` installed (``pip install atheris``) coverage leads the way to new inputs; without it, seeded files are
mutated blindly. A finding is printed with the file that causes it, and the exit code is 1. Each target has its own process.
"""

import argparse
import importlib.util
import json
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

    _watched: Any = atheris.instrument_imports(include=["mission_io"])
else:
    _watched = nullcontext()

with _watched:
    from mission_io.errors import FormatError
    from mission_io.formats import csv, files, geojson, kml, old_qgc_json, plan, poly, rally_lines, wpl
    from mission_io.formats.drawings import DrawnArea, fence_from_areas
    from mission_io.formats.mission_dat import read_mission_dat, write_mission_dat
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
}
BINARY = frozenset({"mission_dat"})
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
    }  # fmt: skip
    return [text.encode("latin-1" if target in BINARY else "utf-8") for text in texts[target]]


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
    options = [f"-max_total_time={round(seconds)}", f"-seed={seed}", f"-timeout={HANG_S}", f"-max_len={_LARGEST}",
               "-print_final_stats=1", f"-dict={words}", f"-exact_artifact_path={finding}", str(corpus)]  # fmt: skip
    atheris.Setup([sys.argv[0], *options], lambda data: attempt(target, data))
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
    parser.add_argument("--seconds", type=float, default=60.0, help="for each target; of processor time for mutations")
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
