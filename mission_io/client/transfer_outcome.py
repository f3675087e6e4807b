"""The outcome of a failed transfer: the reason, the vehicle's list, and its capacity.

What a vehicle holds is inferred from its autopilot's behaviour and from what was read back.

ArduPilot states its capacity only when it keeps missions on a memory card: the reserved size is a parameter, and every
item takes the same space (AP_Mission and AP_BoardConfig of ArduPilot 4.7). The capacity of its internal memory depends on
the board, and neither it nor PX4 states it; a list that is too long is answered NO_SPACE when it is announced.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, NamedTuple

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.comparison import Difference, compare_items
from mission_io.errors import TransferCancelledError, TransferError, TransferSilentError, VehicleHolds
from mission_io.model.items import MissionItem, MissionType
from mission_io.model.plain_text import counted
from mission_io.protocol.download import Download, DownloadState
from mission_io.protocol.exchange import Clear, ClearState
from mission_io.protocol.tables import UploadState
from mission_io.protocol.upload import Upload

# Reading an upload back: the sent and the received list, and every difference with its reason.


@dataclass(frozen=True, slots=True)
class ReadBack:
    """The result of ``Client.upload_and_verify``."""

    mission_type: MissionType  # the list
    autopilot: str  # name of the autopilot whose changes by design the comparison knows
    sent: tuple[MissionItem, ...]  # the items as they were sent, with home in front where item 0 is home
    received: tuple[MissionItem, ...]  # the items as they were read back
    differences: tuple[Difference, ...]  # every field that came back changed, acceptable or not

    @property
    def passed(self) -> bool:
        """Whether the vehicle holds the intended list, except for differences by its autopilot's design."""
        return all(difference.acceptable for difference in self.differences)

    def as_json(self) -> dict[str, Any]:
        """The same as plain JSON values; NaN becomes null."""
        return {
            "mission_type": self.mission_type.name.lower(),
            "autopilot": self.autopilot,
            "passed": self.passed,
            "sent": [_item_json(item) for item in self.sent],
            "received": [_item_json(item) for item in self.received],
            "differences": [
                {key: _json_value(value) for key, value in dataclasses.asdict(difference).items()}
                for difference in self.differences
            ],
        }


def _item_json(item: MissionItem) -> dict[str, Any]:
    return {
        "command": int(item.command),
        "frame": item.frame.name,
        "params": [_json_value(value) for value in item.params],
        "lat_deg": _json_value(item.lat_deg),
        "lon_deg": _json_value(item.lon_deg),
        "alt_m": _json_value(item.alt_m),
        "autocontinue": item.autocontinue,
    }


def _json_value(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


class TransferredList(NamedTuple):
    """Number of items of a transferred list, and the vehicle's id of the list, 0 where it has none."""

    item_count: int
    list_id: int


def items_on_card(size_kb: float) -> int | None:
    """Number of items that ArduPilot stores in a card file of this size; None without a card or a size."""
    if not (math.isfinite(size_kb) and size_kb >= 1.0):
        return None
    return (int(size_kb) * 1024 - 4) // 15  # 4 bytes of header, 15 for each item


_ERRORS: Final[dict[Enum, type[TransferError]]] = {
    UploadState.SILENT: TransferSilentError,
    DownloadState.SILENT: TransferSilentError,
    ClearState.SILENT: TransferSilentError,
    UploadState.CANCELLED: TransferCancelledError,
    DownloadState.CANCELLED: TransferCancelledError,
}
_REFUSED: Final = (UploadState.REFUSED, DownloadState.REFUSED, ClearState.REFUSED)
_STUCK: Final = (UploadState.STUCK, DownloadState.STUCK, ClearState.STUCK)

PROVEN_BY_READING: Final = (UploadState.UNCONFIRMED, UploadState.ACCEPTED_EARLY)
"""Final states of an upload that are a success if the list read back equals the one sent."""


def list_name(mission_type: MissionType) -> str:
    """The name of a list in messages."""
    return {MissionType.MISSION: "mission", MissionType.FENCE: "fence", MissionType.RALLY: "rally points"}[mission_type]


def failure(
    doing: str,
    exchange: Upload | Download | Clear,
    how_far: str,
    *,
    vehicle_holds: VehicleHolds,
    held_items: tuple[MissionItem, ...] | None = None,
    advice: str = "",
) -> TransferError:
    """The error for an exchange that failed: silent, cancelled, or ended by the vehicle.

    Args:
        doing: What was attempted; begins the message.
        exchange: The exchange, at its end.
        how_far: How far it got and what the vehicle holds now.
        vehicle_holds: What the vehicle holds now.
        held_items: The items read back.
        advice: Added when the vehicle is silent.
    """
    result = exchange.last_result
    reason = f" with {getattr(result, 'name', result)}" if result else ""
    text = f"{doing}: vehicle {exchange.vehicle.system_id}: {exchange.state.value}{reason}"
    if exchange.state in _STUCK:
        text += f" for {exchange.timing.no_progress_s:g} s"
    text += f" {how_far}" if how_far else ""
    kind = _ERRORS.get(exchange.state, TransferError)
    if kind is TransferSilentError:
        text += advice
    refusal = exchange.last_result if exchange.state in _REFUSED else None
    return kind(text, vehicle_holds=vehicle_holds, held_items=held_items, refusal=refusal)


def held_by_design(upload: Upload, total: int, autopilot: Autopilot) -> VehicleHolds:
    """The list that the vehicle must hold when it does not answer.

    An atomic autopilot keeps the old list until the last item has arrived. The others overwrite it item by item, and
    truncate it to the new length as soon as they know it.
    """
    if upload.sent_count == total and upload.state is not UploadState.REFUSED:
        return "unknown"
    if upload.mission_type in autopilot.atomic:
        return "unchanged"
    if upload.sent_count == 0:
        return "unchanged" if upload.state is UploadState.REFUSED else "unknown"
    return "mixed"


def new_items_in_front(
    sent: Sequence[MissionItem], held: Sequence[MissionItem], autopilot: Autopilot, mission_type: MissionType
) -> int:
    """Number of items at the front of ``held`` that equal those sent."""
    for number, (new, now) in enumerate(zip(sent, held, strict=False)):
        home = number == 0 and autopilot.home_in_item_0 and mission_type is MissionType.MISSION
        if not home and not all(d.acceptable for d in compare_items([new], [now], autopilot, MissionType.RALLY)):
            return number
    return min(len(sent), len(held))


def held_as_read(
    upload: Upload, sent: Sequence[MissionItem], held: Sequence[MissionItem], autopilot: Autopilot
) -> VehicleHolds:
    """The list that the vehicle holds, by reading it back."""
    mission_type = upload.mission_type
    new = new_items_in_front(sent, held, autopilot, mission_type)
    if new == len(sent) == len(held):
        return "replaced"
    home = int(autopilot.home_in_item_0 and mission_type is MissionType.MISSION)
    if mission_type in autopilot.atomic:
        # By design it is the old list. One that begins like the new list after everything was sent is doubtful.
        doubtful = upload.state in PROVEN_BY_READING and new > home
        return "unknown" if doubtful else "unchanged"
    # A list shorter than the new one was not truncated to it, so without a new item it is unchanged.
    return "unchanged" if new <= home and len(held) < len(sent) else "mixed"


def description(
    holds: VehicleHolds,
    sent: Sequence[MissionItem],
    held: Sequence[MissionItem] | None,
    autopilot: Autopilot | None,
    mission_type: MissionType,
) -> str:
    """One line on the vehicle's list and the remedy."""
    text = f"the vehicle's list is now {holds}"
    if held is not None:
        text += f" ({counted(len(held), 'item')}"
        if autopilot is not None and holds in ("mixed", "unknown"):
            text += f", the first {new_items_in_front(sent, held, autopilot, mission_type)} of which are new"
        text += ")"
    return text + ("; upload the list again, or clear it" if holds in ("mixed", "unknown") else "")
