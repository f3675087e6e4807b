"""Differences between missions: the vehicle's mission against the intended one, and one mission against another.

The comparison with a vehicle is the only one in the package: used after an upload, before arming, and in flight. Positions agree
within 2 cm, or within the effect of MAVLink's steps of 1e-7 degrees where that is larger; heights agree within 2 cm; parameters
agree when they mean the same to their command. Changes that an autopilot makes by design are its ``storage``. What the parameters
of a command mean is data, in ``parameter_meanings``.

The difference of two missions is lossless, and can be applied or reversed: ``apply_diff(diff(a, b), a)`` equals ``b`` to the last
bit, NaN and minus zero included. A moved item appears as removed and inserted. The time is proportional to the number of items,
not to its square.
"""

import math
import struct
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import MappingProxyType

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.mission_lists import command_read_back
from mission_io.data_tables import read_document
from mission_io.errors import MisuseError
from mission_io.model.items import (
    NOT_STEPS,
    Command,
    GeoPoint,
    Mission,
    MissionItem,
    MissionType,
    ground_distance_m,
    same_number,
)
from mission_io.wire.messages import degrees_on_wire, float32

# Meanings of command parameters, as data: which are unused, and which NaN, 0 or -1 leaves to the vehicle.
#
# The table is ``data/parameter_meanings.toml``. A parameter without description or label, or called empty, reserved
# or unused, is of no use; "NaN to use the current system yaw heading mode" is a heading. Ground stations fill unused
# parameters and those left to the vehicle with 0, -1 or NaN.

_SIX_DECIMALS = 1e-6
"""Files of other programs keep numbers with six decimals."""


class Meaning(Enum):
    """Rule that compares two numbers of the same parameter."""

    RESERVED = "the command does not use this parameter"
    NUMBER = "a number"
    OR_DEFAULT = "a number; with 0 or NaN, the vehicle chooses the value"
    IF_ABOVE_ZERO = "a number above 0; with any other value, the vehicle chooses"
    IF_NOT_NEGATIVE = "a number from 0; with a negative number or NaN, the vehicle chooses the value"
    HEADING = "degrees on a circle; with NaN, the vehicle chooses the value"

    def same(self, a: float, b: float) -> bool:
        """Whether two numbers mean the same."""
        match self:
            case Meaning.RESERVED:
                return True
            case Meaning.HEADING if math.isfinite(a) and math.isfinite(b):
                return abs((a - b + 180.0) % 360.0 - 180.0) <= _rounding(max(abs(a), abs(b)))
            case Meaning.OR_DEFAULT:
                a, b = (0.0 if math.isnan(value) else value for value in (a, b))
            case Meaning.IF_ABOVE_ZERO:
                a, b = (value if value > 0.0 else 0.0 for value in (a, b))
            case Meaning.IF_NOT_NEGATIVE:
                a, b = (value if value >= 0.0 else -1.0 for value in (a, b))
        return same_number(a, b) or abs(a - b) <= _rounding(abs(a))


def meaning_of(command: int, number: int) -> Meaning:
    """The meaning of a command's parameter ``number`` (1 to 7); a plain number for unknown commands.

    Parameters 5 to 7 of a command with a position are the position, and not covered here.
    """
    known = _meanings().get(command, "")
    return _LETTERS[known[number - 1]] if number <= len(known) else Meaning.NUMBER


def has_no_position(command: int) -> bool:
    """Whether parameters 5 to 7 of a command are of no use: neither a position nor numbers."""
    return _meanings().get(command, "")[4:] == "---"


def number_for_nan(item: MissionItem, number: int) -> float:
    """The number for NaN in parameter 1 to 4 of a format without NaN; NaN where none means the same.

    A heading becomes 0, as other programs write it, although it means north; the writer must report that.
    """
    match meaning_of(item.command, number):
        case Meaning.IF_NOT_NEGATIVE:
            return -1.0
        case Meaning.NUMBER:
            # A rate beside a given angle of a gimbal: the angle is gone to, so 0 adds nothing.
            beside_angle = item.command == Command.DO_GIMBAL_MANAGER_PITCHYAW and number in (3, 4)
            return 0.0 if beside_angle and math.isfinite(item.params[number - 3]) else math.nan
    return 0.0


def _rounding(size: float) -> float:
    return max(_SIX_DECIMALS, size * _FLOAT32_STEP) if math.isfinite(size) else 0.0


_LETTERS: Mapping[str, Meaning] = MappingProxyType(dict(zip("-ndaph", Meaning, strict=True)))


@cache
def _meanings() -> Mapping[int, str]:
    """By command: a letter each for parameters 1 to 4, and 5 to 7 of a command without a position."""
    path = "mission_io/data/parameter_meanings.toml"
    for command, letters in read_document(path).items():
        if not (command.isdigit() and isinstance(letters, str) and len(letters) <= 7 and set(letters) <= set(_LETTERS)):
            raise ValueError(f"{path}: {command}: expected at most seven of {''.join(_LETTERS)}, not {letters!r}")
    return {int(command): letters for command, letters in read_document(path).items()}


_FLOAT32_STEP = 2.0**-23

FieldValue = float | int | str | bool | None

SAME_POSITION_M = 0.02
"""Places and heights no farther apart are the same."""

_WIRE_STEP_DEG = 1.000001e-7
_HALF_UNIT_DEG = 0.5000001e-7
_NUMBERS = {"param1": 1, "param2": 2, "param3": 3, "param4": 4, "lat_deg": 5, "lon_deg": 6, "alt_m": 7}
_STRUCTURE = ("count", "command", "frame")


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that differs from the intended value."""

    item: int | None  # number of the item on the wire, from 0; None when the lists differ in length
    # ``count``, ``command``, ``frame``, ``param1`` to ``param4``, ``lat_deg``, ``lon_deg``, ``alt_m``,
    # ``autocontinue``, or ``home`` for a whole item 0 that an autopilot replaced
    field: str
    sent: FieldValue  # the sent or intended value
    received: FieldValue  # what came back, or is held
    acceptable: bool  # whether it is none: rounding, the autopilot's design, or another number for the same thing
    why: str  # the reason for that verdict
    # how far apart two places are over ground, or two heights, in metres; None for what is no length, infinite where
    # one of the two is not a number
    size_m: float | None = None


def compare_items(
    sent: Sequence[MissionItem],
    received: Sequence[MissionItem],
    autopilot: Autopilot,
    mission_type: MissionType = MissionType.MISSION,
) -> tuple[Difference, ...]:
    """Every difference between two item lists on the wire; empty when they are equal to the last bit."""
    differences: list[Difference] = []
    if len(sent) != len(received):
        why = "some items were lost" if len(received) < len(sent) else "the vehicle has items that were not sent"
        differences.append(Difference(None, "count", len(sent), len(received), False, why))
    home_first = autopilot.home_in_item_0 and mission_type is MissionType.MISSION
    for number, (a, b) in enumerate(zip(sent, received, strict=False)):
        if number == 0 and home_first:
            if (a.lat_deg, a.lon_deg, a.alt_m) != (b.lat_deg, b.lon_deg, b.alt_m):
                why = f"{autopilot.name} keeps its own home in item 0"
                differences.append(Difference(0, "home", _position(a), _position(b), True, why))
            continue
        differences.extend(_item_differences(number, a, b, autopilot))
    return tuple(differences)


def faults(differences: Sequence[Difference]) -> tuple[Difference, ...]:
    """The differences that are faults, the largest first.

    First what makes it another list (number of items, commands, frames), then places and heights by their distance, then
    everything else in the list's order.
    """

    def rank(difference: Difference) -> tuple[int, float]:
        if difference.field in _STRUCTURE:
            return _STRUCTURE.index(difference.field), 0.0
        if difference.size_m is not None:
            return len(_STRUCTURE), -difference.size_m
        return len(_STRUCTURE) + 1, 0.0

    return tuple(sorted((d for d in differences if not d.acceptable), key=rank))


def fault_text(differences: Sequence[Difference]) -> str | None:
    """The largest fault with its size, and the number of faults, as text; None without one."""
    wrong = faults(differences)
    if not wrong:
        return None
    first = wrong[0]
    where = "" if first.item is None else f" in item {first.item}"
    text = f"{first.field}{where} is {_shown(first.received)} instead of {_shown(first.sent)}{_size_text(first)}"
    return text if len(wrong) == 1 else f"{text}, the largest of {len(wrong)} differences"


def _shown(value: FieldValue) -> str:
    """A number with its significant decimals: seven for degrees."""
    return f"{value:.7f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def _size_text(difference: Difference) -> str:
    size_m = difference.size_m
    if size_m is None or not math.isfinite(size_m):
        return ""
    if difference.field != "alt_m":
        return f": {size_m:.2f} m away"
    lower = float(difference.received or 0.0) < float(difference.sent or 0.0)
    return f": {size_m:.2f} m {'lower' if lower else 'higher'}"


def _item_differences(number: int, a: MissionItem, b: MissionItem, autopilot: Autopilot) -> list[Difference]:
    if a.command != b.command:
        return [Difference(number, "command", int(a.command), int(b.command), False, "this is a different command")]
    found: list[Difference] = []
    if a.frame != b.frame:
        no_position = not command_read_back(a).has_position and not command_read_back(b).has_position
        if not no_position:
            why = "the height would refer to a different datum"
        elif b.frame is autopilot.command_frame_returned:
            why = f"{autopilot.name} returns commands without a position in this frame"
        else:
            why = "a command without a position means the same in every frame"
        found.append(Difference(number, "frame", a.frame.name, b.frame.name, no_position, why))
    a, b = command_read_back(a), command_read_back(b)
    apart_m = _apart_m(a, b)
    for (name, x), (_, y) in zip(a.values(), b.values(), strict=True):
        if same_number(x, y):
            continue
        size_m = None
        if a.has_position and name in ("lat_deg", "lon_deg"):
            size_m = apart_m
        elif a.has_position and name == "alt_m":
            size_m = abs(y - x) if math.isfinite(x) and math.isfinite(y) else math.inf
        acceptable, why = _verdict(a, name, x, y, autopilot, size_m)
        found.append(Difference(number, name, x, y, acceptable, why, size_m))
    if a.autocontinue != b.autocontinue:
        by_design = a.command in NOT_STEPS or (not autopilot.keeps_autocontinue and b.autocontinue)
        why = f"{autopilot.name} does not store this value" if by_design else "the vehicle would stop at another item"
        found.append(Difference(number, "autocontinue", a.autocontinue, b.autocontinue, by_design, why))
    return found


def _verdict(
    item: MissionItem, name: str, sent: float, received: float, autopilot: Autopilot, size_m: float | None
) -> tuple[bool, str]:
    if item.has_position and name in ("lat_deg", "lon_deg"):
        return _position_verdict(sent, received, size_m)
    meaning = Meaning.NUMBER if item.has_position and name == "alt_m" else meaning_of(item.command, _NUMBERS[name])
    if meaning is Meaning.RESERVED:
        return True, meaning.value
    rule = autopilot.rule_for(item, name)
    if rule is not None and math.isfinite(sent):
        stored = rule.store(sent)
        if _close(received, stored) and not abs(received - sent) > rule.largest_change:
            return True, rule.why
        # Another version of the autopilot may round where this one truncates; what it cannot store is no rounding.
        if abs(received - sent) <= rule.largest_change < math.inf and _close(received, rule.store(received)):
            return True, rule.why
    elif rule is not None and _close(received, rule.store(sent)):
        return True, rule.why
    if math.isfinite(sent) and received == float32(sent):
        return True, "MAVLink carries this number in 32 bits"
    if size_m is not None:
        is_same = size_m <= SAME_POSITION_M
        return is_same, "this is the same height within 2 cm" if is_same else "this is a different height"
    if meaning.same(sent, received):
        return True, f"the meaning is the same: {meaning.value}"
    return False, "the value differs, and no known behaviour of the autopilot explains it"


def _position_verdict(sent: float, received: float, apart_m: float | None) -> tuple[bool, str]:
    if math.isfinite(sent) and abs(received - degrees_on_wire(sent)) < _HALF_UNIT_DEG:
        return True, "MAVLink carries coordinates in steps of 1e-7 degrees"
    if abs(received - sent) <= _WIRE_STEP_DEG or (apart_m is not None and apart_m <= SAME_POSITION_M):
        return True, "this is the same position within 2 cm or a step of 1e-7 degrees"
    return False, "this is a different position"


def _apart_m(a: MissionItem, b: MissionItem) -> float | None:
    """Distance over ground between two positions; infinite if one is invalid, None for commands without a position."""
    if not a.has_position:
        return None
    degrees = (a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg)
    return ground_distance_m(*degrees) if all(map(math.isfinite, degrees)) else math.inf


def _close(a: float, b: float) -> bool:
    return same_number(a, b) or abs(a - b) <= abs(b) * _FLOAT32_STEP


def _position(item: MissionItem) -> str:
    return f"{item.lat_deg:.7f}, {item.lon_deg:.7f}, {item.alt_m:.2f} m AMSL"


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
        lines = (
            [] if self.home is None else [f"- home {_home_text(self.home[0])}", f"+ home {_home_text(self.home[1])}"]
        )
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


def _home_text(home: GeoPoint | None) -> str:
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
    return struct.pack("<qi7d?", item.command, item.frame, *(value for _, value in item.values()), item.autocontinue)


def _home_bits(home: GeoPoint | None) -> bytes | None:
    return None if home is None else struct.pack("<3d", home.lat_deg, home.lon_deg, home.alt_amsl_m)
