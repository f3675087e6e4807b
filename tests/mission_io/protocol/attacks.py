"""One call of the client against one hostile vehicle, on a simulated clock: how it ended, when, and with how many messages."""

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.comparison import compare_items
from mission_io.client.client import Client
from mission_io.errors import MissionIoError
from mission_io.links.simulated import Conditions, SimulatedLink
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.timing import LongestTimes, Timing, longest_times
from mission_io.wire.messages import MissionCount, MissionItemInt, message_from_item
from tests.mission_io.protocol.hostile import HostileVehicle, valid_items

ITEMS = 9
CALLS = ("upload", "download", "clear")
MESSAGES_PER_ITEM, MESSAGES_PER_S = 60, 5
"""What a call may send: so many for each item of the list and the count, and so many in each second that it takes."""


@dataclass(frozen=True, slots=True)
class Attack:
    """What came of a call.

    Attributes:
        vehicle: The tricks of the vehicle.
        error: What the call said; empty when it said that it worked.
        correct: Whether it said that it worked and the vehicle holds (upload, clear) or held (download) just that.
        time_s: Simulated time from the call to its end.
        bound_s: The longest that it may take.
        sent: Messages that reached the vehicle.
    """

    seed: int
    autopilot: str
    mission_type: str
    call: str
    vehicle: str
    error: str
    correct: bool
    time_s: float
    bound_s: float
    sent: int

    @property
    def most_messages(self) -> float:
        """How many messages the call may send."""
        return MESSAGES_PER_ITEM * (ITEMS + 1) + MESSAGES_PER_S * self.time_s


def attack(seed: int, autopilot: Autopilot, mission_type: MissionType, call: str) -> Attack:
    """Run one call against the vehicle of a seed. Errors that are not of this package are not caught."""
    held = random.Random(seed).choice([0, 3, 6, ITEMS])
    vehicle = HostileVehicle(autopilot, seed, mission_type, held=held)
    link = SimulatedLink(vehicle, rng=random.Random(seed), conditions=Conditions(delay_s=0.01))
    client = Client(link)
    client.wait_for_vehicle(60.0)
    vehicle.sent_count = 0
    begun_at, error, correct = client.clock.now(), "", True
    sent = valid_items(ITEMS, mission_type)
    try:
        correct = _calls(client, vehicle, mission_type, sent)[call]()
    except MissionIoError as caught:
        error = f"{type(caught).__name__}: {caught}"
    longest = longest_times(Timing(), ITEMS)
    time_s = client.clock.now() - begun_at
    return Attack(
        seed, autopilot.name, mission_type.name.lower(), call, vehicle.name, error, correct and not error, time_s,
        _bound(longest, call), vehicle.sent_count,
    )  # fmt: skip


def _bound(longest: LongestTimes, call: str) -> float:
    return {"upload": longest.verified_upload_s, "download": longest.download_s, "clear": longest.clear_s}[call]


def _calls(
    client: Client, vehicle: HostileVehicle, mission_type: MissionType, sent: Sequence[MissionItem]
) -> dict[str, Callable[[], bool]]:
    autopilot = vehicle.autopilot

    def differs(held: Sequence[MissionItem]) -> bool:
        return not all(d.acceptable for d in compare_items(sent, held, autopilot, mission_type))

    def upload() -> bool:
        client.upload(mission_type, sent)
        if differs(client.download(mission_type)):
            raise MissionIoError("what was read back differs from what was sent")
        return not differs(vehicle.server.items(mission_type))

    def download() -> bool:
        return _was_said(vehicle, client.download(mission_type))

    def clear() -> bool:
        client.clear(mission_type)
        return True

    return {"upload": upload, "download": download, "clear": clear}


def _was_said(vehicle: HostileVehicle, received: Sequence[MissionItem]) -> bool:
    """Whether the vehicle named that number of items, and said each of them in its place."""
    counts = {message.count for message in vehicle.said if isinstance(message, MissionCount)}
    said = [message for message in vehicle.said if isinstance(message, MissionItemInt)]
    positions = [{_shown(item) for item in said if item.seq == seq} for seq in range(len(received))]
    shown = [
        _shown(message_from_item(item, 0, mission_type=0, target_system=1, target_component=1)) for item in received
    ]
    return len(received) in counts and all(item in position for item, position in zip(shown, positions, strict=True))


def _shown(item: MissionItemInt) -> tuple[object, ...]:
    """What is compared; text, because NaN is not equal to itself."""
    return item.command, str(item.params), item.x, item.y, str(item.z)
