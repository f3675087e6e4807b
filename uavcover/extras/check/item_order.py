"""The order in which items are flown: jumps are followed, as often as they say."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.model.items import Command, MissionItem
from uavcover.extras.check.findings import CheckFinding

ENDLESS_PASSES = 2
"""How often a jump without an end is followed."""
_JUMP_TAG, _DO_JUMP_TAG = 600, 601
_LAST_NAVIGATION = 95
MAX_STEPS = 20_000
"""Items that are flown, repetitions counted; no battery lasts for more."""


@dataclass(frozen=True, slots=True)
class ItemOrder:
    """Items in flying order.

    Attributes:
        numbers: of the items, the first being 1, as often as each is flown.
        findings: jumps that lead nowhere or have no end.
    """

    numbers: tuple[int, ...]
    findings: tuple[CheckFinding, ...]


def order_of(items: Sequence[MissionItem]) -> ItemOrder:
    """Follow the jumps of a mission.

    The count of a jump is not reset when it is met again, as in ArduPilot (AP_Mission::get_next_cmd), so an inner loop runs
    its times once.
    """
    taken: Counter[int] = Counter()
    endless: set[int] = set()
    order: list[int] = []
    findings: list[CheckFinding] = []
    at = 1
    while 1 <= at <= len(items):
        item = items[at - 1]
        if item.command not in (Command.DO_JUMP, _DO_JUMP_TAG):
            order.append(at)
            at += 1
        else:
            target, times = item.params[:2]
            leads = f"a jump to {'tag' if item.command == _DO_JUMP_TAG else 'item'} {target:g}, {times:g} times"
            if item.command == _DO_JUMP_TAG:
                target = next(
                    (n for n, one in enumerate(items, 1) if one.command == _JUMP_TAG and one.params[0] == target), 0
                )
            if not (1 <= target <= len(items) and target == int(target) and math.isfinite(times)):
                there = f"the mission has items 1 to {len(items)}"
                if item.command == _DO_JUMP_TAG:
                    there = "no item of the mission has this tag"
                findings.append(
                    CheckFinding(
                        kind="jump", weight="breaks", items=(at, at),
                        what=f"{leads}; {there}",
                        do="jump to an item of the mission",
                    )
                )  # fmt: skip
                at += 1
                continue
            round_only = (
                [] if target > at else [n for n in range(int(target), at) if items[n - 1].command <= _LAST_NAVIGATION]
            )
            if target <= at and not round_only and times != 0:
                findings.append(
                    CheckFinding(
                        kind="jump", weight="breaks", items=(int(target), at),
                        what=f"{leads}: round and round, and no item in between flies anywhere",
                        do="jump to an item that flies, or remove it",
                    )
                )  # fmt: skip
                at += 1
                continue
            if times < 0 and at not in endless:
                endless.add(at)
                findings.append(
                    CheckFinding(
                        kind="endless", weight="look", items=(at, at),
                        what=f"jumps back to item {target:g} without end; {ENDLESS_PASSES} rounds were judged",
                        do="state how often, or watch the battery",
                    )
                )  # fmt: skip
            if taken[at] < (ENDLESS_PASSES if times < 0 else times):
                taken[at] += 1
                at = int(target)
            else:
                at += 1
        if len(order) >= MAX_STEPS or sum(taken.values()) >= MAX_STEPS:
            findings.append(
                CheckFinding(
                    kind="endless", weight="unknown", items=(at, at),
                    what=f"jumps make more than {MAX_STEPS} items; what follows was not judged",
                    do="let jumps repeat less often",
                )
            )  # fmt: skip
            break
    return ItemOrder(tuple(order), tuple(findings))
