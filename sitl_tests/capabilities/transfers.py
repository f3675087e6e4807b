"""Finding a vehicle, and giving it missions, fences and rally points; each is compared with a download of its own."""

from dataclasses import replace

from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import MissionList, items_of, mission_type_of
from mission_io.client.files import FileUploads
from mission_io.client.lists import upload_part
from mission_io.errors import MisuseError
from mission_io.links.simulated import Conditions
from mission_io.model.items import Mission
from mission_io.wire import messages as m
from sitl_tests.case import Case, Finding, Station, Stopwatch
from sitl_tests.errors import require
from sitl_tests.matrix import WORKS
from sitl_tests.missions import fence_with_hole, long_mission, rally_points
from sitl_tests.relay import Relay
from uavcover.missions.mission_compiler import AUTOPILOTS
from uavcover.terrain.frames import LocalFrame

_MISSION_ITEMS = 60
_PART, _PART_ITEMS = 19, 10
_LOSS = 0.2
_HOME_S = 60.0
_NEAR_M = 2.0


def connect(case: Case) -> Finding:
    """The vehicle is found, says what it is, and stands where it was put."""
    with case.station() as station:
        vehicle = station.client.vehicle
        require(
            vehicle.autopilot is AUTOPILOTS[case.autopilot],
            f"the heartbeat says {vehicle.autopilot.name}, expected {case.autopilot}",
        )
        version = station.client.request_message(m.AutopilotVersion)
        home = _home(station)
    planned = case.vehicle.home
    frame = LocalFrame(planned.lat_deg, planned.lon_deg, planned.alt_amsl_m)
    east, north, up = frame.enu_from_geodetic(home.lat_deg, home.lon_deg, home.alt_amsl_m)[0].tolist()
    require(
        max(abs(east), abs(north), abs(up)) <= _NEAR_M,
        f"home is {east:.1f}, {north:.1f}, {up:.1f} m (ENU) from where it was put",
    )
    number = version.flight_sw_version
    return Finding(
        WORKS, f"version {number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}, home {up:+.2f} m in height"
    )


def mission_round_trip(case: Case) -> Finding:
    """A mission goes up and comes back the same."""
    return _round_trip(case, long_mission(case.vehicle.home, _MISSION_ITEMS))


def fence_round_trip(case: Case) -> Finding:
    """A fence of a polygon and a circle goes up and comes back the same."""
    return _round_trip(case, fence_with_hole(case.vehicle.home))


def rally_round_trip(case: Case) -> Finding:
    """Rally points go up and come back the same."""
    return _round_trip(case, rally_points(case.vehicle.home))


def upload_under_loss(case: Case) -> Finding:
    """A mission gets across a link that loses a fifth of the datagrams each way."""
    mission = long_mission(case.vehicle.home, _MISSION_ITEMS)
    watch = Stopwatch()
    with (
        Relay(case.vehicle.url, seed=case.seed, conditions=Conditions(loss=_LOSS)) as relay,
        case.station(relay.url) as station,
    ):
        checked = station.client.upload_and_verify(mission)
        took_s = watch.elapsed_s
    require(checked.passed, "what was read back over the bad link is not what was sent")
    _require_held(case, mission)
    return Finding(WORKS, f"{_MISSION_ITEMS} items and read-back in {took_s:.1f} s at {100 * _LOSS:g} % loss each way")


def mission_as_file(case: Case) -> Finding:
    """A mission and a fence come as one file each, are read back, and are what another station finds."""
    mission, fence = long_mission(case.vehicle.home, _MISSION_ITEMS), fence_with_hole(case.vehicle.home)
    with case.station() as station:
        try:
            whole = [FileUploads(station.client).upload_list(content).passed for content in (mission, fence)]
        except MisuseError as error:  # our own check knows who has no lists as files
            return Finding("refused", str(error))
        require(all(whole), f"read back changed: mission and fence are {whole}")
    for content in (mission, fence):
        _require_held(case, content)
    return Finding(WORKS, f"{_MISSION_ITEMS} items and a fence, as another station finds them")


def part_of_mission(case: Case) -> Finding:
    """Ten items of a mission are written over on a good link, then again on one that loses a fifth of the datagrams each way."""
    mission = long_mission(case.vehicle.home, _MISSION_ITEMS)
    with case.station() as station:
        station.client.upload_and_verify(mission)
        mission = _raised(mission)
        try:
            checked = upload_part(station.client, _PART + 1, mission.items[_PART : _PART + _PART_ITEMS])
        except MisuseError as error:  # our own check knows who takes no parts
            return Finding("refused", str(error))
    require(checked.passed, "what was read back is not what was meant")
    _require_held(case, mission)
    mission, watch = _raised(mission), Stopwatch()
    with (
        Relay(case.vehicle.url, seed=case.seed, conditions=Conditions(loss=_LOSS)) as relay,
        case.station(relay.url) as station,
    ):
        checked = upload_part(station.client, _PART + 1, mission.items[_PART : _PART + _PART_ITEMS])
        took_s = watch.elapsed_s
    require(checked.passed, "what was read back over the bad link is not what was meant")
    _require_held(case, mission)
    return Finding(
        WORKS, f"{_PART_ITEMS} of {_MISSION_ITEMS} items in {took_s:.1f} s at {100 * _LOSS:g} % loss each way"
    )


def _raised(mission: Mission) -> Mission:
    """The same with the items of the part a metre higher."""
    end = _PART + _PART_ITEMS
    part = tuple(replace(item, alt_m=item.alt_m + 1.0) for item in mission.items[_PART:end])
    return Mission(mission.home, (*mission.items[:_PART], *part, *mission.items[end:]))


def _round_trip(case: Case, content: MissionList) -> Finding:
    with case.station() as station:
        checked = station.client.upload_and_verify(content)
        require(checked.passed, f"read back changed: {[d for d in checked.differences if not d.acceptable][:2]}")
    _require_held(case, content)
    with case.station() as station:
        station.client.clear(mission_type_of(content))
    by_design = len({difference.field for difference in checked.differences})
    return Finding(WORKS, f"{len(checked.sent)} items, {by_design} fields change by design; cleared afterwards")


def _require_held(case: Case, content: MissionList) -> None:
    autopilot = AUTOPILOTS[case.autopilot]
    sent = items_of(content, autopilot)
    held = case.held(mission_type_of(content))
    wrong = [d for d in compare_items(sent, held, autopilot, mission_type_of(content)) if not d.acceptable]
    require(not wrong, f"another station finds: {wrong[:2]}")


def _home(station: Station) -> m.HomePosition:
    """The vehicle's home, once it knows it."""
    station.wait(lambda: station.monitor.latest(m.Heartbeat) is not None, within_s=_HOME_S, what="no heartbeat")
    return station.client.request_message(m.HomePosition, timeout_s=_HOME_S)
