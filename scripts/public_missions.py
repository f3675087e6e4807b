"""Read every mission, fence and rally file of a folder, write it, read it again, and print what became of it.

Usage: python scripts/public_missions.py FOLDER [--list] [--json FILE]

FOLDER holds one folder a source (``owner+repository``); equal files count once. Each file is read by the reader of its
format, written in the same format, and read again; a ``.plan`` is written as ``.waypoints`` too and the other way round,
where both can say it. What a ``.waypoints`` file says before and after is compared as pymavlink reads it, and what a
``.plan`` says as plain JSON, so that no code that wrote a file judges it. A file that is refused although pymavlink reads it
is named. Nothing is written into FOLDER.
"""

import argparse
import hashlib
import json
import math
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymavlink import mavwp

from mission_io.autopilots.autopilot import PX4
from mission_io.errors import MissionIoError
from mission_io.formats import kml, plan, poly, wpl
from mission_io.formats.drawings import fence_from_areas
from mission_io.formats.files import read_file
from mission_io.formats.text import text_from_bytes
from mission_io.model.areas import Fence, RallyPoints, fence_from_items, items_from_fence
from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionItem
from scripts.options import existing_folder, file_to_write

_HOME = GeoPoint(-35.25, 149.125, 580.5)
"""Stands for the home that a file does not have, where the other format needs one."""
_NUMBER = re.compile(r"[-+]?\d[\d.,e+-]*")
_QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a file in one way: passed, refused or failed, and why; a refusal is contested where pymavlink reads it."""

    result: str
    why: str = ""
    contested: bool = False


class LostError(Exception):
    """Something that was read is gone."""


def kind_of(path: Path, text: str) -> str:
    """The format of a file by its beginning, without a look at any of our readers."""
    start = text.lstrip("\ufeff \t\r\n")[:400]
    if path.suffix.lower() in {".kml", ".poly", ".fen"}:
        return path.suffix.lower()[1:]
    if re.match(r"(#.*\n\s*)*QGC\s*WPL", start):
        return "waypoints"
    if start.startswith("{"):
        return "plan" if re.search(r'"fileType"\s*:\s*"Plan"', text) else "old JSON"
    if re.match(r"(#.*\n\s*)*RALLY\s", start):
        return "rally lines"
    if re.match(r"(#.*\n\s*)*-?\d+\.\d+[\s,]+-?\d+\.\d+\s*$", start.split("\n\n")[0], re.M):
        return "places"
    return "other"


def check(condition: bool, what: str) -> None:
    """What was read must survive."""
    if not condition:
        raise LostError(what)


def near(a: float, b: float, within: float, *, for_nan: float = 0.0) -> bool:
    """Equality of numbers; NaN equals what ``.waypoints`` files have instead: 0, and -1 in a NAV_DELAY."""
    a, b = (for_nan if math.isnan(x) else x for x in (a, b))
    return abs(a - b) <= within


def same_items(before: tuple[MissionItem, ...], after: tuple[MissionItem, ...]) -> None:
    """Every number of every item, degrees within 1e-8 and NaN as 0."""
    check(len(before) == len(after), f"{len(before)} items became {len(after)}")
    for number, (a, b) in enumerate(zip(before, after, strict=True), start=1):
        same = (a.command, a.frame, a.autocontinue) == (b.command, b.frame, b.autocontinue)
        check(same, f"item {number}: command, frame or autocontinue")
        for (name, x), (_, y) in zip(a.values(), b.values(), strict=True):
            within, for_nan = (
                1.0001e-8 if name.endswith("deg") else 0.0,
                -1.0 if a.command == Command.NAV_DELAY else 0.0,
            )
            check(near(x, y, within, for_nan=for_nan), f"item {number}: {name}")


def rows_of_pymavlink(text: str) -> list[tuple[float, ...]] | None:
    """The rows of a ``.waypoints`` file as pymavlink reads them; None when it refuses."""
    with tempfile.NamedTemporaryFile("w", suffix=".waypoints", encoding="utf-8", newline="") as file:
        file.write(text)
        file.flush()
        loader = mavwp.MAVWPLoader()
        try:
            loader.load(file.name)
        except Exception:  # whatever it raises, it refuses
            return None
    rows = [loader.item(n) for n in range(loader.count())]
    return [(w.command, w.param1, w.param2, w.param3, w.param4, w.x, w.y, w.z, w.autocontinue) for w in rows]


def round_trip_waypoints(path: Path, text: str) -> None:
    """A ``.waypoints`` file, in its own format."""
    file = read_file(path)
    read = wpl.read(text)
    written = wpl.write_mission(Mission(read.home or _HOME, read.items))
    again = wpl.read(written)
    check(again.repairs == (), "the strict form needs no repair")
    same_items(read.items, again.items)
    if file.fence is not None:
        check(fence_from_items(again.items) == file.fence, "the fence")
    before, after = rows_of_pymavlink(text), rows_of_pymavlink(written)
    if not before or read.version != 110 or read.home is None:
        return
    check(after is not None and len(before) == len(after), f"pymavlink reads {len(before)} rows, then other ones")
    for number, (x, y) in enumerate(zip(before[1:], (after or [])[1:], strict=True), start=1):
        same = all(near(p, q, 1.0001e-8 if n in (5, 6) else 0.0) for n, (p, q) in enumerate(zip(x, y, strict=True)))
        check(same, f"pymavlink reads another row {number}")


def waypoints_as_plan(path: Path, _: str) -> None:
    """A ``.waypoints`` file, written as ``.plan``."""
    file = read_file(path)
    mission = file.mission or Mission(None, ())
    lists = plan.PlanFile(
        Mission(mission.home or _HOME, mission.items), file.fence or Fence(), file.rally or RallyPoints(), 3
    )
    again = plan.read(plan.write(lists))
    same_items(mission.items, again.mission.items)
    check(again.mission.home == (mission.home or _HOME), "home")
    check(again.fence == lists.fence and again.rally == lists.rally, "fence or rally points")


def _plain(value: Any) -> Any:
    """JSON for a comparison: whole numbers are numbers like others."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def round_trip_plan(_: Path, text: str) -> None:
    """A ``.plan``, in its own format: the items as plain JSON, everything else as it was read."""
    read = plan.read_to_keep(text)
    written = plan.write(read)
    again = plan.read_to_keep(written)
    same_items(read.mission.items, again.mission.items)
    check(
        (again.fence, again.rally, again.mission.home) == (read.fence, read.rally, read.mission.home), "lists or home"
    )
    before, after = json.loads(text), json.loads(written)
    jumps = '"command": 177' in text.replace('":177', '": 177')
    items = ([_plain(e) for e in d["mission"]["items"]] for d in (before, after))
    for number, (x, y) in enumerate(zip(*items, strict=True)):
        check(
            all(y.get(key) == value for key, value in x.items()) or (jumps and x.get("command") == 177.0),
            f"items[{number}]",
        )
    for key in set(before) - {"geoFence", "rallyPoints", "mission", "version"}:
        check(before[key] == after[key], key)
    for part in ("geoFence", "rallyPoints"):
        if _plain(before.get(part, {})).get("version") == 2.0:
            for key in ("polygons", "circles", "points"):
                check(_plain(before[part].get(key, [])) == _plain(after[part].get(key, [])), f"{part}.{key}")


def plan_as_waypoints(path: Path, _: str) -> None:
    """A ``.plan``, written as ``.waypoints``: mission, and fence and rally points as lists of their own."""
    file = read_file(path)
    mission = file.mission or Mission(None, ())
    again = wpl.read(wpl.write_mission(Mission(mission.home or _HOME, mission.items)))
    same_items(mission.items, again.items)
    fence, rally = file.fence or Fence(), file.rally or RallyPoints()
    same_items(items_from_fence(fence), wpl.read(wpl.write_fence(fence, _HOME)).items)
    check(len(wpl.read(wpl.write_rally(rally, _HOME)).rally().points) == len(rally.points), "rally points")


def old_json_as_plan(path: Path, text: str) -> None:
    """A mission in QGroundControl's first JSON, written as ``.plan`` and read again."""
    file = read_file(path)
    mission = file.mission
    check(mission is not None, "a mission")
    assert mission is not None
    lists = plan.PlanFile(Mission(mission.home or _HOME, mission.items), Fence(), RallyPoints(), PX4.mav_autopilot)
    same_items(mission.items, plan.read(plan.write(lists)).mission.items)
    count = sum(1 for entry in json.loads(text)["items"] if entry.get("type") in ("missionItem", "SimpleItem"))
    check(len(mission.items) >= count, f"{count} simple items in the file, {len(mission.items)} read")


def round_trip_drawing(_: Path, text: str) -> None:
    """A KML drawing: its areas as a fence in ``.waypoints``."""
    drawing = kml.read_drawing(text)
    fence = fence_from_areas(drawing.areas)
    back = wpl.read(wpl.write_fence(fence, _HOME)).fence()
    check([len(p.vertices) for p in back.polygons] == [len(p.vertices) for p in fence.polygons], "areas")
    numbers = len(re.findall(r"<(?:\w+:)?(?:Polygon|LineString|Point)\b", re.sub(r"<!--.*?-->", "", text, flags=re.S)))
    found = len(drawing.areas) + len(drawing.lines) + len(drawing.spots)
    check(found + sum("empty" in line for line in drawing.repairs) >= numbers, f"{numbers} shapes, {found} read")


def round_trip_poly(_: Path, text: str) -> None:
    """A ``.poly`` area."""
    area = poly.read_area(text).area
    check(poly.read_area(poly.write_area(area)).area == area, "the area")


def round_trip_places(path: Path, _: str) -> None:
    """A fence or rally points of the old kinds, as ``.waypoints``."""
    file = read_file(path)
    check(file.fence is not None or file.rally is not None, "a fence or rally points")
    if file.fence is not None:
        same_items(items_from_fence(file.fence), wpl.read(wpl.write_fence(file.fence, _HOME)).items)
    if file.rally is not None:
        back = wpl.read(wpl.write_rally(file.rally, _HOME)).rally()
        check([p.frame for p in back.points] == [Frame.ABOVE_HOME] * len(file.rally.points), "rally points")


def read_only(path: Path, _: str) -> None:
    """A file of no known kind."""
    read_file(path)


WAYS: dict[str, dict[str, Callable[[Path, str], None]]] = {
    "waypoints": {"itself": round_trip_waypoints, ".plan": waypoints_as_plan},
    "plan": {"itself": round_trip_plan, ".waypoints": plan_as_waypoints},
    "old JSON": {".plan": old_json_as_plan},
    "kml": {"fence": round_trip_drawing},
    "poly": {"itself": round_trip_poly},
    "fen": {"fence": round_trip_places},
    "places": {"fence": round_trip_places},
    "rally lines": {"rally": round_trip_places},
    "other": {"read": read_only},
}


def outcome_of(way: Callable[[Path, str], None], path: Path, text: str, kind: str) -> Outcome:
    """What becomes of a file in one way."""
    try:
        way(path, text)
    except MissionIoError as error:
        what = str(error).removeprefix(f"{path}: ")
        contested = kind == "waypoints" and bool(rows_of_pymavlink(text))
        return Outcome("refused", what, contested)
    except LostError as error:
        return Outcome("failed", f"lost: {error}")
    except Exception as error:  # a fault is what this looks for
        return Outcome("failed", f"{type(error).__name__}: {error}"[:200])
    return Outcome("passed")


def reason(why: str) -> str:
    """A reason without the numbers and names of its file."""
    return _NUMBER.sub("N", _QUOTED.sub("'...'", why))[:110]


def main() -> int:
    """Judge every file of a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=existing_folder)
    parser.add_argument("--list", action="store_true", help="name every file that did not pass")
    parser.add_argument("--json", type=file_to_write, help="write every outcome")
    options = parser.parse_args()
    seen: set[str] = set()
    counts: Counter[tuple[str, str, str]] = Counter()
    reasons: Counter[tuple[str, str, str, str]] = Counter()
    sources: Counter[str] = Counter()
    rows: list[dict[str, object]] = []
    files = sorted(p for p in options.folder.rglob("*") if p.is_file())
    for path in files:
        data = path.read_bytes()
        digest = hashlib.sha256(data).hexdigest()
        if digest in seen or not data.strip():
            continue
        seen.add(digest)
        sources[path.relative_to(options.folder).parts[0].replace("+", "/", 1)] += 1
        try:
            text = text_from_bytes(data).text
        except MissionIoError:
            text = ""
        kind = kind_of(path, text)
        for way, attempt in WAYS[kind].items():
            outcome = outcome_of(attempt, path, text, kind)
            counts[kind, way, outcome.result] += 1
            if outcome.result != "passed":
                mark = " (pymavlink reads it)" if outcome.contested else ""
                reasons[kind, way, outcome.result, reason(outcome.why) + mark] += 1
                if options.list:
                    print(f"{outcome.result} {kind}->{way} {path}: {outcome.why}{mark}", file=sys.stderr)
            name = str(path.relative_to(options.folder))
            rows.append({"file": name, "kind": kind, "way": way, "result": outcome.result, "why": outcome.why})
    print(f"{len(seen)} different files of {len(files)}\n")
    print("| format | written as | files | passed | refused | failed |\n|---|---|---|---|---|---|")
    for kind, ways in WAYS.items():
        for way in ways:
            results = [counts[kind, way, result] for result in ("passed", "refused", "failed")]
            if sum(results):
                print(f"| {kind} | {way} | {sum(results)} | {' | '.join(map(str, results))} |")
    print("\n| format | written as | | reason | files |\n|---|---|---|---|---|")
    for (kind, way, result, why), count in sorted(reasons.items(), key=lambda entry: (entry[0][:3], -entry[1])):
        print(f"| {kind} | {way} | {result} | {why} | {count} |")
    print("\n| repository | files |\n|---|---|")
    for source, count in sorted(sources.items()):
        print(f"| {source} | {count} |")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))
    return 1 if any(result == "failed" for _, _, result in counts) else 0


if __name__ == "__main__":
    sys.exit(main())
