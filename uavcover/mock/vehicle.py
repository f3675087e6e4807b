"""A multirotor with an autopilot that speaks MAVLink, without a socket or a clock of its own.

``now`` is vehicle time: seconds since the vehicle was switched on. Equal seeds and equal messages at equal times give
equal flights.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mission_io.autopilots.autopilot import Autopilot, Mode
from mission_io.model.enums import Severity
from mission_io.model.items import Command, GeoPoint, MissionItem, MissionType
from mission_io.wire import messages as m
from uavcover.mock.behaviour import BODY, FLIGHT
from uavcover.mock.body import SMART_RTL, Ground
from uavcover.mock.dynamics import WindModel
from uavcover.mock.faults import Fault, FaultKind
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.reactions import Failsafes, handle
from uavcover.mock.state import MockConfig, MockState
from uavcover.mock.telemetry import OnTruth, tell, truth_sample

# Effects of each fault on the mock vehicle at its begin and end.


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


def _get_stuck(control: FlightControl, _: Fault) -> None:
    control.state.body.itinerary.stuck = True


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


def _fail_motors(control: FlightControl, _: Fault) -> None:
    """Motors give no thrust; the autopilot notices only that its commands have no effect."""
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


_BEGIN: dict[FaultKind, Callable[[FlightControl, Fault], object]] = {
    FaultKind.GPS_LOSS: _lose_fix,
    FaultKind.BATTERY_FAILSAFE: _drain_battery,
    FaultKind.PILOT_MODE: lambda control, fault: control.set_mode(fault.mode or Mode.HOLD),
    FaultKind.REBOOT: lambda control, fault: control.power_off(fault.number),
    FaultKind.STUCK: _get_stuck,
    FaultKind.STRONG_WIND: _blow,
    FaultKind.MISSION_CHANGED: _change_mission,
    FaultKind.MISSION_LOWERED: _lower_mission,
    # Another station forces a disarm (COMPONENT_ARM_DISARM with param2 21196).
    FaultKind.FORCE_DISARM: lambda control, _: control.disarm(force=True),
    FaultKind.MOTOR_FAILURE: _fail_motors,
    FaultKind.GPS_GLITCH: _glitch,
    # Another station commands another speed (DO_CHANGE_SPEED).
    FaultKind.SPEED_CHANGED: lambda control, fault: control.set_speeds(
        replace(control.state.speeds, cruise_m_s=fault.number)
    ),
    FaultKind.ITEM_SET_BACK: _set_item_back,
    FaultKind.CAMERA_STOPS: _stop_camera,
    FaultKind.CAMERA_SKIPS: _skip_photos,
    FaultKind.CAMERA_SILENT: _hush_camera,
}
"""Any other fault works by being in effect: the vehicle asks ``is_going_on``."""

_END: dict[FaultKind, Callable[[FlightControl], None]] = {
    FaultKind.GPS_LOSS: _find_fix,
    FaultKind.STUCK: lambda control: control.state.body.itinerary.come_loose(),
    FaultKind.GPS_GLITCH: _end_glitch,
}


__all__ = ["MockConfig", "MockVehicle"]


class MockVehicle(MockState):
    """The vehicle: feed it with ``receive`` and ``advance``, and send what ``outgoing`` returns.

    Attributes:
        control: what the vehicle can be made to do.
        failsafes: what it does by itself.
    """

    def __init__(
        self,
        autopilot: Autopilot,  # the autopilot to imitate: ``mission_io.autopilots.autopilot.ARDUPILOT`` or ``PX4``
        home: GeoPoint,  # where it stands
        config: MockConfig | None = None,  # what kind of vehicle it is; None takes the defaults
        *,
        # height of the ground above mean sea level by latitude and longitude; None is flat at home's height
        ground: Ground | None = None,
        rng: np.random.Generator | None = None,  # of gusts and errors; None is seed 0
        on_truth: OnTruth | None = None,  # called with the true position each time the vehicle reports its position
    ) -> None:
        super().__init__(
            autopilot,
            home,
            config if config is not None else MockConfig(),
            ground=ground,
            rng=rng if rng is not None else np.random.default_rng(0),
        )
        self.control = FlightControl(self)
        self.failsafes = Failsafes(self.control)
        self._on_truth = on_truth
        self._texts_said = 0

    def receive(self, received: m.Received, now: float) -> None:
        """Handle a message that arrives at ``now``."""
        self.advance(now)
        local = self.address
        if self.ignores(received.system_id):
            return
        if self.cut_off or not m.is_for(received.message, system_id=local.system_id, component_id=local.component_id):
            return
        self.send_all(handle(self.control, self.failsafes, received))

    def advance(self, now: float) -> None:
        """Let vehicle time run to ``now``, counted from when it was first switched on; an earlier time does nothing."""
        last = int(now / BODY.step_s + 1e-6)
        while self.steps_done < last:
            self.steps_done += 1
            self._step()
        self.send_all(self.missions.messages_to_send(self.powered_s))
        self.control.apply_mission_changes()

    def outgoing(self) -> list[m.Message]:
        """Messages since the last call. A message with a target is for that ground station only."""
        self.send_all(self.missions.messages_to_send(self.powered_s))
        return self.take_queued()

    def _step(self) -> None:
        body = self.body
        if self.steps_done <= self.off_until_step:
            if body.falling:
                body.step(self.time_s)
            if self.steps_done == self.off_until_step:
                self._boot()
            return
        now = self.time_s
        apply_faults(self.control)
        if self.armed or body.falling:
            self._fly(now)
        body.believed.step()
        if self.steps_done % FLIGHT.check_every == 0:
            self._check()
        if now + 1e-9 >= self.streams.next_due_s:
            for kind in self.streams.due(now):
                tell(self, kind)
                if kind is m.GlobalPositionInt and self._on_truth is not None:
                    self._on_truth(truth_sample(self))
        texts = self.behaviour.start_texts
        while self._texts_said < len(texts) and now >= texts[self._texts_said].at_s:
            self.say(texts[self._texts_said].severity, texts[self._texts_said].text)
            self._texts_said += 1

    def _check(self) -> None:
        """Draw power, check the failsafes, send what mission transfers have due, and note what terrain is wanted."""
        self.body.draw_power(FLIGHT.check_every * BODY.step_s, motors=self.flying)
        self._note_trail()
        self.failsafes.check()
        self.send_all(self.missions.messages_to_send(self.powered_s))
        if self.terrain is not None and self.home_known:
            self.terrain.want_for(self.body.home, self.mission_items)

    def _note_trail(self) -> None:
        """Keep SmartRTL's positions, of which it flies one after the other."""
        if not (self.armed and self.is_ardupilot):
            return
        here = None if self.body.believed.lost else self.body.believed.position_m
        if self.custom_mode != SMART_RTL:
            if (words := self.trail.note(here, self.time_s)) is not None:
                self.say(Severity.WARNING, words)
        elif here is not None:
            self.trail.pop_near(here)

    def _boot(self) -> None:
        self._texts_said = 0
        self.control.boot()
        self.camera.reset()
        self.failsafes.reset()

    def _fly(self, now: float) -> None:
        body = self.body
        was_landed = body.on_ground
        body.step(now)
        if was_landed != body.on_ground:
            self._landing_changed(now)
        if not self.armed:
            return
        self.control.mission.go_on(now)
        self.send_all(self.camera.step(now))
        if body.on_ground and (body.crashed or now >= self.disarm_at_s):
            self.control.disarm()

    def _landing_changed(self, now: float) -> None:
        tell(self, m.ExtendedSysState)
        if not self.body.on_ground:
            if self.took_off_at_s is None:
                self.took_off_at_s = self.powered_s
            return
        self.disarm_at_s = now + FLIGHT.disarm_after_landing_s
        if self.body.crashed and not self.armed:
            return  # nothing detects a crash any more
        if self.body.crashed:
            self.say(Severity.CRITICAL, "Crash: Disarming: hit the ground")
            return
        self.say(Severity.INFO, "Landed")
        self.control.mission.landed(now)
        self.follow([])
