"""What was sent against what came back: every difference, and whether the autopilot makes it by design."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.autopilots import NOT_STEPS, Autopilot, command_read_back
from mission_io.items import MissionItem, MissionType, same_number
from mission_io.wire import degrees_on_wire, float32

FieldValue = float | int | str | bool | None

_HALF_UNIT_DEG = 0.5000001e-7
_FLOAT32_STEP = 2.0**-23


@dataclass(frozen=True, slots=True)
class Difference:
    """One field that came back changed.

    Attributes:
        item: Number of the item on the wire, from 0; None when the lists differ in length.
        field: ``count``, ``command``, ``frame``, ``param1`` to ``param4``, ``lat_deg``, ``lon_deg``, ``alt_m``,
            ``autocontinue``, or ``home`` for a whole item 0 that an autopilot replaced.
        sent: What was sent.
        received: What came back.
        acceptable: Whether the autopilot does this by design and the mission still means the same.
        why: The reason for that verdict.
    """

    item: int | None
    field: str
    sent: FieldValue
    received: FieldValue
    acceptable: bool
    why: str


def compare_items(
    sent: Sequence[MissionItem],
    received: Sequence[MissionItem],
    autopilot: Autopilot,
    mission_type: MissionType = MissionType.MISSION,
) -> tuple[Difference, ...]:
    """Every difference between two item lists as they are on the wire; empty when they are equal to the last bit."""
    differences: list[Difference] = []
    if len(sent) != len(received):
        why = "items were lost" if len(received) < len(sent) else "the vehicle holds items that were not sent"
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


def _item_differences(number: int, a: MissionItem, b: MissionItem, autopilot: Autopilot) -> list[Difference]:
    if a.command != b.command:
        return [Difference(number, "command", int(a.command), int(b.command), False, "it is another command")]
    found: list[Difference] = []
    if a.frame != b.frame:
        by_design = b.frame is autopilot.command_frame_returned and not command_read_back(a).has_position
        why = (
            f"{autopilot.name} returns commands without a position in this frame"
            if by_design
            else "the height would be measured from something else"
        )
        found.append(Difference(number, "frame", a.frame.name, b.frame.name, by_design, why))
    a, b = command_read_back(a), command_read_back(b)
    for (name, x), (_, y) in zip(a.values(), b.values(), strict=True):
        if not same_number(x, y):
            acceptable, why = _verdict(a, name, x, y, autopilot)
            found.append(Difference(number, name, x, y, acceptable, why))
    if a.autocontinue != b.autocontinue:
        by_design = a.command in NOT_STEPS or (not autopilot.keeps_autocontinue and b.autocontinue)
        why = f"{autopilot.name} does not store it" if by_design else "the vehicle would stop at another item"
        found.append(Difference(number, "autocontinue", a.autocontinue, b.autocontinue, by_design, why))
    return found


def _verdict(item: MissionItem, name: str, sent: float, received: float, autopilot: Autopilot) -> tuple[bool, str]:
    if name in ("lat_deg", "lon_deg") and item.has_position:
        if math.isfinite(sent) and abs(received - degrees_on_wire(sent)) < _HALF_UNIT_DEG:
            return True, "MAVLink carries coordinates in steps of 1e-7 degrees"
        return False, "it is another place"
    rule = autopilot.rule_for(item, name)
    if rule is not None:
        if _close(received, rule.store(sent)) and not abs(received - sent) > rule.largest_change:
            return True, rule.why
        if abs(received - sent) <= rule.largest_change and rule.largest_change < math.inf:
            return True, rule.why
    if math.isfinite(sent) and received == float32(sent):
        return True, "MAVLink carries this number in 32 bits"
    return False, "it is another value, and nothing the autopilot does by design explains it"


def _close(a: float, b: float) -> bool:
    return same_number(a, b) or abs(a - b) <= abs(b) * _FLOAT32_STEP


def _place(item: MissionItem) -> str:
    return f"{item.lat_deg:.7f}, {item.lon_deg:.7f}, {item.alt_m:.2f} m AMSL"
