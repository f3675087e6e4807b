import dataclasses
import math
import random
from dataclasses import replace

import pytest
from pyproj import Geod, Transformer

from mission_io.autopilots.autopilot import PX4
from mission_io.autopilots.mission_lists import items_of, mission_list_of, mission_type_of
from mission_io.errors import CommandRefusedError, FormatError, MissionIoError, TransferSilentError
from mission_io.formats.text import doubts_about
from mission_io.model import items as i
from mission_io.model.items import (
    Command,
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    GeoPoint,
    LatLon,
    Mission,
    MissionItem,
    MissionType,
    RallyPoints,
    delay,
    earth_centred_m,
    fence_from_items,
    ground_distance_m,
    items_from_fence,
    items_from_rally,
    rally_from_items,
    waypoint,
)
from tests.mission_io.formats.samples import HOME, MISSION

TRIANGLE = FencePolygon((LatLon(46.0, -7.0), LatLon(46.5, -7.25), LatLon(46.75, -7.5)))
SQUARE = FencePolygon((*TRIANGLE.vertices, LatLon(46.1, -7.6)), inclusion=False)
FENCE = Fence(
    (TRIANGLE, SQUARE, TRIANGLE),
    (FenceCircle(LatLon(46.2, -7.3), 80.0), FenceCircle(LatLon(46.3, -7.4), 90.5, inclusion=False)),
    FramedPoint(46.4, -7.7, 30.0),
)


def test_constructors_say_what_the_commands_mean() -> None:
    position = {"frame": Frame.ABOVE_HOME}
    assert i.waypoint(46.0, -7.0, 30.0, hold_s=5.0, **position).params == (5.0, 0.0, 0.0, 0.0)
    assert i.takeoff(46.0, -7.0, 30.0, **position).command == 22
    assert i.land(46.0, -7.0, **position).alt_m == 0.0
    assert i.return_to_launch() == MissionItem(20, Frame.COMMAND)
    assert i.change_speed(8.5).params == (1.0, 8.5, -1.0, 0.0)
    assert i.change_speed(3.0, kind=i.SpeedType.CLIMB).params[0] == 2.0
    assert i.delay(4.5).params == (4.5, -1.0, -1.0, -1.0)
    assert i.trigger_camera_every(12.5).params == (12.5, 0.0, 1.0, 0.0)
    assert i.trigger_camera_every(0.0).params == (0.0, 0.0, 0.0, 0.0)
    assert i.look_at(46.0, -7.0, 5.0, **position).command == 195
    assert i.look_ahead().command == 197


def test_items_are_frozen_and_nan_equals_nan() -> None:
    a = MissionItem(16, Frame.AMSL, (0.0, 0.0, 0.0, math.nan), 46.0, -7.0, 1.0)
    b = MissionItem(16, Frame.AMSL, (0.0, 0.0, 0.0, float("nan")), 46.0, -7.0, 1.0)
    assert i.same_item(a, b)
    assert not i.same_item(a, dataclasses.replace(b, alt_m=2.0))
    assert not i.same_item(a, dataclasses.replace(b, autocontinue=False))
    with pytest.raises(dataclasses.FrozenInstanceError):
        a.alt_m = 5.0  # type: ignore[misc]


@pytest.mark.parametrize(("frame", "numbers"), [(Frame.AMSL, (0, 5)), (Frame.ABOVE_HOME, (3, 6)),
                                                (Frame.ABOVE_TERRAIN, (10, 11)), (Frame.COMMAND, (2, 2))])  # fmt: skip
def test_frames_have_two_numbers(frame: Frame, numbers: tuple[int, int]) -> None:
    assert [Frame.from_mav_frame(number) for number in numbers] == [frame, frame]
    assert (int(frame), frame.wire) == numbers


def test_unknown_frames_are_refused() -> None:
    with pytest.raises(FormatError, match="unknown frame 1; use 0"):
        Frame.from_mav_frame(1)


def test_a_fence_survives_as_items() -> None:
    items = items_from_fence(FENCE)
    assert [item.command for item in items] == [5001] * 3 + [5002] * 4 + [5001] * 3 + [5003, 5004, 5000]
    assert [item.params[0] for item in items[:8]] == [3.0] * 3 + [4.0] * 4 + [3.0]
    assert fence_from_items(items) == FENCE
    assert fence_from_items(()) == Fence()


def test_rally_points_survive_as_items() -> None:
    rally = RallyPoints((FramedPoint(46.0, -7.0, 20.0), FramedPoint(46.1, -7.1, 900.0, Frame.AMSL)))
    assert rally_from_items(items_from_rally(rally)) == rally
    assert mission_list_of(MissionType.RALLY, items_of(rally, PX4), PX4) == rally
    assert mission_type_of(rally) is MissionType.RALLY


VERTEX = MissionItem(Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, Frame.AMSL, (3.0, 0.0, 0.0, 0.0), 46.0, -7.0)


@pytest.mark.parametrize(
    ("items", "what"),
    [
        ([VERTEX, VERTEX], "the last polygon has only 2 of its 3"),
        (
            [VERTEX, MissionItem(5003, Frame.AMSL, (9.0, 0.0, 0.0, 0.0))],
            "fence item 1: the preceding polygon has only 1",
        ),
        ([dataclasses.replace(VERTEX, params=(2.0, 0.0, 0.0, 0.0))], "fence item 0: the polygon has 2 vertices"),
        ([dataclasses.replace(VERTEX, params=(math.nan, 0.0, 0.0, 0.0))], "polygon has nan vertices"),
        ([MissionItem(5004, Frame.AMSL)], r"radius must be above 0, not 0\.0 m"),
        ([MissionItem(5000, Frame.AMSL)] * 2, "fence item 1: this is a second return point"),
        ([MissionItem(16, Frame.AMSL)], "command 16 is not a fence item"),
    ],
)
def test_bad_fences_are_refused_with_the_item(items: list[MissionItem], what: str) -> None:
    with pytest.raises(FormatError, match=what):
        fence_from_items(items)


def test_fences_that_cannot_be_written() -> None:
    with pytest.raises(FormatError, match="polygon 0: the polygon has 2 vertices"):
        items_from_fence(Fence((FencePolygon(TRIANGLE.vertices[:2]),)))
    with pytest.raises(FormatError, match="circle 0: the radius must"):
        items_from_fence(Fence((), (FenceCircle(LatLon(1.0, 2.0), math.nan),)))
    with pytest.raises(FormatError, match="rally item 0"):
        rally_from_items([VERTEX])


def test_errors_share_one_root_and_say_where() -> None:
    error = FormatError("is broken", where="line 3", advice="mend it")
    assert str(error) == "line 3: is broken; mend it"
    for made in (
        error,
        TransferSilentError("x", vehicle_holds="mixed"),
        CommandRefusedError("x", command=1, result=2, result_name="DENIED"),
    ):
        assert isinstance(made, MissionIoError)


GEOD = Geod(ellps="WGS84")


@pytest.mark.parametrize(
    ("span_deg", "relative", "absolute_m"), [(0.001, 1e-6, 1e-6), (0.1, 1e-6, 1e-3), (3.0, 1e-4, 0.0)]
)
def test_distances_agree_with_pyproj(span_deg: float, relative: float, absolute_m: float) -> None:
    rng = random.Random(5)
    for _ in range(300):
        lat, lon = rng.uniform(-80, 80), rng.uniform(-180, 180)
        lat2, lon2 = lat + rng.uniform(-span_deg, span_deg), lon + rng.uniform(-span_deg, span_deg)
        wanted = GEOD.inv(lon, lat, lon2, lat2)[2]
        assert ground_distance_m(lat, lon, lat2, lon2) == pytest.approx(wanted, rel=relative, abs=absolute_m)


def test_distances_across_the_date_line_and_to_the_other_side() -> None:
    assert ground_distance_m(10.0, 179.999, 10.0, -179.999) == pytest.approx(
        GEOD.inv(179.999, 10.0, -179.999, 10.0)[2], rel=1e-6
    )
    assert ground_distance_m(0.0, 0.0, 0.0, 180.0) == pytest.approx(math.pi * 6378137.0)
    assert ground_distance_m(5.0, 6.0, 5.0, 6.0) == 0.0


def test_points_in_space_agree_with_pyproj() -> None:
    to_space = Transformer.from_crs("EPSG:4979", "EPSG:4978")
    for position in ((33.2, -98.1, 345.0), (-89.0, 12.0, -50.0), (0.0, 180.0, 9000.0)):
        assert earth_centred_m(*position) == pytest.approx(to_space.transform(*position), abs=1e-6)


def test_a_plausible_mission_raises_no_doubts() -> None:
    assert doubts_about(MISSION) == ()
    assert doubts_about(Mission(None, MISSION.items)) == ()


def test_a_place_that_was_never_set_is_doubted() -> None:
    zero = waypoint(0.0, 0.0, 10.0, frame=Frame.ABOVE_HOME)
    assert doubts_about(
        Mission(GeoPoint(0.0, 0.0, 0.0), (*MISSION.items, zero, delay(1.0), replace(zero, command=195)))
    ) == (
        "home is at latitude 0, longitude 0, in the open sea; set the home position",
        "item 9: this waypoint is at latitude 0, longitude 0",
    )


def test_a_route_far_from_home_is_doubted_and_a_swapped_one_is_named() -> None:
    home = GeoPoint(33.2, 60.4, 100.0)
    swapped = waypoint(60.41, 33.21, 30.0, frame=Frame.ABOVE_HOME)
    (doubt,) = doubts_about(Mission(home, (swapped, swapped, replace(swapped, lat_deg=math.nan))))
    assert doubt.startswith("item 1: ")
    assert doubt.endswith(" km from home (the farthest of 2 beyond 100 km); latitude and longitude seem to be swapped")
    (doubt,) = doubts_about(Mission(HOME, (waypoint(33.2, -90.0, 30.0, frame=Frame.AMSL),)))
    far_km = GEOD.inv(HOME.lon_deg, HOME.lat_deg, -90.0, 33.2)[2] / 1000.0
    assert doubt.startswith(
        f"item 1: {far_km:.0f} km from home (the farthest of 1 beyond 100 km); do the route and home belong"
    )
