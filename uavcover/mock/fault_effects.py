"""Effects of each fault on the mock vehicle at its begin and end."""

from collections.abc import Callable
from dataclasses import replace

from mission_io.autopilots.flight_modes import Mode
from mission_io.model.enums import Severity
from mission_io.model.items import Command, MissionItem, MissionType
from uavcover.mock.dynamics import WindModel
from uavcover.mock.faults import Fault, FaultKind
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.tuning import BODY


def apply_faults(control: FlightControl) -> None:
    """Begin and end the faults that are due now."""
    state = control.state
    now = state.powered_s
    for fault in state.faults.take_due(now, took_off_at_s=state.took_off_at_s, current_seq=state.current_seq):
        if (begin := _BEGIN.get(fault.kind)) is not None:
            begin(control, fault)
    for fault in state.faults.take_ended(now):
        if (end := _END.get(fault.kind)) is not None:
            end(control)


def _lose_fix(control: FlightControl, _: Fault) -> None:
    control.state.body.believed.lose_fix()
    control.state.say(
        Severity.CRITICAL, "GPS 1: lost fix" if control.state.is_ardupilot else "GNSS data fusion stopped"
    )


def _find_fix(control: FlightControl) -> None:
    control.state.body.believed.find_fix()
    control.state.say(Severity.INFO, "GPS 1: fix is back" if control.state.is_ardupilot else "GNSS data fusion started")


def _drain_battery(control: FlightControl, fault: Fault) -> None:
    mode = fault.mode or Mode.RETURN
    control.state.body.battery.drop_to(BODY.fault_charge)
    battery = control.state.body.battery
    if control.state.is_ardupilot:
        used_mah = (1.0 - battery.remaining) * battery.capacity_mah
        control.state.say(Severity.CRITICAL, f"Battery 1 is critical {battery.voltage_v:.2f}V used {used_mah:.0f} mAh")
    control.fail_safe("Battery", mode)


def _change_mode(control: FlightControl, fault: Fault) -> None:
    control.set_mode(fault.mode or Mode.HOLD)


def _reboot(control: FlightControl, fault: Fault) -> None:
    control.power_off(fault.number)


def _get_stuck(control: FlightControl, _: Fault) -> None:
    control.state.body.itinerary.stuck = True


def _come_loose(control: FlightControl) -> None:
    control.state.body.itinerary.come_loose()


def _blow(control: FlightControl, fault: Fault) -> None:
    control.state.body.air.change(WindModel(speed_m_s=fault.number, from_deg=BODY.upwind_deg))
    if not control.state.is_ardupilot:
        control.state.say(Severity.WARNING, f"High wind speed detected ({fault.number:.1f} m/s)")


def _change_mission(control: FlightControl, _: Fault) -> None:
    """Another ground station uploads the mission without the waypoint after the next, or without the last one."""
    items = control.state.mission_items
    places = [
        seq
        for seq, item in enumerate(items)
        if item.command == Command.NAV_WAYPOINT and (seq > 0 or not control.state.autopilot.home_in_item_0)
    ]
    if not places:
        return
    ahead = [seq for seq in places if seq > control.state.current_seq + 1]
    gone = ahead[0] if ahead else places[-1]
    _upload(control, (*items[:gone], *items[gone + 1 :]))


def _lower_mission(control: FlightControl, fault: Fault) -> None:
    """Another ground station uploads the same mission with lower waypoints; its length and its current item stay the same."""
    home = int(control.state.autopilot.home_in_item_0)
    _upload(
        control,
        tuple(
            replace(item, alt_m=item.alt_m - fault.number)
            if item.command == Command.NAV_WAYPOINT and n >= home
            else item
            for n, item in enumerate(control.state.mission_items)
        ),
    )


def _upload(control: FlightControl, items: tuple[MissionItem, ...]) -> None:
    control.state.missions.replace(MissionType.MISSION, items)
    if control.state.is_ardupilot:
        control.state.say(Severity.INFO, "Flight plan received")
    control.mission_changed()


def _force_disarm(control: FlightControl, _: Fault) -> None:
    """Another station forces a disarm (COMPONENT_ARM_DISARM with param2 21196)."""
    control.disarm(force=True)


def _fail_motors(control: FlightControl, _: Fault) -> None:
    """Motors give no thrust; the autopilot notices nothing but what it is commanded in vain."""
    control.state.body.motors_failed = control.state.flying
    if control.state.is_ardupilot:
        control.state.say(Severity.EMERGENCY, "Potential Thrust Loss (1)")


def _glitch(control: FlightControl, fault: Fault) -> None:
    control.state.body.believed.glitch_m = fault.number
    if control.state.is_ardupilot:
        control.state.say(Severity.CRITICAL, "GPS Glitch or Compass error")


def _end_glitch(control: FlightControl) -> None:
    control.state.body.believed.glitch_m = 0.0
    if control.state.is_ardupilot:
        control.state.say(Severity.CRITICAL, "Glitch cleared")


def _change_speed(control: FlightControl, fault: Fault) -> None:
    """Another station commands another speed (DO_CHANGE_SPEED)."""
    control.set_speeds(replace(control.state.speeds, cruise_m_s=fault.number))


def _set_item_back(control: FlightControl, _: Fault) -> None:
    """Another station sets the first waypoint again."""
    first = next(
        (n for n, item in enumerate(control.state.mission_items) if n and item.command == Command.NAV_WAYPOINT), None
    )
    if first is not None:
        control.set_current(first)


def _stop_camera(control: FlightControl, fault: Fault) -> None:
    control.state.camera.at_most = control.state.camera.taken + fault.number


def _skip_photos(control: FlightControl, fault: Fault) -> None:
    control.state.camera.every = max(1, round(fault.number))


def _hush_camera(control: FlightControl, _: Fault) -> None:
    control.state.camera.reports = False


_BEGIN: dict[FaultKind, Callable[[FlightControl, Fault], None]] = {
    FaultKind.GPS_LOSS: _lose_fix,
    FaultKind.BATTERY_FAILSAFE: _drain_battery,
    FaultKind.PILOT_MODE: _change_mode,
    FaultKind.REBOOT: _reboot,
    FaultKind.STUCK: _get_stuck,
    FaultKind.STRONG_WIND: _blow,
    FaultKind.MISSION_CHANGED: _change_mission,
    FaultKind.MISSION_LOWERED: _lower_mission,
    FaultKind.FORCE_DISARM: _force_disarm,
    FaultKind.MOTOR_FAILURE: _fail_motors,
    FaultKind.GPS_GLITCH: _glitch,
    FaultKind.SPEED_CHANGED: _change_speed,
    FaultKind.ITEM_SET_BACK: _set_item_back,
    FaultKind.CAMERA_STOPS: _stop_camera,
    FaultKind.CAMERA_SKIPS: _skip_photos,
    FaultKind.CAMERA_SILENT: _hush_camera,
}
"""Any other fault works by being in effect: the vehicle asks ``is_going_on``."""

_END: dict[FaultKind, Callable[[FlightControl], None]] = {
    FaultKind.GPS_LOSS: _find_fix,
    FaultKind.STUCK: _come_loose,
    FaultKind.GPS_GLITCH: _end_glitch,
}
