"""Battery use of a site's flights, in seconds of hovering, in the worst of the planned winds."""

import math

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.energy import column_energies, path_energies, star_energies
from uavcover.kernels.way_cost import NO_ENERGIES, FlightEnergies, WayCost
from uavcover.missions.way_cost import power_of
from uavcover.model.vehicle import AutopilotName, Vehicle, Wind
from uavcover.scenario.pace import pace_of
from uavcover.scenario.site import Site

_DIRECTIONS = 12
"""Directions of the strongest wind. Between two of them the airspeed differs by less than 4 % of the wind."""


def winds_of(wind: Wind) -> FloatArray:
    """(w, 2) winds that batteries are planned for, towards east and north: the stated wind, and the strongest from all sides."""
    to_rad = math.radians(wind.from_deg + 180.0)
    known = np.array([[wind.speed_m_s * math.sin(to_rad), wind.speed_m_s * math.cos(to_rad)]])
    if not wind.most_m_s:
        return known
    sides_rad = 2.0 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    return np.vstack([known, wind.most_m_s * np.column_stack([np.sin(sides_rad), np.cos(sides_rad)])])


def usable_s(vehicle: Vehicle) -> float:
    """Seconds of hovering that the model may count for a flight, so that it keeps the reserve; infinite without endurance."""
    return (vehicle.longest_flight_s or math.inf) / (1.0 + vehicle.power.uncertainty_fraction)


class FlightEnergy:
    """Energies of a site's flights, each (w,) or (w, n) seconds of hovering in w winds.

    Args:
        site: the scenario on its ground.
        autopilot: who flies; the scenario's own by default.
    """

    def __init__(self, site: Site, autopilot: AutopilotName | None = None) -> None:
        wind = site.scenario.wind
        self._site = site
        self._power = power_of(site.scenario.vehicle, gust_m_s=wind.gust_m_s)
        self._pace, self.winds_m_s = pace_of(site, autopilot), winds_of(wind)

    def takeoff_s(self, height_m: float) -> FloatArray:
        """(w,) from the ground straight up to rest at a height."""
        return np.asarray(column_energies(self._power, self._pace, self.winds_m_s, float(height_m))[0])

    def landing_s(self, height_m: float) -> FloatArray:
        """(w,) from rest at a height straight down to the ground."""
        return np.asarray(column_energies(self._power, self._pace, self.winds_m_s, float(height_m))[1])

    def legs_and_turns_s(self, path_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(w, n - 1) hovering seconds of the legs of an (n, 3) path from rest to rest, and (w, n) of passing its waypoints."""
        legs, turns = path_energies(self._power, self._pace, self.winds_m_s, np.ascontiguousarray(path_m))
        return np.asarray(legs), np.asarray(turns)

    def path_s(self, path_m: FloatArray) -> FloatArray:
        """(w,) along an (n, 3) path, from rest to rest."""
        legs, turns = self.legs_and_turns_s(path_m)
        return np.asarray(legs.sum(axis=1) + turns.sum(axis=1))

    def first_legs_s(self, path_m: FloatArray, legs: int) -> FloatArray:
        """(w,) hovering seconds of the first ``legs`` legs of an (n, 3) path with all turns. Of its last legs if negative."""
        along, turns = self.legs_and_turns_s(path_m)
        return np.asarray((along[:, :legs] if legs > 0 else along[:, legs:]).sum(axis=1) + turns.sum(axis=1))

    def flights(
        self, route_m: FloatArray, there_s: FloatArray, back_s: FloatArray, alone_s: FloatArray
    ) -> FlightEnergies:
        """Energy of the flights along parts of an (n, 3) route.

        Args:
            route_m: the route.
            there_s: (w, n) from home on the ground to each waypoint, with the turn there.
            back_s: (w, n) from there to home, landed, with the turn there.
            alone_s: (w, n) of a flight to it alone.
        """
        vehicle = self._site.scenario.vehicle
        if vehicle.hover_s is None:
            return NO_ENERGIES
        legs, turns = self.legs_and_turns_s(route_m)
        return FlightEnergies(
            so_far_s=np.hstack([np.zeros((len(legs), 1)), np.cumsum(legs, axis=1)]),
            turns_s=np.cumsum(turns, axis=1),
            there_s=there_s,
            back_s=back_s,
            alone_s=alone_s,
            usable_s=usable_s(vehicle),
        )

    def straight_flights(self, way: WayCost, route_m: FloatArray) -> FlightEnergies:
        """Energy of the flights along parts of an (n, 3) route with straight transits."""
        out, back = star_energies(self._power, self._pace, self.winds_m_s, way.column_top, route_m)
        up, down = column_energies(self._power, self._pace, self.winds_m_s, way.column_m)
        there, home = out + up[:, None], back + down[:, None]
        alone, n, top = there + home, len(route_m), np.array(way.column_top)
        tops = np.broadcast_to(top, (n, 3))
        if way.stop_at_first == 0:
            alone += self._turns_s(tops, route_m, tops)
            there[:, :-1] += self._turns_s(tops[1:], route_m[:-1], route_m[1:])
        home[:, 1:] += self._turns_s(route_m[:-1], route_m[1:], tops[1:])
        return self.flights(route_m, there, home, alone)

    def _turns_s(self, before_m: FloatArray, at_m: FloatArray, after_m: FloatArray) -> FloatArray:
        """(w, k) of passing each of (k, 3) places between two others."""
        # One path through all of them: a turn depends on the places before and after it alone.
        path_m = np.stack([before_m, at_m, after_m], axis=1).reshape(-1, 3)
        return self.legs_and_turns_s(path_m)[1][:, 1::3]


def battery_used_s(energy: FlightEnergy, begin_s: FloatArray, path_m: FloatArray, home_m: FloatArray) -> float:
    """Seconds of hovering that a flight uses in the worst wind.

    Args:
        energy: of the site's flights.
        begin_s: (w,) of the take-off, or of what it begins with in the air.
        path_m: (n, 3) ENU from there to the top of the column above home.
        home_m: (3,) ENU, the ground at home.
    """
    return float((begin_s + energy.path_s(path_m) + energy.landing_s(path_m[-1, 2] - home_m[2])).max())


def longest_flight_in_words(vehicle: Vehicle) -> str:
    """The limit that a flight is held against, as messages tell it."""
    load = f" ({vehicle.hover_s:.0f} s with the payload)" if vehicle.hover_s and vehicle.power.payload_kg else ""
    return (
        f"vehicle.endurance_s is {vehicle.endurance_s or math.inf:g} s{load}, and vehicle.reserve_fraction = "
        f"{vehicle.reserve_fraction:g} allows flights of at most {vehicle.longest_flight_s or math.inf:.0f} s"
    )


def battery_in_words(site: Site, used_s: float) -> str:
    """Battery fraction that ``used_s`` seconds of hovering take, the wind, and the allowed fraction, as text."""
    vehicle, wind = site.scenario.vehicle, site.scenario.wind
    hover_s, strongest_m_s = vehicle.hover_s or math.inf, max(wind.speed_m_s, wind.most_m_s or 0.0)
    blows = f" in {strongest_m_s:g} m/s of wind" if strongest_m_s else ""
    return (
        f"{used_s / hover_s:.0%} of a battery{blows}; only {usable_s(vehicle) / hover_s:.0%} is usable "
        f"(vehicle.reserve_fraction = {vehicle.reserve_fraction:g}, vehicle.power.uncertainty_fraction = "
        f"{vehicle.power.uncertainty_fraction:g})"
    )
