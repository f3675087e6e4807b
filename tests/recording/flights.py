"""A synthetic flight: straight lines over the area of a bundled scenario."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.recording.flight import RecordedEvent, VehicleState
from uavcover.scenario.scenario_file import load_scenario, terrain_source
from uavcover.scenario.site import Site, build_site
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations


@dataclass(frozen=True, eq=False)
class Flight:
    site: Site
    coverage: CoverageMap
    planned: Route
    track: Track
    first_observed_s: NDArray[np.float64]
    events: tuple[RecordedEvent, ...]
    states: tuple[VehicleState, ...]


def lines_over(site: Site, *, spacing_m: float, count: int | None) -> Route:
    """The first lines of a boustrophedon at mid-height, so that cells stay unseen."""
    west, south, east, north = site.area.bounds
    norths = np.linspace(south, north, 7)
    positions = [
        (e, n)
        for k, e in enumerate(np.arange(west + spacing_m / 2.0, east, spacing_m)[:count])
        for n in (norths if k % 2 == 0 else norths[::-1])
    ]
    limits = site.scenario.limits
    height = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    return Route(np.column_stack([positions, site.ground.heights_m(positions) + height]))


def make_flight(
    name: str,
    *,
    cell_size_m: float,
    line_spacing_m: float,
    speed_m_s: float,
    rate_hz: float,
    lines: int | None = None,
) -> Flight:
    scenario = load_scenario(name)
    raster = scenario.terrain.kind == "raster"
    site = build_site(scenario, terrain_file=terrain_source(scenario.terrain).files[0] if raster else None)  # type: ignore[arg-type]
    coverage = CoverageMap(site, cell_size_m=cell_size_m)
    planned = lines_over(site, spacing_m=line_spacing_m, count=lines)
    track = fly(site, planned.waypoints_m, speed_m_s=speed_m_s, rate_hz=rate_hz)
    first = coverage.first_observed(LevelObservations.towards_north(track.enu_m))
    return Flight(
        site=site,
        coverage=coverage,
        planned=planned,
        track=track,
        first_observed_s=np.where(first >= 0, track.time_s[first], np.nan),
        events=(
            RecordedEvent(float(track.time_s[-1]), "landed"),
            RecordedEvent(3.0, "armed"),
            RecordedEvent(20.0, "gust", "WARN"),
        ),
        states=tuple(
            VehicleState(4.0 + k, None if k == 0 else 16.0 - 0.01 * k, None if k == 0 else 99.0 - k, 50 * k, 5 * k)
            for k in range(30)
        ),
    )


def fly(site: Site, waypoints_m: NDArray[np.float64], *, speed_m_s: float, rate_hz: float) -> Track:
    along_m = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(waypoints_m, axis=0), axis=1)))
    time_s = np.arange(0.0, along_m[-1] / speed_m_s, 1.0 / rate_hz)
    enu = np.column_stack([np.interp(time_s * speed_m_s, along_m, waypoints_m[:, axis]) for axis in range(3)])
    velocity = np.gradient(enu, axis=0)
    yaw_deg = np.degrees(np.arctan2(velocity[:, 0], velocity[:, 1])) % 360.0
    geodetic = np.column_stack([np.full((time_s.size, 2), np.nan), enu[:, 2]])
    if site.frame is not None:
        geodetic = np.column_stack(site.frame.geodetic_from_enu(enu))
    attitude = np.column_stack([np.full(time_s.size, 1.5), np.full(time_s.size, -4.0), yaw_deg])
    waypoint = np.searchsorted(along_m, time_s * speed_m_s, side="right")
    # Not a whole number of seconds: vehicle time starts when the autopilot does.
    return Track(time_s + 3.0 + 1.0 / 3.0, geodetic, enu, attitude, waypoint.astype(np.int64))
