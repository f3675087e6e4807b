"""Planned times along a compiled mission, from the ground to the ground."""

from dataclasses import dataclass

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.flight_time import Pace, landing_time, leg_times, takeoff_time, turn_times
from uavcover.missions.sorties import Sortie
from uavcover.model.vehicle import AutopilotName
from uavcover.scenario.pace import pace_of
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """A flight as points with their times; between them it moves evenly."""

    time_s: FloatArray  # (n,) since take-off, not decreasing
    place_m: FloatArray  # (n, 3) ENU metres, the ground at home first and last

    @property
    def duration_s(self) -> float:
        """Time from take-off to landing."""
        return float(self.time_s[-1])

    def places_m(self, times_s: FloatArray) -> FloatArray:
        """(k, 3) ENU, where the flight is at (k,) times since take-off; at its ends before and after it."""
        return np.column_stack([np.interp(times_s, self.time_s, axis) for axis in self.place_m.T])

    def nearest_time_s(self, place_m: FloatArray, *, from_s: float, to_s: float) -> float:
        """The planned time at which the flight is nearest to a (3,) place, between two times since take-off."""
        inside = self.time_s[(self.time_s > from_s) & (self.time_s < to_s)]
        times = np.clip(np.concatenate([[from_s], inside, [to_s]]), 0.0, self.duration_s)
        points = self.places_m(times)
        along = np.diff(points, axis=0)
        squared = np.einsum("ij,ij->i", along, along)
        reach = np.einsum("ij,ij->i", place_m - points[:-1], along)
        share = np.clip(reach / np.where(squared > 0.0, squared, np.inf), 0.0, 1.0)
        off = np.linalg.norm(points[:-1] + share[:, None] * along - place_m, axis=1)
        k = int(np.argmin(off))
        return float(times[k] + share[k] * (times[k + 1] - times[k]))


def timeline_of(site: Site, sortie: Sortie, *, autopilot: AutopilotName) -> Timeline:
    """The planned times of a sortie; the last one is its flight time.

    What passing a waypoint without a stop saves is taken half from the leg before it and half from the leg behind.

    Raises:
        InfeasibleError: the site has no home.
    """
    home = site.home_m
    if home is None:
        raise InfeasibleError(f"scenario {site.scenario.name} has no [home]")
    pace, path = pace_of(site, autopilot), sortie.compiled.path_m
    if trigger_distance_m(site.scenario) is not None:
        # The waypoint at which photos begin stands twice in the mission and is a stop.
        path = np.insert(path, _first_row(sortie), sortie.route.waypoints_m[0], axis=0)
    turns_s = turn_times(pace, path)
    legs_s = leg_times(pace, path) + 0.5 * (turns_s[:-1] + turns_s[1:])
    climb_s, climb_m = _climb(pace, home, float(path[0, 2] - home[2]))
    sink_s, sink_m = _descent(pace, home, float(path[-1, 2] - home[2]))
    begin_s = climb_s[-1]
    # Two sharp turns close to each other may save more than the leg between them takes: then it takes no time.
    along_s = np.maximum.accumulate(begin_s + np.concatenate([[0.0], np.cumsum(legs_s)]))
    return Timeline(
        time_s=np.concatenate([climb_s[:-1], along_s, along_s[-1] + sink_s[1:]]),
        place_m=np.vstack([climb_m[:-1], path, sink_m[1:]]),
    )


def _first_row(sortie: Sortie) -> int:
    """Row of the first planned waypoint in the path of the mission."""
    path, route = sortie.compiled.path_m, sortie.route.waypoints_m
    for row in range(len(path) - len(route) + 1):
        if np.array_equal(path[row : row + len(route)], route):
            return row
    raise InfeasibleError("the mission does not contain the planned route")


def _climb(pace: Pace, home_m: FloatArray, height_m: float) -> tuple[FloatArray, FloatArray]:
    heights = np.unique([0.0, min(pace.takeoff_slow_m, height_m), height_m])
    times = np.array([0.0, *(takeoff_time(pace, h) for h in heights[1:])])
    return times, _column(home_m, heights)


def _descent(pace: Pace, home_m: FloatArray, height_m: float) -> tuple[FloatArray, FloatArray]:
    """The last metres are slow, and the metres above those slower than the rest."""
    slow_m = min(pace.land_slow_m, height_m)
    heights = np.unique([0.0, slow_m, min(slow_m + pace.land_band_m, height_m), height_m])[::-1]
    left = np.array([*(landing_time(pace, h) for h in heights[:-1]), 0.0])
    return left[0] - left, _column(home_m, heights)


def _column(home_m: FloatArray, heights_m: FloatArray) -> FloatArray:
    return np.asarray(home_m + heights_m[:, None] * np.array([0.0, 0.0, 1.0]))
