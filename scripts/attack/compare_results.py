"""Compare what two checkouts compute: plans, selections, exports, verdicts, checks, photo judgements of 12 scenarios.

``record CHECKOUT FOLDER`` runs every command with the code of a checkout and keeps what it printed and wrote;
``compare FOLDER FOLDER`` prints what differs and ends with 1 when anything does. A refactoring has 0 differences.
Times, versions and the wording of sentences may differ; numbers inside sentences may not.
"""

import argparse
import contextlib
import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

SCENARIOS = {
    "jacksboro": "",
    "paper-R2": "",
    "paper-planar": "",
    "paper-r1": "",
    "ridge-25km2": "--parts 2",
    "ridge-obstacles": "",
    "docs/examples/search.toml": "",
    "docs/examples/survey.toml": "",
    "docs/examples/valley.toml": "",
    "docs/examples/valley.toml:px4": "--autopilot px4 --rally auto",
    "docs/examples/valley.toml:two": "--vehicles 2",
    "jacksboro:nsga2": "--algorithm nsga2",
}
"""Bundled names, files of the checkout, and options; what follows a colon makes the name unique."""

FORMATS = ("plan", "kml", "geojson", "csv", "gpx", "wpml", "litchi", "print", "mavproxy-fence")
VALLEY = ("--dem", "bundled:jacksboro.tif", "--vertical-datum", "EGM96")
CHANGING = re.compile(
    r"(version|command|commit|_at$|^at$|elapsed|search_time|seconds|processor|sha256|hash|created|cwd|previous|^run$|memory|"
    r"^per_second|^out$|workers|load|wall_s)"
)
NUMBER = re.compile(r"-?\d+(?:[.,]\d+)*(?:[eE][-+]?\d+)?")
ENDLESS = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d)?(?:\.\d+)?Z?|\d\d:\d\d UTC|\b[0-9a-f]{7,64}\b")


def run(checkout: Path, *words: str, cwd: Path) -> str:
    """The exit code and output of one command of the checkout."""
    env = dict(os.environ, PYTHONPATH=str(checkout), PYTHONHASHSEED="0", COLUMNS="100", SOURCE_DATE_EPOCH="1700000000")
    python = checkout / ".venv/bin/python"
    ended = subprocess.run(
        [str(python) if python.exists() else sys.executable, "-m", "uavcover", *words],
        cwd=cwd, env=env, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=1200, check=False,
    )  # fmt: skip
    return f"exit {ended.returncode}\n{ended.stdout}\n--- stderr\n{ended.stderr}"


def positions(mission: Path) -> list[tuple[float, float, float]]:
    """Latitude, longitude, height of the waypoints of a .waypoints file."""
    rows = [line.split("\t") for line in mission.read_text().splitlines()[1:]]
    return [(float(r[8]), float(r[9]), float(r[10])) for r in rows if r[3] == "16" and float(r[8])]


def write_flight(file: Path, route: list[tuple[float, float, float]]) -> None:
    """The route flown at constant speed as a .gpx log with a position each second."""
    points, moment = [], 1_700_000_000
    for (lat0, lon0, alt0), (lat1, lon1, alt1) in pairwise(route):
        metres = max(abs(lat1 - lat0) * 111_000, abs(lon1 - lon0) * 89_000, abs(alt1 - alt0))
        steps = max(1, round(metres / 8.0))
        for k in range(steps):
            moment += 1
            stamp = f"{datetime.fromtimestamp(moment, UTC):%Y-%m-%dT%H:%M:%SZ}"
            lat, lon, alt = (a + (b - a) * k / steps for a, b in ((lat0, lat1), (lon0, lon1), (alt0, alt1)))
            points.append(f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><ele>{alt:.3f}</ele><time>{stamp}</time></trkpt>')
    file.write_text(
        '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
        + "".join(points) + "</trkseg></trk></gpx>"
    )  # fmt: skip


def write_photos(file: Path, route: list[tuple[float, float, float]]) -> None:
    """A photo at each waypoint, as a table."""
    rows = [f"{k:04d},{lat:.7f},{lon:.7f},{alt:.2f},0,-90" for k, (lat, lon, alt) in enumerate(route)]
    file.write_text("name,lat,lon,alt,yaw,pitch\n" + "\n".join(rows) + "\n")


def record(checkout: Path, out: Path) -> None:
    """Run everything with one checkout."""
    out.mkdir(parents=True)
    for key, options in SCENARIOS.items():
        name, folder = key.split(":")[0], out / re.sub(r"\W+", "-", key)
        folder.mkdir()
        scenario = str(checkout / name) if name.endswith(".toml") else name

        def step(what: str, *words: str, cwd: Path = folder) -> None:
            print(f"{cwd.name}: {what}", file=sys.stderr, flush=True)
            (cwd / f"{what}.txt").write_text(run(checkout, *words, cwd=cwd))

        searched = ("--evaluations", "60", "--seed", "3", "--workers", "2", *options.split())
        step("plan", "plan", scenario, "-o", "run", *searched, "--json")
        step("pareto", "pareto", "run", "--json")
        step("select", "select", "run", "knee", "--json")
        for kind in FORMATS:
            step(f"export-{kind}", "export", "run", "--format", kind, "-o", f"exported-{kind}", "--json")
        missions = sorted((folder / "run").rglob("mission.waypoints"))
        if not missions:
            continue
        mission, route = missions[0], positions(missions[0])
        write_flight(folder / "flown.gpx", route)
        write_photos(folder / "photos.csv", route)
        folder_of_one = str(mission.parent.relative_to(folder))
        step("verify", "verify", folder_of_one, "--log", "flown.gpx", "--json")
        step("gaps", "gaps", folder_of_one, "--evaluations", "10", "--seed", "3", "--json")
        step("report", "report", folder_of_one, "--json")
        dem = str(checkout / "uavcover/data/jacksboro.tif")
        step("check", "check", str(mission.relative_to(folder)), "--dem", dem, "--vertical-datum", "EGM96", "--json")
        step(
            "judge-photos", "judge-photos", "photos.csv", "--scenario", scenario, "-o", "photos", "--no-refly", "--json"
        )


def plain(value: Any, key: str = "") -> Any:
    """A JSON value without what may differ."""
    if key and CHANGING.search(key):
        return None
    if isinstance(value, dict):
        return {k: plain(v, k) for k, v in value.items()}
    if isinstance(value, list):
        return [plain(v) for v in value]
    if isinstance(value, str) and re.fullmatch("[0-9a-f]{64}", value):
        return None
    if isinstance(value, str) and (" " in value or "/" in value):
        return numbers(value)
    return value


def numbers(text: str) -> list[str]:
    """The numbers of a sentence, without paths, dates and times."""
    text = ENDLESS.sub(" ", re.sub(r"\S*/\S*", " ", text))
    return NUMBER.findall(text)


def leaves(value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Every value of a JSON document with its place."""
    if isinstance(value, dict):
        for k, v in value.items():
            yield from leaves(v, f"{where}.{k}")
    elif isinstance(value, list) and any(isinstance(v, dict | list) for v in value):
        for k, v in enumerate(value):
            yield from leaves(v, f"{where}[{k}]")
    else:
        yield where, value


def content(file: Path) -> dict[str, Any]:
    """What of a file must be equal, by place."""
    raw = file.read_bytes()
    if zipfile.is_zipfile(file):
        with zipfile.ZipFile(file) as archive:
            return {name: numbers(archive.read(name).decode(errors="replace")) for name in sorted(archive.namelist())}
    if file.suffix in (".tif", ".png", ".waypoints", ".rrd"):
        return {"bytes": raw}
    text = raw.decode(errors="replace")
    if file.suffix == ".html":
        return {"size is positive": len(text) > 0}
    if file.suffix == ".txt":
        head, _, rest = text.partition("\n")
        found: dict[str, Any] = {"exit": head}
        printed = rest.partition("\n--- stderr")[0]
        with contextlib.suppress(ValueError):
            found |= dict(leaves(plain(json.loads(printed))))
        return found
    with contextlib.suppress(ValueError):
        return dict(leaves(plain(json.loads(text))))
    if file.suffix == ".csv":
        return {f"line {k}": line for k, line in enumerate(text.splitlines())}
    return {f"line {k}": numbers(line) for k, line in enumerate(text.splitlines())}


def compare(before: Path, after: Path) -> int:
    """How many differences there are; each is printed."""
    names = [
        {f.relative_to(side) for f in side.rglob("*") if f.is_file() and ".uavcover" not in f.name}
        for side in (before, after)
    ]
    found = 0
    for name in sorted(names[0] ^ names[1]):
        found += 1
        print(f"{name}: only {'before' if name in names[0] else 'after'}")
    for name in sorted(names[0] & names[1]):
        old, new = content(before / name), content(after / name)
        for position in list(dict.fromkeys([*old, *new])):
            if old.get(position, "absent") != new.get(position, "absent"):
                found += 1
                print(
                    f"{name} {position}: {str(old.get(position, 'absent'))[:100]} -> {str(new.get(position, 'absent'))[:100]}"
                )
    print(f"{found} differences in {len(names[0] | names[1])} files")
    return found


def main() -> int:
    """Record or compare."""
    requested = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    requested.add_argument("do", choices=("record", "compare"))
    requested.add_argument("first", type=Path, help="record: the checkout; compare: results before")
    requested.add_argument("second", type=Path, help="record: a new folder for results; compare: results after")
    a = requested.parse_args()
    if a.do == "record":
        record(a.first.resolve(), a.second.resolve())
        return 0
    return 1 if compare(a.first, a.second) else 0


if __name__ == "__main__":
    sys.exit(main())
