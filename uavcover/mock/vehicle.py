"""A multirotor with an autopilot that speaks MAVLink, without a socket and without a clock of its own.

``now`` is vehicle time: seconds since it was switched on. Given the same seed and the same messages at the same times,
it does the same.
"""

from collections.abc import Iterable

import numpy as np

from mission_io.autopilots.autopilot import Autopilot, autopilot_for
from mission_io.model.enums import AutopilotId, CommandResult, MissionState, VehicleClass
from mission_io.model.items import GeoPoint, MissionItem, MissionType
from mission_io.protocol.exchange import Address
from mission_io.wire import messages as m
from uavcover.mock.battery import BatteryData
from uavcover.mock.behaviour import Behaviour, Settings, TerrainSource, TransferClock, quick
from uavcover.mock.body import STEP_S, Ground, MockBody
from uavcover.mock.commands import refusal_to_arm, take
from uavcover.mock.dynamics import Airframe, Vector, Wind
from uavcover.mock.failsafes import Failsafes
from uavcover.mock.fault_effects import Faults
from uavcover.mock.faults import Fault, FaultKind
from uavcover.mock.guidance import Speeds
from uavcover.mock.itinerary import Step, StepKind, return_steps
from uavcover.mock.mission_flight import MissionFlight, MissionStore
from uavcover.mock.parameters import Parameters
from uavcover.mock.positioning import GpsError, OnTruth
from uavcover.mock.telemetry import Outbox, Streams, telemetry, truth_sample
from uavcover.mock.terrain_feed import TerrainFeed
from uavcover.vehicle.modes import Mode, has_mode

_DISARM_AFTER_LANDING_S = 2.0
_DISARM_WHEN_IDLE_S = 10.0
"""Waiting for the ground station's next command: on the link's clock, however fast the vehicle's runs."""
_LOOK_EVERY = 10
"""Steps between two looks at battery and failsafes."""
_INFO, _WARNING, _CRITICAL = 6, 4, 2
_FAILSAFE_NAMES = {Mode.RETURN: "RTL Mode", Mode.LAND: "LAND Mode", Mode.HOLD: "BRAKE Mode"}


class MockVehicle:
    """The vehicle: feed it with ``receive`` and ``advance``, and send what ``outgoing`` gives.

    Args:
        autopilot: whose behaviour to show: ``mission_io.autopilots.autopilot.ARDUPILOT`` or ``PX4``.
        home: where it stands.
        settings: how it flies; None takes the defaults.
        airframe: what it can do; None takes the defaults.
        wind: None is calm.
        gps: how far its positions are off; None is exact.
        battery: what it flies on; None takes the defaults.
        rng: of gusts and errors; None is seed 0.
        ground: height of the ground above sea level by latitude and longitude; None is flat at home's height.
        speed: how many times faster than the link its time runs.
        behaviour: how it starts up and talks; None is ``behaviour.quick()``.
        faults: what goes wrong.
        on_truth: takes where it really is, each time it tells its position.
        system_id: its MAVLink system; its component is 1.
        vehicle_type: the MAV_TYPE that it says it is, with the flight mode numbers of such a vehicle; it flies as a multirotor
            whatever it says.

    Attributes:
        body: what flies.
        faults: what has gone wrong; ``faults.add`` takes more.
        missions: the lists that it holds.
        took_off_at_s: ``powered_s`` when it first left the ground.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        home: GeoPoint,
        *,
        settings: Settings | None = None,
        airframe: Airframe | None = None,
        wind: Wind | None = None,
        gps: GpsError | None = None,
        battery: BatteryData | None = None,
        rng: np.random.Generator | None = None,
        ground: Ground | None = None,
        speed: float = 1.0,
        behaviour: Behaviour | None = None,
        faults: Iterable[Fault] = (),
        on_truth: OnTruth | None = None,
        system_id: int = 1,
        vehicle_type: int = VehicleClass.QUADROTOR,
    ) -> None:
        as_given = vehicle_type == VehicleClass.QUADROTOR
        self.autopilot = autopilot if as_given else autopilot_for(autopilot.mav_autopilot, vehicle_type)
        self.speed = speed
        self.vehicle_type = vehicle_type
        self.behaviour = behaviour if behaviour is not None else quick()
        self.address = Address(system_id, 1)
        self.parameters = Parameters(autopilot.mav_autopilot, settings if settings is not None else Settings())
        self.speeds: Speeds = self.settings.speeds
        rng = rng if rng is not None else np.random.default_rng(0)
        self.body: MockBody = MockBody(
            home,
            airframe=airframe if airframe is not None else Airframe(),
            wind=wind if wind is not None else Wind(),
            gps=gps if gps is not None else GpsError(),
            battery=battery if battery is not None else BatteryData(),
            rng=rng,
            ground=ground,
        )
        self.faults = Faults(faults)
        self.mode, self.armed = Mode.MANUAL, False
        self.mission: MissionFlight = MissionFlight(self)
        self.terrain = TerrainFeed() if self._asks_for_terrain else None
        self.failsafes = Failsafes()
        self.took_off_at_s: float | None = None
        self.missions = MissionStore(
            autopilot,
            local=self.address,
            seconds_per_s=1.0 / speed if self.behaviour.transfer_clock is TransferClock.LINK else 1.0,
            stale_read_back=self.behaviour.stale_read_back,
            rng=rng,
        )
        self._streams = Streams(self)
        self._on_truth = on_truth
        self._steps_done = self._boot_step = self._off_until_step = 0
        self._texts_said = 0
        self._disarm_at_s = 0.0
        self._outbox = Outbox(self)

    # How the vehicle is.

    @property
    def powered_s(self) -> float:
        """Vehicle time since it was first switched on, whatever happened since."""
        return self._steps_done * STEP_S

    @property
    def time_s(self) -> float:
        """Vehicle time: since it was last switched on."""
        return (self._steps_done - self._boot_step) * STEP_S

    @property
    def settings(self) -> Settings:
        """How it flies unless a mission says otherwise."""
        return self.parameters.settings

    @property
    def cut_off(self) -> bool:
        """Whether nothing gets through, in neither direction."""
        return self._steps_done < self._off_until_step or self.faults.is_going_on(FaultKind.LINK_OUTAGE)

    @property
    def flying(self) -> bool:
        """Whether its motors keep it in the air."""
        return self.armed and not self.body.on_ground

    @property
    def mission_state(self) -> MissionState:
        """What it does with its mission."""
        return self.mission.state

    @property
    def current_seq(self) -> int:
        """Number of the mission item that it flies to, on the wire."""
        return self.mission.current_seq

    @property
    def is_ardupilot(self) -> bool:
        """Whether it behaves as ArduPilot; otherwise as PX4."""
        return self.autopilot.mav_autopilot == AutopilotId.ARDUPILOT

    @property
    def has_fix(self) -> bool:
        """Whether the satellite receiver knows where it is."""
        return self.time_s >= self.behaviour.fix_s and not self.body.believed.lost

    @property
    def checks_pass(self) -> bool:
        """Whether home is known and its own checks before arming pass, which is not yet being ready."""
        refused = self.faults.is_going_on(FaultKind.ARMING_REFUSED)
        return self.time_s >= self.behaviour.checks_pass_s and self.has_fix and not refused

    @property
    def home_known(self) -> bool:
        """Whether it can tell its home."""
        return self.time_s >= self.behaviour.checks_pass_s

    @property
    def ready(self) -> bool:
        """Whether it knows where it is, so that it can be armed."""
        return self.time_s >= self.behaviour.ready_s and not self.body.believed.lost

    @property
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The mission it holds, as it is on the wire."""
        return self.missions.items(MissionType.MISSION)

    # In and out.

    def receive(self, received: m.Received, now: float) -> None:
        """Take a message that arrives at ``now``."""
        self.advance(now)
        local = self.address
        if self.cut_off or not m.is_for(received.message, system_id=local.system_id, component_id=local.component_id):
            return
        self._outbox.put_all(take(self, received))

    def take_mission_message(self, received: m.Received) -> list[m.Message]:
        """Act on a message of the mission protocol, and return what is answered at once."""
        answers = self.missions.receive(received, self.powered_s, flying=self.armed)
        self._look_at_missions()
        return answers

    def advance(self, now: float) -> None:
        """Let vehicle time run to ``now``, counted from when it was first switched on; the past changes nothing."""
        last = int(now / STEP_S + 1e-6)
        while self._steps_done < last:
            self._steps_done += 1
            self._step()
        self._outbox.put_all(self.missions.messages_to_send(self.powered_s))
        self._look_at_missions()

    def outgoing(self) -> list[m.Message]:
        """What it has to say since the last call. A message with a target is for that ground station only."""
        self._outbox.put_all(self.missions.messages_to_send(self.powered_s))
        return self._outbox.take()

    # What it can be told to do; the results are answers to commands.

    def arm(self) -> CommandResult:
        """Start the motors."""
        if self.armed:
            return CommandResult.ACCEPTED
        refusal = refusal_to_arm(self)
        if refusal is not None:
            return refusal
        self.armed, self.body.crashed = True, False
        self.body.set_home_here()
        self.missions.set_home(self.body.home)
        self.stay_armed()
        self.speeds = self.settings.speeds
        self.mission.rewind()
        self.say(_INFO, "Arming motors" if self.is_ardupilot else "Armed by external command")
        if self.mode is Mode.MISSION:  # PX4 takes off as soon as it is armed
            self.mission.start()
        return CommandResult.ACCEPTED

    def disarm(self, *, force: bool = False) -> CommandResult:
        """Stop the motors; in the air only when forced, and then it falls."""
        if not self.body.on_ground and not force:
            return CommandResult.DENIED
        if self.armed:
            self.say(_INFO, "Disarming motors")
        self.armed = False
        self.body.cut_motors()
        self.follow([])
        self.tell(m.ExtendedSysState)
        return CommandResult.ACCEPTED

    def set_mode(self, mode: Mode) -> CommandResult:
        """Change the flight mode."""
        if not has_mode(self.autopilot, mode):
            return CommandResult.DENIED
        if mode is Mode.MISSION and not self.mission.there_is_one:
            self.say(_WARNING, "Mode change to MISSION failed: no mission")
            return CommandResult.FAILED
        if mode not in (Mode.MANUAL, Mode.LAND) and not (self.home_known and not self.body.believed.lost):
            self.say(_WARNING, f"Mode change to {mode.name} failed: needs position")
            return CommandResult.FAILED
        was, self.mode = self.mode, mode
        if was is mode or not self.armed:
            return CommandResult.ACCEPTED
        flying = not self.body.on_ground
        if mode is Mode.MISSION and (flying or not self.is_ardupilot):
            self.mission.start()
        elif mode is not Mode.MISSION:
            self.mission.pause()
            self.follow(self._mode_steps(mode) if flying else [])
        return CommandResult.ACCEPTED

    def start_mission(self) -> CommandResult:
        """Begin the mission: ArduPilot waits for this on the ground."""
        if not self.armed or not self.mission.there_is_one:
            return CommandResult.FAILED
        if self.mode is not Mode.MISSION:
            return self.set_mode(Mode.MISSION) if not self.body.on_ground else CommandResult.FAILED
        if self.mission_state is not MissionState.ACTIVE:
            self.mission.start()
        return CommandResult.ACCEPTED

    def set_current(self, seq: int) -> CommandResult:
        """Go on with another item."""
        if not self.mission.go_to(seq):
            return CommandResult.DENIED
        if self.mode is Mode.MISSION and self.flying:
            self.mission.start()
        self.tell(m.MissionCurrent)
        return CommandResult.ACCEPTED

    def set_speeds(self, speeds: Speeds) -> None:
        """Fly at other speeds from here on."""
        self.speeds = speeds
        if self.mode is Mode.MISSION and self.flying:
            self.mission.start()

    def set_interval(self, kind: type[m.Message], interval_s: float | None) -> None:
        """Send a kind of message each ``interval_s`` seconds; 0 is its default, None is never."""
        default_s = self.behaviour.streams_s.get(kind)
        self._streams.set_interval(kind, default_s if interval_s == 0.0 else interval_s, self.time_s)

    def tell(self, kind: type[m.Message]) -> None:
        """Send one message of a kind now."""
        message = telemetry(self, kind)
        if message is not None:
            self._outbox.put(message)

    def say(self, severity: int, text: str) -> None:
        """Send a line for the pilot."""
        self._outbox.put(m.StatusText(severity, text))

    def say_reached(self, seq: int) -> None:
        """Tell that an item was reached."""
        self._outbox.put(m.MissionItemReached(seq))

    def follow(self, steps: list[Step]) -> None:
        """Do these steps from now on; none is to stay."""
        self.body.follow(steps, self.time_s, land_m_s=self.settings.land_m_s)

    def stay_armed(self) -> None:
        """Wait for the next command once more."""
        self._disarm_at_s = self.time_s + _DISARM_WHEN_IDLE_S * self.speed

    def place(self, item: MissionItem) -> Vector:
        """The position that a mission item names, by the ground as the vehicle knows it."""
        ground = self.body.ground_alt_amsl_m
        return self.body.place(item, ground if self.terrain is None else self.terrain.known_or(ground))

    # How it goes on by itself.

    def fail_safe(self, what: str, mode: Mode) -> None:
        """Change to a mode because of something that went wrong, and say so; on the ground only say it."""
        if not self.armed or self.body.on_ground or self.mode is mode:
            return
        if self.is_ardupilot:
            self.say(_CRITICAL, f"{what} Failsafe: changed to {_FAILSAFE_NAMES[mode]}")
        else:
            self.say(_CRITICAL, f"Failsafe activated: {what.lower()}, switching to {mode.value}")
        self.set_mode(mode)

    def power_off(self, seconds: float) -> None:
        """Lose power for a while and start anew: motors off, conversations and intervals forgotten, lists kept."""
        self.armed = False
        self.body.cut_motors()
        self.follow([])
        self._outbox.take()
        self._off_until_step = self._steps_done + round(seconds / STEP_S)

    def _step(self) -> None:
        body = self.body
        if self._steps_done <= self._off_until_step:
            if body.falling:
                body.step(self.time_s)
            if self._steps_done == self._off_until_step:
                self._start_up()
            return
        now = self.time_s
        self.faults.step(self)
        if self.armed or body.falling:
            self._fly(now)
        body.believed.step()
        if self._steps_done % _LOOK_EVERY == 0:
            body.draw_power(_LOOK_EVERY * STEP_S, motors=self.flying)
            self.failsafes.look(self)
            self._outbox.put_all(self.missions.messages_to_send(self.powered_s))
            if self.terrain is not None and self.home_known:
                self.terrain.want_for(self.body.home, self.mission_items)
                self._outbox.put_all(self.terrain.requests(now))
        if now + 1e-9 >= self._streams.next_due_s:
            for kind in self._streams.due(now):
                self.tell(kind)
                if kind is m.GlobalPositionInt and self._on_truth is not None:
                    self._on_truth(truth_sample(self))
        texts = self.behaviour.start_texts
        while self._texts_said < len(texts) and now >= texts[self._texts_said].at_s:
            self.say(texts[self._texts_said].severity, texts[self._texts_said].text)
            self._texts_said += 1

    def _start_up(self) -> None:
        """Be switched on again."""
        self._boot_step, self._texts_said = self._steps_done, 0
        self.mode, self.mission = Mode.MANUAL, MissionFlight(self)
        self.missions.reboot(self.powered_s)
        self._streams, self.failsafes = Streams(self), Failsafes()

    def _fly(self, now: float) -> None:
        body = self.body
        was_landed = body.on_ground
        body.step(now)
        if was_landed != body.on_ground:
            self._landing_changed(now)
        if not self.armed:
            return
        self.mission.go_on(now)
        if body.on_ground and (body.crashed or now >= self._disarm_at_s):
            self.disarm()

    def _landing_changed(self, now: float) -> None:
        self.tell(m.ExtendedSysState)
        if not self.body.on_ground:
            if self.took_off_at_s is None:
                self.took_off_at_s = self.powered_s
            return
        self._disarm_at_s = now + _DISARM_AFTER_LANDING_S
        if self.body.crashed and not self.armed:
            return  # nobody watches for a crash any more
        if self.body.crashed:
            self.say(_CRITICAL, "Crash: Disarming: hit the ground")
            return
        self.say(_INFO, "Landed")
        self.mission.landed(now)
        self.follow([])

    def _mode_steps(self, mode: Mode) -> list[Step]:
        if mode is Mode.RETURN:
            return return_steps(None, self.settings, self.settings.speeds, home_m=self.body.home_m)
        if mode is Mode.LAND:
            return [Step(None, StepKind.DESCEND, self.settings.speeds)]
        return []

    @property
    def _asks_for_terrain(self) -> bool:
        return self.is_ardupilot and self.behaviour.terrain is TerrainSource.GROUND_STATION

    def _look_at_missions(self) -> None:
        """Take note of what a transfer changed."""
        if self.home_known:
            self.missions.set_home(self.body.home)
        for event in self.missions.events(self.powered_s):
            if event.mission_type is MissionType.MISSION:
                self.mission.changed()
