"""Plan what nobody chose: random terrains, areas, sensors and bands of heights, each plan checked and flown.

Usage: .venv/bin/python scripts/bench/random_cases.py -o PAGE.md [--cases 24] [--first 0] [--evaluations 300]

The cases are those of tests/random_kinds.py. Each plan is checked as in scripts/bench/kinds.py, by code that shares nothing with
the planner, and flown by a mock vehicle on a simulated clock. Not every case can be planned: the walls of a canyon may be higher
than the band of heights is wide. Each finished case is a row of the .csv beside the page; run again after a stop, the same
command goes on with what is missing.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from scripts.bench.kinds import Row, measure_file, read_rows, said_of, write_rows
from scripts.options import file_to_write
from tests.random_kinds import random_case

CLAIM = 0.002
"""A claim and its recomputation are equal within this."""

FLOWN = 0.003
"""A flight may see so much less than planned."""

LANDED = "landed"
"""The ending of a flight that the verdict has nothing against."""

_LONGER = 1.001


def measured(number: int, folder: Path, *, evaluations: int) -> Row:
    """One case as a row, its number in place of the seed."""
    case = random_case(number)
    folder.mkdir(parents=True, exist_ok=True)
    words = f"{case.ground}, {case.area}, {case.kind.band_m[0]:.0f} to {case.kind.band_m[1]:.0f} m"
    if case.kind.prisms:
        words += f", {len(case.kind.prisms)} houses"
    return measure_file(case.write(folder), words, case.sensor, number, evaluations=evaluations, flown=True)


def faults(row: Row) -> list[str]:
    """What does not hold of a case that was planned."""
    found = []
    if not row.met:
        found.append("not reached")
    if abs(row.recomputed - row.claimed) > CLAIM:
        found.append(f"claim {100.0 * (row.claimed - row.recomputed):+.2f}")
    if math.isnan(row.flown) or row.ending != LANDED:
        found.append(f"flight: {row.ending}")
    if row.flown < row.claimed - FLOWN:
        found.append(f"flown {100.0 * (row.flown - row.claimed):+.2f}")
    if row.mission_s > _LONGER * row.lines_s:
        found.append(f"{100.0 * (row.mission_s / row.lines_s - 1.0):.1f} % longer")
    if row.out_of_band_m > 0.0:
        found.append(f"{row.out_of_band_m:.2f} m out of its band")
    return found


def summary(rows: Sequence[Row]) -> list[str]:
    """What the table says, in a few lines."""
    planned = [row for row in rows if not math.isnan(row.claimed)]
    if not planned:
        return [f"- None of {len(rows)} was planned."]
    off = [100.0 * (row.claimed - row.recomputed) for row in planned]
    flown = [100.0 * (row.flown - row.claimed) for row in planned if not math.isnan(row.flown)]
    gains = sorted(100.0 * (row.mission_s / row.lines_s - 1.0) for row in planned if not math.isnan(row.lines_s))
    against = "- No simple lines see as much."
    if gains:
        middle, worst = gains[len(gains) // 2], gains[-1]
        against = f"- Against the best simple lines that see as much: {middle:+.0f} % time in the middle, {worst:+.1f} % at most."
    return [
        f"- {len(planned)} of {len(rows)} were planned, {sum(row.met for row in planned)} of them reach what was asked.",
        f"- Claims less recomputation: {min(off):+.2f} to {max(off):+.2f} points.",
        f"- Flown less planned: {min(flown, default=math.nan):+.2f} to {max(flown, default=math.nan):+.2f} points.",
        against,
    ]


def write(out: Path, rows: Sequence[Row], *, command: str) -> None:
    """The page, and the table beside it."""
    write_rows(out.with_suffix(".csv"), rows)
    lines = [
        "# What nobody chose",
        "",
        said_of(command),
        "",
        *summary(rows),
        "",
        "| case | terrain, area, band | sensor | asked | claimed | recomputed | flown | waypoints | mission | best lines | "
        "what does not hold |",
        "|---:|---|---|---:|---:|---:|---:|---:|---:|---:|---|",
    ]  # fmt: skip
    for row in rows:
        start = f"| {row.seed} | {row.terrain} | {row.sensor} | {100.0 * row.asked:g} % | "
        if math.isnan(row.claimed):
            lines.append(start + f" | | | | | | no plan: {row.ending} |")
            continue
        best = "none" if math.isnan(row.lines_s) else f"{row.lines_s:.0f} s"
        lines.append(
            start
            + f"{100.0 * row.claimed:.2f} % | {100.0 * row.recomputed:.2f} % | {100.0 * row.flown:.2f} % | "
            f"{row.waypoints} | {row.mission_s:.0f} s | {best} | {', '.join(faults(row))} |"
        )  # fmt: skip
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan, check, fly, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, required=True)
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--evaluations", type=int, default=300)
    chosen = parser.parse_args(arguments)
    command = f"bench/random_cases.py --first {chosen.first} --cases {chosen.cases} --evaluations {chosen.evaluations}"
    rows = read_rows(chosen.out.with_suffix(".csv"))
    done = {row.seed for row in rows}
    with tempfile.TemporaryDirectory() as temporary:
        for number in range(chosen.first, chosen.first + chosen.cases):
            if number not in done:
                rows.append(measured(number, Path(temporary) / str(number), evaluations=chosen.evaluations))
                print(rows[-1], flush=True)
                write(chosen.out, rows, command=command)
    return 0


if __name__ == "__main__":
    sys.exit(main())
