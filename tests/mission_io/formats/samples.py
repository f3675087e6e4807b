"""Missions with asymmetric places, so that swapped coordinates cannot hide, and hypothesis strategies for more."""

import math

from hypothesis import strategies as st

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
    return_to_launch,
    takeoff,
    trigger_camera_every,
    waypoint,
)

HOME = GeoPoint(33.21875, -98.1234567, 345.678)
MISSION = Mission(
    HOME,
    (
        takeoff(33.21875, -98.1234567, 30.0, frame=Frame.ABOVE_HOME),
        change_speed(12.5),
        trigger_camera_every(25.0),
        waypoint(33.2191234, -98.1240001, 60.25, frame=Frame.ABOVE_HOME, hold_s=2.0),
        waypoint(33.2201234, -98.1250002, 470.5, frame=Frame.AMSL),
        waypoint(33.2211234, -98.1260003, 61.0, frame=Frame.ABOVE_HOME),
        land(33.21875, -98.1234567, frame=Frame.ABOVE_HOME),
        return_to_launch(),
    ),
)
FENCE = Fence(
    (
        FencePolygon((LatLon(33.1, -98.2), LatLon(33.3, -98.25), LatLon(33.35, -98.05))),
        FencePolygon(
            (LatLon(33.2, -98.1), LatLon(33.21, -98.11), LatLon(33.22, -98.1), LatLon(33.2, -98.09)), inclusion=False
        ),
    ),
    (FenceCircle(LatLon(33.2, -98.15), 150.5, inclusion=False),),
    FramedPoint(33.21, -98.12, 40.0, Frame.ABOVE_HOME),
)
RALLY = RallyPoints((FramedPoint(33.2, -98.13, 50.0), FramedPoint(33.23, -98.14, 55.5)))


def fen_text(fence: Fence) -> str:
    """A ``.fen`` file: the return point, then the closed ring of the first polygon."""
    assert fence.return_point is not None
    ring = fence.polygons[0].vertices
    return "".join(
        f"{position.lat_deg:.8f} {position.lon_deg:.8f}\n" for position in (fence.return_point, *ring, ring[0])
    )


FLOATS = st.floats(-1e30, 1e30)
LATITUDES = st.integers(-9000000000, 9000000000).map(lambda n: n / 1e8)
LONGITUDES = st.integers(-18000000000, 18000000000).map(lambda n: n / 1e8)
ITEMS = st.builds(
    MissionItem,
    command=st.integers(0, 65535),
    frame=st.sampled_from([Frame.AMSL, Frame.ABOVE_HOME, Frame.ABOVE_TERRAIN]),
    params=st.tuples(FLOATS, FLOATS, FLOATS, FLOATS),
    lat_deg=LATITUDES,
    lon_deg=LONGITUDES,
    alt_m=FLOATS,
    autocontinue=st.booleans(),
)
COMMANDS = st.builds(
    MissionItem,
    command=st.integers(0, 65535),
    frame=st.just(Frame.COMMAND),
    params=st.tuples(FLOATS, FLOATS, FLOATS, FLOATS),
    lat_deg=FLOATS,
    lon_deg=FLOATS,
    alt_m=FLOATS,
)
MISSIONS = st.builds(
    Mission,
    home=st.builds(GeoPoint, LATITUDES, LONGITUDES, st.floats(-1e4, 1e5)),
    items=st.lists(ITEMS | COMMANDS, max_size=8).map(tuple),
)
NAN_YAW = MissionItem(16, Frame.AMSL, (0.0, 0.0, 0.0, math.nan), 33.2, -98.1, 400.0)
