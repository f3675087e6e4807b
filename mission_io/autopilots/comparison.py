"""The comparison of what was meant with what a vehicle holds: every difference, and whether it matters.

The only comparison in the package: used after an upload, before arming, and in flight. Positions agree within 2 cm, or
within the effect of MAVLink's steps of 1e-7 degrees where that is larger; heights agree within 2 cm; parameters agree when
they mean the same to their command. Changes that an autopilot makes by design are in ``storage``.

What the parameters of a command mean is data, in ``parameter_meanings``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.autopilots.autopilot import NOT_STEPS, Autopilot, command_read_back
from mission_io.autopilots.parameter_meanings import Meaning, meaning_of
from mission_io.model.items import MissionItem, MissionType, same_number
from mission_io.model.places import ground_distance_m
from mission_io.wire.mission_items import degrees_on_wire, float32

_FLOAT32_STEP = 2.0**-23

FieldValue = float | int | str | bool | None

SAME_PLACE_M = 0.02
"""Places and heights no farther apart are the same."""

_WIRE_STEP_DEG = 1.000001e-7
_HALF_UNIT_DEG = 0.5000001e-7
_NUMBERS = {"param1": 1, "param2": 2, "param3": 3, "param4": 4, "lat_deg": 5, "lon_deg": 6, "alt_m": 7}
_STRUCTURE = ("count", "command", "frame")


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that differs from what was meant.

    Attributes:
        item: Number of the item on the wire, from 0; None when the lists differ in length.
        field: ``count``, ``command``, ``frame``, ``param1`` to ``param4``, ``lat_deg``, ``lon_deg``, ``alt_m``,
            ``autocontinue``, or ``home`` for a whole item 0 that an autopilot replaced.
        sent: What was sent, or meant.
        received: What came back, or is held.
        acceptable: Whether it is none: rounding, the autopilot's design, or another number for the same thing.
        why: The reason for that verdict.
        size_m: How far apart two places are over ground, or two heights, in metres; None for what is no length, infinite
            where one of the two is not a number.
    """

    item: int | None
    field: str
    sent: FieldValue
    received: FieldValue
    acceptable: bool
    why: str
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
        why = "items were lost" if len(received) < len(sent) else "the vehicle has items that were not sent"
        differences.append(Difference(None, "count", len(sent), len(received), False, why))
    home_first = autopilot.home_in_item_0 and mission_type is MissionType.MISSION
    for number, (a, b) in enumerate(zip(sent, received, strict=False)):
        if number == 0 and home_first:
            if (a.lat_deg, a.lon_deg, a.alt_m) != (b.lat_deg, b.lon_deg, b.alt_m):
                why = f"{autopilot.name} keeps its own home in item 0"
                differences.append(Difference(0, "home", _place(a), _place(b), True, why))
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
    """The largest fault with its size, and how many there are, for people; None when there is none."""
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
        return [Difference(number, "command", int(a.command), int(b.command), False, "it is a different command")]
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
        why = f"{autopilot.name} does not store it" if by_design else "the vehicle would stop at another item"
        found.append(Difference(number, "autocontinue", a.autocontinue, b.autocontinue, by_design, why))
    return found


def _verdict(
    item: MissionItem, name: str, sent: float, received: float, autopilot: Autopilot, size_m: float | None
) -> tuple[bool, str]:
    if item.has_position and name in ("lat_deg", "lon_deg"):
        return _place_verdict(sent, received, size_m)
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
        return (
            (True, "it is the same height within 2 cm")
            if size_m <= SAME_PLACE_M
            else (False, "it is a different height")
        )
    if meaning.same(sent, received):
        return True, f"it means the same: {meaning.value}"
    return False, "the value differs, and no known behaviour of the autopilot explains it"


def _place_verdict(sent: float, received: float, apart_m: float | None) -> tuple[bool, str]:
    if math.isfinite(sent) and abs(received - degrees_on_wire(sent)) < _HALF_UNIT_DEG:
        rounded = "MAVLink carries coordinates in steps of 1e-7 degrees"
        return True, rounded
    if abs(received - sent) <= _WIRE_STEP_DEG or (apart_m is not None and apart_m <= SAME_PLACE_M):
        return True, "it is the same position within 2 cm or a step of 1e-7 degrees"
    return False, "it is a different position"


def _apart_m(a: MissionItem, b: MissionItem) -> float | None:
    """Distance over ground between two positions; infinite if one is invalid, None for commands without a position."""
    if not a.has_position:
        return None
    degrees = (a.lat_deg, a.lon_deg, b.lat_deg, b.lon_deg)
    return ground_distance_m(*degrees) if all(map(math.isfinite, degrees)) else math.inf


def _close(a: float, b: float) -> bool:
    return same_number(a, b) or abs(a - b) <= abs(b) * _FLOAT32_STEP


def _place(item: MissionItem) -> str:
    return f"{item.lat_deg:.7f}, {item.lon_deg:.7f}, {item.alt_m:.2f} m AMSL"
