"""Writing over some items of a vehicle's mission, the others left as they are."""

from collections.abc import Sequence

from mission_io.client.client import Client
from mission_io.client.running import Progress, Stop, run
from mission_io.client.transfer_outcome import PROVEN_BY_READING, ReadBack, failure
from mission_io.errors import MisuseError
from mission_io.model.items import Mission, MissionItem, MissionType
from mission_io.model.plain_text import counted
from mission_io.protocol.tables import UploadState
from mission_io.protocol.upload import Upload


def upload_part(
    client: Client,
    first: int,
    items: Sequence[MissionItem],
    *,
    progress: Progress | None = None,
    stop: Stop | None = None,
    in_flight: bool = False,
) -> ReadBack:
    """Write items over those of the vehicle's mission, then read the whole mission back and compare it.

    The mission is read first: its other items are what they have to be afterwards. Only ArduPilot takes parts
    (MISSION_WRITE_PARTIAL_LIST), and each item as it comes: an error in between leaves the items before it written.

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
        run(client, upload, lambda: (upload.across_count, len(items)), progress=progress, stop=stop)
        if upload.state is not UploadState.ACCEPTED and upload.state not in PROVEN_BY_READING:
            how_far = f"after {upload.across_count} of {len(items)} items; download the mission to see them"
            doing = f"upload of items {first} to {last} of the mission"
            raise failure(doing, upload, how_far, vehicle_holds="unknown", advice=client.signing_advice())

    return client.upload_and_verify(mission, stop=stop, in_flight=in_flight, carry=carry)
