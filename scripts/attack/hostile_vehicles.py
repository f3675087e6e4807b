"""Every call of the client against vehicles that are wrong on purpose, in simulated time: does each end as it is stated?

    python scripts/attack/hostile_vehicles.py [-o PAGE.md] [--seeds 100]

Each seed is a vehicle with one to three tricks (tests/mission_io/protocol/hostile.py) as ArduPilot and as PX4; upload (and
reading back), download and clear run for mission, fence and rally points: 1,800 calls with 100 seeds. Exit code 0 when
every call ended within its time (mission_io/protocol/timing.py) and number of messages, with a named error or rightly.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from mission_io.autopilots.autopilot import ARDUPILOT, PX4  # noqa: E402
from mission_io.model.items import MissionType  # noqa: E402
from scripts.options import file_to_write  # noqa: E402
from tests.mission_io.protocol.attacks import CALLS, ITEMS, Attack, attack  # noqa: E402
from tests.mission_io.protocol.hostile import TRICKS  # noqa: E402

HEAD = f"""# Transfers with hostile vehicles

Written by `scripts/attack/hostile_vehicles.py` in simulated time: a vehicle is an autopilot's own server with one to three
tricks, and some answer up to 3 s late. Lists of {ITEMS} items; an upload is read back. "Bound" is the time that
`mission_io.protocol.timing` states for the call, however slowly a vehicle gets on; "wrong" is a success that was none.
An error of another kind than the package's own would end the script.

The tricks: {", ".join(kind.__name__ for kind in TRICKS)}.
"""
COLUMNS = (
    "call", "calls", "right", "named errors", "wrong", "beyond the bound", "median", "longest", "bound", "most messages",
)  # fmt: skip


def is_wrong(result: Attack) -> bool:
    """Whether a call said that it worked and it had not."""
    return not result.error and not result.correct


def is_beyond(result: Attack) -> bool:
    """Whether a call took longer, or sent more, than it may."""
    return result.time_s > result.bound_s or result.sent > result.most_messages


def row(call: str, results: Sequence[Attack]) -> str:
    """One line of the table."""
    times = sorted(result.time_s for result in results)
    cells = (
        call, len(results), sum(result.correct for result in results), sum(bool(result.error) for result in results),
        sum(map(is_wrong, results)), sum(map(is_beyond, results)), f"{times[len(times) // 2]:.1f} s", f"{times[-1]:.1f} s",
        f"{results[0].bound_s:.0f} s", max(result.sent for result in results),
    )  # fmt: skip
    return "| " + " | ".join(map(str, cells)) + " |"


def slowest(results: Sequence[Attack]) -> str:
    """The five calls that took longest, with what they said."""
    lines = [
        f"- {result.time_s:.1f} s, {result.sent} messages: {result.call} of the {result.mission_type}, {result.autopilot}, seed "
        f"{result.seed} ({result.vehicle}): {result.error or 'worked'}"
        for result in sorted(results, key=lambda result: -result.time_s)[:5]
    ]
    return "\n".join(lines)


def main() -> int:
    """Run every call, and write the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("-o", "--out", type=file_to_write, help="write the table there, too")
    options.add_argument("--seeds", type=int, default=100)
    chosen = options.parse_args()
    results = [
        attack(seed, autopilot, mission_type, call)
        for seed in range(chosen.seeds)
        for autopilot in (ARDUPILOT, PX4)
        for mission_type in MissionType
        for call in CALLS
    ]
    rows = [row(call, [result for result in results if result.call == call]) for call in CALLS]
    header = "| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS)
    text = f"{HEAD}\n{chosen.seeds} seeds, both autopilots, three lists:\n\n{header}\n" + "\n".join(rows)
    text += f"\n\nThe slowest:\n\n{slowest(results)}\n"
    print(text)
    if chosen.out is not None:
        chosen.out.write_text(text, encoding="utf-8")
    bad = [result for result in results if is_wrong(result) or is_beyond(result)]
    for result in bad:
        print(f"NOT AS STATED: {result}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
