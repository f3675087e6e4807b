"""The body of the mock vehicle: its true and its believed position, its itinerary, and its trail for SmartRTL.

The believed position is the true one with a slowly wandering error, and a drift while there is no fix. The trail is the flown
path, simplified and with its loops cut out, as libraries/AP_SmartRTL and mode_smart_rtl.cpp of ArduCopter 4.7 make it, where
they decide the path; the prediction in ``uavcover/missions/failsafe_path.py`` shares no code with it.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mission_io.model.enums import LandedState
from mission_io.model.items import Command, Frame, GeoPoint, MissionItem
from uavcover.mock.behaviour import BODY, FLIGHT
from uavcover.mock.dynamics import Airframe, Battery, BatteryData, PointMass, Vector, WindField, WindModel
from uavcover.mock.itinerary import Itinerary, Step
from uavcover.model.vehicle import AutopilotMotion
from uavcover.terrain.frames import LocalFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsError:
    """Position error of the satellite receiver."""

    horizontal_m: float = 0.0  # standard deviation of the error, east and north each
    vertical_m: float = 0.0  # standard deviation of the error in height
    time_s: float = 30.0  # correlation time of both: the error wanders, it does not jump
    latency_s: float = 0.0  # age of a position when the receiver reports it

    def __post_init__(self) -> None:
        for name in ("horizontal_m", "vertical_m", "latency_s"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name}: {getattr(self, name)} must not be negative")
        if not self.time_s > 0.0:
            raise ValueError(f"time_s: must be greater than 0, not {self.time_s}")


class Positioning:
    """The believed state by which the vehicle steers; a ``Mover`` for its ``Itinerary``.

    Attributes:
        position_m: the believed position, east, north, up.
        velocity_m_s: over ground, assumed exact.
        receiver_m: the latest position of the satellite receiver, delayed by its latency.
        lost: whether there is no fix.
        glitch_m: sudden error of the believed position to the east, as from a reflected or faked signal.
    """

    def __init__(self, point: PointMass, error: GpsError, *, rng: np.random.Generator) -> None:
        self.lost = False
        self.glitch_m = 0.0
        self._point, self._rng = point, rng
        self._error_m: Vector = (0.0, 0.0, 0.0)
        self._wander_m: Vector = (0.0, 0.0, 0.0)
        self._keep = math.exp(-point.step_s / error.time_s)
        fraction = math.sqrt(1.0 - self._keep**2)
        self._scales = (error.horizontal_m * fraction, error.horizontal_m * fraction, error.vertical_m * fraction)
        self._exact = error.horizontal_m == 0.0 and error.vertical_m == 0.0
        if not self._exact:  # the receiver has been on for long: the error has its full spread from the start
            first = self._rng.standard_normal(3)
            spread = (error.horizontal_m, error.horizontal_m, error.vertical_m)
            self._wander_m = tuple(float(a) * b for a, b in zip(first, spread, strict=True))  # type: ignore[assignment]
        self._noise: list[list[float]] = []
        self._drift_m_s: Vector = (0.0, 0.0, 0.0)
        self._receiver_due = 0
        self._receiver_every = max(1, round(BODY.receiver_s / point.step_s))
        self._reported: deque[Vector] = deque(maxlen=round(error.latency_s / BODY.receiver_s) + 1)
        self.position_m = self.receiver_m = _sum(point.position_m, self._wander_m)

    @property
    def airframe(self) -> Airframe:
        """The vehicle's airframe."""
        return self._point.airframe

    @property
    def velocity_m_s(self) -> Vector:
        """Over ground."""
        return self._point.velocity_m_s

    @property
    def error_m(self) -> Vector:
        """Believed position less the true one."""
        x, y, z = self._point.position_m
        return (self.position_m[0] - x, self.position_m[1] - y, self.position_m[2] - z)

    def lose_fix(self) -> None:
        """Lose the satellite fix."""
        angle = float(self._rng.uniform(0.0, math.tau))
        self._drift_m_s = (BODY.drift_m_s * math.sin(angle), BODY.drift_m_s * math.cos(angle), 0.0)
        self.lost = True

    def step(self) -> None:
        """Update the believed position after one more step."""
        if not self._exact:
            self._wander()
        dt = self._point.step_s
        if self.lost:
            self._error_m = _sum(self._error_m, tuple(d * dt for d in self._drift_m_s))  # type: ignore[arg-type]
        elif self._error_m != (0.0, 0.0, 0.0):
            keep = math.exp(-dt / BODY.recovery_s)
            x, y, _ = self._error_m
            self._error_m = (x * keep, y * keep, 0.0) if math.hypot(x, y) > 1e-3 else (0.0, 0.0, 0.0)
        true = self._point.position_m
        if self._exact and self._error_m == (0.0, 0.0, 0.0):
            self.position_m = true
        else:
            self.position_m = _sum(_sum(true, self._wander_m), self._error_m)
        if self.glitch_m:
            self.position_m = _sum(self.position_m, (self.glitch_m, 0.0, 0.0))
        self._receiver_due -= 1
        if self._receiver_due <= 0:
            self._receiver_due = self._receiver_every
            if not self.lost:
                self._reported.append(_sum(true, self._wander_m))
                self.receiver_m = self._reported[0]

    def _wander(self) -> None:
        if not self._noise:
            self._noise = self._rng.standard_normal((512, 3)).tolist()
        noise, keep, scales, (x, y, z) = self._noise.pop(), self._keep, self._scales, self._wander_m
        self._wander_m = (
            keep * x + scales[0] * noise[0],
            keep * y + scales[1] * noise[1],
            keep * z + scales[2] * noise[2],
        )


def _sum(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


Ground = Callable[[float, float], float]
"""Height of the ground above mean sea level in metres, at a latitude and a longitude in degrees."""


class MockBody:
    """Position and motion of the vehicle, and the itinerary that it follows.

    Without ``ground`` the world is flat at home's height and only a landing vehicle touches it, so a route may lead below
    home. With it, flying into the ground is a crash.

    Attributes:
        point: its true state.
        believed: its believed position, by which it steers.
        air: the wind.
        battery: the battery and its charge.
        falling: whether it is in the air with its motors off.
        motors_failed: whether its motors give no thrust although it is armed; the autopilot assumes that it flies.
    """

    def __init__(
        self,
        home: GeoPoint,  # where it stands at first, and the origin of its frame; home itself moves to where it is armed
        *,
        airframe: Airframe,  # limits of its dynamics
        wind: WindModel,  # steady wind and gusts
        gps: GpsError,  # error of its positions
        battery: BatteryData,  # its battery
        rng: np.random.Generator,  # of the gusts and of the errors
        ground: Ground | None,  # height of the ground; None is flat
    ) -> None:
        self.home, self.home_m = home, (0.0, 0.0, 0.0)
        self.frame = LocalFrame(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        self.point = PointMass(airframe, step_s=BODY.step_s, position_m=(0.0, 0.0, 0.0))
        self.on_ground, self.crashed, self.falling = True, False, False
        self.motors_failed = False
        self.air = WindField(wind, step_s=BODY.step_s, rng=rng)
        self.believed = Positioning(self.point, gps, rng=rng)
        self.battery = Battery(battery)
        self.itinerary = Itinerary((), self.believed, 0.0)
        self._ground = ground

    @property
    def landed_state(self) -> LandedState:
        """The landed state that EXTENDED_SYS_STATE reports."""
        if self.on_ground or self.falling:  # with motors off both autopilots report this at once, at any height
            return LandedState.ON_GROUND
        return LandedState.LANDING if self.itinerary.landing else LandedState.IN_AIR

    def geodetic(self) -> GeoPoint:
        """The true position."""
        return self.geodetic_of(self.point.position_m)

    def geodetic_of(self, position_m: Vector) -> GeoPoint:
        """A position in its frame as geodetic coordinates."""
        lat, lon, alt = self.frame.geodetic_from_enu(position_m)
        return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))

    def follow(self, steps: list[Step], now: float, *, land_m_s: float, motion: AutopilotMotion | None = None) -> None:
        """Replace the itinerary by these steps; an empty list is to stay here."""
        self.itinerary = Itinerary(steps, self.believed, now, land_m_s=land_m_s, motion=motion)

    def cut_motors(self) -> None:
        """Stop the motors: in the air the vehicle falls."""
        self.falling = not self.on_ground
        self.crashed |= self.falling
        if self.on_ground:
            self.point.rest(up_m=self.point.position_m[2])

    def draw_power(self, seconds: float, *, motors: bool) -> None:
        """Draw power from the battery for some seconds: of the motors, or of the electronics alone."""
        if motors:
            self.battery.fly(seconds, airspeed_m_s=self.point.airspeed_m_s, climb_m_s=self.point.velocity_m_s[2])
        else:
            self.battery.idle(seconds)

    def set_home_here(self) -> None:
        """Set home to the believed position."""
        here = self.believed.position_m
        if math.dist(here, self.home_m) > BODY.same_position_m:
            self.home, self.home_m = self.geodetic_of(here), here

    def set_home(self, home: GeoPoint) -> None:
        """Set home to any position."""
        east, north, up = self.frame.enu_from_geodetic(home.lat_deg, home.lon_deg, home.alt_amsl_m)[0]
        self.home, self.home_m = home, (float(east), float(north), float(up))

    def position(self, item: MissionItem, ground: Ground) -> Vector:
        """The position of a mission item; a take-off goes straight up at any coordinates.

        Args:
            item: the item.
            ground: height of the ground as the vehicle knows it.
        """
        if item.command == Command.NAV_TAKEOFF:
            here = self.geodetic_of(self.believed.position_m)
            item = replace(item, lat_deg=here.lat_deg, lon_deg=here.lon_deg)
        alt_amsl_m = item.alt_m
        if item.frame is Frame.ABOVE_HOME:
            alt_amsl_m += self.home.alt_amsl_m
        elif item.frame is Frame.ABOVE_TERRAIN:
            alt_amsl_m += ground(item.lat_deg, item.lon_deg)
        east, north, up = self.frame.enu_from_geodetic(item.lat_deg, item.lon_deg, alt_amsl_m)[0]
        return (float(east), float(north), float(up))

    def step(self, now: float) -> None:
        """Fly for one step. On the ground nothing happens until the itinerary has a step."""
        wind = self.air.step()
        if self.on_ground:
            if self.itinerary.step is None or self.itinerary.landing:
                return
            self.on_ground = False
        ground_up_m = self._ground_up_m()
        if self.motors_failed:
            self._tumble(ground_up_m, wind)
            return
        if self.falling:
            self.point.fall(wind)
        else:
            self.point.step(self.itinerary.wanted_velocity(now, ground_up_m), wind)
        landing, above_m = self.itinerary.landing, self.point.position_m[2] - ground_up_m
        if ((landing or self.falling) and above_m <= 0.0) or (self._ground is not None and above_m < -BODY.touch_m):
            self.crashed = self.falling or not landing
            self.on_ground, self.falling = True, False
            self.point.rest(up_m=ground_up_m)

    def _tumble(self, ground_up_m: float, wind_m_s: Vector) -> None:
        """Fall on one side, and lie there: the autopilot still commands its motors."""
        if self.point.position_m[2] > ground_up_m:
            self.point.fall(wind_m_s)
        else:
            self.point.rest(up_m=ground_up_m)
        self.point.roll_rad = BODY.tumbled_rad

    def _ground_up_m(self) -> float:
        """Height of the ground below in the vehicle's frame; the Earth's curvature is neglected."""
        if self._ground is None:
            return 0.0
        here = self.geodetic()
        return self._ground(here.lat_deg, here.lon_deg) - self.frame.alt_amsl_m

    def ground_alt_amsl_m(self, lat_deg: float, lon_deg: float) -> float:
        """Height of the true ground above mean sea level."""
        return self.frame.alt_amsl_m if self._ground is None else self._ground(lat_deg, lon_deg)


SMART_RTL = 21
"""Its flight mode number."""


class Trail:
    """The positions that SmartRTL flies back to.

    Attributes:
        is_active: whether SmartRTL is available.
    """

    def __init__(self) -> None:
        self._points: list[Vector] = []
        self._accuracy_m, self._most, self._simplified = 2.0, 300, 0
        self._good_s = self._saved_s = 0.0
        self.is_active = False

    def begin(self, here: Vector | None, now: float, *, accuracy_m: float, most: float) -> None:
        """Forget the path and begin at ``here``, as at arming; without a position or a buffer there is no SmartRTL."""
        self._accuracy_m, self._most = accuracy_m, int(min(500.0, most))
        self._points, self._simplified = [], 0
        self._good_s = self._saved_s = now
        self.is_active = here is not None and self._most > 0 and accuracy_m > 0.0
        if here is not None and self.is_active:
            self._points.append(here)

    def note(self, here: Vector | None, now: float) -> str | None:
        """Add a position, None if it is lost; return the autopilot's reason if SmartRTL ends with it."""
        if not self.is_active:
            return None
        if here is None:
            return self._end("bad position") if now - self._good_s > FLIGHT.trail_timeout_s else None
        self._good_s = now
        if math.dist(self._points[-1], here) < self._accuracy_m:
            self._saved_s = now
            return None
        if len(self._points) < self._most:
            self._points.append(here)
            self._saved_s = now
        new, is_low = len(self._points) - self._simplified, self._most - len(self._points) <= FLIGHT.low_space
        if new >= FLIGHT.routine_points or (is_low and new >= FLIGHT.low_space):
            self._simplify()
        elif is_low:
            self._prune()
        return self._end("buffer full") if now - self._saved_s > FLIGHT.trail_timeout_s else None

    def pop_near(self, here: Vector) -> None:
        """Forget the newest position once it is reached on the return transit."""
        if len(self._points) > 1 and math.dist(self._points[-1], here) <= self._accuracy_m:
            self._points.pop()

    def back(self) -> list[Vector]:
        """The cleaned path, newest first; its last point is where the vehicle was armed."""
        self._simplify()
        self._prune()
        return self._points[::-1]

    def _end(self, why: str) -> str:
        self.is_active = False
        return f"SmartRTL deactivated: {why}"

    def _simplify(self) -> None:
        """Simplify the positions added since the last call (Ramer-Douglas-Peucker)."""
        first = max(0, self._simplified - 1)
        self._points[first:] = _simplified(self._points[first:], FLIGHT.simplify_fraction * self._accuracy_m)
        self._simplified = len(self._points)

    def _prune(self) -> None:
        """Cut out loops between segments that approach each other; of overlapping loops the longer one."""
        points, loops = self._points, list[tuple[float, int, int, Vector]]()
        for i in range(len(points) - 1, 3, -1):
            for j in range(1, i - 1):
                found = _nearest(points[i], points[i - 1], points[j - 1], points[j])
                if found is None or found[0] >= FLIGHT.prune_fraction * self._accuracy_m:
                    continue
                middle = found[1]
                length = sum(math.dist(a, b) ** 2 for a, b in zip(points[j : i - 1], points[j + 1 : i], strict=True))
                length += math.dist(middle, points[j]) ** 2 + math.dist(middle, points[i - 1]) ** 2
                rivals = [one for one in loops if one[1] <= i - 1 and j <= one[2]]
                if sum(one[0] for one in rivals) <= length:
                    loops = [one for one in loops if one not in rivals] + [(length, j, i - 1, middle)]
                break
        for _, start, end, middle in sorted(loops, key=lambda one: -one[1]):
            points[start : end + 1] = [middle]
        self._simplified = min(self._simplified, len(points))


def _simplified(points: Sequence[Vector], epsilon_m: float) -> list[Vector]:
    kept, stack = {0, len(points) - 1}, [(0, len(points) - 1)]
    line = np.asarray(points, float)
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        chord, inner = line[b] - line[a], line[a + 1 : b] - line[a]
        length = float(chord @ chord)
        fraction = np.clip(inner @ chord / length, 0.0, 1.0) if length > 0.0 else np.zeros(len(inner))
        off = np.linalg.norm(inner - fraction[:, None] * chord, axis=1)
        worst = a + 1 + int(off.argmax())
        if off.max() > epsilon_m:
            kept.add(worst)
            stack += [(a, worst), (worst, b)]
    return [points[k] for k in sorted(kept)]


def _nearest(a: Vector, b: Vector, c: Vector, d: Vector) -> tuple[float, Vector] | None:
    """Distance and middle of two segments where they are nearest; None for parallel ones, as in the autopilot."""
    one, two, apart = (tuple(q - p for p, q in zip(x, y, strict=True)) for x, y in ((a, b), (c, d), (c, a)))
    aa, ab, bb = _dot(one, one), _dot(one, two), _dot(two, two)
    da, db = _dot(one, apart), _dot(two, apart)
    if abs(aa * bb - ab * ab) < 1e-6:
        return None
    t = max(0.0, min(1.0, (ab * db - bb * da) / (aa * bb - ab * ab)))
    u = max(0.0, min(1.0, (aa * db - ab * da) / (aa * bb - ab * ab)))
    first = tuple(p + t * q for p, q in zip(a, one, strict=True))
    second = tuple(p + u * q for p, q in zip(c, two, strict=True))
    x, y, z = (0.5 * (p + q) for p, q in zip(first, second, strict=True))
    return math.dist(first, second), (x, y, z)


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(p * q for p, q in zip(a, b, strict=True))
