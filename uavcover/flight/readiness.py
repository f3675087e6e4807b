"""Before arming: the telemetry that following needs, the vehicle's readiness, its home, and its mission."""

import math

from mission_io import messages as m
from mission_io.autopilots import wire_items
from mission_io.compare import compare_items
from mission_io.enums import AutopilotId, EkfFlag
from mission_io.errors import CommandRefusedError
from mission_io.items import GeoPoint, MissionType
from uavcover.errors import VehicleError
from uavcover.flight.conversation import Conversation
from uavcover.flight.events import EventKind
from uavcover.flight.flight_plan import FlightPlan
from uavcover.frames import LocalFrame

_INTERVALS_S: dict[type[m.Message], float] = {
    m.GlobalPositionInt: 0.1,
    m.Attitude: 0.1,
    m.MissionCurrent: 0.2,
    m.ExtendedSysState: 0.5,
    m.SysStatus: 1.0,
    m.GpsRawInt: 1.0,
}
_LEAST_RATE_HZ = 5.0
_RATE_WINDOW_S = 2.0
_FIX_3D = 3


def request_telemetry(conversation: Conversation) -> None:
    """Ask for what following needs, as often as it needs it. A refusal is a warning: the rate is checked later."""
    intervals = dict(_INTERVALS_S)
    if conversation.client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT:
        intervals[m.EkfStatusReport] = 1.0
    for kind, interval_s in intervals.items():
        try:
            conversation.client.request_message_interval(kind, interval_s)
        except CommandRefusedError as error:
            text = f"{kind.__name__} each {interval_s:g} s was answered {error.result_name}"
            conversation.tell(EventKind.WARNING, text)


def wait_until_ready(conversation: Conversation) -> None:
    """Wait until the vehicle can be armed.

    ArduPilot's pre-arm bit is good about 18 s before arming works, so its position filter has to agree.

    Raises:
        VehicleError: it does not get ready; the message says what it lacks.
    """
    conversation.tell(EventKind.STAGE, "waiting until the vehicle is ready")
    conversation.wait(
        lambda: not missing(conversation),
        patience_s=conversation.patience.ready_s,
        what=lambda: f"vehicle {conversation.client.vehicle.system_id} has no {' and no '.join(missing(conversation))}",
        stops_before=0,
    )
    _check_rate(conversation)
    conversation.tell(EventKind.STAGE, "the vehicle is ready")


def missing(conversation: Conversation) -> list[str]:
    """What the vehicle still lacks before it can be armed; empty when it is ready."""
    monitor = conversation.monitor
    lacks: list[str] = []
    gps = monitor.latest(m.GpsRawInt)
    if gps is None or gps.fix_type < _FIX_3D:
        lacks.append("satellite fix")
    if conversation.client.vehicle.mav_autopilot == AutopilotId.ARDUPILOT:
        ekf = monitor.latest(m.EkfStatusReport)
        if ekf is None or not ekf.flags & EkfFlag.POSITION_HORIZONTAL_ABSOLUTE or ekf.flags & EkfFlag.CONSTANT_POSITION:
            lacks.append("position estimate")
    status = monitor.latest(m.SysStatus)
    checked = m.PREARM_CHECK_BIT
    if status is None or (status.sensors_present & checked and not status.sensors_healthy & checked):
        lacks.append("passed pre-arm check")
    if monitor.latest(m.GlobalPositionInt) is None:
        lacks.append("position messages")
    return lacks


def check_home(conversation: Conversation, plan: FlightPlan) -> None:
    """Refuse a vehicle whose home, or which itself, is not where the mission was planned to start.

    Heights above home would be wrong by the difference. ArduPilot sets home anew where it is armed, so both count.

    Raises:
        VehicleError: it is too far away, over ground or in height.
    """
    home = conversation.client.request_message(m.HomePosition)
    here = conversation.monitor.latest(m.GlobalPositionInt)
    places = {"home": GeoPoint(home.lat_deg, home.lon_deg, home.alt_amsl_m)}
    if here is not None:
        places["position"] = GeoPoint(here.lat_deg, here.lon_deg, here.alt_amsl_m)
    frame = LocalFrame(plan.home.lat_deg, plan.home.lon_deg, plan.home.alt_amsl_m)
    most_m = plan.max_home_error_m
    for name, place in places.items():
        east, north, up = frame.enu_from_geodetic(place.lat_deg, place.lon_deg, place.alt_amsl_m)[0].tolist()
        aside_m = math.hypot(east, north)
        where = f"the vehicle's {name} (latitude {place.lat_deg:.7f}, longitude {place.lon_deg:.7f})"
        if aside_m > most_m:
            raise VehicleError(
                f"{where} is {aside_m:.1f} m from the planned home, max_home_error_m is {most_m:g}; "
                "not armed: move the vehicle or plan for this home"
            )
        if abs(up) > most_m:
            raise VehicleError(
                f"{where} is at {place.alt_amsl_m:.1f} m above sea level, {abs(up):.1f} m {'above' if up > 0 else 'below'} "
                f"the planned home, max_home_error_m is {most_m:g}; not armed: heights above home would be wrong by it"
            )
    if plan.ground_alt_amsl_m is not None and abs(home.alt_amsl_m - plan.ground_alt_amsl_m) > most_m:
        raise VehicleError(
            f"the vehicle's home is at {home.alt_amsl_m:.1f} m above sea level and the terrain there at "
            f"{plan.ground_alt_amsl_m:.1f} m, max_home_error_m is {most_m:g}; not armed: check the height datum"
        )


def check_mission(conversation: Conversation, plan: FlightPlan) -> None:
    """Refuse a vehicle that holds another mission than the planned one.

    Raises:
        VehicleError: it holds none, or one that differs; the message names the first difference.
    """
    autopilot = conversation.autopilot
    wanted = wire_items(plan.mission, autopilot)
    held = conversation.client.download(MissionType.MISSION)
    wrong = [d for d in compare_items(wanted, held, autopilot) if not d.acceptable]
    if wrong:
        first = wrong[0]
        where = "" if first.item is None else f" in item {first.item}"
        raise VehicleError(
            f"the vehicle holds another mission: {first.field}{where} is {first.received}, planned is {first.sent}; "
            "not armed: upload the mission first"
        )


def _check_rate(conversation: Conversation) -> None:
    """Listen until positions of two seconds are here, and count them."""
    monitor = conversation.monitor
    times = monitor.position_times_s
    times.clear()
    conversation.wait(
        lambda: len(times) > 1 and times[-1] - times[0] >= _RATE_WINDOW_S,
        patience_s=10.0 * _RATE_WINDOW_S,
        what=lambda: "no steady positions",
        stops_before=0,
    )
    rate_hz = (len(times) - 1) / (times[-1] - times[0])
    if rate_hz < _LEAST_RATE_HZ:
        raise VehicleError(
            f"positions come {rate_hz:.1f} times a second of vehicle time, following needs {_LEAST_RATE_HZ:g}; "
            "not armed: raise the rate of GLOBAL_POSITION_INT or use a faster link"
        )
