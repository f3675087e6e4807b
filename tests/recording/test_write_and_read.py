"""What is written comes back: the track to the last bit, the cells as they were seen."""

import dataclasses
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rerun_cli.__main__ import __file__ as rerun_cli_main

from tests.recording.conftest import write
from tests.recording.flights import Flight, make_flight
from uavcover.errors import InputError, OutputError
from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, Track
from uavcover.recording import flight as flight_columns
from uavcover.recording import layout
from uavcover.recording.layout import SCENE, RecordingError, describe_recording, read_recorded_track


def rerun(*arguments: str | Path) -> subprocess.CompletedProcess[bytes]:
    program = Path(rerun_cli_main).parent / "rerun"
    return subprocess.run([program, *arguments], capture_output=True, check=False, env={**os.environ, "CI": "1"})


def assert_equal_tracks(one: Track, other: Track) -> None:
    for field in dataclasses.fields(Track):
        expected, found = getattr(one, field.name), getattr(other, field.name)
        assert found.dtype == expected.dtype, field.name
        np.testing.assert_array_equal(found, expected, err_msg=field.name)


def test_track_comes_back_exactly(flight: Flight, recorded: Path) -> None:
    assert_equal_tracks(flight.track, read_recorded_track(recorded))


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="threads are counted by the kernel")
def test_the_threads_of_a_recording_end_when_the_next_one_begins(flight: Flight, tmp_path: Path) -> None:
    """Rerun keeps two of its stream and two of its layout, which only rerun can end: 200 flights had more than a thousand."""

    def threads_after(number: int) -> int:
        write(tmp_path / f"{number}.rrd", flight)
        return len(os.listdir("/proc/self/task"))

    threads = [threads_after(number) for number in range(6)]
    assert max(np.diff(threads[1:])) <= 2


def test_values_without_a_short_decimal_come_back_exactly(flight: Flight, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    n = 50
    track = Track(
        time_s=np.cumsum(rng.uniform(1e-6, 1.0, n)),
        geodetic=rng.uniform(-80.0, 80.0, (n, 3)),
        enu_m=rng.uniform(-100.0, 100.0, (n, 3)) + np.array([-400.0, 400.0, 900.0]),
        attitude_deg=np.where(rng.random((n, 3)) < 0.1, np.nan, rng.uniform(-180.0, 360.0, (n, 3))),
        current_waypoint=rng.integers(-1, 2**40, n),
        **{name: np.where(rng.random(n) < 0.1, np.nan, rng.uniform(-9.0, 9.0, n)) for name in OPTIONAL_COLUMNS},
    )
    unobserved = np.full(flight.coverage.grid.count, np.nan)
    path = write(tmp_path / "f.rrd", dataclasses.replace(flight, track=track, first_observed_s=unobserved, events=()))
    assert_equal_tracks(track, read_recorded_track(path))


def test_a_recording_without_the_optional_columns_is_read(
    flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of versions before there were any."""
    every = flight_columns.track_columns
    monkeypatch.setattr(flight_columns, "track_columns", lambda track: {name: every(track)[name] for name in COLUMNS})
    moving = dataclasses.replace(flight.track, velocity_east_m_s=np.ones(len(flight.track)))
    path = write(tmp_path / "f.rrd", dataclasses.replace(flight, track=moving))
    assert_equal_tracks(dataclasses.replace(moving, velocity_east_m_s=np.empty(0)), read_recorded_track(path))


def test_cells_have_the_colours_of_the_ground_truth_at_every_time(flight: Flight, recorded: Path) -> None:
    start_s, end_s = flight.track.time_s[[0, -1]]
    cells: dict[str, np.ndarray] = {}
    colors: dict[str, list[tuple[float, np.ndarray]]] = {}
    for chunk in RrdReader(recorded).stream():
        if not chunk.entity_path.startswith(f"{layout.COVERAGE}/"):
            continue
        batch = chunk.to_record_batch()
        if chunk.is_static:
            cells[chunk.entity_path] = batch.column(layout.CELL_NUMBERS)[0].values.to_numpy()
            continue
        times = batch.column(layout.TIMELINE).cast("int64").to_numpy() / 1e9
        rows = [row.values.to_numpy() for row in batch.column("Mesh3D:vertex_colors")]
        colors.setdefault(chunk.entity_path, []).extend(zip(times, rows, strict=True))

    assert sorted(np.concatenate(list(cells.values()))) == list(range(flight.coverage.grid.count))
    turned = 0
    for entity, numbers in cells.items():
        history = sorted(colors[entity], key=lambda row: row[0])
        assert history[0][0] == pytest.approx(start_s, abs=1e-9)
        for time_s in [*np.arange(start_s, end_s, 7.37), end_s + 1e-6]:
            # What the viewer shows: the last colours that are not later.
            shown = [rgba for at_s, rgba in history if at_s <= time_s + 1e-9][-1]
            assert (shown.reshape(-1, 4) == shown[::4, None]).all()
            red, green = shown[::4] >> 24, (shown[::4] >> 16) & 255
            green_at_s = flight.first_observed_s[numbers]
            assert (green[green_at_s <= time_s - SCENE.tick_s] > red[green_at_s <= time_s - SCENE.tick_s] * 2).all()
            unobserved = ~(green_at_s <= time_s)
            assert (green[unobserved] <= red[unobserved] * 2).all()
            turned += int((~unobserved).sum())
    assert turned > 0
    assert np.isnan(flight.first_observed_s).any()


def test_coverage_series_ends_at_the_share_that_was_seen(flight: Flight, recorded: Path) -> None:
    chunks = RrdReader(recorded).stream().filter(content=layout.OBSERVED, is_static=False).to_chunks()
    percent = np.concatenate([c.to_record_batch().column("Scalars:scalars").flatten().to_numpy() for c in chunks])
    fraction = flight.coverage.fraction(np.isfinite(flight.first_observed_s))
    assert percent[-1] == pytest.approx(100.0 * fraction, rel=1e-12)
    assert (np.diff(percent) >= 0.0).all()


def test_entities(flight: Flight, recorded: Path) -> None:
    rows = {row.entity: row for row in describe_recording(recorded)}
    expected = {value for name, value in vars(layout).items() if name.isupper() and str(value).startswith("/")}
    expected -= {layout.COVERAGE, layout.MAP, layout.SERIES, layout.OBSTACLES, layout.NO_FLY}
    expected |= {f"{layout.COVERAGE}/*", "/map/area", "/map/fence", "/map/home", "/map/planned"}
    assert expected <= set(rows)
    track = rows[layout.TRACK]
    assert track.timelines == (layout.TIMELINE,)
    assert track.samples == len(flight.track)
    assert (track.start_s, track.end_s) == pytest.approx(tuple(flight.track.time_s[[0, -1]]), abs=1e-9)
    assert rows[layout.BATTERY_PERCENT].samples == len(flight.states) - 1
    assert rows[layout.TERRAIN].timelines == ()
    assert rows[layout.TERRAIN].start_s is None
    assert rows[layout.EVENTS].samples == len(flight.events)


def test_rerun_finds_the_file_valid_and_two_writings_equal(flight: Flight, recorded: Path, tmp_path: Path) -> None:
    again = write(tmp_path / "again.rrd", flight)
    assert rerun("rrd", "verify", recorded).returncode == 0
    compared = rerun("rrd", "compare", recorded, again)
    assert compared.returncode == 0, compared.stderr[:2000]


def test_another_track_is_another_recording(flight: Flight, recorded: Path, tmp_path: Path) -> None:
    shifted = flight.track.enu_m + np.array([1e-9, 0.0, 0.0])
    path = write(
        tmp_path / "f.rrd", dataclasses.replace(flight, track=dataclasses.replace(flight.track, enu_m=shifted))
    )
    one, other = (RrdReader(p).recordings()[0] for p in (recorded, path))
    assert one.recording_id != other.recording_id
    assert one.application_id == other.application_id


@pytest.mark.parametrize("name", ["valley", "two words", "valley, north", "Tal Süd", "v1.2/3", "谷", "x" * 300])
def test_rerun_takes_the_application_id_of_any_scenario_as_it_is(
    flight: Flight, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    scenario = dataclasses.replace(flight.site.scenario, name=name)
    identifier = layout.application_id(dataclasses.replace(flight.site, scenario=scenario))
    rr.RecordingStream(identifier)
    assert "migration" not in capfd.readouterr().err
    other = dataclasses.replace(scenario, name=f"{name}!")
    assert layout.application_id(dataclasses.replace(flight.site, scenario=other)) != identifier


def test_a_scenario_without_a_place_on_earth_has_no_map(nowhere_flight: Flight, tmp_path: Path) -> None:
    path = write(tmp_path / "flight.rrd", nowhere_flight)
    assert_equal_tracks(nowhere_flight.track, read_recorded_track(path))
    assert not [row for row in describe_recording(path) if row.entity.startswith(layout.MAP)]


def test_one_sample_is_a_recording(flight: Flight, tmp_path: Path) -> None:
    track = Track(*(getattr(flight.track, f.name)[:1] for f in dataclasses.fields(Track)))
    unobserved = np.full(flight.coverage.grid.count, np.inf)
    path = write(tmp_path / "flight.rrd", dataclasses.replace(flight, track=track, first_observed_s=unobserved))
    assert_equal_tracks(track, read_recorded_track(path))


def test_size_at_forty_thousand_cells(tmp_path: Path) -> None:
    flight = make_flight("jacksboro", cell_size_m=5.0, line_spacing_m=150.0, speed_m_s=10.0, rate_hz=10.0)
    assert flight.coverage.grid.count == 40_000
    assert len(flight.track) > 7_000
    assert write(tmp_path / "flight.rrd", flight).stat().st_size < 15_000_000


def test_nothing_but_the_recording_is_left_and_its_mode_is_usual(recorded: Path) -> None:
    assert [p.name for p in recorded.parent.iterdir()] == ["flight.rrd"]
    usual = recorded.parent / "usual"
    usual.touch()
    assert recorded.stat().st_mode == usual.stat().st_mode
    usual.unlink()


def test_strict_mode_is_put_back(recorded: Path) -> None:
    assert recorded.exists()
    assert not rr.error_utils.strict_mode()


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_file_is_refused(recorded: Path, tmp_path: Path, keep: float) -> None:
    data = recorded.read_bytes()
    path = tmp_path / "cut.rrd"
    path.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(RecordingError, match=r"cut\.rrd"):
        read_recorded_track(path)
    with pytest.raises(RecordingError, match=r"cut\.rrd"):
        describe_recording(path)


def test_other_files_are_refused(recorded: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.rrd"
    other.write_text("time_s,lat_deg\n" * 1000)
    with pytest.raises(RecordingError, match="this is not a complete rerun recording"):
        read_recorded_track(other)
    with pytest.raises(RecordingError, match="no such file"):
        read_recorded_track(tmp_path / "missing.rrd")
    with pytest.raises(RecordingError, match="no such file"):
        read_recorded_track(recorded.parent)
    foreign = tmp_path / "foreign.rrd"
    with rr.RecordingStream("somebody_else", send_properties=False) as stream:
        stream.save(foreign)
        stream.log("points", rr.Points3D([[1.0, 2.0, 3.0]]), static=True)
    with pytest.raises(RecordingError, match="contains no uavcover track"):
        read_recorded_track(foreign)
    assert issubclass(RecordingError, InputError)


def test_damaged_bytes_are_refused_or_read_exactly(flight: Flight, recorded: Path, tmp_path: Path) -> None:
    data = bytearray(recorded.read_bytes())
    rng = np.random.default_rng(3)
    path = tmp_path / "damaged.rrd"
    for at in rng.integers(0, len(data), 12):
        damaged = data.copy()
        damaged[at : at + 64] = bytes(64)
        path.write_bytes(damaged)
        try:
            track = read_recorded_track(path)
        except RecordingError:
            continue
        assert len(track) == len(flight.track)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"first_observed_s": np.zeros(3)}, "first_observed_s has shape"),
        ({"first_observed_s": "late"}, "outside the flight"),
        ({"track": "empty"}, "no samples"),
        ({"track": "standing"}, "does not increase at sample 5"),
    ],
)
def test_what_does_not_fit_is_refused(flight: Flight, tmp_path: Path, change: dict, message: str) -> None:
    track = flight.track
    if change.get("track") == "empty":
        change = {"track": Track(*(getattr(track, f.name)[:0] for f in dataclasses.fields(Track)))}
    elif change.get("track") == "standing":
        change = {"track": dataclasses.replace(track, time_s=np.minimum(track.time_s, track.time_s[4]))}
    elif isinstance(change.get("first_observed_s"), str):
        change = {"first_observed_s": np.full(flight.coverage.grid.count, track.time_s[-1] + 1.0)}
    with pytest.raises(RecordingError, match=message):
        write(tmp_path / "flight.rrd", dataclasses.replace(flight, **change))
    assert list(tmp_path.iterdir()) == []


def test_nowhere_to_write(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        write(tmp_path / "missing" / "flight.rrd", flight)


def test_arguments_are_left_alone(flight: Flight, tmp_path: Path) -> None:
    first_observed_s, waypoints_m = flight.first_observed_s.copy(), flight.planned.waypoints_m.copy()
    write(tmp_path / "flight.rrd", flight)
    np.testing.assert_array_equal(flight.first_observed_s, first_observed_s)
    np.testing.assert_array_equal(flight.planned.waypoints_m, waypoints_m)


def test_a_failed_write_leaves_the_old_file(flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "flight.rrd"
    path.write_text("old")
    monkeypatch.setattr("uavcover.recording.writer.begin_recording", _fail)
    with pytest.raises(KeyboardInterrupt):
        write(path, flight)
    assert [p.name for p in tmp_path.iterdir()] == ["flight.rrd"]
    assert path.read_text() == "old"


def _fail(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
def test_a_full_disk_is_an_error(tmp_path: Path) -> None:
    program = """
        import resource, sys
        from pathlib import Path
        from tests.recording.conftest import write
        from tests.recording.flights import make_flight
        from uavcover.errors import OutputError
        flight = make_flight("paper-R2", cell_size_m=0.5, line_spacing_m=2.0, speed_m_s=0.5, rate_hz=5.0)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        try:
            write(Path(sys.argv[1]) / "flight.rrd", flight)
        except OutputError as error:
            sys.exit(0 if "cannot be written (File too large)" in str(error) else 3)
        sys.exit(4)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program), tmp_path], check=False, capture_output=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.iterdir()) == []
