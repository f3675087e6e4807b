"""Logs of a thousand samples a second: verified in bounded time and memory, with the verdict of all samples."""

import dataclasses
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

from tests.planner.sites import hills, make_site, with_scenario
from tests.verification.honest import Weather, flown_by_the_mock
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, Sensor, SphereSensor
from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, Track, TrackSample
from uavcover.model.verdict import VerificationReport
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.run import track_file
from uavcover.run.track_file import TrackWriter, read_track_with_warnings
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification import observations
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.judged_track import JudgedTrack, judge_track
from uavcover.verification.verify import verify_track

SENSORS: dict[str, Sensor] = {
    "nadir": NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0),
    "frame": FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=45.0, range_m=200.0),
    "sphere": SphereSensor(kind="sphere", range_m=110.0, sensing="along-path"),
    "disc": DiscSensor(kind="disc", radius_m=12.0, sensing="along-path"),
}
HZ = 1000.0


class Flown:
    """A flight of the mock over hills, as it was recorded."""

    def __init__(self, sensor: Sensor, weather: Weather | None = None) -> None:
        self.site = make_site(hills, sensor=sensor, ring=((0.0, 0.0), (160.0, 0.0), (160.0, 90.0), (0.0, 90.0)))
        layout = regular_layout(angle_rad=0.1, lines=2, height_agl_m=80.0, inset=0.0, tolerance_m=10.0)
        route = fly_layout(self.site, layout)
        self.coverage = CoverageMap(self.site, cell_size_m=3.0)
        self.planned = PlannedRoute(route.waypoints_m, 1.0)
        self.track = flown_by_the_mock(self.site, route, weather)

    def verify(self, track: Track) -> VerificationReport:
        return verify_track(self.site, self.coverage, track, self.planned)


def at_rate(site: Site, track: Track, *, hz: float = HZ, noise_m: float = 0.0, noise_deg: float = 0.0) -> Track:
    """A flight as a fast logger has it: between its samples as straight as the flight was, with noise of every sample."""
    rng = np.random.default_rng(7)
    time_s = np.arange(track.time_s[0], track.time_s[-1], 1.0 / hz)

    def between(values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(time_s, track.time_s, vertical) for vertical in values.T])

    yaw = np.unwrap(track.attitude_deg[:, 2], period=360.0)
    attitude = between(np.column_stack([track.attitude_deg[:, :2], yaw]))
    enu = between(track.enu_m) + rng.normal(0.0, noise_m, (len(time_s), 3))
    assert site.frame is not None
    return Track(
        time_s=time_s,
        geodetic=np.column_stack(site.frame.geodetic_from_enu(enu)),
        enu_m=enu,
        attitude_deg=attitude + rng.normal(0.0, noise_deg, attitude.shape),
        current_waypoint=track.current_waypoint[np.searchsorted(track.time_s, time_s, side="right") - 1],
        attitude_age_s=np.zeros(len(time_s)),
    )


def all_of_them(_site: Site, looks: observations.Observations) -> np.ndarray:
    return np.arange(len(looks))


@pytest.fixture(scope="module")
def flown() -> Callable[[str], Flown]:
    known: dict[str, Flown] = {}

    def of(name: str) -> Flown:
        windy = Weather(wind_m_s=8.0, gust_m_s=2.0, gps_m=0.5, seed=3)
        return known.setdefault(name, Flown(SENSORS[name], windy if name == "frame" else None))

    return of


@pytest.mark.parametrize(
    ("name", "noise"), [("nadir", (0.01, 0.05)), ("frame", (0.0, 0.0)), ("sphere", (0.01, 0.0)), ("disc", (0.01, 0.05))]
)
def test_a_thinned_flight_has_the_verdict_of_all_samples(
    name: str, noise: tuple[float, float], flown, monkeypatch
) -> None:
    flight = flown(name)
    track = at_rate(flight.site, flight.track, hz=200.0, noise_m=noise[0], noise_deg=noise[1])
    thinned = flight.verify(track)
    monkeypatch.setattr(observations, "informative", all_of_them)
    whole = flight.verify(track)
    assert thinned.coverage_fraction == pytest.approx(whole.coverage_fraction, abs=1e-4)
    assert thinned.surely_covered_fraction == pytest.approx(whole.surely_covered_fraction, abs=1e-4)
    assert thinned.possibly_covered_fraction == pytest.approx(whole.possibly_covered_fraction, abs=1e-4)
    assert whole.coverage_fraction > 0.1
    assert (thinned.verdict, thinned.reasons, thinned.violations) == (whole.verdict, whole.reasons, whole.violations)
    assert (thinned.doubts, thinned.findings) == (whole.doubts, whole.findings)


def test_few_of_a_thousand_observations_a_second_are_counted(flown) -> None:
    flight = flown("nadir")
    fast = at_rate(flight.site, flight.track)
    counted = len(judged(flight, fast).observations(flight.site))
    assert counted < 0.03 * len(fast)
    assert counted > 0.5 * len(judged(flight, flight.track).observations(flight.site))


def judged(flight: Flown, track: Track) -> JudgedTrack:
    return judge_track(flight.site, track, flight.planned)


@pytest.mark.parametrize("lasts", [1, 5])
def test_a_dip_of_milliseconds_below_the_band_is_found(lasts: int, flown) -> None:
    """A few samples of those that coverage does not need."""
    flight = flown("nadir")
    track = at_rate(flight.site, flight.track)
    lowest_m = flight.verify(track).min_height_agl_m
    assert lowest_m is not None
    limits = dataclasses.replace(flight.site.scenario.limits, min_height_agl_m=lowest_m - 0.02)
    site = with_scenario(flight.site, limits=limits)
    assert verify_track(site, flight.coverage, track, flight.planned).passed
    on_route = np.flatnonzero(track.current_waypoint >= 1)
    at = on_route[int(np.argmin(site.ground.heights_agl_m(track.enu_m[on_route])))]
    dipped = {name: getattr(track, name).copy() for name in ("geodetic", "enu_m")}
    for heights in dipped.values():
        heights[at : at + lasts, 2] -= 0.05
    found = verify_track(site, flight.coverage, dataclasses.replace(track, **dipped), flight.planned)
    assert found.verdict == "failed"
    assert [violation.kind for violation in found.violations] == ["below-band"]
    assert found.violations[0].excess == pytest.approx(0.03, abs=0.005)


def test_memory_of_a_fast_log_is_that_of_its_samples(flown) -> None:
    """At most 400 bytes a sample at a time, beside its track: 10^6 samples stay below 600 MB with the program."""
    flight = flown("nadir")
    track = at_rate(flight.site, flight.track)
    flight.verify(flight.track)
    tracemalloc.start()
    flight.verify(track)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 400 * len(track)


def test_a_plain_table_is_read_as_row_by_row(flown, tmp_path, monkeypatch) -> None:
    flight = flown("nadir")
    path = tmp_path / "track.csv"
    with TrackWriter(path) as writer:
        track = flight.track
        for k in range(len(track)):
            row = [
                track.time_s[k],
                *track.geodetic[k],
                *track.enu_m[k],
                *track.attitude_deg[k],
                track.current_waypoint[k],
            ]
            more = {
                "attitude_age_s": track.attitude_age_s[k],
                "pictures_taken": float(k // 2),
                "unix_time_s": 1.7e9 + k,
            }
            writer.write(TrackSample(*row, **more))
    monkeypatch.setattr(track_file, "_BLOCK_BYTES", 1000)
    plain = track_file._plain_track(path)
    assert plain is not None
    monkeypatch.setattr(track_file, "_plain_track", lambda _: None)
    by_row = read_track_with_warnings(path).track
    for name in ("time_s", "geodetic", "enu_m", "attitude_deg", "current_waypoint", *OPTIONAL_COLUMNS):
        assert np.array_equal(getattr(plain, name), getattr(by_row, name), equal_nan=True), name
    assert len(COLUMNS) + len(OPTIONAL_COLUMNS) == 19
