"""Compiles the numeric kernels before they are needed, so that no search and no verdict waits for it.

A kernel is compiled for the types that it is called with. The rounds below plan, judge and close gaps once with each kind of
sensor and encoding, on little work; what they call is what every scenario calls.
"""

import contextlib
import time

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.judging.phases import PlannedRoute
from uavcover.judging.verify import FlownTrack, verify_flight
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.planning.gap_route import plan_closing_route
from uavcover.routes.flights import compile_flights
from uavcover.run.bounds import bounds
from uavcover.run.plan_search import SearchRequest, plan
from uavcover.run.user import User
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import judging_map

ROUNDS = (("jacksboro", 200), ("paper-R2", 200))
"""A camera along its path, and a sphere at waypoints; with evaluations enough for the local search too."""

_SAMPLE_S = 0.2
_GAP_CELLS = 40


def compile_kernels(user: User) -> float:
    """Compile whatever is not compiled yet; returns the seconds that it took.

    Args:
        user: told which round begins.
    """
    started = time.monotonic()
    for number, (name, evaluations) in enumerate(ROUNDS, start=1):
        user.say(f"compiling the numeric kernels: {number} of {len(ROUNDS)}")
        site = load_site(name)
        result = plan(site, SearchRequest(evaluations=evaluations, seed=1))
        bounds(site, result, time_s=0.0)
        chosen = result.chosen
        promised = PlannedRoute(chosen.route.waypoints_m, chosen.metrics.coverage_fraction)
        coverage = judging_map(site)
        track = _flown(site, chosen.route)
        verify_flight(site, coverage, [FlownTrack(track, promised)])
        if site.home_m is not None:
            compile_flights(site, chosen.route)
            distance_m = np.linalg.norm(coverage.grid.cells.centre_m - chosen.route.waypoints_m[-1], axis=1)
            missing = coverage.coverable & (distance_m <= np.sort(distance_m)[_GAP_CELLS])
            with contextlib.suppress(InfeasibleError):
                plan_closing_route(coverage, missing, start_m=site.home_m, end_m=site.home_m)
    return time.monotonic() - started


def _flown(site: Site, route: Route) -> Track:
    """A track at cruise speed along a route."""
    path: FloatArray = route.waypoints_m
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    speed_m_s = site.scenario.vehicle.cruise_speed_m_s
    time_s = np.arange(0.0, max(along_m[-1] / speed_m_s, 2.0 * _SAMPLE_S), _SAMPLE_S)
    enu_m = np.column_stack([np.interp(time_s * speed_m_s, along_m, path[:, axis]) for axis in range(3)])
    geodetic = enu_m[:, [1, 0, 2]] * 0.0 if site.frame is None else np.column_stack(site.frame.geodetic_from_enu(enu_m))
    return Track(
        time_s=time_s,
        geodetic=geodetic,
        enu_m=enu_m,
        attitude_deg=np.outer(np.cos(np.arange(len(time_s))), (1e-6, -1e-6, 0.0)),  # all zero would be no measurement
        current_waypoint=np.searchsorted(along_m, time_s * speed_m_s).astype(np.int64),
        attitude_age_s=np.zeros(len(time_s)),
    )
