import datetime
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.verification.track_logs.samples import (
    COUNT,
    FRAME,
    GROUND_M,
    flight,
    velocity_ned_m_s,
    write_dataflash,
    write_gpx,
    write_tlog,
    write_ulog,
)
from uavcover.errors import TrackError
from uavcover.model.track import ReadTrack, Track
from uavcover.model.vehicle import Vehicle, Wind
from uavcover.terrain.frames import LocalFrame
from uavcover.verification.possible_motion import Motion, judge_motion, motion_limits
from uavcover.verification.track_logs.fixes import confirmed, fixes_at
from uavcover.verification.track_logs.logged_rows import LoggedRows
from uavcover.verification.track_logs.readers import READERS, _fixes, assemble_track, read_foreign_log

WRITERS = {"flight.tlog": write_tlog, "flight.BIN": write_dataflash, "flight.ulg": write_ulog}


def read(path: Path) -> ReadTrack:
    return read_foreign_log(path, FRAME)


@pytest.mark.parametrize("name", WRITERS)
def test_the_flight_comes_back(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    track = read(path).track
    positions, attitudes = flight()
    np.testing.assert_allclose(track.time_s, positions[:, 0], atol=1e-6)
    # Latitudes and longitudes of 1e-7 degrees are centimetres, heights millimetres or a float's rounding.
    np.testing.assert_allclose(track.geodetic[:, :2], positions[:, 1:3], atol=0.51e-7)
    np.testing.assert_allclose(track.geodetic[:, 2], positions[:, 3], atol=1e-3)
    np.testing.assert_allclose(track.enu_m, FRAME.enu_from_geodetic(*positions[:, 1:].T), atol=0.02)
    assert (track.current_waypoint == -1).all()
    # The first position comes before the first attitude, the others lie halfway between two.
    expected = 0.5 * (attitudes[:-1, 1:3] + attitudes[1:, 1:3])
    np.testing.assert_allclose(track.attitude_deg[1:, :2], expected, atol=0.02)
    yaw = (350.0 + np.arange(COUNT - 1) + 0.5) % 360.0
    np.testing.assert_allclose((track.attitude_deg[1:, 2] - yaw + 180.0) % 360.0, 180.0, atol=0.02)


@pytest.mark.parametrize("name", WRITERS)
def test_the_time_of_day_is_what_the_receiver_told(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    assert np.isnan(read(path).track.unix_time_s).all()
    WRITERS[name](path, began_unix_s=1_780_000_000.0)
    track = read(path).track
    np.testing.assert_allclose(track.unix_time_s, 1_780_000_000.0 + track.time_s, atol=2e-3)


@pytest.mark.parametrize("name", WRITERS)
def test_it_is_known_whether_there_was_a_fix(tmp_path: Path, name: str) -> None:
    """Of any receiver: the first one loses it for longer."""
    path = tmp_path / name
    fixes = [(1 if 5 <= k < 30 else 4, 0 if 10 <= k < 20 else 3) for k in range(COUNT)]
    WRITERS[name](path, fixes=fixes)
    lost = read(path).track.has_fix == 0.0
    assert np.flatnonzero(lost).tolist() == list(range(10, 20))


@pytest.mark.parametrize("name", ["flight.BIN", "flight.tlog"])
@pytest.mark.parametrize(("off_deg", "confirms"), [(0.00001, True), (0.0003, False)], ids=["1 m", "40 m"])
def test_a_receiver_elsewhere_is_no_fix(tmp_path: Path, name: str, off_deg: float, confirms: bool) -> None:
    """The position may have drifted from it by any distance, and the flight passed."""
    path = tmp_path / name
    fixes = [(3, 0)] * COUNT
    WRITERS[name](path, fixes=fixes, receiver_off_deg=off_deg)
    track, warnings = read(path).track, read(path).warnings
    assert (track.has_fix[1:-1] == float(confirms)).all()
    assert any("receiver fixes are more than 4 m from the position of the estimator" in w for w in warnings) != confirms


@pytest.mark.parametrize(
    ("late_s", "north_m", "step_s", "confirms"),
    [(0.3, 3.0, 0.2, True), (0.3, 5.0, 0.2, False), (2.0, 0.0, 0.2, False), (0.3, 50.0, 3.0, True)],
)
def test_a_receiver_is_late_by_less_than_a_second(late_s: float, north_m: float, step_s: float, confirms: bool) -> None:
    """Between rare positions the path is not known, and nothing contradicts it."""
    t = np.arange(0.0, 60.0, step_s)
    deg_m = 1.0 / 111_195.0  # on a sphere
    positions = np.column_stack([t, np.zeros(len(t)), 10.0 * t * deg_m, np.zeros(len(t))])
    at = np.arange(5.0, 55.0)
    ones = np.ones(len(at))
    reports = np.column_stack([at, 0.0 * at, ones, north_m * deg_m * ones, 10.0 * (at - late_s) * deg_m])
    fixes, warnings = confirmed(reports, positions)
    assert (fixes[:, 1] == float(confirms)).all()
    assert bool(warnings) != confirms
    other = np.column_stack([at + 0.1, ones, ones, 0.0 * at, 10.0 * at * deg_m])
    both = np.vstack([reports, other])
    fixes, _ = confirmed(both[np.argsort(both[:, 0])], positions)
    assert fixes[1:, 1].all(), "one of two receivers is enough"


@pytest.mark.parametrize("keys", [("lat", "lon", "alt"), ("latitude_deg", "longitude_deg", "altitude_msl_m")])
def test_px4s_receiver_has_no_fix_while_the_estimator_extrapolates(keys: tuple[str, str, str]) -> None:
    unit = 1e7 if keys[0] == "lat" else 1.0
    stamps = np.array([1_000_000, 2_000_000, 3_000_000])
    receiver = {"timestamp": stamps, "fix_type": np.array([3, 3, 2]), **{key: 8.0 * unit * np.ones(3) for key in keys}}
    position = {"timestamp": stamps - 1, "dead_reckoning": np.array([0, 1, 0])}
    np.testing.assert_allclose(_fixes({"sensor_gps": receiver})[:, 2:], [[1, 8, 8], [1, 8, 8], [0, 8, 8]])
    both = _fixes({"sensor_gps": receiver, "vehicle_global_position": position})
    assert both[:, 2].tolist() == [1.0, 0.0, 0.0]
    assert _fixes({"vehicle_global_position": position})[:, 2:].tolist() == [[1, 0, 0], [0, 0, 0], [1, 0, 0]]


def test_a_receiver_that_falls_silent_has_no_fix() -> None:
    """ArduPilot logs one report without a fix when a receiver is lost, and then none; 9 s later positions counted again."""
    times = np.arange(20.0)
    reports = np.column_stack([times, np.ones(20)])
    later = np.array([21.0, 23.5, 26.0, 400.0])
    assert fixes_at(later, reports).tolist() == [1.0, 1.0, 0.0, 0.0]
    lost = np.vstack([reports, [23.0, 0.0]])
    assert fixes_at(later, lost).tolist() == [1.0, 0.0, 0.0, 0.0]
    slow = reports * [4.0, 1.0]
    assert fixes_at(76.0 + later, slow).tolist() == [0.0, 0.0, 0.0, 0.0]
    assert fixes_at(76.0 + np.array([4.0, 11.0, 12.5]), slow)[[0, 2]].tolist() == [1.0, 0.0]
    np.testing.assert_array_equal(fixes_at(later, reports[:3]), np.nan)


def test_an_old_report_says_nothing() -> None:
    fixes = np.array([[21.0, 0.0, 0.0, 0.0, 0.0], [22.0, 0.0, 1.0, 0.0, 0.0]])
    track = assemble_track(
        Path("x"), LoggedRows(rows([20.0, 21.5, 23.0, 27.5]), np.empty((0, 4)), fixes=fixes), FRAME
    ).track
    np.testing.assert_array_equal(track.has_fix, [np.nan, 0.0, 1.0, np.nan])


VELOCITIES = {
    "of the position message": ("flight.tlog", write_tlog, {}),
    "of the primary core": ("flight.bin", write_dataflash, {"core": "XKF1"}),
    "of the core of old versions": ("flight.bin", write_dataflash, {"core": "NKF1"}),
    "of the receiver where no core is logged": ("flight.bin", write_dataflash, {}),
    "of the receiver whose positions are taken": ("flight.bin", write_dataflash, {"core": "XKF1", "estimated": False}),
    "of the local position": ("flight.ulg", write_ulog, {}),
    "of PX4's receiver until 1.14": ("flight.ulg", write_ulog, {"receiver": "vehicle_gps_position"}),
    "of PX4's receiver": ("flight.ulg", write_ulog, {"receiver": "sensor_gps"}),
}


@pytest.mark.parametrize("source", VELOCITIES)
def test_the_velocity_is_read(tmp_path: Path, source: str) -> None:
    name, write, options = VELOCITIES[source]
    write(tmp_path / name, velocity=True, **options)
    track = read(tmp_path / name).track
    velocity = np.column_stack([track.velocity_north_m_s, track.velocity_east_m_s, track.velocity_down_m_s])
    known = np.isfinite(velocity).all(axis=1)
    assert known.mean() > 0.9
    # Between two rows 0.2 s apart it is interpolated.
    np.testing.assert_allclose(velocity[known], velocity_ned_m_s(track.time_s)[known], atol=0.04)
    np.testing.assert_array_equal(track.velocity_enu_m_s[known], velocity[known][:, [1, 0, 2]] * [1.0, 1.0, -1.0])


@pytest.mark.parametrize("name", [*WRITERS, "flight.gpx"])
def test_what_is_not_reported_is_unknown_and_no_warning(tmp_path: Path, name: str) -> None:
    """Messages hold zeros then; GPX has none."""
    {**WRITERS, "flight.gpx": write_gpx}[name](tmp_path / name)
    loaded = read(tmp_path / name)
    assert np.isnan(loaded.track.velocity_enu_m_s).all()
    assert not any("velocit" in warning for warning in loaded.warnings)


def test_velocities_too_far_apart_are_not_interpolated() -> None:
    positions, _ = flight()
    moving = np.column_stack([positions[::5, 0], np.ones((len(positions[::5]), 3))])
    track = assemble_track(Path("x"), LoggedRows(positions, np.empty((0, 4)), velocities=moving), FRAME).track
    assert np.flatnonzero(np.isfinite(track.velocity_down_m_s)).tolist() == list(range(0, COUNT, 5))


def test_clocks_that_do_not_run_together_tell_no_time_of_day(tmp_path: Path) -> None:
    path = tmp_path / "simulated.tlog"
    write_tlog(path, began_unix_s=1_780_000_000.0, speed=20.0)
    assert np.isnan(read(path).track.unix_time_s).all()


def test_gpx_has_places_heights_and_times_but_no_attitude(tmp_path: Path) -> None:
    path = tmp_path / "flight.gpx"
    write_gpx(path)
    loaded = read(path)
    positions, _ = flight()
    np.testing.assert_allclose(loaded.track.time_s, positions[:, 0] - positions[0, 0], atol=1e-3)
    np.testing.assert_array_equal(loaded.track.geodetic, positions[:, 1:])
    first = datetime.datetime(2026, 11, 21, 10, 0, tzinfo=datetime.UTC).timestamp() + positions[0, 0]
    np.testing.assert_allclose(loaded.track.unix_time_s, first + loaded.track.time_s, atol=1e-3)
    assert np.isnan(loaded.track.attitude_deg).all()
    assert any("above sea level" in warning for warning in loaded.warnings)
    assert any("no attitude" in warning for warning in loaded.warnings)


def test_dataflash_without_estimated_positions_takes_the_first_gps(tmp_path: Path) -> None:
    path = tmp_path / "x.bin"
    write_dataflash(path, estimated=False, attitude=False)
    loaded = read(path)
    assert len(loaded.track) == COUNT
    assert any("has no POS messages" in warning for warning in loaded.warnings)
    assert np.isnan(loaded.track.attitude_deg).all()


def test_telemetry_of_two_vehicles_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "two.tlog"
    write_tlog(path, systems=(1, 7))
    with pytest.raises(
        TrackError,
        match=r"two\.tlog: the log has positions of 2 vehicles \(system IDs 1, 7\); choose one with --system",
    ):
        read(path)


def test_telemetry_cut_off_in_a_packet_keeps_what_came_before(tmp_path: Path) -> None:
    path = tmp_path / "cut.tlog"
    write_tlog(path)
    path.write_bytes(path.read_bytes()[:-50])
    assert COUNT - 1 <= len(read(path).track) <= COUNT


def test_dataflash_with_damaged_bytes_says_so(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "damaged.bin"
    write_dataflash(path)
    content = path.read_bytes()
    middle = content.index(b"\xa3\x95\x01", len(content) // 2)
    path.write_bytes(content[:middle] + b"garbage" + content[middle:])
    loaded = read(path)
    assert len(loaded.track) == COUNT
    assert any("damaged" in warning for warning in loaded.warnings)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("ending", READERS)
@pytest.mark.parametrize("content", [b"", b"\x00" * 2000, b"time,lat\n1,2\n", bytes(range(256)) * 8])
def test_files_that_are_no_log(tmp_path: Path, ending: str, content: bytes) -> None:
    path = tmp_path / f"x{ending}"
    path.write_bytes(content)
    with pytest.raises(TrackError, match=f"x{ending}: "):
        read(path)


@pytest.mark.parametrize("name", ["x.bin", "x.ulg"])
def test_a_log_that_ends_behind_its_first_bytes(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    (write_dataflash if name == "x.bin" else write_ulog)(path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(TrackError, match=f"{name}: "):
        read(path)


def test_without_pyulog_the_way_to_get_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.ulg"
    write_ulog(path)
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(TrackError, match=r"pip install pyulog"):
        read(path)


@pytest.mark.parametrize(
    ("point", "message"),
    [
        (
            '<trkpt lat="1" lon="2"><time>2026-01-01T00:00:00Z</time></trkpt>',
            "track point 0: ele is missing; export the track with time and height",
        ),
        (
            '<trkpt lat="x" lon="2"><ele>3</ele><time>2026-01-01T00:00:00Z</time></trkpt>',
            "lat must be a number, not 'x'",
        ),
        ('<trkpt lat="1" lon="2"><ele>3</ele></trkpt>', "track point 0: time is missing; export the track"),
        (
            '<trkpt lat="1_0" lon="2"><ele>3</ele><time>2026-01-01T00:00:00Z</time></trkpt>',
            "lat must be a number, not '1_0'",
        ),
        (
            '<trkpt lat="1" lon="2"><ele>nan</ele><time>2026-01-01T00:00:00Z</time></trkpt>',
            "ele must be a number, not 'nan'",
        ),
        ('<trkpt lat="99" lon="2"><ele>3</ele><time>{time}</time></trkpt>', "not a position on Earth"),
        ("", "no track points"),
    ],
)
def test_gpx_mistakes(tmp_path: Path, point: str, message: str) -> None:
    path = tmp_path / "x.gpx"
    write_gpx(path, point=point)
    with pytest.raises(TrackError, match=message):
        read(path)


@pytest.mark.parametrize("content", ["<!DOCTYPE x [<!ENTITY a 'b'>]><gpx/>", "<kml/>", "<gpx>"])
def test_xml_that_is_no_gpx(tmp_path: Path, content: str) -> None:
    path = tmp_path / "x.gpx"
    path.write_text(content)
    with pytest.raises(TrackError, match=r"x\.gpx: "):
        read(path)


# Assembly


def rows(times: list[float], *, lat: float = 36.5) -> np.ndarray:
    return np.array([[t, lat, -84.2, 480.0] for t in times])


def test_positions_before_the_fix_and_repeated_times_are_left_out_and_said() -> None:
    positions = rows([1.0, 2.0, 3.0, 3.0, 4.0])
    positions[0, 1:3] = 0.0
    loaded = assemble_track(Path("x"), LoggedRows(positions, np.empty((0, 4))), FRAME)
    assert loaded.track.time_s.tolist() == [2.0, 3.0, 4.0]
    assert [warning.split(": ")[1][:1] for warning in loaded.warnings] == ["1", "1", "3"]


def test_time_that_goes_back_is_refused() -> None:
    with pytest.raises(TrackError, match=r"goes back from 3.000 s to 1.500 s at position 2"):
        assemble_track(Path("x"), LoggedRows(rows([1.0, 3.0, 1.5, 4.0]), np.empty((0, 4))), FRAME)


def test_positions_in_another_order_are_left_out() -> None:
    loaded = assemble_track(Path("x"), LoggedRows(rows([1.0, 3.0, 2.5, 2.9, 4.0]), np.empty((0, 4))), FRAME)
    assert loaded.track.time_s.tolist() == [1.0, 3.0, 4.0]
    assert "2 repeated or late positions were ignored" in loaded.warnings[0]


def test_attitude_is_read_only_where_there_is_some_near() -> None:
    attitudes = np.array([[1.0, 10.0, 0.0, 350.0], [1.5, 20.0, 0.0, 10.0], [9.0, 0.0, 0.0, 0.0], [9.5, 0.0, 0.0, 0.0]])
    loaded = assemble_track(Path("x"), LoggedRows(rows([0.5, 1.25, 5.0, 9.25, 10.4, 10.6]), attitudes), FRAME)
    np.testing.assert_allclose(
        loaded.track.attitude_deg,
        [[10.0, 0.0, 350.0], [15.0, 0.0, 0.0], [np.nan] * 3, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [np.nan] * 3],
        atol=1e-9,
    )


@pytest.mark.parametrize("system", [1, 7])
def test_one_vehicle_of_several_is_chosen(tmp_path: Path, system: int) -> None:
    path = tmp_path / "two.tlog"
    write_tlog(path, systems=(1, 7))
    assert len(read_foreign_log(path, FRAME, system=system).track) == COUNT
    with pytest.raises(TrackError, match="has no vehicle with system ID 3; set --system to one of 1, 7"):
        read_foreign_log(path, FRAME, system=3)


@pytest.mark.parametrize(
    ("kind", "autopilot"),
    [(6, 8), (6, 0), (5, 3), (18, 8), (26, 8)],
    ids=["QGC", "generic", "tracker", "companion", "gimbal"],
)
def test_what_is_no_vehicle_is_none_of_several(tmp_path: Path, kind: int, autopilot: int) -> None:
    path = tmp_path / "station.tlog"
    write_tlog(path, stations=((255, kind, autopilot),))
    track = read(path).track
    np.testing.assert_allclose(track.geodetic[:, :2], flight()[0][:, 1:3], atol=0.51e-7)
    with pytest.raises(TrackError, match="has no vehicle with system ID 255; set --system to one of 1"):
        read_foreign_log(path, FRAME, system=255)


@pytest.mark.parametrize("receiver", ["vehicle_gps_position", "sensor_gps"])
def test_a_ulog_without_an_estimate_has_the_positions_of_its_receiver(tmp_path: Path, receiver: str) -> None:
    path = tmp_path / "flight.ulg"
    write_ulog(path, receiver=receiver)
    loaded = read(path)
    positions, _ = flight()
    # The first row has no fix.
    np.testing.assert_allclose(loaded.track.geodetic[:, :2], positions[1:, 1:3], atol=1.01e-7)
    np.testing.assert_allclose(loaded.track.geodetic[:, 2], positions[1:, 3], atol=2e-3)
    assert any("using its receiver's positions" in warning for warning in loaded.warnings)


@pytest.mark.parametrize("name", WRITERS)
def test_ground_that_a_rangefinder_measured_comes_back(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    assert read(path).track.ranged.shape == (0, 3)
    WRITERS[name](path, ranging=True)
    track = read(path).track
    # All but the last reading, after the last position, or the first, before the first attitude.
    assert COUNT - 2 <= len(track.ranged) <= COUNT
    np.testing.assert_allclose(track.ranged[:, 2], GROUND_M, atol=0.12)
    positions = FRAME.enu_from_geodetic(*track.ranged.T)
    # Not below the vehicle, which leans by up to 10 degrees.
    assert 3.0 < np.abs(positions[: COUNT - 2, 1] - track.enu_m[: COUNT - 2, 1]).max() < 25.0


@pytest.mark.parametrize(("name", "count"), [("flight.tlog", COUNT - 1), ("flight.BIN", COUNT), ("flight.ulg", 0)])
def test_the_terrain_data_of_the_vehicle_comes_back_where_it_knew_the_ground(
    tmp_path: Path, name: str, count: int
) -> None:
    path = tmp_path / name
    WRITERS[name](path, ranging=True)
    stored = read(path).track.stored
    assert len(stored) == count
    assert (stored[:, 2] == 409.0).all()


DATA = Path(__file__).with_name("data")
HOME = LocalFrame(36.4762, -84.216, 485.424)
SQUARE_M = np.array([(0.0, 30.0, 25.0), (40.0, 30.0, 25.0), (40.0, 70.0, 25.0), (0.0, 70.0, 25.0), (0.0, 0.0, 25.0)])
LOGS = sorted(path.name for path in DATA.iterdir())


def track(name: str) -> Track:
    return read_foreign_log(DATA / name, HOME).track


@pytest.mark.parametrize("name", LOGS)
def test_the_flown_square_is_in_the_log(name: str) -> None:
    flown = track(name)
    for corner in SQUARE_M:
        assert np.linalg.norm(flown.enu_m - corner, axis=1).min() < 3.0
    # Home's height is only as good as a barometer.
    np.testing.assert_allclose(flown.enu_m[[0, -1]], 0.0, atol=1.5)
    assert flown.enu_m[:, 2].max() < 28.0
    assert (np.diff(flown.time_s) > 0.0).all()


@pytest.mark.parametrize("name", LOGS)
def test_attitudes_are_those_of_a_flight_with_the_nose_along_the_path(name: str) -> None:
    flown = track(name)
    assert np.abs(flown.attitude_deg[:, :2]).max() < 45.0
    assert (east := np.gradient(flown.enu_m[:, 0], flown.time_s) > 3.0).sum() > 10
    assert np.median(np.abs(flown.attitude_deg[east, 2] - 90.0)) < 10.0


@pytest.mark.parametrize("name", ["arducopter_square.bin", "arducopter_square.tlog"])
def test_reported_velocities_agree_with_the_positions_and_turned_ones_do_not(name: str) -> None:
    flown, limits = track(name), motion_limits(Vehicle(), Wind())

    def judged(velocity_m_s: np.ndarray) -> Motion:
        return judge_motion(flown.time_s, flown.enu_m, limits, max_gap_s=2.0, velocity_m_s=velocity_m_s)

    assert ((motion := judged(flown.velocity_enu_m_s)).moves, motion.contradiction) == ((), None)
    assert np.isfinite(flown.velocity_enu_m_s).all(axis=1).mean() > 0.95
    assert judged(flown.velocity_enu_m_s[:, [1, 0, 2]]).contradiction is not None


def test_two_logs_of_one_flight_tell_the_same() -> None:
    """The autopilot's own log and what it told the ground station, by the same clock."""
    own, reported = track("arducopter_square.bin"), track("arducopter_square.tlog")
    inside = (own.time_s > reported.time_s[0]) & (own.time_s < reported.time_s[-1])
    assert inside.sum() > 300
    for axis in range(3):
        expected = np.interp(own.time_s[inside], reported.time_s, reported.enu_m[:, axis])
        assert np.abs(own.enu_m[inside, axis] - expected).max() < 0.5
