"""What a vehicle holds after an upload that did not end well, from its autopilot's ways and from what was read back."""

from collections.abc import Sequence

from mission_io.autopilots import Autopilot
from mission_io.compare import compare_items
from mission_io.errors import VehicleHolds
from mission_io.items import MissionItem, MissionType
from mission_io.protocol.upload import Upload
from mission_io.protocol.upload_table import UploadState


def held_by_design(upload: Upload, total: int, autopilot: Autopilot) -> VehicleHolds:
    """What the vehicle must have when it cannot be asked.

    An atomic autopilot keeps the old list until the last item is there; the others write over it item by item, and cut
    it to the new length as soon as they are told that.
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
    """How many items at the front of ``held`` are those that were sent."""
    for number, (new, now) in enumerate(zip(sent, held, strict=False)):
        home = number == 0 and autopilot.home_in_item_0 and mission_type is MissionType.MISSION
        if not home and not all(d.acceptable for d in compare_items([new], [now], autopilot, MissionType.RALLY)):
            return number
    return min(len(sent), len(held))


def held_as_read(
    upload: Upload, sent: Sequence[MissionItem], held: Sequence[MissionItem], autopilot: Autopilot
) -> VehicleHolds:
    """What the vehicle has, by the list that was read back from it."""
    mission_type = upload.mission_type
    new = new_items_in_front(sent, held, autopilot, mission_type)
    if new == len(sent) == len(held):
        return "replaced"
    home = int(autopilot.home_in_item_0 and mission_type is MissionType.MISSION)
    if mission_type in autopilot.atomic:
        # By design it is the old list. One that begins like the new one after everything was sent is neither, perhaps.
        doubtful = upload.state is UploadState.UNCONFIRMED and new > home
        return "unknown" if doubtful else "unchanged"
    # A list that is shorter than the new one was not cut to it, so without a new item nothing happened to it.
    return "unchanged" if new <= home and len(held) < len(sent) else "mixed"


def description(
    holds: VehicleHolds,
    sent: Sequence[MissionItem],
    held: Sequence[MissionItem] | None,
    autopilot: Autopilot,
    mission_type: MissionType,
) -> str:
    """One line about what the vehicle holds and what to do about it."""
    text = f"the vehicle's list is now {holds}"
    if held is not None:
        text += f" ({len(held)} items"
        if holds in ("mixed", "unknown"):
            text += f", of which the first {new_items_in_front(sent, held, autopilot, mission_type)} are new"
        text += ")"
    return text + ("; upload again, or clear it" if holds in ("mixed", "unknown") else "")
