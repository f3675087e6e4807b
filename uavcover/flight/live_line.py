"""The line that says what a vehicle in flight does, from what it reported last."""

import math
from collections.abc import Callable

import numpy as np

from mission_io.wire import messages as m
from uavcover.flight.connect import Connected
from uavcover.flight.modes import Mode, mode_from_custom
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import landing_time, leg_times, turn_times
from uavcover.model.route import Route
from uavcover.model.track import TrackSample
from uavcover.scenario.pace import pace_of
from uavcover.scenario.site import Site


class LiveLine:
    """Mode, waypoint, height above ground, speed, battery, distance home, coverage so far and time left, as text.

    Everything but the coverage is read from the latest messages; the coverage is counted elsewhere, in another thread.

    Args:
        site: the scenario on its ground.
        route: the planned one.
        vehicle: who flies it.
        covered: the share of the area that was observed so far, 0 to 1; None while it is not known.
    """

    def __init__(self, site: Site, route: Route, vehicle: Connected, *, covered: Callable[[], float | None]) -> None:
        self._site, self._vehicle, self._covered = site, vehicle, covered
        self._count = len(route)
        self._waypoint = 0
        self._left = _TimeLeft(site, route.waypoints_m, vehicle) if site.home_m is not None else None

    def text(self, sample: TrackSample) -> str:
        """The line at a sample of the track, about 100 characters long; what is not known is left out."""
        if sample.current_waypoint >= 0:
            self._waypoint = sample.current_waypoint
        at_m = np.array([sample.east_m, sample.north_m, sample.up_m])
        client, monitor = self._vehicle.client, self._vehicle.monitor
        mode = mode_from_custom(client.vehicle.autopilot, client.vehicle.custom_mode)
        # Item and mode tell that the last waypoint is behind: in another mode no planned waypoint is flown to.
        between = sample.current_waypoint < 0 and mode is Mode.MISSION
        homeward = between and self._waypoint == self._count - 1
        elsewhere = between and 0 < self._waypoint < self._count - 1  # as on the way home after a stop
        parts = [
            f"mode {client.vehicle.custom_mode}" if mode is None else mode.value,
            "homeward" if homeward else "off the plan" if elsewhere else f"waypoint {self._waypoint} of {self._count}",
        ]
        height_m = float(self._site.ground.heights_agl_m(at_m[None])[0])
        if math.isfinite(height_m):
            parts.append(f"{height_m:.0f} m AGL")
        position, status = monitor.latest(m.GlobalPositionInt), monitor.latest(m.SysStatus)
        if position is not None:
            parts.append(f"{math.hypot(position.velocity_north_m_s, position.velocity_east_m_s):.1f} m/s")
        if status is not None and status.battery_remaining_percent is not None:
            parts.append(f"battery {status.battery_remaining_percent:.0f} %")
        if self._site.home_m is not None:
            parts.append(f"home {math.hypot(*(at_m - self._site.home_m)[:2]):.0f} m")
        covered = self._covered()
        if covered is not None:
            parts.append(f"covered {100.0 * covered:.0f} %")
        if self._left is not None and not elsewhere:
            left_s = self._left.seconds(at_m, None if homeward else self._waypoint)
            parts.append(f"{int(left_s) // 60}:{int(left_s) % 60:02d} left")
        return ", ".join(parts)


class _TimeLeft:
    """How long a flight takes from a position, at the planned pace: the route from the waypoint it heads for, then home."""

    def __init__(self, site: Site, waypoints_m: FloatArray, vehicle: Connected) -> None:
        assert site.home_m is not None
        self._pace, self._home_m = pace_of(site, vehicle.autopilot), site.home_m
        above_home = np.array([*site.home_m[:2], waypoints_m[-1, 2]])
        self._path_m = np.vstack([waypoints_m, above_home])
        turns_s = turn_times(self._pace, self._path_m)
        legs_s = leg_times(self._pace, self._path_m) + 0.5 * (turns_s[:-1] + turns_s[1:])
        self._from_waypoint_s = np.append(np.cumsum(legs_s[::-1])[::-1], 0.0)

    def seconds(self, at_m: FloatArray, waypoint: int | None) -> float:
        """Seconds to the landing; ``waypoint`` is None once the last one is reached."""
        to = len(self._path_m) - 1 if waypoint is None else waypoint
        target = self._path_m[to] if waypoint is not None else np.array([*self._home_m[:2], at_m[2]])
        there_s = float(leg_times(self._pace, np.vstack([at_m, target]))[0]) if math.dist(at_m, target) > 0.1 else 0.0
        sinks_m = max(0.0, float((target if waypoint is None else self._path_m[-1])[2] - self._home_m[2]))
        return there_s + float(self._from_waypoint_s[to]) + float(landing_time(self._pace, sinks_m))
