"""The itinerary of the mock vehicle: simple steps (climb, fly to, descend, wait) made from mission items or flight modes."""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol, Self, cast

from mission_io.autopilots.mission_lists import command_read_back
from mission_io.model.items import Command, MissionItem, SpeedType
from uavcover.mock.behaviour import FLIGHT, Settings, Speeds
from uavcover.mock.dynamics import Airframe, Vector
from uavcover.mock.guidance import Leg, Legs, Stop, legs_of, passing_speeds, velocity_along, velocity_to
from uavcover.model.vehicle import AutopilotMotion


class Mover(Protocol):
    """A moving body: its believed position, its speed, its airframe."""

    @property
    def airframe(self) -> Airframe:
        """Its airframe."""

    @property
    def position_m(self) -> Vector:
        """East, north, up."""

    @property
    def velocity_m_s(self) -> Vector:
        """Over ground."""


class StepKind(Enum):
    """One simple thing to do."""

    CLIMB = "straight up to a height"
    GO = "along a straight line to a point"
    LEVEL = "at the present height to above a point"
    DESCEND = "straight down to the ground"
    WAIT = "stay for a while"


@dataclass(frozen=True, slots=True)
class CameraOrder:
    """Order of one mission command to the camera."""

    distance_m: float | None  # between photos from now on, 0 stops them; None: as before
    now: bool  # whether to take a photo at once

    @classmethod
    def of(cls, item: MissionItem) -> Self | None:
        """The order of a mission item; None for other commands, or for a series by time."""
        match item.command:
            case Command.DO_SET_CAM_TRIGG_DIST if item.params[0] >= 0.0:
                return cls(item.params[0], item.params[2] > 0.0)
            case Command.DO_DIGICAM_CONTROL if command_read_back(item).lat_deg == 1.0:  # its fifth parameter: shoot
                return cls(None, True)
            case Command.IMAGE_START_CAPTURE if item.params[2] == 1.0:
                return cls(None, True)
        return None


@dataclass(frozen=True, slots=True)
class Step:
    """One step."""

    seq: int | None  # its mission item; None for a step of a mode
    kind: StepKind  # what to do
    speeds: Speeds  # how fast
    point_m: Vector | None = None  # where to; None for here
    radius_m: float = FLIGHT.settled_m  # acceptance radius
    wait_s: float = 0.0  # how long to wait
    camera: tuple[CameraOrder, ...] = ()  # camera actions after the step


def mission_steps(
    items: Sequence[MissionItem],  # as they are on the wire
    first_seq: int,  # where to begin
    *,
    position: Callable[[MissionItem], Vector],  # position of an item in the vehicle's frame, east, north, up in metres
    settings: Settings,  # the vehicle's
    speeds: Speeds,  # as they are now; the mission's speed changes apply from where they stand
    # the steps of a return that an item asks for, by its number, where the items before it end, and the speeds
    return_steps: Callable[[int, Vector | None, Speeds], list[Step]],
) -> list[Step]:
    """The steps of a mission from item ``first_seq`` on, starting with ``speeds``."""
    steps: list[Step] = []
    for seq in range(first_seq, len(items)):
        item = items[seq]
        match item.command:
            case Command.NAV_TAKEOFF:
                steps.append(Step(seq, StepKind.CLIMB, speeds, position(item), 1.0))
            case Command.NAV_WAYPOINT | Command.NAV_LOITER_TIME:
                own = item.params[1] if item.command == Command.NAV_WAYPOINT else 0.0
                radius = own if math.isfinite(own) and own > 0.0 else settings.acceptance_radius_m
                steps.append(Step(seq, StepKind.GO, speeds, position(item), radius))
                if item.params[0] > 0.0:
                    steps.append(Step(seq, StepKind.WAIT, speeds, wait_s=item.params[0]))
            case Command.NAV_LOITER_UNLIM:
                steps.append(Step(seq, StepKind.GO, speeds, position(item), settings.acceptance_radius_m))
                steps.append(Step(seq, StepKind.WAIT, speeds, wait_s=math.inf))
            case Command.NAV_LOITER_TURNS:
                steps.extend(_turns(seq, item, position(item), settings, speeds))
            case Command.NAV_LAND:
                somewhere = item.has_position and (item.lat_deg, item.lon_deg) != (0.0, 0.0)
                steps.append(Step(seq, StepKind.LEVEL, speeds, position(item) if somewhere else None))
                steps.append(Step(seq, StepKind.DESCEND, speeds))
            case Command.NAV_RETURN_TO_LAUNCH:
                points = [step.point_m for step in steps if step.point_m is not None]
                steps.extend(return_steps(seq, points[-1] if points else None, speeds))
            case Command.NAV_DELAY:
                steps.append(Step(seq, StepKind.WAIT, speeds, wait_s=max(0.0, item.params[0])))
            case Command.DO_CHANGE_SPEED:
                speeds = changed_speeds(speeds, item.params)
        order = CameraOrder.of(item)
        if order is not None and steps:
            steps[-1] = replace(steps[-1], camera=(*steps[-1].camera, order))
    return steps


def _turns(seq: int, item: MissionItem, center: Vector, settings: Settings, speeds: Speeds) -> list[Step]:
    """Circles around a position, begun in the north: clockwise, or the other way with a negative radius."""
    turns, radius_m = item.params[0], item.params[2]
    if not (math.isfinite(radius_m) and radius_m != 0.0):
        radius_m = FLIGHT.circle_radius_m
    sense, radius_m = math.copysign(1.0, radius_m), abs(radius_m)
    corners = max(12, math.ceil(math.tau * radius_m / FLIGHT.circle_leg_m))
    accept_m = min(settings.acceptance_radius_m, 0.25 * radius_m)
    steps: list[Step] = []
    for n in range(round(max(0.0, turns) * corners) + 1):
        angle = sense * math.tau * n / corners
        point = (center[0] + radius_m * math.sin(angle), center[1] + radius_m * math.cos(angle), center[2])
        steps.append(Step(seq, StepKind.GO, speeds, point, accept_m))
    return steps


def changed_speeds(speeds: Speeds, params: Sequence[float]) -> Speeds:
    """The speeds after a DO_CHANGE_SPEED; a speed that is not above zero leaves them as they are."""
    kind, speed = params[0], params[1]
    if not speed > 0.0:
        return speeds
    if kind == SpeedType.CLIMB.value:
        return Speeds(speeds.cruise_m_s, speed, speeds.descent_m_s)
    if kind == SpeedType.DESCENT.value:
        return Speeds(speeds.cruise_m_s, speeds.climb_m_s, speed)
    return Speeds(speed, speeds.climb_m_s, speeds.descent_m_s)


class Itinerary:
    """Steps that are carried out in order.

    Attributes:
        completed: the items whose last step was finished since they were last read.
        camera: the camera actions since they were last read.
        stuck: whether it stays at its step after reaching it.
    """

    def __init__(
        self,
        steps: Iterable[Step],
        body: Mover,
        now: float,
        *,
        land_m_s: float = 0.7,
        motion: AutopilotMotion | None = None,
    ) -> None:
        self._steps, self._index = tuple(steps), 0
        self._body, self._airframe, self._land_m_s = body, body.airframe, land_m_s
        self._motion, self._legs, self._first_leg, self._led_until = motion, cast(Legs | None, None), 0, 0
        self.completed: list[int] = []
        self.camera: list[CameraOrder] = []
        self.stuck = False
        self._leg_start: Vector = body.position_m
        self._target: Vector = halting_point(body)
        self._passing: list[float] = []
        self._until = 0.0
        self._begin(now)

    @property
    def step(self) -> Step | None:
        """The current step; None when all are done and the vehicle stays in place."""
        return self._steps[self._index] if self._index < len(self._steps) else None

    @property
    def landing(self) -> bool:
        """Whether the vehicle is coming straight down to land."""
        return self.step is not None and self.step.kind is StepKind.DESCEND

    def come_loose(self) -> None:
        """Continue the present step from the vehicle's position: its legs stood still while it was stuck."""
        self.stuck = False
        if self._legs is not None and (step := self.step) is not None:
            self._led_until = 0
            self._lead(step, self._body.position_m)

    def wanted_velocity(self, now: float, ground_up_m: float) -> Vector:
        """The velocity to want now, moving on to the next step where one is done; east, north, up in m/s."""
        while (step := self.step) is not None and self._done(step, now):
            self._next(now)
        position = self._body.position_m
        if step is None or step.kind is StepKind.WAIT:
            return velocity_to(position, self._target, speeds=self._hold_speeds(), airframe=self._airframe)
        if step.kind is StepKind.DESCEND:
            down = self._landing_speed(position[2] - ground_up_m, step.speeds.descent_m_s)
            at = (self._target[0], self._target[1], position[2])
            east, north, _ = velocity_to(position, at, speeds=step.speeds, airframe=self._airframe)
            return (east, north, -down)
        if self._legs is not None and not self.stuck:
            return self._legs.wanted_velocity(position)
        passing = self._passing[0] if self._passing else 0.0
        stop = Stop(self._target, step.radius_m, passing == 0.0)
        return velocity_along(
            position, self._leg_start, stop, passing_m_s=passing, speeds=step.speeds, airframe=self._airframe
        )

    def _landing_speed(self, above_m: float, descent_m_s: float) -> float:
        """Downwards at a height above the ground: changed over a band of heights, where the autopilot does so."""
        motion = self._motion
        if motion is None:
            return descent_m_s if above_m > FLIGHT.slow_landing_below_m else self._land_m_s
        slow = min(self._land_m_s, descent_m_s)
        fraction = max(0.0, min(1.0, (above_m - motion.land_slow_m) / motion.land_band_m))
        return slow + fraction * (descent_m_s - slow)

    def _hold_speeds(self) -> Speeds:
        frame = self._airframe
        return Speeds(frame.max_speed_m_s, frame.max_climb_m_s, frame.max_descent_m_s)

    def _done(self, step: Step, now: float) -> bool:
        if self.stuck:
            return False
        if step.kind is StepKind.WAIT:
            return now >= self._until
        if self._legs is not None:
            return self._first_leg + self._legs.passed > self._index
        if step.kind is StepKind.DESCEND:
            return False  # the ground ends it
        if step.kind is StepKind.CLIMB:
            return self._body.position_m[2] >= self._target[2] - step.radius_m
        return math.dist(self._body.position_m, self._target) <= step.radius_m

    def _next(self, now: float) -> None:
        done = self._steps[self._index]
        self._index += 1
        follower = self.step
        self.camera.extend(done.camera)
        if done.seq is not None and (follower is None or follower.seq != done.seq):
            self.completed.append(done.seq)
        self._begin(now)

    def _begin(self, now: float) -> None:
        """Take up the present step: a leg starts where the last one was meant to end."""
        step = self.step
        if step is None:
            return
        here = self._target if self._index else self._body.position_m
        self._leg_start = here
        if step.kind is StepKind.WAIT:
            self._until = now + step.wait_s
        elif step.kind is StepKind.CLIMB and step.point_m is not None:
            self._target = (here[0], here[1], max(step.point_m[2], here[2]))
        elif step.kind is StepKind.LEVEL:
            east, north, _ = step.point_m if step.point_m is not None else here
            self._target = (east, north, here[2])
        elif step.kind is StepKind.GO and step.point_m is not None:
            self._target = step.point_m
        if step.kind is StepKind.GO:
            self._passing = self._passing[1:] or self._chain(here)
        else:
            self._passing = []
        self._lead(step, here)

    def _lead(self, step: Step, here: Vector) -> None:
        """Lead the vehicle along the legs that begin now; legs between waypoints blend into each other."""
        if self._motion is None or step.kind not in (StepKind.CLIMB, StepKind.GO):
            self._legs = None
            return
        if step.kind is StepKind.GO:
            if self._first_leg < self._index < self._led_until:
                return
            legs = [
                Leg(one.point_m, one.speeds)
                for one in itertools.takewhile(lambda one: one.kind is StepKind.GO, self._steps[self._index :])
                if one.point_m is not None
            ]
        else:
            legs = [Leg(self._target, step.speeds)]
        self._legs, self._first_leg = legs_of(self._motion, here, legs), self._index
        self._led_until = self._index + len(legs)

    def _chain(self, here: Vector) -> list[float]:
        """Passing speeds of the waypoints that follow each other without a wait."""
        stops: list[Stop] = []
        for step in self._steps[self._index :]:
            if step.kind is not StepKind.GO or step.point_m is None:
                break
            stops.append(Stop(step.point_m, step.radius_m, must_halt=False))
        return passing_speeds(here, stops, self._airframe)


def halting_point(body: Mover) -> Vector:
    """Position of rest of a vehicle that starts to brake now."""
    frame = body.airframe
    (x, y, z), (vx, vy, vz) = body.position_m, body.velocity_m_s
    level = math.hypot(vx, vy) / (1.2 * frame.max_acceleration_m_s2)
    upright = abs(vz) / (1.2 * frame.max_vertical_acceleration_m_s2)
    return (x + vx * level, y + vy * level, z + vz * upright)
