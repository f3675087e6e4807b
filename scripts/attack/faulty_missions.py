"""Put faults into good missions and see whether ``uavcover check`` finds them.

Usage: .venv/bin/python scripts/attack/faulty_missions.py [--missions 100] [--faults 500] [--seed 1] [-o PAGE.md]

Good missions are lines over seven terrains, and faults of ten kinds are put into them. Both are believed only when
tests/naive/mission_check.py, which shares nothing with the package, says by more than a margin that they are what they are to be.
"""

import argparse
import itertools
import json
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from scripts.options import file_to_write
from tests.extras.check.made_faults import with_fault
from tests.extras.check.made_missions import KINDS, Case, Terrain, good_mission, terrains
from uavcover.cli.main import app, run_app

LEEWAY_M = 1.0
"""Where the naive judge, which samples, is nearer to a limit than this, it does not decide."""


def judged(case: Case, folder: Path) -> tuple[int, list[dict]]:
    """Exit code and findings of the command."""
    import contextlib
    import io

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_app(app, ["check", *case.write(folder), "--json", "-q"])
    document = json.loads(out.getvalue() or "{}")
    return code, document.get(
        "findings", [{"kind": "refused", "weight": "breaks", "items": None, "what": document.get("error")}]
    )


def touches(items: list[int] | None, expected: tuple[int, int] | None) -> bool:
    """Whether a finding names the items of a fault, or the whole mission."""
    if items is None or expected is None:
        return True
    low, high = min(items), max(items)
    return low <= max(expected) and high >= min(expected)


def denied(case: Case, findings: list[dict]) -> list[str]:
    """Kinds that the command reports and the naive judge says are kept by more than the leeway."""
    if case.truth is None:
        return []
    broken = {one["kind"] for one in findings if one["weight"] == "breaks"}
    return [
        kind for kind in sorted(broken & set(case.truth)) if max(case.truth[kind].values(), default=0.0) < -LEEWAY_M
    ]


def main() -> None:
    """Make missions and faults, judge them, write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--missions", type=int, default=100)
    parser.add_argument("--faults", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--out", type=file_to_write, default=None)
    given = parser.parse_args()
    began = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        grounds = terrains(folder)
        good, alarms = _good_missions(grounds, given.missions, folder, given.seed)
        rows, extra = _faults(good, given.faults, folder, given.seed)
    text = _page(good, alarms, rows, extra, time.process_time() - began, given.seed)
    print(text)
    if given.out is not None:
        given.out.write_text(text, encoding="utf-8")


def _good_missions(grounds: list[Terrain], count: int, folder: Path, seed: int) -> tuple[list[Case], list[str]]:
    good: list[Case] = []
    alarms = []
    number = -1
    while len(good) < count:
        number += 1
        case = good_mission(grounds[number % len(grounds)], np.random.default_rng([2 * seed - 1, number]))
        if case is None:
            continue
        good.append(case)
        code, findings = judged(case, folder)
        reported = [f"{one['kind']} {one['items']}: {one['what']}" for one in findings if one["weight"] != "look"]
        if code != 0 or reported:
            alarms.append(f"mission {number} on {case.terrain.name}: exit {code}; {'; '.join(reported)}")
            print(alarms[-1], flush=True)
    return good, alarms


def _faults(good: list[Case], count: int, folder: Path, seed: int) -> tuple[dict[str, Counter], list[str]]:
    rows = {kind: Counter() for kind in KINDS}
    extra = []
    each = [count // len(KINDS) + (k < count % len(KINDS)) for k in range(len(KINDS))]
    for kind, wanted in zip(KINDS, each, strict=True):
        for number in itertools.count():
            if rows[kind]["seeded"] == wanted or number > 40 * wanted + 40:
                break
            faulty = with_fault(
                good[number % len(good)], kind, np.random.default_rng([2 * seed, KINDS.index(kind), number])
            )
            if faulty is None:
                continue
            code, findings = judged(faulty, folder)
            there = [one for one in findings if one["weight"] == "breaks" and one["kind"] in faulty.expected]
            found = code in (1, 2) and any(touches(one["items"], faulty.items) for one in there)
            rows[kind]["seeded"] += 1
            rows[kind]["found"] += found
            rows[kind]["missed"] += not found
            if not found:
                reported = [f"{one['kind']} {one['items']}" for one in findings if one["weight"] == "breaks"]
                extra.append(f"missed: {kind} {number} on {faulty.terrain.name}, items {faulty.items}: {reported}")
                print(extra[-1], flush=True)
            for other in denied(faulty, findings):
                extra.append(f"false: {kind} {number} on {faulty.terrain.name}: {other}")
                print(extra[-1], flush=True)
        print(f"{kind}: {dict(rows[kind])}", flush=True)
    return rows, extra


def _page(
    good: list[Case], alarms: list[str], rows: dict[str, Counter], extra: list[str], seconds: float, seed: int
) -> str:
    by_terrain = Counter(case.terrain.name for case in good)
    seeded, found = (sum(row[key] for row in rows.values()) for key in ("seeded", "found"))
    false = sum(line.startswith("false") for line in extra)
    kinds = "\n".join(f"| {KINDS_IN_WORDS[kind]} | {row['seeded']} | {row['found']} |" for kind, row in rows.items())
    where = ", ".join(f"{count} on {name}" for name, count in sorted(by_terrain.items()))
    text = PAGE.format(
        missions=len(good),
        seeded=seeded,
        found=found,
        alarms=len(alarms),
        false=false,
        leeway=LEEWAY_M,
        kinds=kinds,
        where=where,
        seconds=seconds,
        seed=seed,
    )
    wrong = [f"- {line}" for line in (*alarms, *extra)]
    return text + ("\nWhat went wrong:\n\n" + "\n".join(wrong) + "\n" if wrong else "")


PAGE = """# Faults in missions

`python scripts/attack/faulty_missions.py --missions {missions} --faults {seeded} --seed {seed}` makes good missions, puts
one fault into each copy and runs `uavcover check` on the files. What a mission is, good or faulty, is decided by
`tests/naive/mission_check.py`: a place every 2 m along the path, each asked on its own, with another geodesy, another reader
of the elevation file and another point-in-polygon test. It shares no code with the package. A mission counts as good when it
keeps every limit by {leeway:g} m or more, and a fault as one when it breaks one by as much.

**{found} of {seeded} faults found; {alarms} false alarms on {missions} good missions.** A fault is found when the command
ends with 1 (or refuses the file with 2) and a finding of the right kind names its items. On the faulty missions {false}
findings were of a kind that the naive judge says is kept.

| fault | seeded | found |
|---|---:|---:|
{kinds}

Good missions: {where}. They have heights above home or above the sea, are `.waypoints` for ArduPilot or `.plan` for PX4, end
with a landing or a return, and some have splines, jumps that repeat a line, and waits. Each has a fence, a no-fly zone beside
it or above it, a battery and a return altitude. Limits: 20 to 120 m above the ground.

{seconds:.0f} s of processor time, for making, naive judging and the command.
"""

KINDS_IN_WORDS = {
    "hill": "waypoints left out: a hill between two points",
    "no-fly": "a leg cuts the corner of a no-fly zone",
    "spline": "a spline cuts: into the ground or out of the fence",
    "jump": "a jump skips a climb",
    "frame": "heights in the wrong frame",
    "feet": "feet for metres, or metres for feet",
    "swapped": "latitude and longitude swapped",
    "fence": "a fence that is too small",
    "battery": "a battery that is too small",
    "return": "a return through a ridge",
}


if __name__ == "__main__":
    main()
