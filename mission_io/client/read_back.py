"""Reading an upload back: the sent and the received list, and every difference with its reason."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from mission_io.autopilots.autopilot import Autopilot
from mission_io.autopilots.comparison import Difference, compare_items
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.tuning import TRANSFERS


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
        """Whether the vehicle holds what was meant: every difference is by its autopilot's design."""
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


def read_back(
    download: Callable[[], tuple[MissionItem, ...]],
    wait: Callable[[float], None],
    mission_type: MissionType,
    items: Sequence[MissionItem],
    autopilot: Autopilot,
) -> ReadBack:
    """Compare what the vehicle holds with what was sent; read once more when it differs.

    PX4 returned the previous list once in 60 times when it was read immediately.

    Args:
        download: Reads the vehicle's list.
        wait: Lets a number of seconds pass.
        mission_type: Which list.
        items: What was sent.
        autopilot: Whose changes by design the comparison knows.
    """
    received = download()
    differences = compare_items(items, received, autopilot, mission_type)
    if not all(difference.acceptable for difference in differences):
        wait(TRANSFERS.stale_read_back_s)
        received = download()
        differences = compare_items(items, received, autopilot, mission_type)
    return ReadBack(mission_type, autopilot.name, tuple(items), received, differences)


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
