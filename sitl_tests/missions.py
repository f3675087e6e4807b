"""Small missions, fences and rally points around a home."""

from dataclasses import replace
from math import nan

from mission_io.model.items import (
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    GeoPoint,
    LatLon,
    Mission,
    MissionItem,
    RallyPoints,
    change_speed,
    land,
    takeoff,
    waypoint,
)
from uavcover.terrain.frames import LocalFrame

EastNorth = tuple[float, float]

SQUARE_M: tuple[EastNorth, ...] = ((0.0, 30.0), (40.0, 30.0), (40.0, 70.0), (0.0, 70.0))
DIAMOND_M: tuple[EastNorth, ...] = ((-30.0, 20.0), (-60.0, 50.0), (-30.0, 80.0))
HEIGHT_M = 25.0
SPEED_M_S = 8.0
FIRST_WAYPOINT_ITEM = 2
"""Index of the first point of the route in the items of ``route_mission``."""


def route_mission(
    home: GeoPoint,
    route_m: tuple[EastNorth, ...] = SQUARE_M,
    *,
    height_m: float = HEIGHT_M,
    frame: Frame = Frame.ABOVE_HOME,
) -> Mission:
    """Take off, fly a route of (east, north) metres from home at one height, come back, land."""
    points = tuple(_waypoint(home, point, height_m, frame) for point in (*route_m, (0.0, 0.0)))
    return Mission(
        home,
        (
            takeoff(home.lat_deg, home.lon_deg, height_m, frame=frame),
            change_speed(SPEED_M_S),
            *points,
            land(home.lat_deg, home.lon_deg, 0.0, frame=frame),
        ),
    )


def long_mission(home: GeoPoint, count: int, *, lowest_m: float = HEIGHT_M) -> Mission:
    """Many waypoints on a spiral, for transfers."""
    middle = tuple(
        waypoint(
            *_position(home, (5.0 * (n % 20), 30.0 + 4.0 * (n // 20))), lowest_m + 0.37 * n, frame=Frame.ABOVE_HOME
        )
        for n in range(count - 2)
    )
    return Mission(
        home,
        (
            takeoff(home.lat_deg, home.lon_deg, HEIGHT_M, frame=Frame.ABOVE_HOME),
            *middle,
            land(home.lat_deg, home.lon_deg, 0.0, frame=Frame.ABOVE_HOME),
        ),
    )


def impossible_item() -> MissionItem:
    """A waypoint north of the north pole."""
    return waypoint(91.0, 8.5, HEIGHT_M, frame=Frame.ABOVE_HOME)


def fence_around(home: GeoPoint, half_width_m: float) -> Fence:
    """A square to stay inside of, around home."""
    corners = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    return Fence(
        (FencePolygon(tuple(LatLon(*_position(home, (half_width_m * e, half_width_m * n))) for e, n in corners)),)
    )


def fence_with_hole(home: GeoPoint) -> Fence:
    """A square around home, and a circle to stay out of."""
    square = fence_around(home, 300.0).polygons
    return Fence(square, (FenceCircle(LatLon(*_position(home, (150.0, 150.0))), 20.0, inclusion=False),))


def rally_points(home: GeoPoint, positions_m: tuple[EastNorth, ...] = ((20.0, 10.0), (-15.0, 35.0))) -> RallyPoints:
    """Places beside home, 30 m above it."""
    return RallyPoints(tuple(FramedPoint(*_position(home, position), 30.0) for position in positions_m))


def _waypoint(home: GeoPoint, east_north_m: EastNorth, height_m: float, frame: Frame) -> MissionItem:
    """A waypoint that leaves the heading to the vehicle, as compiled missions do."""
    item = waypoint(*_position(home, east_north_m), height_m, frame=frame)
    return replace(item, params=(*item.params[:3], nan))


def _position(home: GeoPoint, east_north_m: EastNorth) -> tuple[float, float]:
    frame = LocalFrame(home.lat_deg, home.lon_deg, home.alt_amsl_m)
    lat, lon, _ = frame.geodetic_from_enu((*east_north_m, 0.0))
    return float(lat[0]), float(lon[0])
