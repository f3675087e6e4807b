"""Readers that nobody here wrote read our files to the same items."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mavsdk
import pytest
from mavsdk.plugins.mission_raw import MissionRaw
from pymavlink import mavutil, mavwp
from pymavlink.dialects.v20 import ardupilotmega

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.autopilots.mission_lists import home_item
from mission_io.formats import plan, wpl
from mission_io.formats.drawings import read_fence_list
from mission_io.links.datagrams import UdpLink
from mission_io.model.items import Fence, Frame, FramedPoint, GeoPoint, MissionItem, items_from_fence, items_from_rally
from mission_io.wire.messages import float32
from tests.mission_io.formats.samples import FENCE, HOME, MISSION, RALLY, fen_text
from tests.mission_io.real_vehicle import flying_on
from tests.mission_io.vehicle import VehiclePeer


def of_mavwp(item: Any) -> MissionItem:
    params = (item.param1, item.param2, item.param3, item.param4)
    frame = Frame.from_mav_frame(item.frame)
    return MissionItem(item.command, frame, params, item.x, item.y, item.z, bool(item.autocontinue))


def test_pymavlink_reads_our_waypoints(tmp_path: Path) -> None:
    path = tmp_path / "mission.waypoints"
    path.write_text(wpl.write_mission(MISSION), newline="")
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == 9
    assert [of_mavwp(loader.wp(number)) for number in range(9)] == [home_item(HOME), *MISSION.items]


@pytest.fixture
def mavlink_2(monkeypatch: pytest.MonkeyPatch) -> None:
    """pymavlink's fence and rally loaders want MAVLink 2, which it is told by the environment."""
    monkeypatch.setenv("MAVLINK20", "1")
    monkeypatch.setattr(mavutil, "mavlink", ardupilotmega)


@pytest.mark.usefixtures("mavlink_2")
@pytest.mark.parametrize("home", [HOME, None], ids=["home", "no home"])
def test_pymavlinks_fence_and_rally_loaders_read_our_waypoints(tmp_path: Path, home: GeoPoint | None) -> None:
    """MAVProxy sends every row that these loaders read, so that home would become an item of the fence."""
    path, rows_of_home = tmp_path / "list.waypoints", 0 if home is None else 1
    for loader, text, items in (
        (mavwp.MissionItemProtocol_Fence(), wpl.write_fence(FENCE, home), items_from_fence(FENCE)),
        (mavwp.MissionItemProtocol_Rally(), wpl.write_rally(RALLY, home), items_from_rally(RALLY)),
    ):
        path.write_text(text, newline="")
        assert loader.load(str(path)) == len(items) + rows_of_home
        assert [of_mavwp(loader.wp(row + rows_of_home)) for row in range(len(items))] == list(items)


def test_what_pymavlink_writes_is_read_to_its_six_decimals(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.waypoints", tmp_path / "theirs.waypoints"
    ours.write_text(wpl.write_mission(MISSION), newline="")
    loader = mavwp.MAVWPLoader()
    loader.load(str(ours))
    loader.save(str(theirs))
    back = wpl.read(theirs.read_text())
    assert back.repairs == ()
    assert len(back.items) == len(MISSION.items)
    for read, item in zip(back.items, MISSION.items, strict=True):
        assert (read.command, read.frame, read.params) == (item.command, item.frame, item.params)
        assert (read.lat_deg, read.lon_deg) == pytest.approx((item.lat_deg, item.lon_deg), abs=5.1e-7)


ONE_POLYGON = Fence(FENCE.polygons[:1], (), FramedPoint(33.21, -98.12, 0.0))


def test_a_fen_of_pymavlinks_old_fence_loader_is_read(tmp_path: Path) -> None:
    path = tmp_path / "one.fen"
    path.write_text(fen_text(ONE_POLYGON), newline="")
    loader = mavwp.MAVFenceLoader()
    assert loader.load(str(path)) == 5
    assert (loader.point(0).lat, loader.point(0).lng) == (33.21, -98.12)
    corners = [(vertex.lat_deg, vertex.lon_deg) for vertex in ONE_POLYGON.polygons[0].vertices]
    assert loader.polygon() == [*corners, corners[0]]
    loader.save(str(path))
    assert read_fence_list(path.read_text()).fence == ONE_POLYGON


MAVPROXY_IS_HERE = "MAVProxy is not installed; pip install --no-deps MAVProxy (its own needs include vtk and OpenCV)"


@pytest.mark.usefixtures("mavlink_2")
def test_mavproxys_fence_module_finds_our_polygons(tmp_path: Path) -> None:
    fence_module = pytest.importorskip("MAVProxy.modules.mavproxy_fence", reason=MAVPROXY_IS_HERE).FenceModule

    class Module:
        wploader = fence_module.loader_class()()
        polygons_of_type = fence_module.polygons_of_type

    path = tmp_path / "fence.waypoints"
    path.write_text(wpl.write_fence(FENCE, HOME), newline="")
    Module.wploader.load(str(path))
    Module.wploader.remove(Module.wploader.item(0))
    inside, outside = fence_module.inclusion_polygons(Module()), fence_module.exclusion_polygons(Module())
    for polygons, ours in ((inside, FENCE.polygons[0]), (outside, FENCE.polygons[1])):
        (polygon,) = polygons
        assert [(p.x, p.y) for p in polygon] == [(v.lat_deg, v.lon_deg) for v in ours.vertices]


@pytest.fixture(scope="module", params=[ARDUPILOT, PX4], ids=lambda a: a.name)
def importer(request: pytest.FixtureRequest) -> Iterator[MissionRaw]:
    """MAVSDK's importers; they go by the vehicle that is connected, so one of ours is."""
    mavsdk.log_subscribe(lambda *_: True)
    link = UdpLink.listening()
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    ground = mavsdk.Mavsdk(configuration)
    ground.add_any_connection(f"udpout://127.0.0.1:{link.local_port}")
    with flying_on(link, VehiclePeer(request.param)):
        system = ground.first_autopilot(10.0)
        assert system is not None
        raw = MissionRaw(system)
        raw.autopilot_of_test = request.param
        yield raw
        raw.destroy()
        ground.destroy()


def of_mavsdk(item: Any) -> MissionItem:
    frame = Frame.from_mav_frame(item.frame)
    scale = 1e7 if frame is not Frame.COMMAND else 1.0
    return MissionItem(
        item.command,
        frame,
        (item.param1, item.param2, item.param3, item.param4),
        item.x / scale,
        item.y / scale,
        item.z,
        bool(item.autocontinue),
    )


def as_32_bits(item: MissionItem) -> MissionItem:
    p1, p2, p3, p4 = (float32(value) for value in item.params)
    alt_m = float32(item.alt_m)
    return MissionItem(item.command, item.frame, (p1, p2, p3, p4), item.lat_deg, item.lon_deg, alt_m, item.autocontinue)


def test_mavsdk_reads_our_waypoints(importer: MissionRaw) -> None:
    read = importer.import_mission_planner_mission_from_string(wpl.write_mission(MISSION)).mission_items
    items = [of_mavsdk(item) for item in read]
    expected = [as_32_bits(item) for item in (home_item(HOME), *MISSION.items)]
    assert items[-len(expected) :] == expected
    # It inserts a home row of its own for ArduPilot, and keeps ours.
    assert len(items) - len(expected) == int(importer.autopilot_of_test.home_in_item_0)


def test_mavsdk_reads_our_plan(importer: MissionRaw) -> None:
    autopilot = importer.autopilot_of_test
    text = plan.write(plan.PlanFile(MISSION, FENCE, RALLY, mav_autopilot=autopilot.mav_autopilot))
    read = importer.import_qgroundcontrol_mission_from_string(text)
    items = [of_mavsdk(item) for item in read.mission_items]
    expected = [as_32_bits(item) for item in MISSION.items]
    assert items[-len(expected) :] == expected
    assert len(items) - len(expected) == int(autopilot.home_in_item_0)
    assert [round(point.x / 1e7, 7) for point in read.rally_items] == [33.2, 33.23]
    assert len(read.geofence_items) == 8
