"""Missions that are wrong: what the vehicle does with them, and what it holds afterwards."""

from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import wire_items
from mission_io.errors import MisuseError, TransferError
from mission_io.model.items import Frame, Mission, MissionItem, MissionType, waypoint
from sitl_tests.case import Case, Finding
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.matrix import WORKS
from sitl_tests.missions import impossible_item, long_mission, route_mission
from uavcover.missions.mission_compiler import AUTOPILOTS

_OLD_ITEMS, _NEW_ITEMS, _BAD_ITEM = 12, 15, 7
_NEW_LOWEST_M = 40.0


def refused_mission(case: Case) -> Finding:
    """A waypoint at latitude 91 is refused; our side does not even send it."""
    mission = route_mission(case.vehicle.home)
    items = (*mission.items[:3], impossible_item(), *mission.items[3:])
    bad = Mission(mission.home, items)
    with case.station() as station:
        try:
            station.client.upload_and_verify(bad)
        except MisuseError as error:
            ours = str(error)
        else:
            raise CheckFailedError("our own check let latitude 91 pass")
        try:
            station.client.upload(MissionType.MISSION, wire_items(bad, AUTOPILOTS[case.autopilot]))
        except TransferError as error:
            return Finding("refused", str(error))
    return Finding("accepted", f"without our check ({ours}) it would fly with it")


def failed_upload(case: Case) -> Finding:
    """After an upload that fails in the middle it is known what the vehicle holds."""
    autopilot = AUTOPILOTS[case.autopilot]
    home = case.vehicle.home
    old = wire_items(long_mission(home, _OLD_ITEMS), autopilot)
    new = list(wire_items(long_mission(home, _NEW_ITEMS, lowest_m=_NEW_LOWEST_M), autopilot))
    new[_BAD_ITEM] = _not_stored(case)
    with case.station() as station:
        station.client.upload(MissionType.MISSION, old)
        try:
            station.client.upload(MissionType.MISSION, new)
        except TransferError as error:
            said, text = error.vehicle_holds, str(error)
        else:
            raise CheckFailedError("an item that the vehicle cannot store was accepted")
    held = case.held(MissionType.MISSION)
    unchanged = all(d.acceptable for d in compare_items(old, held, autopilot))
    require(
        unchanged == (said == "unchanged"), f"our side says {said}, another station finds {len(held)} items: {text}"
    )
    return Finding(said, f"{len(held)} items held of {len(old)} old and {len(new)} new")


def terrain_frames(case: Case) -> Finding:
    """Heights above the terrain are stored as such."""
    mission = route_mission(case.vehicle.home, frame=Frame.ABOVE_TERRAIN)
    # A landing needs no height, and some autopilots want take-off above home.
    home = route_mission(case.vehicle.home)
    mission = Mission(mission.home, (*home.items[:2], *mission.items[2:-1], home.items[-1]))
    items = wire_items(mission, AUTOPILOTS[case.autopilot])
    with case.station() as station:
        try:
            station.client.upload(MissionType.MISSION, items)
        except TransferError as error:
            return Finding("refused", str(error))
    held = case.held(MissionType.MISSION)
    kept = sum(item.frame is Frame.ABOVE_TERRAIN for item in held)
    wanted = sum(item.frame is Frame.ABOVE_TERRAIN for item in items)
    require(kept == wanted, f"{kept} of {wanted} items came back in the terrain frame")
    return Finding(WORKS, f"{kept} items came back in the terrain frame")


def _not_stored(case: Case) -> MissionItem:
    """An item in the middle of a list that the autopilot refuses: PX4 takes any number, but not any frame."""
    if case.autopilot == "px4":
        home = case.vehicle.home
        return waypoint(home.lat_deg, home.lon_deg, 30.0, frame=Frame.ABOVE_TERRAIN)
    return impossible_item()
