"""The state of the mock vehicle: its true state, and its pending messages.

Everything else in this package reads and changes this state: ``telemetry`` reports it, ``reactions`` and ``vehicle`` change it
through ``flight_control``, and ``vehicle`` advances the time.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mission_io.autopilots.autopilot import Autopilot, Mode, autopilot_for, custom_mode, has_mode, mode_from_custom
from mission_io.model.enums import AutopilotId, MissionState, VehicleClass
from mission_io.model.items import GeoPoint, MissionItem, MissionType
from mission_io.protocol.ftp import FtpServer
from mission_io.wire import messages as m
from mission_io.wire.messages import Address
from uavcover.mock.behaviour import BODY, FLIGHT, Behaviour, GroundSource, Parameters, Settings, TransferClock, quick
from uavcover.mock.body import GpsError, Ground, MockBody, Trail
from uavcover.mock.dynamics import Airframe, BatteryData, Vector, WindModel, course_rad
from uavcover.mock.faults import Fault, FaultKind, FaultSchedule
from uavcover.mock.itinerary import CameraOrder, Step
from uavcover.mock.mission_store import FenceWatch, ListFiles, MissionStore, TerrainFeed
from uavcover.model.vehicle import MOTIONS

# The camera of the mock vehicle: triggered by distance or by commands; it reports every photo.
#
# As ArduPilot and PX4 do it, the next photo by distance is due where the straight line over ground from the last one reaches the
# distance: the rule of :func:`uavcover.kernels.coverage.photo_positions`, one step of flight after the other.


class MockCamera:
    """Takes photos and makes the messages that report them.

    Args:
        body: what carries it; photos are placed where it believes to be.
        ardupilot: whether it reports as ArduPilot does (CAMERA_FEEDBACK); otherwise as PX4 (CAMERA_IMAGE_CAPTURED).

    Attributes:
        taken: how many photos it has taken since it was switched on.
        every: number of triggers for one photo.
        at_most: largest number of photos.
        reports: whether it reports its photos.
    """

    def __init__(self, body: MockBody, *, ardupilot: bool) -> None:
        self._body, self._ardupilot = body, ardupilot
        self.every, self.at_most, self.reports = 1, math.inf, True
        self.reset()

    def reset(self) -> None:
        """Stop, and count from 0, as after a reboot."""
        self.taken, self._triggered, self._distance_m = 0, 0, 0.0
        self._last_m: Vector | None = None

    def obey(self, order: CameraOrder, now: float) -> list[m.Message]:
        """Carry out the mission's camera orders; returns their reports.

        PX4 forgets the last photo with every new distance, ArduPilot only when it stops.
        """
        if order.distance_m is not None:
            self._distance_m = order.distance_m
            self._last_m = self._last_m if self._ardupilot and order.distance_m > 0.0 else None
        return self._shoot(now) if order.now else []

    def step(self, now: float) -> list[m.Message]:
        """Take a due photo by distance; PX4 takes the first one as soon as it is switched on."""
        if self._distance_m == 0.0:
            return []
        here = self._body.believed.position_m
        if self._last_m is None:
            if not self._ardupilot:
                return self._shoot(now)
            self._last_m = here
        return self._shoot(now) if math.dist(here[:2], self._last_m[:2]) >= self._distance_m else []

    def _shoot(self, now: float) -> list[m.Message]:
        self._triggered, self._last_m = self._triggered + 1, self._body.believed.position_m
        if (self._triggered - 1) % self.every or self.taken >= self.at_most:
            return []
        self.taken += 1
        return [self._report(now, self._last_m)] if self.reports else []

    def _report(self, now: float, position_m: Vector) -> m.Message:
        body, point = self._body, self._body.point
        here = body.geodetic_of(position_m)
        above_home_m = here.alt_amsl_m - body.home.alt_amsl_m
        roll, pitch, yaw = point.roll_rad, point.pitch_rad, point.yaw_rad
        if self._ardupilot:
            return m.CameraFeedback(
                now, self.taken, here.lat_deg, here.lon_deg, here.alt_amsl_m, above_home_m,
                math.degrees(roll), math.degrees(pitch), math.degrees(yaw) % 360.0, self.taken,
            )  # fmt: skip
        return m.CameraImageCaptured(
            now,
            here.lat_deg,
            here.lon_deg,
            here.alt_amsl_m,
            above_home_m,
            _quaternion(roll, pitch, yaw),
            self.taken - 1,
            1,
        )


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """The rotation from body to north-east-down (w, x, y, z), yaw-pitch-roll order."""
    cr, sr, cp, sp = math.cos(0.5 * roll), math.sin(0.5 * roll), math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class TruthSample:
    """True and believed position when a position was reported."""

    time_s: float  # vehicle time since it was switched on, as in the reported position
    lat_deg: float  # true latitude
    lon_deg: float  # true longitude
    alt_amsl_m: float  # true height above mean sea level
    east_error_m: float  # believed position less the true one
    north_error_m: float  # the same
    up_error_m: float  # the same
    roll_deg: float  # right side down is positive
    pitch_deg: float  # nose up is positive
    yaw_deg: float  # clockwise from north


OnTruth = Callable[[TruthSample], None]
"""Called with each sample."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MockConfig:
    """Configuration of a simulated vehicle."""

    settings: Settings = field(default_factory=Settings)  # speeds and heights unless a mission overrides them
    airframe: Airframe = field(default_factory=Airframe)  # limits of its dynamics
    wind: WindModel = field(default_factory=WindModel)  # the wind that it flies in
    gps: GpsError = field(default_factory=GpsError)  # error of its positions
    battery: BatteryData = field(default_factory=BatteryData)  # its battery
    behaviour: Behaviour = field(default_factory=quick)  # its start-up and its unrequested messages
    faults: Sequence[Fault] = ()  # what goes wrong
    speed: float = 1.0  # vehicle seconds per second on the link's clock
    system_id: int = 1  # its MAVLink system id; its component id is 1
    # the MAV_TYPE that it reports, with the flight mode numbers of such a vehicle; it always flies as a multirotor
    vehicle_type: int = VehicleClass.QUADROTOR


class MockState:
    """State of one mock vehicle.

    Attributes:
        body: the flying body, with its battery, its itinerary and its believed position.
        camera: takes photos where the mission asks for them.
        parameters: values of the autopilot's parameters.
        speeds: speeds to fly at now.
        faults: what has gone wrong and what will; ``faults.add`` takes more.
        missions: mission, fence and rally points that it holds.
        mode_number: the requested number of its mode, where several numbers mean the same; None is the usual one.
        trail: of ArduCopter's SmartRTL.
        mission_state: progress of the mission.
        current_seq: wire number of the mission item that it flies to.
        streams: which messages are due when.
        files: what it keeps for MAVLink FTP, in memory.
        terrain: heights of the ground that ground stations have sent; None when it does not ask for them.
        took_off_at_s: ``powered_s`` when it first left the ground.
        disarm_at_s: ``time_s`` at which it disarms itself on the ground.
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
        config = MockConfig() if config is None else config
        rng = np.random.default_rng(0) if rng is None else rng
        self.on_truth = on_truth
        as_given = config.vehicle_type == VehicleClass.QUADROTOR
        self.autopilot = autopilot if as_given else autopilot_for(autopilot.mav_autopilot, config.vehicle_type)
        self.speed, self.vehicle_type, self.behaviour = config.speed, config.vehicle_type, config.behaviour
        self.address = Address(config.system_id, 1)
        self.parameters = Parameters(autopilot.mav_autopilot, config.settings)
        self.speeds = self.settings.speeds
        airframe, motion = config.airframe, MOTIONS["ardupilot" if self.is_ardupilot else "px4"]
        if motion.yaw_acceleration_deg_s2 is not None:
            yaw_deg_s2 = min(airframe.max_yaw_acceleration_deg_s2, motion.yaw_acceleration_deg_s2)
            airframe = replace(airframe, max_yaw_acceleration_deg_s2=yaw_deg_s2)
        self.body = MockBody(
            home,
            airframe=airframe,
            wind=config.wind,
            gps=config.gps,
            battery=config.battery,
            rng=rng,
            ground=ground,
        )
        self.body.point.heading_for = self._heading
        self.camera = MockCamera(self.body, ardupilot=self.is_ardupilot)
        self.faults = FaultSchedule(config.faults, link_speed=config.speed)
        self.mode, self.armed = Mode.MANUAL, False
        self.mode_number: int | None = None
        self.trail = Trail()
        self.mission_state, self.current_seq = MissionState.NOT_STARTED, 0
        self.missions = MissionStore(
            autopilot,
            local=self.address,
            seconds_per_s=1.0 / self.speed if self.behaviour.transfer_clock is TransferClock.LINK else 1.0,
            stale_read_back=self.behaviour.stale_read_back,
            rng=rng,
        )
        self.fence = FenceWatch(self.missions, self.body, self.parameters, ardupilot=self.is_ardupilot)
        asks_for_terrain = self.is_ardupilot and self.behaviour.terrain is GroundSource.GROUND_STATION
        self.files = FtpServer(made=ListFiles(self.missions, self.autopilot) if self.autopilot.lists_as_files else None)
        self.terrain = TerrainFeed() if asks_for_terrain else None
        self.streams = Streams(self.behaviour, ardupilot=self.is_ardupilot)
        self.took_off_at_s: float | None = None
        self.disarm_at_s = 0.0
        self.steps_done = self.boot_step = self.off_until_step = 0
        self._texts_in_pieces = 0
        self._waiting: list[m.Message] = []

    @property
    def powered_s(self) -> float:
        """Vehicle time since it was first switched on, reboots included."""
        return self.steps_done * BODY.step_s

    @property
    def time_s(self) -> float:
        """Vehicle time since it was last switched on."""
        return (self.steps_done - self.boot_step) * BODY.step_s

    @property
    def settings(self) -> Settings:
        """Speeds and heights unless a mission overrides them."""
        return self.parameters.settings

    @property
    def custom_mode(self) -> int:
        """The number of its mode in heartbeats."""
        if self.mode_number is not None and mode_from_custom(self.autopilot, self.mode_number) is self.mode:
            return self.mode_number
        return custom_mode(self.autopilot, self.mode) if has_mode(self.autopilot, self.mode) else 0

    @property
    def cut_off(self) -> bool:
        """Whether no message gets through in either direction."""
        return self.steps_done < self.off_until_step or self.faults.is_going_on(FaultKind.LINK_OUTAGE)

    @property
    def flying(self) -> bool:
        """Whether its motors keep it in the air."""
        return self.armed and not self.body.on_ground

    @property
    def is_ardupilot(self) -> bool:
        """Whether it behaves as ArduPilot; otherwise as PX4."""
        return self.autopilot.mav_autopilot == AutopilotId.ARDUPILOT

    @property
    def has_fix(self) -> bool:
        """Whether the satellite receiver has a fix."""
        return self.time_s >= self.behaviour.fix_s and not self.body.believed.lost

    @property
    def checks_pass(self) -> bool:
        """Whether home is known and the pre-arm checks pass; arming may still fail, see ``ready``."""
        refused = self.faults.is_going_on(FaultKind.ARMING_REFUSED)
        return self.time_s >= self.behaviour.checks_pass_s and self.has_fix and not refused

    @property
    def home_known(self) -> bool:
        """Whether it knows its home."""
        return self.time_s >= self.behaviour.checks_pass_s

    @property
    def ready(self) -> bool:
        """Whether it has a position, which arming requires."""
        return self.time_s >= self.behaviour.ready_s and not self.body.believed.lost

    @property
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The mission that it holds, in wire order."""
        return self.missions.items(MissionType.MISSION)

    def ignores(self, system_id: int) -> bool:
        """Whether it hears nothing of a system: ArduPilot may listen to one ground station alone."""
        own = (self.address.system_id, self.parameters["MAV_GCS_SYSID"]) if self.is_ardupilot else (system_id,)
        return system_id not in own and bool(int(self.parameters["MAV_OPTIONS"]) & 1)

    def _heading(self, velocity_m_s: Vector) -> float | None:
        """The heading that its yaw parameter requests, radians; None is to turn no more."""
        mode = self.parameters["WP_YAW_BEHAVIOR" if self.is_ardupilot else "MPC_YAW_MODE"]
        if mode == (0.0 if self.is_ardupilot else 5.0):
            return None
        if self.is_ardupilot or mode not in (1.0, 2.0):
            return course_rad(velocity_m_s)
        (x, y, _), (home_x, home_y, _) = self.body.point.position_m, self.body.home_m
        sign = 1.0 if mode == 1.0 else -1.0
        return math.atan2(sign * (home_x - x), sign * (home_y - y))

    def send(self, message: m.Message) -> None:
        """Queue a message, unless a fault prevents its reception."""
        silenced = isinstance(message, m.Heartbeat) and self.faults.is_going_on(FaultKind.HEARTBEAT_LOSS)
        if not (silenced or self.cut_off):
            self._waiting.append(message)

    def send_all(self, messages: Iterable[m.Message]) -> None:
        """Queue several messages."""
        for message in messages:
            self.send(message)

    def take_queued(self) -> list[m.Message]:
        """Return the queued messages and empty the queue."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def say(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT, in pieces where it is long."""
        if len(text) <= m.TEXT_LETTERS:
            self.send(m.StatusText(severity, text))
            return
        self._texts_in_pieces += 1
        for chunk, begin in enumerate(range(0, len(text) + 1, m.TEXT_LETTERS)):
            self.send(m.StatusText(severity, text[begin : begin + m.TEXT_LETTERS], self._texts_in_pieces, chunk))

    def send_status_text(self, severity: int, ardupilot: str | None, px4: str | None) -> None:
        """Send the text of the autopilot that it imitates; nothing where that has none."""
        text = ardupilot if self.is_ardupilot else px4
        if text is not None:
            self.say(severity, text)

    def set_interval(self, kind: type[m.Message], interval_s: float | None) -> None:
        """Send a kind of message every ``interval_s`` seconds; 0 is its default, None is never."""
        default_s = self.behaviour.streams.value.get(kind)
        self.streams.set_interval(kind, default_s if interval_s == 0.0 else interval_s, self.time_s)

    def follow(self, steps: list[Step]) -> None:
        """Replace the itinerary; an empty one is to stay here."""
        self.body.follow(steps, self.time_s, land_m_s=self.settings.land_m_s, motion=self.settings.motion)

    def stay_armed(self) -> None:
        """Restart the time after which it disarms itself on the ground."""
        self.disarm_at_s = self.time_s + FLIGHT.disarm_when_idle_s * self.speed

    def position(self, item: MissionItem) -> Vector:
        """Position of a mission item in the vehicle's frame, with the ground as the vehicle knows it."""
        ground = self.body.ground_alt_amsl_m
        return self.body.position(item, ground if self.terrain is None else self.terrain.known_or(ground))


class Streams:
    """Which messages are due when, in vehicle time.

    Args:
        behaviour: what the vehicle sends unasked.
        ardupilot: whether it is ArduPilot; PX4 has no EKF_STATUS_REPORT.

    Attributes:
        next_due_s: when the next message is due; infinite when none is.
    """

    def __init__(self, behaviour: Behaviour, *, ardupilot: bool) -> None:
        self._behaviour, self._ardupilot = behaviour, ardupilot
        self.reset()

    def reset(self) -> None:
        """Return to the default intervals, as after a reboot."""
        self._interval_s = dict(self._behaviour.streams.value)
        if not self._ardupilot:
            self._interval_s.pop(m.EkfStatusReport, None)
        self._due_s = dict(self._interval_s)
        self.next_due_s = min(self._due_s.values())

    def set_interval(self, kind: type[m.Message], interval_s: float | None, now: float) -> None:
        """Send a kind of message every ``interval_s`` seconds; None is never."""
        self._due_s.pop(kind, None)
        if interval_s is not None:
            self._interval_s[kind] = interval_s
            self._due_s[kind] = now + interval_s
        self.next_due_s = min(self._due_s.values(), default=math.inf)

    def due(self, now: float) -> Iterator[type[m.Message]]:
        """The kinds that are due, each once."""
        for kind, due_s in self._due_s.items():
            if due_s <= now + FLIGHT.tolerance_s:
                self._due_s[kind] = max(due_s + self._interval_s[kind], now)
                yield kind
        self.next_due_s = min(self._due_s.values(), default=math.inf)
