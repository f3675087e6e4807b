"""MAVSDK as a second client, ``--client mavsdk``: transfers and commands of another implementation.

In: a link. Out: a client with the methods of ``mission_io.Client``. Begin with ``client.py``.
Its library is large: everything is imported on demand.
"""

from typing import TYPE_CHECKING, Any

from mission_io.links.datagrams import Link
from mission_io.model.items import MissionItem, MissionType

if TYPE_CHECKING:
    from uavcover.extras.mavsdk.client import MavsdkClient
    from uavcover.flight.monitor import Monitor


def open_client(link: Link, *, own_system: int) -> "tuple[MavsdkClient, Monitor]":
    """A client on a link, with a monitor that hears everything."""
    from uavcover.extras.mavsdk.client import MavsdkClient
    from uavcover.flight.monitor import Monitor

    monitor = Monitor()
    return MavsdkClient(link, system_id=own_system, listener=monitor), monitor


def raw_items(items: tuple[MissionItem, ...], mission_type: MissionType) -> list[Any]:
    """The items as MAVSDK has them."""
    from uavcover.extras.mavsdk import session

    return session.raw_items(items, mission_type)


def items_from_raw(raw: list[Any], mission_type: MissionType) -> tuple[MissionItem, ...]:
    """MAVSDK's items as ours."""
    from uavcover.extras.mavsdk import session

    return session.items_from_raw(raw, mission_type)
