"""The places of a mission in flying order, as the export formats draw them."""

from dataclasses import dataclass

from mission_io.errors import FormatError
from mission_io.items import Command, Frame, Mission, MissionItem

_FLOWN_TO = frozenset({Command.NAV_WAYPOINT, Command.NAV_LOITER_TIME, Command.NAV_TAKEOFF, Command.NAV_LAND})


@dataclass(frozen=True, slots=True)
class RoutePoint:
    """A place that the vehicle flies to: the item's number (from 1) and the item, heights in its own frame."""

    number: int
    item: MissionItem


def route_of(mission: Mission) -> tuple[RoutePoint, ...]:
    """The items that say where to fly, in order, with their numbers in the mission (home is 0)."""
    return tuple(
        RoutePoint(number, item)
        for number, item in enumerate(mission.items, start=1)
        if item.has_position and item.command in _FLOWN_TO
    )


def alt_amsl_m(point: RoutePoint, mission: Mission) -> float:
    """The height of a point above mean sea level in metres.

    Raises:
        FormatError: heights above home in a mission without a home, or heights above terrain, which nobody here knows.
    """
    item = point.item
    if item.frame is Frame.AMSL:
        return item.alt_m
    where = f"item {point.number}"
    if item.frame is Frame.ABOVE_TERRAIN:
        raise FormatError("its height is above the terrain, which is not known here", where=where)
    if mission.home is None:
        raise FormatError("its height is above home, and the mission has no home", where=where, advice="give the home")
    return mission.home.alt_amsl_m + item.alt_m
