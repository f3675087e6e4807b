"""How many items a vehicle takes, where it tells.

ArduPilot tells when it keeps its mission on a memory card: the size set aside there is a parameter, and every item takes
the same space (AP_Mission and AP_BoardConfig of ArduPilot 4.7). What its own memory holds depends on the board, and
neither it nor PX4 tells that; more items than there is room for are then answered NO_SPACE when they are announced.
"""

import math

from mission_io import commands
from mission_io.autopilots import Autopilot
from mission_io.connection import Connection
from mission_io.errors import VehicleSilentError

_KILOBYTE = 1024
_HEADER_BYTES = 4
_ITEM_BYTES = 15


def ask_item_limit(connection: Connection, autopilot: Autopilot, *, timeout_s: float) -> int | None:
    """Ask the vehicle how many mission items it takes, home included; None when it does not tell.

    Args:
        connection: Has found the vehicle.
        autopilot: Whose ways to expect.
        timeout_s: How long to wait for an answer; a vehicle without a card slot gives none.
    """
    if autopilot.card_parameter is None:
        return None
    try:
        size_kb = commands.read_parameter(connection, autopilot.card_parameter, timeout_s=timeout_s).value
    except VehicleSilentError:
        return None
    return items_on_card(size_kb)


def items_on_card(size_kb: float) -> int | None:
    """How many items ArduPilot keeps in so many kilobytes of a memory card; None for no card, or no size."""
    if not (math.isfinite(size_kb) and size_kb >= 1.0):
        return None
    return (int(size_kb) * _KILOBYTE - _HEADER_BYTES) // _ITEM_BYTES
