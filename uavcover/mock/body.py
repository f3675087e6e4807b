"""The body of the mock vehicle, in the air or on the ground, and the itinerary that it follows."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mission_io.model.enums import LandedState
from mission_io.model.items import Command, Frame, GeoPoint, MissionItem
from uavcover.mock.dynamics import Airframe, Battery, BatteryData, PointMass, Vector, WindField, WindModel
from uavcover.mock.itinerary import Itinerary, Step
from uavcover.mock.positioning import GpsError, Positioning
from uavcover.mock.tuning import BODY
from uavcover.model.vehicle import AutopilotMotion
from uavcover.terrain.frames import LocalFrame

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
        motors_failed: whether its motors give no thrust although it is armed; the autopilot believes that it flies on.
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
        if math.dist(here, self.home_m) > BODY.same_place_m:
            self.home, self.home_m = self.geodetic_of(here), here

    def set_home(self, home: GeoPoint) -> None:
        """Set home to any position."""
        east, north, up = self.frame.enu_from_geodetic(home.lat_deg, home.lon_deg, home.alt_amsl_m)[0]
        self.home, self.home_m = home, (float(east), float(north), float(up))

    def place(self, item: MissionItem, ground: Ground) -> Vector:
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
