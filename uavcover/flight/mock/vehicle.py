"""A multirotor with an autopilot that speaks MAVLink, without a socket and without a clock of its own.

``now`` is vehicle time: seconds since it was switched on. Given the same seed and the same messages at the same times,
it does the same.
"""

import numpy as np

from mission_io import messages as m
from mission_io.autopilots import Autopilot
from mission_io.enums import AutopilotId, CommandResult, MissionResult, MissionState
from mission_io.items import GeoPoint, MissionItem, MissionType
from mission_io.protocol.exchange import Address
from mission_io.protocol.server import MissionServer
from uavcover.flight.mock.body import STEP_S, Ground, MockBody
from uavcover.flight.mock.commands import answer_command, answer_parameter
from uavcover.flight.mock.dynamics import Airframe, Wind
from uavcover.flight.mock.guidance import Speeds
from uavcover.flight.mock.itinerary import Step, StepKind, mission_steps, return_steps
from uavcover.flight.mock.settings import Settings
from uavcover.flight.mock.telemetry import DEFAULT_INTERVALS_S, Streams, telemetry
from uavcover.flight.modes import Mode, mode_from_custom

_DISARM_AFTER_LANDING_S = 2.0
_DISARM_WHEN_IDLE_S = 10.0
"""Waiting for the ground station's next command: on the link's clock, however fast the vehicle's runs."""
_INFO, _WARNING, _CRITICAL = 6, 4, 2


class MockVehicle:
    """The vehicle: feed it with ``receive`` and ``advance``, and send what ``outgoing`` gives.

    Args:
        autopilot: whose behaviour to show: ``mission_io.autopilots.ARDUPILOT`` or ``PX4``.
        home: where it stands.
        settings: how it flies; None takes the defaults.
        airframe: what it can do; None takes the defaults.
        wind: None is calm.
        rng: of the gusts; None is seed 0.
        ground: height of the ground above sea level by latitude and longitude; None is flat at home's height.
        speed: how many times faster than the link its time runs. The time-outs of mission transfers are the link's.
        ready_after_s: time it needs after being switched on until it can be armed.
        system_id: its MAVLink system; its component is 1.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        home: GeoPoint,
        *,
        settings: Settings | None = None,
        airframe: Airframe | None = None,
        wind: Wind | None = None,
        rng: np.random.Generator | None = None,
        ground: Ground | None = None,
        speed: float = 1.0,
        ready_after_s: float = 2.0,
        system_id: int = 1,
    ) -> None:
        self.autopilot = autopilot
        self.address = Address(system_id, 1)
        self.settings = settings if settings is not None else Settings()
        self.speeds: Speeds = self.settings.speeds
        self.body: MockBody = MockBody(
            home,
            airframe=airframe if airframe is not None else Airframe(),
            wind=wind if wind is not None else Wind(),
            rng=rng if rng is not None else np.random.default_rng(0),
            ground=ground,
        )
        self.mode, self.armed = Mode.MANUAL, False
        self.mission_state = MissionState.NOT_STARTED
        self.current_seq = 0
        self._speed, self._ready_after_s = speed, ready_after_s
        # Booting takes vehicle time, and the server counts in the link's.
        booted_at = autopilot.boot_refusal_s / speed - autopilot.boot_refusal_s
        self._missions = MissionServer(autopilot, local=self.address, booted_at=booted_at)
        self._streams = Streams(autopilot)
        self._steps_done = 0
        self._disarm_at_s = 0.0
        self._outbox: list[m.Message] = []

    # How the vehicle is.

    @property
    def time_s(self) -> float:
        """Vehicle time."""
        return self._steps_done * STEP_S

    @property
    def checks_pass(self) -> bool:
        """Whether its own checks before arming pass, which is not yet being ready."""
        return self.time_s >= 0.5 * self._ready_after_s

    @property
    def ready(self) -> bool:
        """Whether it knows where it is and can be armed."""
        return self.time_s >= self._ready_after_s

    @property
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The mission it holds, as it is on the wire."""
        return self._missions.items(MissionType.MISSION)

    # In and out.

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message that arrives at ``now``."""
        self.advance(now)
        message = received.message
        if not m.is_for(message, system_id=self.address.system_id, component_id=self.address.component_id):
            return
        match message:
            case m.CommandLong() | m.CommandInt():
                result = answer_command(self, message)
                self._outbox.append(
                    m.CommandAck(
                        message.command,
                        result,
                        target_system=received.system_id,
                        target_component=received.component_id,
                    )
                )
            case m.SetMode():
                mode = mode_from_custom(self.autopilot, message.custom_mode)
                if mode is not None:
                    self.set_mode(mode)
            case m.MissionSetCurrent():
                self.set_current(message.seq)
            case m.ParamRequestRead() | m.ParamSet():
                value = answer_parameter(self, message)
                if value is not None:
                    self._outbox.append(value)
            case m.MissionClearAll() if self.armed and self.autopilot.mav_autopilot == AutopilotId.ARDUPILOT:
                self._outbox.append(
                    m.MissionAck(received.system_id, received.component_id, MissionResult.ERROR, message.mission_type)
                )
            case _:
                self._missions.receive(received, now / self._speed)
                self._look_at_missions()

    def advance(self, now: float) -> None:
        """Let vehicle time run to ``now``; a time that has passed changes nothing."""
        last = int(now / STEP_S + 1e-6)
        while self._steps_done < last:
            self._steps_done += 1
            self._step(self.time_s)
        self._outbox.extend(self._missions.messages_to_send(now / self._speed))
        self._look_at_missions()

    def outgoing(self) -> list[m.Message]:
        """What it has to say since the last call. A message with a target is for that ground station only."""
        self._outbox.extend(self._missions.messages_to_send(self.time_s / self._speed))
        outbox, self._outbox = self._outbox, []
        return outbox

    # What it can be told to do; the results are answers to commands.

    def arm(self) -> CommandResult:
        """Start the motors."""
        if self.armed:
            return CommandResult.ACCEPTED
        ardupilot = self.autopilot.mav_autopilot == AutopilotId.ARDUPILOT
        if not self.ready:
            self.say(_CRITICAL, "PreArm: Need Position Estimate" if ardupilot else "Preflight Fail: no position")
            return CommandResult.FAILED if ardupilot else CommandResult.TEMPORARILY_REJECTED
        armable = (Mode.MANUAL, Mode.GUIDED, Mode.HOLD) if ardupilot else tuple(Mode)
        if self.mode not in armable:
            self.say(_CRITICAL, f"Arm: {self.mode.name} mode is not armable")
            return CommandResult.FAILED
        if self.mode is Mode.MISSION and not self._has_mission():
            self.say(_CRITICAL, "Preflight Fail: no valid mission")
            return CommandResult.TEMPORARILY_REJECTED
        self.armed, self.body.crashed = True, False
        self._disarm_at_s = self.time_s + _DISARM_WHEN_IDLE_S * self._speed
        self.speeds = self.settings.speeds
        self.current_seq = self._first_seq()
        self.mission_state = MissionState.NOT_STARTED
        self.say(_INFO, "Arming motors" if ardupilot else "Armed by external command")
        if self.mode is Mode.MISSION:  # PX4 takes off as soon as it is armed
            self._follow_mission()
        return CommandResult.ACCEPTED

    def disarm(self, *, force: bool = False) -> CommandResult:
        """Stop the motors; in the air only when forced, and then it falls."""
        if not self.body.on_ground and not force:
            return CommandResult.DENIED
        if self.armed:
            self.say(_INFO, "Disarming motors")
        self.armed = False
        self.body.crashed |= not self.body.on_ground
        self.body.on_ground = True
        self.body.point.rest(up_m=self.body.point.position_m[2])
        self.body.follow([], self.time_s, land_m_s=self.settings.land_m_s)
        return CommandResult.ACCEPTED

    def set_mode(self, mode: Mode) -> CommandResult:
        """Change the flight mode."""
        if mode is Mode.MISSION and not self._has_mission():
            self.say(_WARNING, "Mode change to MISSION failed: no mission")
            return CommandResult.FAILED
        if mode is not Mode.MANUAL and not self.checks_pass:
            self.say(_WARNING, f"Mode change to {mode.name} failed: needs position")
            return CommandResult.FAILED
        was, self.mode = self.mode, mode
        if was is mode or not self.armed:
            return CommandResult.ACCEPTED
        flying = not self.body.on_ground
        if mode is Mode.MISSION and (flying or self.autopilot.mav_autopilot == AutopilotId.PX4):
            self._follow_mission()
        elif mode is not Mode.MISSION:
            if self.mission_state is MissionState.ACTIVE:
                self.mission_state = MissionState.PAUSED
            self._follow(self._mode_steps(mode) if flying else [])
        return CommandResult.ACCEPTED

    def start_mission(self) -> CommandResult:
        """Begin the mission: ArduPilot waits for this on the ground."""
        if not self.armed or not self._has_mission():
            return CommandResult.FAILED
        if self.mode is not Mode.MISSION:
            return self.set_mode(Mode.MISSION) if not self.body.on_ground else CommandResult.FAILED
        if self.mission_state is not MissionState.ACTIVE:
            self._follow_mission()
        return CommandResult.ACCEPTED

    def set_current(self, seq: int) -> CommandResult:
        """Go on with another item."""
        if not self._first_seq() <= seq < len(self.mission_items):
            return CommandResult.DENIED
        self.current_seq = seq
        if self.mission_state is MissionState.COMPLETE:
            self.mission_state = MissionState.PAUSED
        if self.mode is Mode.MISSION and self.armed and not self.body.on_ground:
            self._follow_mission()
        self.tell(m.MissionCurrent)
        return CommandResult.ACCEPTED

    def set_speeds(self, speeds: Speeds) -> None:
        """Fly at other speeds from here on."""
        self.speeds = speeds
        if self.mode is Mode.MISSION and self.armed and not self.body.on_ground:
            self._follow_mission()

    def set_interval(self, kind: type[m.Message], interval_s: float | None) -> None:
        """Send a kind of message each ``interval_s`` seconds; 0 is its default, None is never."""
        self._streams.set_interval(
            kind, DEFAULT_INTERVALS_S.get(kind) if interval_s == 0.0 else interval_s, self.time_s
        )

    def tell(self, kind: type[m.Message]) -> None:
        """Send one message of a kind now."""
        message = telemetry(self, kind)
        if message is not None:
            self._outbox.append(message)

    def say(self, severity: int, text: str) -> None:
        """Send a line for the pilot."""
        self._outbox.append(m.StatusText(severity, text))

    # How it goes on by itself.

    def _step(self, now: float) -> None:
        body = self.body
        if self.armed:
            was_landed = body.on_ground
            body.step(now)
            if was_landed != body.on_ground:
                self._landing_changed(now)
            self._follow_progress()
            if body.on_ground and (body.crashed or now >= self._disarm_at_s):
                self.disarm()
        if now + 1e-9 >= self._streams.next_due_s:
            for kind in self._streams.due(now):
                self.tell(kind)

    def _landing_changed(self, now: float) -> None:
        self.tell(m.ExtendedSysState)
        if not self.body.on_ground:
            return
        self._disarm_at_s = now + _DISARM_AFTER_LANDING_S
        if self.body.crashed:
            self.say(_CRITICAL, "Crash: Disarming: hit the ground")
            return
        self.say(_INFO, "Landed")
        step = self.body.itinerary.step
        if self.mission_state is MissionState.ACTIVE and step is not None and step.seq is not None:
            self._outbox.append(m.MissionItemReached(step.seq))
            self._complete()
        self._follow([])

    def _follow_progress(self) -> None:
        """Tell which items were reached, and which one is current."""
        if self.mission_state is not MissionState.ACTIVE:
            return
        itinerary = self.body.itinerary
        while itinerary.completed:
            self._outbox.append(m.MissionItemReached(itinerary.completed.pop(0)))
        step = itinerary.step
        if step is None:
            self._complete()
        elif step.seq is not None and step.seq != self.current_seq:
            self.current_seq = step.seq
            self.speeds = step.speeds
            self.tell(m.MissionCurrent)

    def _complete(self) -> None:
        self.mission_state = MissionState.COMPLETE
        self.tell(m.MissionCurrent)

    def _follow_mission(self) -> None:
        """Fly the mission from the current item on."""
        self.current_seq = max(self.current_seq, self._first_seq())
        steps = mission_steps(
            self.mission_items, self.current_seq, place=self.body.place, settings=self.settings, speeds=self.speeds
        )
        self.mission_state = MissionState.ACTIVE
        self._disarm_at_s = self.time_s + _DISARM_WHEN_IDLE_S * self._speed
        self._follow(steps)
        self.tell(m.MissionCurrent)

    def _follow(self, steps: list[Step]) -> None:
        self.body.follow(steps, self.time_s, land_m_s=self.settings.land_m_s)

    def _mode_steps(self, mode: Mode) -> list[Step]:
        if mode is Mode.RETURN:
            return return_steps(None, self.settings, self.settings.speeds)
        if mode is Mode.LAND:
            return [Step(None, StepKind.DESCEND, self.settings.speeds)]
        return []

    def _first_seq(self) -> int:
        return 1 if self.autopilot.home_in_item_0 else 0

    def _has_mission(self) -> bool:
        return len(self.mission_items) > self._first_seq()

    def _look_at_missions(self) -> None:
        """Take note of what a transfer changed."""
        for event in self._missions.events():
            if event.mission_type is not MissionType.MISSION:
                continue
            if self.autopilot.home_in_item_0 and event.items:
                self._put_home_in_item_0(event.items)
            flying = self.armed and not self.body.on_ground
            if flying and self.mode is Mode.MISSION:
                self._follow_mission()
            elif not flying or not self.autopilot.home_in_item_0:
                self.current_seq = 0
                self.mission_state = MissionState.NOT_STARTED

    def _put_home_in_item_0(self, items: tuple[MissionItem, ...]) -> None:
        home, row = self.body.home, items[0]
        if row.lat_deg != home.lat_deg or row.lon_deg != home.lon_deg or row.alt_m != home.alt_amsl_m:
            mine = MissionItem(
                row.command, row.frame, row.params, home.lat_deg, home.lon_deg, home.alt_amsl_m, row.autocontinue
            )
            self._missions.set_items(MissionType.MISSION, (mine, *items[1:]))
