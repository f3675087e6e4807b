"""Differences between two missions: lossless, and can be applied or reversed.

``apply_diff(diff(a, b), a)`` equals ``b`` to the last bit, NaN and minus zero included. A moved item appears as removed and
inserted. The time is proportional to the number of items, not to its square.
"""

import struct
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.errors import MisuseError
from mission_io.model.items import Command, GeoPoint, Mission, MissionItem


@dataclass(frozen=True, slots=True)
class Edit:
    """A run of items replaced by another."""

    at: int  # position of its first item in the old list, from 0
    removed: tuple[MissionItem, ...]  # the old items; empty for an insertion
    inserted: tuple[MissionItem, ...]  # the new items; empty for a removal


@dataclass(frozen=True, slots=True)
class MissionDiff:
    """The changes from one mission to another; false when there are none."""

    home: tuple[GeoPoint | None, GeoPoint | None] | None  # the old and the new home, when they differ
    edits: tuple[Edit, ...]  # the changed runs of items, in order, none adjacent to another

    def __bool__(self) -> bool:
        return self.home is not None or bool(self.edits)

    def __str__(self) -> str:
        """One line for each item removed (``-``) or inserted (``+``), numbered from 1, every number unrounded."""
        lines = [] if self.home is None else [f"- home {_place(self.home[0])}", f"+ home {_place(self.home[1])}"]
        shift = 0
        for edit in self.edits:
            lines += [f"- {n} {_item_text(item)}" for n, item in enumerate(edit.removed, start=edit.at + 1)]
            lines += [f"+ {n} {_item_text(item)}" for n, item in enumerate(edit.inserted, start=edit.at + shift + 1)]
            shift += len(edit.inserted) - len(edit.removed)
        return "\n".join(lines) or "no difference"

    def inverse(self) -> "MissionDiff":
        """The reverse changes."""
        edits: list[Edit] = []
        shift = 0
        for edit in self.edits:
            edits.append(Edit(edit.at + shift, edit.inserted, edit.removed))
            shift += len(edit.inserted) - len(edit.removed)
        return MissionDiff(None if self.home is None else (self.home[1], self.home[0]), tuple(edits))


def diff(old: Mission, new: Mission) -> MissionDiff:
    """The changes from ``old`` to ``new``."""
    home = None if _home_bits(old.home) == _home_bits(new.home) else (old.home, new.home)
    return MissionDiff(home, diff_items(old.items, new.items))


def apply_diff(change: MissionDiff, mission: Mission) -> Mission:
    """Apply changes to the mission they were made from. Raises MisuseError: it is another mission."""
    if change.home is None:
        home = mission.home
    else:
        if _home_bits(mission.home) != _home_bits(change.home[0]):
            raise MisuseError(
                "the change belongs to a mission with a different home; create it again from this mission"
            )
        home = change.home[1]
    return Mission(home, apply_edits(change.edits, mission.items))


def diff_items(old: Sequence[MissionItem], new: Sequence[MissionItem]) -> tuple[Edit, ...]:
    """The changed runs between two item lists: of missions, fences or rally points.

    Items that occur once in each list anchor the comparison, in their longest common order (patience sorting); matches
    extend from there over equal neighbours. Lists without such items are compared from both ends.
    """
    old_bits, new_bits = [_bits(item) for item in old], [_bits(item) for item in new]
    edits: list[Edit] = []
    i = j = 0
    for next_i, next_j in [*_anchors(old_bits, new_bits), (len(old), len(new))]:
        while i < next_i and j < next_j and old_bits[i] == new_bits[j]:
            i, j = i + 1, j + 1
        end_i, end_j = next_i, next_j
        while end_i > i and end_j > j and old_bits[end_i - 1] == new_bits[end_j - 1]:
            end_i, end_j = end_i - 1, end_j - 1
        if end_i > i or end_j > j:
            edits.append(Edit(i, tuple(old[i:end_i]), tuple(new[j:end_j])))
        i, j = next_i, next_j
    return tuple(edits)


def apply_edits(edits: Sequence[Edit], items: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
    """Apply edits to the item list they were made from. Raises MisuseError: it is another list."""
    result: list[MissionItem] = []
    position = 0
    for edit in edits:
        end = edit.at + len(edit.removed)
        there = items[edit.at : end]
        if edit.at < position or [*map(_bits, there)] != [*map(_bits, edit.removed)]:
            raise MisuseError(
                f"the change does not match the mission at item {edit.at}; create it again from this mission"
            )
        result += items[position : edit.at]
        result += edit.inserted
        position = end
    return (*result, *items[position:])


def _place(home: GeoPoint | None) -> str:
    return "unknown" if home is None else f"{home.lat_deg}, {home.lon_deg}, {home.alt_amsl_m} m AMSL"


def _item_text(item: MissionItem) -> str:
    name = Command(item.command).name if item.command in list(Command) else f"command {item.command}"
    params = ", ".join(f"{value}" for value in item.params)
    if not item.has_position:
        return f"{name}({params}, {item.lat_deg}, {item.lon_deg}, {item.alt_m})"
    return f"{name}({params}) at {item.lat_deg}, {item.lon_deg}, {item.alt_m} m {item.frame.name}"


def _anchors(old: list[bytes], new: list[bytes]) -> list[tuple[int, int]]:
    """Pairs of positions of the items that occur once in each list, in their longest common order."""
    at_old, at_new = _only_once(old), _only_once(new)
    pairs = [(i, at_new[bits]) for bits, i in at_old.items() if bits in at_new]
    tails: list[int] = []
    tail_pairs: list[int] = []
    before: list[int] = []
    for number, (_, j) in enumerate(pairs):
        length = bisect_left(tails, j)
        before.append(tail_pairs[length - 1] if length else -1)
        if length == len(tails):
            tails.append(j)
            tail_pairs.append(number)
        else:
            tails[length], tail_pairs[length] = j, number
    chain: list[tuple[int, int]] = []
    number = tail_pairs[-1] if tail_pairs else -1
    while number >= 0:
        chain.append(pairs[number])
        number = before[number]
    return chain[::-1]


def _only_once(bits: list[bytes]) -> dict[bytes, int]:
    found: dict[bytes, int] = {}
    for position, value in enumerate(bits):
        found[value] = -1 if value in found else position
    return {value: position for value, position in found.items() if position >= 0}


def _bits(item: MissionItem) -> bytes:
    return struct.pack(
        "<qi7d?",
        item.command,
        item.frame,
        *(value for _, value in item.values()),
        item.autocontinue,
    )


def _home_bits(home: GeoPoint | None) -> bytes | None:
    return None if home is None else struct.pack("<3d", home.lat_deg, home.lon_deg, home.alt_amsl_m)
