"""Small worlds and missions for tests: a plain with a ridge across it, in metres east and north of home."""

import numpy as np

from mission_io.model.items import Command, Frame, GeoPoint, Mission, MissionItem
from uavcover.extras.check.world import Aircraft, World
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground, grid_ground

LAT, LON, HOME_M = 46.31, 10.42, 700.0
FRAME = LocalFrame(LAT, LON, HOME_M)
STEP_M, REACH_M = 10.0, 1500.0


def ridge_ground(height_m: float = 100.0, *, at_east_m: float = 400.0, half_width_m: float = 50.0) -> Ground:
    """A plain at the height of home, and a ridge from south to north with a triangular section."""
    axis = np.arange(-REACH_M, REACH_M + STEP_M, STEP_M)
    east, _ = np.meshgrid(axis, axis)
    up = height_m * np.maximum(0.0, 1.0 - np.abs(east - at_east_m) / half_width_m)
    return grid_ground(up, east0_m=-REACH_M, north0_m=-REACH_M, step_m=STEP_M, source="ridge", vertical_datum="EGM96")


def world(ground: Ground | None = None) -> World:
    return World(FRAME, ridge_ground() if ground is None else ground)


def lat_lon(east_m: float, north_m: float) -> tuple[float, float]:
    lat, lon, _ = FRAME.geodetic_from_enu([[east_m, north_m, 0.0]])
    return float(lat[0]), float(lon[0])


def item(
    command: Command,
    east_m: float,
    north_m: float,
    alt_m: float,
    *,
    frame: Frame = Frame.ABOVE_HOME,
    params=(0.0, 0.0, 0.0, 0.0),
) -> MissionItem:
    return MissionItem(command, frame, params, *lat_lon(east_m, north_m), alt_m)


def waypoint(east_m: float, north_m: float, alt_m: float, frame: Frame = Frame.ABOVE_HOME) -> MissionItem:
    return item(Command.NAV_WAYPOINT, east_m, north_m, alt_m, frame=frame)


def up(alt_m: float = 50.0) -> MissionItem:
    return MissionItem(Command.NAV_TAKEOFF, Frame.ABOVE_HOME, alt_m=alt_m)


def home() -> MissionItem:
    return MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.COMMAND)


def command(number: int, *params: float) -> MissionItem:
    return MissionItem(number, Frame.COMMAND, (*params, *[0.0] * (4 - len(params))))  # type: ignore[arg-type]


def mission(*items: MissionItem) -> Mission:
    return Mission(GeoPoint(LAT, LON, HOME_M), items)


COPTER = Aircraft(return_height_m=60.0)
PLANE = Aircraft(kind="fixed-wing", cruise_speed_m_s=15.0, max_climb_m_s=3.0, turn_radius_m=30.0, loiter_radius_m=60.0)
