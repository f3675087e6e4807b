"""A multirotor with an autopilot that speaks MAVLink, without a socket or a clock of its own.

``now`` is vehicle time: seconds since the vehicle was switched on. Equal seeds and equal messages at equal times give
equal flights.
"""

from dataclasses import replace
from functools import cached_property

from mission_io.autopilots.autopilot import Mode
from mission_io.model.enums import Severity
from mission_io.model.items import Command, MissionItem, MissionType
from mission_io.wire import messages as m
from uavcover.mock.behaviour import BODY, FLIGHT
from uavcover.mock.body import SMART_RTL
from uavcover.mock.dynamics import WindModel
from uavcover.mock.faults import Fault, FaultKind
from uavcover.mock.flight_control import FlightControl
from uavcover.mock.reactions import Failsafes, handle
from uavcover.mock.state import MockConfig, MockState
from uavcover.mock.telemetry import tell, truth_sample

__all__ = ["MockConfig", "MockVehicle"]


def _begin_fault(control: FlightControl, fault: Fault) -> None:
    """Begin a fault; any other works by being in effect: the vehicle asks ``is_going_on``."""
    state = control.state
    match fault.kind:
        case FaultKind.GPS_LOSS:
            state.body.believed.lose_fix()
            state.send_status_text(Severity.CRITICAL, "GPS 1: lost fix", "GNSS data fusion stopped")
        case FaultKind.BATTERY_FAILSAFE:
            battery = state.body.battery
            battery.drop_to(BODY.fault_charge)
            used_mah = (1.0 - battery.remaining) * battery.capacity_mah
            words = f"Battery 1 is critical {battery.voltage_v:.2f}V used {used_mah:.0f} mAh"
            state.send_status_text(Severity.CRITICAL, words, None)
            control.fail_safe("Battery", fault.mode or Mode.RETURN)
        case FaultKind.PILOT_MODE:
            control.set_mode(fault.mode or Mode.HOLD)
        case FaultKind.REBOOT:
            control.power_off(fault.number)
        case FaultKind.STUCK:
            state.body.itinerary.stuck = True
        case FaultKind.STRONG_WIND:
            state.body.air.change(WindModel(speed_m_s=fault.number, from_deg=BODY.upwind_deg))
            state.send_status_text(Severity.WARNING, None, f"High wind speed detected ({fault.number:.1f} m/s)")
        case FaultKind.MISSION_CHANGED:
            _change_mission(control)
        case FaultKind.MISSION_LOWERED:
            _lower_mission(control, fault.number)
        case FaultKind.FORCE_DISARM:  # another station, by COMPONENT_ARM_DISARM with param2 21196
            control.disarm(force=True)
        case FaultKind.MOTOR_FAILURE:  # the autopilot notices only that its commands have no effect
            state.body.motors_failed = state.flying
            state.send_status_text(Severity.EMERGENCY, "Potential Thrust Loss (1)", None)
        case FaultKind.GPS_GLITCH:
            state.body.believed.glitch_m = fault.number
            state.send_status_text(Severity.CRITICAL, "GPS Glitch or Compass error", None)
        case FaultKind.SPEED_CHANGED:  # by another station, with DO_CHANGE_SPEED
            control.set_speeds(replace(state.speeds, cruise_m_s=fault.number))
        case FaultKind.ITEM_SET_BACK:  # another station sets the first waypoint again
            waypoints = (n for n, item in enumerate(state.mission_items) if item.command == Command.NAV_WAYPOINT)
            if (first := next(filter(None, waypoints), None)) is not None:
                control.set_current(first)
        case FaultKind.CAMERA_STOPS:
            state.camera.at_most = state.camera.taken + fault.number
        case FaultKind.CAMERA_SKIPS:
            state.camera.every = max(1, round(fault.number))
        case FaultKind.CAMERA_SILENT:
            state.camera.reports = False


def _end_fault(state: MockState, fault: Fault) -> None:
    match fault.kind:
        case FaultKind.GPS_LOSS:
            state.body.believed.lost = False
            state.send_status_text(Severity.INFO, "GPS 1: fix is back", "GNSS data fusion started")
        case FaultKind.STUCK:
            state.body.itinerary.come_loose()
        case FaultKind.GPS_GLITCH:
            state.body.believed.glitch_m = 0.0
            state.send_status_text(Severity.CRITICAL, "Glitch cleared", None)


def _change_mission(control: FlightControl) -> None:
    """Another ground station uploads the mission without the waypoint after the next, or without the last one."""
    state = control.state
    items, home = state.mission_items, int(state.autopilot.home_in_item_0)
    positions = [n for n, item in enumerate(items) if item.command == Command.NAV_WAYPOINT and n >= home]
    if positions:
        gone = next((n for n in positions if n > state.current_seq + 1), positions[-1])
        _upload(control, (*items[:gone], *items[gone + 1 :]))


def _lower_mission(control: FlightControl, by_m: float) -> None:
    """Another ground station uploads the same mission with lower waypoints; its length and its current item stay the same."""
    home = int(control.state.autopilot.home_in_item_0)
    lowered = (
        replace(item, alt_m=item.alt_m - by_m) if item.command == Command.NAV_WAYPOINT and n >= home else item
        for n, item in enumerate(control.state.mission_items)
    )
    _upload(control, tuple(lowered))


def _upload(control: FlightControl, items: tuple[MissionItem, ...]) -> None:
    control.state.missions.replace(MissionType.MISSION, items)
    control.state.send_status_text(Severity.INFO, "Flight plan received", None)
    control.mission_changed()


class MockVehicle(MockState):
    """The vehicle: feed it with ``receive`` and ``advance``, and send what ``outgoing`` returns."""

    _texts_said = 0

    @cached_property
    def control(self) -> FlightControl:
        """The actions of the vehicle."""
        return FlightControl(self)

    @cached_property
    def failsafes(self) -> Failsafes:
        """The reactions of the vehicle to failures."""
        return Failsafes(self.control)

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
        for fault in self.faults.take_due(
            self.powered_s, took_off_at_s=self.took_off_at_s, current_seq=self.current_seq
        ):
            _begin_fault(self.control, fault)
        for fault in self.faults.take_ended(self.powered_s):
            _end_fault(self, fault)
        if self.armed or body.falling:
            self._fly(now)
        body.believed.step()
        if self.steps_done % FLIGHT.check_every == 0:
            self._check()
        if now + 1e-9 >= self.streams.next_due_s:
            for kind in self.streams.due(now):
                tell(self, kind)
                if kind is m.GlobalPositionInt and self.on_truth is not None:
                    self.on_truth(truth_sample(self))
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
