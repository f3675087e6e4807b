"""A vehicle's lists without a whole transfer: items of a mission written over, and whether a list has changed."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

from mission_io.client import commands
from mission_io.client.client import Client
from mission_io.client.connection import Progress, Stop
from mission_io.client.transfer_outcome import PROVEN_BY_READING, ReadBack, failure
from mission_io.errors import MisuseError, TransferCancelledError
from mission_io.model.items import Mission, MissionItem, MissionType
from mission_io.model.plain_text import counted
from mission_io.protocol.tables import UploadState
from mission_io.protocol.timing import CALLS
from mission_io.protocol.upload import Upload
from mission_io.wire.messages import MissionCurrent


def upload_part(
    client: Client,
    first: int,
    items: Sequence[MissionItem],
    *,
    progress: Progress | None = None,
    stop: Stop | None = None,
    in_flight: bool = False,
) -> ReadBack:
    """Replace items of the vehicle's mission, then read the whole mission back and compare it.

    The mission is read first, because its other items must not change. Only ArduPilot takes parts (MISSION_WRITE_PARTIAL_LIST),
    and each item as it comes: an error in between leaves the items before it written.

    Args:
        client: Connected to the vehicle.
        first: The number of the first item that is replaced; item 1 is the first behind home.
        items: What replaces it and the ones after it.
        progress: Called with the items that have arrived, and their number.
        stop: Polled; True cancels.
        in_flight: Allow it on an armed vehicle.

    Raises:
        MisuseError: the autopilot takes no parts, the mission has no such items, an item would be refused, or the vehicle is
            armed and ``in_flight`` is False.
        TransferError: the vehicle refused, cancelled, or made no progress.
    """
    autopilot = client.vehicle.autopilot
    if not autopilot.takes_parts:
        raise MisuseError(f"{autopilot.name} does not accept a part of a mission; upload the whole mission")
    held = client.download_list(MissionType.MISSION)
    if not isinstance(held, Mission):  # download_list returns the requested type
        raise MisuseError("the vehicle has no mission; upload the whole mission")
    last = first + len(items) - 1
    if not 1 <= first <= last <= len(held.items):
        raise MisuseError(
            f"items {first} to {last} are not all in the vehicle's mission of {counted(len(held.items), 'item')}, and only "
            "existing items can be replaced; upload the whole mission"
        )
    mission = Mission(held.home, (*held.items[: first - 1], *items, *held.items[last:]))

    def carry(mission_type: MissionType, wire: Sequence[MissionItem]) -> None:
        upload = Upload(wire[first : last + 1], first=first, **client.exchange_options(mission_type))
        client.run(upload, lambda: (upload.across_count, len(items)), progress=progress, stop=stop)
        if upload.state is not UploadState.ACCEPTED and upload.state not in PROVEN_BY_READING:
            how_far = f"after {upload.across_count} of {len(items)} items; download the mission to see them"
            doing = f"upload of items {first} to {last} of the mission"
            raise failure(doing, upload, how_far, vehicle_holds="unknown", advice=client.signing_advice())

    return client.upload_and_verify(mission, stop=stop, in_flight=in_flight, carry=carry)


# Whether lists have changed, without downloading them: by the ids that PX4 and others give them.
#
# A vehicle tells the id of a list in MISSION_COUNT and MISSION_ACK (``opaque_id``) and in MISSION_CURRENT (``mission_id``,
# ``fence_id``, ``rally_points_id``). ArduPilot has none: there only another number of items proves a change.


@dataclass(frozen=True, slots=True)
class ListIds:
    """The ids of a vehicle's lists; None for an empty list, and for every list of a vehicle without ids."""

    mission: int | None
    fence: int | None
    rally: int | None

    def of(self, mission_type: MissionType) -> int | None:
        """The id of one list."""
        return {MissionType.MISSION: self.mission, MissionType.FENCE: self.fence, MissionType.RALLY: self.rally}[
            mission_type
        ]


def read_list_ids(client: Client, *, timeout_s: float = CALLS.list_id_answer_s) -> ListIds:
    """Ask for the ids of all lists.

    Raises:
        VehicleSilentError: no MISSION_CURRENT within ``timeout_s`` seconds.
    """
    current = commands.request_message(client, MissionCurrent, timeout_s=timeout_s)
    return ListIds(current.mission_id or None, current.fence_id or None, current.rally_points_id or None)


def list_changed(
    client: Client, mission_type: MissionType, *, timeout_s: float = CALLS.list_id_answer_s
) -> bool | None:
    """Whether a list differs from the one that this client transferred last, in either direction.

    Args:
        client: Has uploaded or downloaded that list.
        mission_type: Which list.
        timeout_s: Longest time to wait for an answer.

    Returns:
        None if this client has not transferred the list, or if the vehicle has no ids and the number of items is the same. Then
        only
        a download can find a change.

    Raises:
        VehicleSilentError: no answer within ``timeout_s`` seconds.
    """
    known = client.transferred.get(mission_type)
    if known is None:
        return None
    if known.list_id:
        return read_list_ids(client, timeout_s=timeout_s).of(mission_type) != known.list_id
    held = _count(client, mission_type)
    client.transferred[mission_type] = known
    if held != known.item_count:
        return True
    return False if held == 0 else None


def _count(client: Client, mission_type: MissionType) -> int:
    """Number of items of a list; requests the list, and cancels after its count."""
    totals = [0]
    with contextlib.suppress(TransferCancelledError):
        client.download(mission_type, progress=lambda _, total: totals.append(total), stop=lambda: len(totals) > 1)
    return totals[-1]
