"""A multirotor as a point mass in a local east-north-up frame, the wind that acts on it, and its battery.

Rotor thrust and drag accelerate the mass: ``a = thrust + drag * (wind - v)``. The controller demands an acceleration towards
the wanted velocity and leans against the wind that it estimates with a delay. A steady wind therefore costs lean and a gust
costs position, as on real multirotors. The demand is jerk limited and never exceeds the airspeed limit: in a stronger wind
the vehicle drifts.

The wind is steady wind, seeded random gusts, and a change of the steady wind in flight. The gusts have the form of Dryden's
longitudinal spectrum (MIL-F-8785C, 3.7.1.2): white noise through ``1 / (1 + T s)`` in each axis, where ``T`` is the time an
eddy takes to pass. The battery's power follows the momentum theory of rotors, its voltage shows the remaining charge.

Scalars instead of arrays: a step on three numbers is ten times faster without numpy.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from uavcover.mock.behaviour import BODY
from uavcover.model.vehicle import GRAVITY_M_S2, PowerModel, Vehicle

Vector = tuple[float, float, float]
"""East, north, up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """Limits of the vehicle's dynamics."""

    max_speed_m_s: float = 20.0  # largest horizontal speed over ground
    max_climb_m_s: float = 6.0  # largest upward speed
    max_descent_m_s: float = 4.0  # largest downward speed
    max_acceleration_m_s2: float = 4.0  # largest horizontal acceleration of the controller
    max_vertical_acceleration_m_s2: float = 2.5  # largest vertical acceleration of the controller
    max_jerk_m_s3: float = 20.0  # how fast that acceleration changes, over ground and vertically
    max_airspeed_m_s: float = 18.0  # largest horizontal speed through the air that it asks for
    max_lean_deg: float = 35.0  # largest lean; the part that the wind takes is not available for acceleration
    # largest yaw rate; 60 is ATC_SLEW_YAW of ArduCopter and MPC_YAWRAUTO_MAX of PX4 from 1.15 on
    max_yaw_rate_deg_s: float = 60.0
    max_yaw_acceleration_deg_s2: float = 10_000.0  # how fast that rate changes; by default in one step
    velocity_gain_1_s: float = 3.0  # acceleration asked for per metre per second of speed error
    drag_1_s: float = 0.2  # acceleration per metre per second of air speed
    wind_estimate_s: float = 1.5  # time constant with which the controller learns the wind

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: must be greater than 0, not {value}")


class PointMass:
    """The state of the vehicle, moved in fixed steps.

    Attributes:
        position_m: east, north, up.
        velocity_m_s: over ground.
        acceleration_m_s2: of the last step.
        yaw_rad: clockwise from north.
        heading_for: the heading to turn to by the velocity that is wanted; None keeps the present one.
        roll_rad: right side down is positive.
        pitch_rad: nose up is positive.
    """

    def __init__(self, airframe: Airframe, *, step_s: float, position_m: Vector, yaw_rad: float = 0.0) -> None:
        self.airframe, self.step_s = airframe, step_s
        self.position_m, self.velocity_m_s, self.acceleration_m_s2 = position_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.yaw_rad, self.roll_rad, self.pitch_rad = yaw_rad, 0.0, 0.0
        self._yaw_rate_rad_s = 0.0
        self.heading_for: Callable[[Vector], float | None] = course_rad
        self._wind_estimate: Vector = (0.0, 0.0, 0.0)
        self._requested: Vector = (0.0, 0.0, 0.0)
        self._learning = 1.0 - math.exp(-step_s / airframe.wind_estimate_s)
        self._max_lean_m_s2 = GRAVITY_M_S2 * math.tan(math.radians(airframe.max_lean_deg))

    def rest(self, *, up_m: float) -> None:
        """Stand on the ground at height ``up_m``."""
        self.position_m = (self.position_m[0], self.position_m[1], up_m)
        self.velocity_m_s = self.acceleration_m_s2 = self._requested = (0.0, 0.0, 0.0)
        self.roll_rad = self.pitch_rad = self._yaw_rate_rad_s = 0.0

    def step(self, wanted_m_s: Vector, wind_m_s: Vector) -> None:
        """Fly for one step towards the velocity ``wanted_m_s`` in air that moves with ``wind_m_s``."""
        frame, dt = self.airframe, self.step_s
        vx, vy, vz = self.velocity_m_s
        gain, drag, learning = frame.velocity_gain_1_s, frame.drag_1_s, self._learning
        ex, ey, ez = self._wind_estimate
        ex += learning * (wind_m_s[0] - ex)
        ey += learning * (wind_m_s[1] - ey)
        ez += learning * (wind_m_s[2] - ez)
        self._wind_estimate = (ex, ey, ez)

        # The airspeed is limited: stronger wind carries the vehicle away.
        wx, wy = _within(wanted_m_s[0] - ex, wanted_m_s[1] - ey, frame.max_airspeed_m_s)
        ax, ay = _within(gain * (wx + ex - vx), gain * (wy + ey - vy), frame.max_acceleration_m_s2)
        az = gain * (wanted_m_s[2] - vz)
        az = max(-frame.max_vertical_acceleration_m_s2, min(az, frame.max_vertical_acceleration_m_s2))
        ax, ay, az = self._slewed(ax, ay, az)
        # Lean: the demanded acceleration less the drag expected in the estimated wind.
        tx, ty = _within(ax - drag * (ex - vx), ay - drag * (ey - vy), self._max_lean_m_s2)
        ax = tx + drag * (wind_m_s[0] - vx)
        ay = ty + drag * (wind_m_s[1] - vy)
        az += drag * (wind_m_s[2] - ez)

        nx, ny = _within(vx + ax * dt, vy + ay * dt, frame.max_speed_m_s)
        nz = max(-frame.max_descent_m_s, min(vz + az * dt, frame.max_climb_m_s))
        x, y, z = self.position_m
        self.position_m = (x + 0.5 * (vx + nx) * dt, y + 0.5 * (vy + ny) * dt, z + 0.5 * (vz + nz) * dt)
        self.velocity_m_s = (nx, ny, nz)
        self.acceleration_m_s2 = ((nx - vx) / dt, (ny - vy) / dt, (nz - vz) / dt)
        self._turn(wanted_m_s)
        self._lean(tx, ty)

    def fall(self, wind_m_s: Vector) -> None:
        """Fall for one step without any thrust, dragged along by the air."""
        drag, dt = self.airframe.drag_1_s, self.step_s
        (x, y, z), (vx, vy, vz) = self.position_m, self.velocity_m_s
        ax, ay = drag * (wind_m_s[0] - vx), drag * (wind_m_s[1] - vy)
        az = drag * (wind_m_s[2] - vz) - GRAVITY_M_S2
        self.acceleration_m_s2 = (ax, ay, az)
        self.velocity_m_s = (vx + ax * dt, vy + ay * dt, vz + az * dt)
        self.position_m = (x + vx * dt, y + vy * dt, z + vz * dt)

    @property
    def airspeed_m_s(self) -> float:
        """Horizontal speed through the air, as it estimates the wind."""
        return math.hypot(self.velocity_m_s[0] - self._wind_estimate[0], self.velocity_m_s[1] - self._wind_estimate[1])

    def _slewed(self, ax: float, ay: float, az: float) -> Vector:
        """The acceleration to demand now: towards the wanted one within the jerk limit."""
        most = self.airframe.max_jerk_m_s3 * self.step_s
        bx, by, bz = self._requested
        dx, dy = _within(ax - bx, ay - by, most)
        self._requested = (bx + dx, by + dy, bz + max(-most, min(az - bz, most)))
        return self._requested

    def _turn(self, wanted_m_s: Vector) -> None:
        """Yaw towards ``heading_for`` while there is a course, and come to rest there."""
        frame, dt, error = self.airframe, self.step_s, 0.0
        if math.hypot(wanted_m_s[0], wanted_m_s[1]) >= 0.5 and (heading := self.heading_for(wanted_m_s)) is not None:
            error = math.remainder(heading - self.yaw_rad, math.tau)
        acceleration = math.radians(frame.max_yaw_acceleration_deg_s2)
        most = math.radians(frame.max_yaw_rate_deg_s), math.sqrt(2.0 * acceleration * abs(error)), abs(error) / dt
        change = math.copysign(min(most), error) - self._yaw_rate_rad_s
        self._yaw_rate_rad_s += max(-acceleration * dt, min(change, acceleration * dt))
        self.yaw_rad = (self.yaw_rad + self._yaw_rate_rad_s * dt) % math.tau

    def _lean(self, thrust_east_m_s2: float, thrust_north_m_s2: float) -> None:
        sin, cos = math.sin(self.yaw_rad), math.cos(self.yaw_rad)
        forward = thrust_east_m_s2 * sin + thrust_north_m_s2 * cos
        right = thrust_east_m_s2 * cos - thrust_north_m_s2 * sin
        self.pitch_rad = -math.atan2(forward, GRAVITY_M_S2)
        self.roll_rad = math.atan2(right, GRAVITY_M_S2)


def course_rad(velocity_m_s: Vector) -> float | None:
    """The heading along a velocity."""
    return math.atan2(velocity_m_s[0], velocity_m_s[1])


def _within(x: float, y: float, most: float) -> tuple[float, float]:
    """The vector itself, or shortened to length ``most``."""
    size = math.hypot(x, y)
    if size <= most:
        return x, y
    return x * most / size, y * most / size


@dataclass(frozen=True, slots=True, kw_only=True)
class WindModel:
    """A steady horizontal wind with gusts on top."""

    speed_m_s: float = 0.0  # steady speed
    from_deg: float = 0.0  # where it comes from, clockwise from north
    gust_m_s: float = 0.0  # standard deviation of the gusts in each horizontal direction; half of it vertically
    gust_time_s: float = 3.0  # correlation time of the gusts

    def __post_init__(self) -> None:
        if not (self.speed_m_s >= 0.0 and self.gust_m_s >= 0.0 and self.gust_time_s > 0.0):
            raise ValueError("wind: speed_m_s and gust_m_s must not be negative, and gust_time_s must be above 0")

    @property
    def steady_m_s(self) -> Vector:
        """Velocity of the air, east, north, up."""
        angle = math.radians(self.from_deg)
        return (-self.speed_m_s * math.sin(angle), -self.speed_m_s * math.cos(angle), 0.0)


class WindField:
    """The wind over time: an Ornstein-Uhlenbeck process around the steady wind, in exact steps of ``step_s``."""

    _BLOCK = 512

    def __init__(self, wind: WindModel, *, step_s: float, rng: np.random.Generator) -> None:
        self._steady = wind.steady_m_s
        self._coming: Vector | None = None
        self._coming_fraction = 1.0 - math.exp(-step_s / BODY.comes_up_s)
        self._rng = rng
        self._keep = math.exp(-step_s / wind.gust_time_s)
        scale = wind.gust_m_s * math.sqrt(1.0 - self._keep**2)
        self._scales = (scale, scale, 0.5 * scale)
        self._gust: Vector = (0.0, 0.0, 0.0)
        self._noise: list[list[float]] = []
        self.velocity_m_s: Vector = self._steady

    def change(self, wind: WindModel) -> None:
        """Change gradually to another steady wind; the gusts stay."""
        self._coming = wind.steady_m_s

    def step(self) -> Vector:
        """Wind velocity after one more step."""
        if self._coming is not None:
            self._come_up(self._coming)
        if self._scales[0] == 0.0:
            return self.velocity_m_s
        if not self._noise:
            self._noise = self._rng.standard_normal((self._BLOCK, 3)).tolist()
        noise = self._noise.pop()
        east, north, up = self._gust
        keep, scales, steady = self._keep, self._scales, self._steady
        self._gust = (
            keep * east + scales[0] * noise[0],
            keep * north + scales[1] * noise[1],
            keep * up + scales[2] * noise[2],
        )
        self.velocity_m_s = (steady[0] + self._gust[0], steady[1] + self._gust[1], steady[2] + self._gust[2])
        return self.velocity_m_s

    def _come_up(self, coming: Vector) -> None:
        fraction, (east, north, up) = self._coming_fraction, self._steady
        east, north, up = (old + fraction * (new - old) for old, new in zip((east, north, up), coming, strict=True))
        if math.dist((east, north, up), coming) < BODY.same_m_s:
            (east, north, up), self._coming = coming, None
        self._steady = self.velocity_m_s = (east, north, up)


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryData:
    """A battery and the multirotor that it carries."""

    # hovering time on a full charge; a day by default, so that no flight ends unexpectedly
    endurance_s: float = 86_400.0
    hover_w: float = 300.0  # hovering power
    power: PowerModel = field(default_factory=PowerModel)  # power of flight, as a multiple of that

    def __post_init__(self) -> None:
        for name in ("endurance_s", "hover_w"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: must be greater than 0, not {getattr(self, name)}")

    @classmethod
    def for_vehicle(cls, vehicle: Vehicle) -> Self:
        """The battery of the vehicle that a scenario plans with."""
        unloaded = cls(power=vehicle.power)
        if vehicle.hover_s is None:
            return unloaded
        return cls(
            endurance_s=vehicle.hover_s, hover_w=unloaded.hover_w * vehicle.power.hover_factor, power=vehicle.power
        )


def power_fraction(airspeed_m_s: float, climb_m_s: float, power: PowerModel) -> float:
    """Power of level or climbing flight as a multiple of the hovering power.

    Induced power by Glauert's momentum theory of a rotor in forward flight (Leishman, Principles of Helicopter
    Aerodynamics, 2.14), the blades' drag (Zeng et al. 2019, Eq. 12), drag and climb on top; all per thrust, with the rotor's
    losses as in hovering. The planner has its own (``kernels/energy.py``).
    """
    hover, half = power.induced_m_s, 0.5 * airspeed_m_s**2
    induced_m_s = math.sqrt(math.sqrt(half**2 + hover**4) - half)  # v_i^4 + V^2 v_i^2 = v_h^4
    drag_m_s2 = power.rotor_drag_1_s * airspeed_m_s + power.body_drag_1_m * airspeed_m_s**2
    upwards_m_s = climb_m_s if climb_m_s > 0.0 else power.descent_gain * climb_m_s
    thrust = (induced_m_s + drag_m_s2 * airspeed_m_s / GRAVITY_M_S2 + upwards_m_s) / hover
    blades = 1.0 + 3.0 * (airspeed_m_s / power.tip_speed_m_s) ** 2
    rotors = max(0.0, power.profile_share * blades + (1.0 - power.profile_share) * thrust)
    return rotors * (1.0 - power.idle_share) + power.idle_share


class Battery:
    """Charge over time.

    Attributes:
        remaining: state of charge; 1 is full.
        power_w: present power.
    """

    def __init__(self, data: BatteryData, *, remaining: float = 1.0) -> None:
        if not 0.0 < remaining <= 1.0:
            raise ValueError(f"remaining: must be above 0 and at most 1, not {remaining}")
        self.data = data
        self.remaining = remaining
        self.capacity_wh = data.hover_w * data.endurance_s / 3600.0
        self.power_w = data.hover_w * data.power.idle_share

    @property
    def capacity_mah(self) -> float:
        """Capacity at nominal voltage."""
        return 1000.0 * self.capacity_wh / (BODY.battery_cells * 0.5 * (BODY.full_v + BODY.empty_v))

    @property
    def voltage_v(self) -> float:
        """Terminal voltage under the present load."""
        open_v = BODY.empty_v + (BODY.full_v - BODY.empty_v) * self.remaining
        return BODY.battery_cells * (open_v - BODY.sag_v * self.power_w / self.data.hover_w)

    @property
    def current_a(self) -> float:
        """Present current."""
        return self.power_w / self.voltage_v

    @property
    def time_left_s(self) -> float:
        """Time until it is empty at the present power; infinite if none is drawn."""
        if self.power_w == 0.0:
            return math.inf
        return self.remaining * self.capacity_wh * 3600.0 / self.power_w

    def fly(self, seconds: float, *, airspeed_m_s: float, climb_m_s: float) -> None:
        """Draw the power of flight."""
        self._draw(seconds, power_fraction(airspeed_m_s, climb_m_s, self.data.power))

    def idle(self, seconds: float) -> None:
        """Draw the power of the electronics."""
        self._draw(seconds, self.data.power.idle_share)

    def drop_to(self, remaining: float) -> None:
        """Drop to this charge at once, as a battery with a bad cell; a lower charge stays."""
        self.remaining = min(self.remaining, remaining)

    def _draw(self, seconds: float, fraction: float) -> None:
        self.power_w = self.data.hover_w * fraction
        self.remaining = max(0.0, self.remaining - fraction * seconds / self.data.endurance_s)
