"""Whether a vehicle's lists have changed, without downloading them: by the ids that PX4 and others give them.

A vehicle tells the id of a list in MISSION_COUNT and MISSION_ACK (``opaque_id``) and in MISSION_CURRENT (``mission_id``,
``fence_id``, ``rally_points_id``). ArduPilot has none: there only another number of items proves a change.
"""

import contextlib
from dataclasses import dataclass

from mission_io.client import commands
from mission_io.client.client import Client
from mission_io.errors import TransferCancelledError
from mission_io.model.items import MissionType
from mission_io.protocol.timing import CALLS
from mission_io.wire.messages import MissionCurrent


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
    """Whether a list is another one than the client transferred last, either way.

    Args:
        client: Has uploaded or downloaded that list.
        mission_type: Which list.
        timeout_s: Longest time to wait for an answer.

    Returns:
        None when the vehicle cannot tell: it has no ids, and the number of items is the same. Then only a download tells.
        Also None when this client has not transferred the list.

    Raises:
        VehicleSilentError: no answer.
        TransferError: the vehicle refuses to tell the number of items.
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
