"""Actions of the mock vehicle: arm, disarm, change its mode, fly its mission, fail safe, lose power.

Results are answers to commands; refusals are worded as the autopilot words them.
"""

from collections.abc import Callable

from mission_io.autopilots.autopilot import Mode, has_mode
from mission_io.model.enums import CommandResult, MissionState, Severity
from mission_io.model.items import GeoPoint, MissionType
from mission_io.wire import messages as m
from uavcover.mock.behaviour import BODY, Speeds
from uavcover.mock.body import SMART_RTL
from uavcover.mock.faults import FaultKind
from uavcover.mock.itinerary import Step, StepKind
from uavcover.mock.mission_flight import MissionFlight, return_steps
from uavcover.mock.state import MockState
from uavcover.mock.telemetry import tell

_FAILSAFE_NAMES = {Mode.RETURN: "RTL Mode", Mode.LAND: "LAND Mode", Mode.HOLD: "BRAKE Mode"}
_ARMABLE = (Mode.MANUAL, Mode.GUIDED, Mode.HOLD)
"""The modes of this vehicle in which ArduPilot can be armed."""

_BRAKE = 17
_ARDUPILOT_NAMES = {
    Mode.MANUAL: "STABILIZE", Mode.GUIDED: "GUIDED", Mode.MISSION: "AUTO", Mode.HOLD: "LOITER", Mode.RETURN: "RTL",
    Mode.LAND: "LAND",
}  # fmt: skip

# ArduPilot's texts under True, PX4's under False.
_REFUSED = {True: "Arm: Compass not healthy", False: "Arming denied: Resolve system health failures first"}
_NO_FIX = {True: "PreArm: GPS 1: Bad fix", False: "Preflight Fail: GPS fix too low"}
_NO_POSITION = {True: "PreArm: Need Position Estimate", False: "Preflight Fail: no position"}
_LOW_BATTERY = {True: "PreArm: Battery 1 below minimum arming capacity", False: "Preflight Fail: low battery"}
_NO_MISSION = {True: "init failed", False: "no mission"}
_FENCE = {True: "PreArm: Vehicle breaching {} fence", False: "Preflight Fail: Geofence violation: {}"}


class FlightControl:
    """Carries out the requests of commands, failsafes and faults.

    Attributes:
        state: the vehicle's state.
        mission: follows its mission.
    """

    def __init__(self, state: MockState) -> None:
        self.state = state
        self.mission = MissionFlight(state)
        self._delayed: tuple[Mode, float] | None = None

    def arm(self) -> CommandResult:
        """Start the motors."""
        state = self.state
        if state.armed:
            return CommandResult.ACCEPTED
        refusal = self._refusal_to_arm()
        if refusal is not None:
            return refusal
        state.armed, state.body.crashed = True, False
        state.body.set_home_here()
        state.missions.set_home(state.body.home)
        get = state.parameters
        if state.is_ardupilot:
            here = None if state.body.believed.lost else state.body.believed.position_m
            state.trail.begin(here, state.time_s, accuracy_m=get["SRTL_ACCURACY"], most=get["SRTL_POINTS"])
        state.stay_armed()
        state.speeds = state.settings.speeds
        self.mission.rewind()
        state.send_status_text(Severity.INFO, "Arming motors", "Armed by external command")
        if state.mode is Mode.MISSION:  # PX4 takes off as soon as it is armed
            self._fly_mission()
        return CommandResult.ACCEPTED

    def disarm(self, *, force: bool = False) -> CommandResult:
        """Stop the motors; in the air only when forced, and then the vehicle falls."""
        state = self.state
        if not state.body.on_ground and not force:
            return CommandResult.DENIED
        if state.armed:
            state.say(Severity.INFO, "Disarming motors")
        state.armed = False
        state.body.cut_motors()
        state.follow([])
        tell(state, m.ExtendedSysState)
        return CommandResult.ACCEPTED

    def set_mode(self, mode: Mode, *, number: int | None = None) -> CommandResult:
        """Change the flight mode; of several ArduPilot modes that mean the same to the one with a number."""
        state = self.state
        if not has_mode(state.autopilot, mode):
            return CommandResult.DENIED
        if mode is Mode.MISSION and not self.mission.there_is_one:
            state.say(Severity.WARNING, f"Mode change to {self._name(mode)} failed: {_NO_MISSION[state.is_ardupilot]}")
            return CommandResult.FAILED
        if mode is Mode.MISSION and self._would_flip():
            state.say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd")
            state.say(Severity.WARNING, f"Mode change to {self._name(mode)} failed: init failed")
            return CommandResult.FAILED
        if mode not in (Mode.MANUAL, Mode.LAND) and not (state.home_known and not state.body.believed.lost):
            state.say(Severity.WARNING, f"Mode change to {self._name(mode)} failed: requires position")
            return CommandResult.FAILED
        if number == SMART_RTL and not state.trail.is_active:
            state.say(Severity.WARNING, "Mode change to SMARTRTL failed: init failed")
            return CommandResult.FAILED
        before, was = state.custom_mode, state.mode
        state.mode, state.mode_number = mode, number
        is_same = was is mode and (before == SMART_RTL) == (state.custom_mode == SMART_RTL)
        if is_same or not state.armed:
            return CommandResult.ACCEPTED
        flying = not state.body.on_ground
        if mode is Mode.MISSION and (flying or not state.is_ardupilot):
            if state.is_ardupilot and state.parameters["MIS_RESTART"]:
                self.mission.rewind()
            self._fly_mission(self.mission.enter)
        elif mode is not Mode.MISSION:
            self.mission.pause()
            state.follow(self._mode_steps(mode, was) if flying else [])
        return CommandResult.ACCEPTED

    def start_mission(self) -> CommandResult:
        """Begin the mission: ArduPilot waits for this on the ground.

        ArduPilot 4.7 changes to AUTO from any mode, and accepts it disarmed without any effect.
        """
        state = self.state
        if state.is_ardupilot:
            result = self.set_mode(Mode.MISSION)
            if result is CommandResult.ACCEPTED and state.armed and state.mission_state is not MissionState.ACTIVE:
                self._fly_mission()
            return result
        if not state.armed or not self.mission.there_is_one:
            return CommandResult.FAILED
        if state.mode is not Mode.MISSION:
            return self.set_mode(Mode.MISSION) if not state.body.on_ground else CommandResult.FAILED
        if state.mission_state is not MissionState.ACTIVE:
            self._fly_mission()
        return CommandResult.ACCEPTED

    def set_current(self, seq: int) -> CommandResult:
        """Continue with another mission item."""
        if not self.mission.go_to(seq):
            self.state.send_status_text(Severity.CRITICAL, None, f"There is no mission item {seq}")
            return CommandResult.DENIED
        self._fly_on()
        tell(self.state, m.MissionCurrent)
        return CommandResult.ACCEPTED

    def set_home(self, home: GeoPoint | None) -> CommandResult:
        """Move home; None moves it to the vehicle. ArduPilot's legs use the new heights from the next item on, PX4's at once."""
        state = self.state
        if not state.is_ardupilot and not state.parameters["COM_HOME_EN"]:
            return CommandResult.DENIED
        if home is None:
            state.body.set_home_here()
        else:
            state.body.set_home(home)
        state.missions.set_home(state.body.home)
        tell(state, m.HomePosition)
        if state.is_ardupilot:
            self.mission.heights_are_old = True
        else:
            self._fly_on()
        return CommandResult.ACCEPTED

    def set_speeds(self, speeds: Speeds) -> None:
        """Fly at other speeds from here on."""
        self.state.speeds = speeds
        self._fly_on()

    def fail_safe_smartly(self, what: str, otherwise: Mode) -> None:
        """Return by SmartRTL if available; otherwise return or land, as ArduCopter's failsafes do."""
        state = self.state
        if state.trail.is_active and not state.body.believed.lost:
            if state.flying and state.custom_mode != SMART_RTL:
                state.say(Severity.CRITICAL, f"{what} Failsafe: changed to SmartRTL Mode")
                self.set_mode(Mode.RETURN, number=SMART_RTL)
            return
        if what != "Fence":
            next_best = "Trying RTL Mode" if otherwise is Mode.RETURN else "Using Land Mode"
            state.say(Severity.WARNING, f"SmartRTL Unavailable, {next_best}")
        self.fail_safe(what, otherwise)

    def fail_safe(self, what: str, mode: Mode, *, delay_s: float = 0.0) -> None:
        """Change to a failsafe mode in flight and report it; do nothing on the ground or in that mode.

        With a delay it holds first, as PX4 does, unless a station chooses another mode meanwhile.
        """
        state = self.state
        if not state.armed or state.body.on_ground or state.mode is mode:
            return
        if state.is_ardupilot:
            state.say(Severity.CRITICAL, f"{what} Failsafe: changed to {_FAILSAFE_NAMES[mode]}")
        else:
            state.say(Severity.CRITICAL, f"Failsafe activated: {what.lower()}, switching to {mode.value}")
        if delay_s > 0.0 and mode in (Mode.RETURN, Mode.LAND):
            self.set_mode(Mode.HOLD)
            self._delayed = (mode, state.time_s + delay_s)
            return
        self.set_mode(mode)

    def end_delay(self) -> None:
        """Carry out the delayed action of a failsafe when it is due."""
        if self._delayed is None:
            return
        mode, due_s = self._delayed
        if self.state.mode is not Mode.HOLD or not self.state.flying:
            self._delayed = None
        elif self.state.time_s >= due_s:
            self._delayed = None
            self.set_mode(mode)

    def power_off(self, seconds: float) -> None:
        """Lose power for a while: motors off, queued messages lost; the vehicle boots again afterwards."""
        state = self.state
        state.armed = False
        state.body.cut_motors()
        state.follow([])
        state.take_queued()
        state.off_until_step = state.steps_done + round(seconds / BODY.step_s)

    def boot(self) -> None:
        """Boot after a loss of power: transfers, intervals and mission progress are forgotten, the lists are kept."""
        state = self.state
        state.boot_step = state.steps_done
        state.mode = Mode.MANUAL
        self.mission.reset()
        state.missions.reboot(state.powered_s)
        state.streams.reset()

    def take_mission_message(self, received: m.Received) -> list[m.Message]:
        """Handle a message of the mission protocol and return the immediate answers."""
        state = self.state
        answers = state.missions.receive(received, state.powered_s, flying=state.armed)
        self.apply_mission_changes()
        return answers

    def apply_mission_changes(self) -> None:
        """React to what transfers have changed."""
        state = self.state
        if state.home_known:
            state.missions.set_home(state.body.home)
        for event in state.missions.events(state.powered_s):
            if event.mission_type is MissionType.MISSION:
                self.mission_changed()

    def mission_changed(self) -> None:
        """Continue with another mission than before."""
        state = self.state
        if state.flying and state.mode is Mode.MISSION:
            state.send_status_text(Severity.CRITICAL, "Auto mission changed, restarted command", None)
            self._fly_mission()
        elif not state.flying or not state.autopilot.home_in_item_0:
            self.mission.reset()
        self.mission.drop_reports()
        tell(state, m.MissionCurrent)

    def reason_not_to_arm(self) -> str | None:
        """The autopilot's text for a refusal to arm; None when nothing prevents it."""
        state = self.state
        ardupilot = state.is_ardupilot
        if state.faults.is_going_on(FaultKind.ARMING_REFUSED):
            return _REFUSED[ardupilot]
        if not state.has_fix:
            return _NO_FIX[ardupilot]
        if not state.ready:
            return _NO_POSITION[ardupilot]
        if state.body.battery.remaining < BODY.arming_charge:
            return _LOW_BATTERY[ardupilot]
        if self.mission.needs_terrain:
            return "PreArm: waiting for terrain data"
        if (limit := state.fence.breach()) is not None:
            return _FENCE[ardupilot].format(limit)
        return None

    def _refusal_to_arm(self) -> CommandResult | None:
        """The answer when arming is refused, after sending the reason; None when nothing prevents it."""
        state = self.state
        ardupilot = state.is_ardupilot
        reason = self.reason_not_to_arm()
        if reason is not None:
            state.say(Severity.CRITICAL, reason)
            return CommandResult.FAILED if ardupilot else CommandResult.TEMPORARILY_REJECTED
        if ardupilot and (state.mode not in _ARMABLE or state.custom_mode == _BRAKE):
            state.say(Severity.CRITICAL, f"Arm: {self._name(state.mode)} mode not armable")
            return CommandResult.FAILED
        if state.mode is Mode.MISSION and not self.mission.there_is_one:
            state.say(Severity.CRITICAL, "Preflight Fail: no valid mission")
            return CommandResult.TEMPORARILY_REJECTED
        return None

    def _would_flip(self) -> bool:
        """Whether a mission would begin on the ground without a take-off; ArduPilot refuses that."""
        state = self.state
        return state.is_ardupilot and state.armed and state.body.on_ground and not self.mission.starts_with_takeoff

    def _name(self, mode: Mode) -> str:
        """A mode as the autopilot names it."""
        if not self.state.is_ardupilot:
            return mode.name
        return "BRAKE" if mode is Mode.HOLD and self.state.custom_mode == _BRAKE else _ARDUPILOT_NAMES[mode]

    def _fly_mission(self, begin: Callable[[], None] | None = None) -> None:
        """Fly the mission, or return home when terrain heights are missing."""
        if self.mission.needs_terrain:
            self.state.say(Severity.CRITICAL, "Failsafe: Terrain data missing")
            self.set_mode(Mode.RETURN)
        else:
            (begin or self.mission.start)()

    def _fly_on(self) -> None:
        """Apply a change to the mission that is being flown."""
        if self.state.mode is Mode.MISSION and self.state.flying:
            self._fly_mission()

    def _mode_steps(self, mode: Mode, was: Mode) -> list[Step]:
        state = self.state
        if mode is Mode.RETURN:
            return return_steps(state, state.settings.speeds, was=was)
        if mode is Mode.LAND:
            return [Step(None, StepKind.DESCEND, state.settings.speeds)]
        return []
