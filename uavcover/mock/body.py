"""The flying part of the mock vehicle: a body in the air or on the ground, and the itinerary that it follows."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mission_io.model.enums import LandedState
from mission_io.model.items import Command, Frame, GeoPoint, MissionItem
from uavcover.mock.battery import Battery, BatteryData
from uavcover.mock.dynamics import Airframe, PointMass, Vector, WindField, WindModel
from uavcover.mock.itinerary import Itinerary, Step
from uavcover.mock.positioning import GpsError, Positioning
from uavcover.scenario.frames import LocalFrame

STEP_S = 0.02
"""One step of the simulation, seconds of vehicle time."""

_SAME_PLACE_M = 0.05
_TOUCH_M = 0.1
"""So deep below the ground a vehicle that does not mean to land has crashed; less is standing on it."""

Ground = Callable[[float, float], float]
"""Height of the ground above mean sea level in metres, at a latitude and a longitude in degrees."""


class MockBody:
    """Where the vehicle is, and how it gets to where it is told to go.

    Without ``ground`` the world is flat at home's height and only a landing vehicle notices it, so that a route may
    lead below home. With it, flying into the ground is a crash.

    Args:
        home: where it stands at first, and the origin of its frame; home itself moves to where it is armed.
        airframe: what it can do.
        wind: steady wind and gusts.
        gps: how far its positions are off.
        battery: what it flies on.
        rng: of the gusts and of the errors.
        ground: height of the ground, or none.

    Attributes:
        point: where it really is.
        believed: where it believes to be; it steers by that.
        air: the wind.
        battery: what is left.
        falling: whether it is in the air without motors.
    """

    def __init__(
        self,
        home: GeoPoint,
        *,
        airframe: Airframe,
        wind: WindModel,
        gps: GpsError,
        battery: BatteryData,
        rng: np.random.Generator,
        ground: Ground | None,
    ) -> None:
        self.home, self.home_m = home, (0.0, 0.0, 0.0)
        self.frame = LocalFrame(home.lat_deg, home.lon_deg, home.alt_amsl_m)
        self.point = PointMass(airframe, step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
        self.on_ground, self.crashed, self.falling = True, False, False
        self.air = WindField(wind, step_s=STEP_S, rng=rng)
        self.believed = Positioning(self.point, gps, rng=rng)
        self.battery = Battery(battery)
        self.itinerary = Itinerary((), self.believed, 0.0)
        self._ground = ground

    @property
    def landed_state(self) -> LandedState:
        """What an EXTENDED_SYS_STATE says."""
        if self.on_ground or self.falling:  # without motors both autopilots say so at once, however high they are
            return LandedState.ON_GROUND
        return LandedState.LANDING if self.itinerary.landing else LandedState.IN_AIR

    def geodetic(self) -> GeoPoint:
        """Where it really is."""
        return self.geodetic_of(self.point.position_m)

    def geodetic_of(self, position_m: Vector) -> GeoPoint:
        """A position in its frame as a place on Earth."""
        lat, lon, alt = self.frame.geodetic_from_enu(position_m)
        return GeoPoint(float(lat[0]), float(lon[0]), float(alt[0]))

    def follow(self, steps: list[Step], now: float, *, land_m_s: float) -> None:
        """Do these steps from now on instead of what was being done; none is to stay."""
        self.itinerary = Itinerary(steps, self.believed, now, land_m_s=land_m_s)

    def cut_motors(self) -> None:
        """Stop the motors: on the ground it stands, in the air it falls."""
        self.falling = not self.on_ground
        self.crashed |= self.falling
        if self.on_ground:
            self.point.rest(up_m=self.point.position_m[2])

    def draw_power(self, seconds: float, *, motors: bool) -> None:
        """Draw from the battery what the motors, or without them the electronics, take in so many seconds."""
        if motors:
            self.battery.fly(seconds, airspeed_m_s=self.point.airspeed_m_s, climb_m_s=self.point.velocity_m_s[2])
        else:
            self.battery.idle(seconds)

    def set_home_here(self) -> None:
        """Count heights above home from here on from where it believes to stand."""
        here = self.believed.position_m
        if math.dist(here, self.home_m) > _SAME_PLACE_M:
            self.home, self.home_m = self.geodetic_of(here), here

    def place(self, item: MissionItem, ground: Ground) -> Vector:
        """The position that a mission item names; a take-off goes straight up, whatever place it names.

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
        """Fly on for one step. On the ground nothing happens until there is something to do."""
        wind = self.air.step()
        if self.on_ground:
            if self.itinerary.step is None or self.itinerary.landing:
                return
            self.on_ground = False
        ground_up_m = self._ground_up_m()
        if self.falling:
            self.point.fall(wind)
        else:
            self.point.step(self.itinerary.wanted_velocity(now, ground_up_m), wind)
        landing, above_m = self.itinerary.landing, self.point.position_m[2] - ground_up_m
        if ((landing or self.falling) and above_m <= 0.0) or (self._ground is not None and above_m < -_TOUCH_M):
            self.crashed = self.falling or not landing
            self.on_ground, self.falling = True, False
            self.point.rest(up_m=ground_up_m)

    def _ground_up_m(self) -> float:
        """Height of the ground below, in the vehicle's frame; the Earth's curvature is left out."""
        if self._ground is None:
            return 0.0
        here = self.geodetic()
        return self._ground(here.lat_deg, here.lon_deg) - self.frame.alt_amsl_m

    def ground_alt_amsl_m(self, lat_deg: float, lon_deg: float) -> float:
        """Height of the true ground above mean sea level."""
        return self.frame.alt_amsl_m if self._ground is None else self._ground(lat_deg, lon_deg)
