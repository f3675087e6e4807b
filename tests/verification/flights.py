"""Synthetic tracks: a perfect vehicle along a path, and along a plan."""

import dataclasses
from typing import Any

import numpy as np

from tests.planner import sites
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import verify_track

NIMBLE = {"acceleration_m_s2": 1e5, "max_climb_m_s": 500.0, "max_descent_m_s": 500.0}
"""A vehicle that takes corners at full speed, as the tracks here do; real ones fly in :mod:`tests.verification.honest`."""

LEVEL_DEG = (1e-6, -1e-6, 0.0)
"""As good as level, and measured: exactly zero throughout, or exactly the same through a turn, would be no measurement."""
LEANING_DEG = (60.0, 0.0, 0.0)
"""Of a first sample that is on no route: who takes such corners leans somewhere."""


def make_site(*arguments: Any, **changes: Any) -> Site:
    """A small site with the nimble vehicle."""
    return sites.make_site(*arguments, **{**changes, "vehicle": {**NIMBLE, **changes.get("vehicle", {})}})


def fly_along(
    site: Site,
    path_m: np.ndarray,
    *,
    first: int = 0,
    count: int | None = None,
    speed_m_s: float = 10.0,
    rate_hz: float = 5.0,
) -> Track:
    """A track exactly along an (n, 3) path; the planned waypoints are rows ``first`` to ``first + count - 1`` of it."""
    count = len(path_m) - first if count is None else count
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path_m, axis=0), axis=1))])
    # The last sample at every waypoint belongs to the way to it.
    along = np.append(np.arange(0.0, flown[-1], speed_m_s / rate_hz), flown[-1])
    enu = np.column_stack([np.interp(along, flown, path_m[:, axis]) for axis in range(3)])
    heading_for = np.searchsorted(flown, along, side="left") - first
    heading_for = np.where((heading_for >= 0) & (heading_for < count), heading_for, -1)
    return track_of(site, enu, time_s=100.0 + along / speed_m_s, current_waypoint=heading_for)


def track_of(site: Site, enu: np.ndarray, *, time_s: np.ndarray, current_waypoint: np.ndarray) -> Track:
    if site.frame is None:
        geodetic = np.column_stack([np.zeros_like(enu[:, :2]), enu[:, 2]])
    else:
        geodetic = np.column_stack(site.frame.geodetic_from_enu(enu))
    attitude = np.outer(np.cos(np.arange(len(enu))), LEVEL_DEG)
    if current_waypoint[0] < 1:
        attitude[0] = LEANING_DEG
    return Track(
        time_s=np.array(time_s, float),
        geodetic=geodetic,
        enu_m=np.array(enu, float),
        attitude_deg=attitude,
        current_waypoint=np.array(current_waypoint, dtype=np.int64),
    )


def changed(track: Track, **changes: Any) -> Track:
    return dataclasses.replace(track, **changes)


def taken(track: Track, keep: np.ndarray) -> Track:
    return Track(
        track.time_s[keep].copy(),
        track.geodetic[keep].copy(),
        track.enu_m[keep].copy(),
        track.attitude_deg[keep].copy(),
        track.current_waypoint[keep].copy(),
    )


def joined_tracks(site: Site, one: Track, other: Track, *, pause_s: float = 60.0) -> Track:
    """One track behind the other, as one that was not recorded in between."""
    later = other.time_s - other.time_s[0] + one.time_s[-1] + pause_s
    return track_of(
        site,
        np.vstack([one.enu_m, other.enu_m]),
        time_s=np.concatenate([one.time_s, later]),
        current_waypoint=np.concatenate([one.current_waypoint, other.current_waypoint]),
    )


def moved(site: Site, track: Track, by_m: tuple[float, float, float], *, which: str = "both") -> Track:
    """The track somewhere else: its latitudes and longitudes, its local columns, or both."""
    other = track_of(site, track.enu_m + np.array(by_m), time_s=track.time_s, current_waypoint=track.current_waypoint)
    if which == "local":
        return changed(track, enu_m=other.enu_m)
    return other if which == "both" else changed(track, geodetic=other.geodetic)


class Flight:
    """A site, a plan for it, and a perfect flight of the compiled mission, take-off and landing included."""

    def __init__(self, site: Site, route: Route | None = None) -> None:
        self.site = site
        self.coverage = CoverageMap(site, cell_size_m=10.0)
        layout = regular_layout(angle_rad=0.0, lines=3, height_agl_m=80.0, inset=0.0, tolerance_m=10.0)
        route = fly_layout(site, layout) if route is None else route
        compiled = compile_mission(site, route, autopilot="ardupilot")
        self.observed = self.coverage.observed(route.waypoints_m)
        self.planned = PlannedRoute(route.waypoints_m, self.coverage.fraction(self.observed))
        assert site.home_m is not None
        path = np.vstack([site.home_m, compiled.path_m, site.home_m])
        self.track = fly_along(site, path, first=compiled.first_waypoint_item, count=len(route))

    def verify(self, track: Track | None = None, *, with_plan: bool = True) -> VerificationReport:
        return verify_track(
            self.site, self.coverage, self.track if track is None else track, self.planned if with_plan else None
        )

    def without_waypoints(self) -> Track:
        return changed(self.track, current_waypoint=np.full(len(self.track), -1, dtype=np.int64))


def reasons(report: VerificationReport) -> str:
    assert not report.passed
    return "; ".join(report.reasons + report.doubts)
