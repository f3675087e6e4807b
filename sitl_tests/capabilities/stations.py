"""Two ground stations at one vehicle."""

import json
from dataclasses import replace
from math import nan

from mission_io.autopilots.autopilot import Mode
from mission_io.autopilots.comparison import compare_items
from mission_io.autopilots.mission_lists import wire_items
from mission_io.formats import plan, wpl
from mission_io.model.enums import MissionResult
from mission_io.model.items import Command, Fence, Frame, Mission, MissionItem, MissionType, RallyPoints
from mission_io.wire import messages as m
from sitl_tests.case import Case, Finding, Station
from sitl_tests.errors import CheckFailedError, require
from sitl_tests.flying import fly_mission, require_flown, waypoints_held
from sitl_tests.matrix import WORKS
from sitl_tests.missions import long_mission, route_mission
from sitl_tests.relay import Relay
from uavcover.extras.mavsdk.session import raw_items
from uavcover.flight.arming import request_telemetry, wait_until_ready
from uavcover.flight.orders import custom_mode
from uavcover.missions.mission_compiler import AUTOPILOTS
from uavcover.model.track import Ending, EventKind, FlightEvent

_ITEMS = 30
_ANSWER_S = 2.0
_LOWERED_M = 5.0
_PX4_FIRMWARE = 12
_FOUND_S = 30.0
_TAKEN_OFF_M = 5.0
_TAKES_OFF_S = 60.0


def second_station(case: Case) -> Finding:
    """A second station hears, is turned away in the middle of the first one's upload, and downloads what that gave."""
    autopilot = AUTOPILOTS[case.autopilot]
    wanted = wire_items(long_mission(case.vehicle.home, _ITEMS), autopilot)
    answers: list[str] = []
    with case.station() as first, case.second_station() as second:

        def interfere(across: int, total: int) -> None:
            if not answers and across >= total // 2:
                answers.append(_answer_to_count(second))

        first.client.upload(MissionType.MISSION, wanted, progress=interfere)
        held = second.client.download(MissionType.MISSION)
    wrong = [d for d in compare_items(wanted, held, autopilot) if not d.acceptable]
    require(bool(answers), "the upload had no middle")
    require(not wrong, f"the second station reads {wrong[:2]}")
    return Finding(WORKS, f"the second one is answered {answers[0]}, the first one's {len(held)} items are whole")


def mission_lowered(case: Case) -> Finding:
    """In flight another station uploads the same mission, every waypoint lower; ``fly`` tells it, and that it was changed."""
    mission, autopilot = route_mission(case.vehicle.home), AUTOPILOTS[case.autopilot]
    lower = replace(mission, items=tuple(_lowered(item) for item in mission.items))
    lowered_s: list[float] = []
    with case.station() as first, case.second_station() as second:

        def interfere(event: FlightEvent) -> None:
            if event.kind is EventKind.WAYPOINT and event.waypoint == 1 and not lowered_s:
                lowered_s.append(event.time_s or 0.0)
                second.client.upload(MissionType.MISSION, wire_items(lower, autopilot), in_flight=True)

        outcome, _ = fly_mission(case, first, mission, on_event=interfere)
    changed = [incident for incident in outcome.incidents if incident.kind is Ending.MISSION_CHANGED]
    require(bool(lowered_s), "it never flew to the second waypoint")
    require(bool(changed), f"the change was not told; it ended with {outcome.ending.key}")
    reported = any(f"{_LOWERED_M:.2f} m lower" in event for event in case.events)
    require(reported, f"how much lower was not told: {changed[0].text}")
    after_s = (changed[0].begin_s or 0.0) - lowered_s[0]
    return Finding(outcome.ending.key, f"told {after_s:.1f} s after the upload began: {changed[0].text}")


def mission_from_file(case: Case) -> Finding:
    """Another station uploads what it read from our own file, places cut to whole steps as others do; ``fly`` flies it."""
    mission, autopilot = route_mission(case.vehicle.home), AUTOPILOTS[case.autopilot]
    read = _read_plan(mission) if case.autopilot == "px4" else _read_waypoints(mission)
    items = wire_items(replace(mission, items=tuple(read)), autopilot)
    steps = sum(a.lat_deg != b.lat_deg or a.lon_deg != b.lon_deg for a, b in zip(read, mission.items, strict=True))
    require(steps > 0, "the other station's places are ours to the last bit: nothing is tested")
    with case.second_station() as second:
        second.client.upload(MissionType.MISSION, items)
    with case.station() as first:
        outcome, path = fly_mission(case, first, mission, upload=False)
    require(outcome.ending is Ending.LANDED, f"it ended with {outcome.ending.key}: {case.events[-1]}")
    worst_m = require_flown(path, waypoints_held(case))
    return Finding(
        WORKS, f"{steps} places differ from ours in the last digits; waypoints passed within {worst_m:.1f} m"
    )


def mavsdk_start(case: Case) -> Finding:
    """MAVSDK by itself, as somebody else's program: upload, arm, ``start_mission``; the vehicle takes off in its mission."""
    import mavsdk
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission_raw import MissionRaw

    mavsdk.log_subscribe(lambda *_: True)
    mission, autopilot = route_mission(case.vehicle.home), AUTOPILOTS[case.autopilot]
    with case.second_station() as watcher, Relay(case.vehicle.url, seed=case.seed) as relay:
        request_telemetry(watcher.session)
        wait_until_ready(watcher.session)
        ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
        ground.add_any_connection(relay.url)
        system = ground.first_autopilot(_FOUND_S)
        require(system is not None, f"MAVSDK did not find the vehicle within {_FOUND_S:g} s")
        action, raw = Action(system), MissionRaw(system)
        try:
            raw.upload_mission(raw_items(wire_items(mission, autopilot), MissionType.MISSION))
            action.arm()
            raw.start_mission()
        except mavsdk.MavsdkError as error:
            raise CheckFailedError(f"MAVSDK: {error}") from None
        finally:
            for part in (raw, action, ground):
                part.destroy()
        number = custom_mode(autopilot, Mode.MISSION)
        began_s = watcher.monitor.time_s or 0.0
        watcher.wait(
            lambda: _height_m(watcher) > _TAKEN_OFF_M and watcher.client.vehicle.custom_mode == number,
            within_s=_TAKES_OFF_S,
            what=f"it is at {_height_m(watcher):.1f} m in {watcher.session.mode_name} after start_mission()",
        )
        took_s = (watcher.monitor.time_s or 0.0) - began_s
    return Finding(WORKS, f"{_TAKEN_OFF_M:g} m above home {took_s:.1f} s after start_mission()")


def _height_m(station: Station) -> float:
    position = station.monitor.latest(m.GlobalPositionInt)
    return 0.0 if position is None else position.alt_above_home_m


def _lowered(item: MissionItem) -> MissionItem:
    return replace(item, alt_m=item.alt_m - _LOWERED_M) if item.command == Command.NAV_WAYPOINT else item


def _read_waypoints(mission: Mission) -> list[MissionItem]:
    """``.waypoints`` as MAVProxy reads it: split by tabs, ``int`` for the wire; row 0 is home."""
    rows = [line.split("\t") for line in wpl.write_mission(mission).splitlines()[2:]]
    return [_cut(int(row[3]), int(row[2]), [float(text) for text in row[4:11]]) for row in rows]


def _read_plan(mission: Mission) -> list[MissionItem]:
    """``.plan`` as QGroundControl reads it: null is NaN, degrees are cast."""
    text = plan.write(plan.PlanFile(mission, Fence(()), RallyPoints(()), mav_autopilot=_PX4_FIRMWARE))
    return [
        _cut(row["command"], row["frame"], [nan if value is None else value for value in row["params"]])
        for row in json.loads(text)["mission"]["items"]
    ]


def _cut(command: int, frame: int, numbers: list[float]) -> MissionItem:
    p1, p2, p3, p4, lat_deg, lon_deg, alt_m = numbers
    if frame != Frame.COMMAND:
        lat_deg, lon_deg = int(lat_deg * 1e7) / 1e7, int(lon_deg * 1e7) / 1e7
    return MissionItem(command, Frame(frame), (p1, p2, p3, p4), lat_deg, lon_deg, alt_m)


def _answer_to_count(station: Station) -> str:
    """What a station that wants to upload one item is answered.

    Raises:
        CheckFailedError: it was let in.
    """
    vehicle, own = station.client.vehicle, station.client.local
    station.client.send(m.MissionCount(vehicle.system_id, vehicle.component_id, 1))

    answers: list[m.MissionAck | m.MissionRequest | m.MissionRequestInt] = []

    def is_answer(received: m.Received) -> bool:
        match received.message:
            case m.MissionAck() | m.MissionRequest() | m.MissionRequestInt() as answer:
                if answer.target_system == own.system_id:
                    answers.append(answer)
        return bool(answers)

    station.client.wait_until(is_answer, timeout_s=_ANSWER_S, what="an answer to a second upload")
    if not isinstance(answers[0], m.MissionAck):
        raise CheckFailedError("the second station's upload was let in")
    return MissionResult(answers[0].result).name
