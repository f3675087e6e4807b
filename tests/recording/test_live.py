"""The recording that grows with the flight: whole at its end, readable after a kill, no hindrance when the disk is full."""

import contextlib
import os
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from tests.recording.flights import Flight
from uavcover.kernels.arrays import BoolArray
from uavcover.model.track import Track, TrackSample
from uavcover.recording import layout, viewer
from uavcover.recording.flight import VehicleState
from uavcover.recording.layout import (
    RecordingError,
    describe_recording,
    read_recorded_track,
    read_recorded_track_with_warnings,
    whole_messages,
)
from uavcover.recording.writer import LiveRecording
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.verification.verify import verify_track

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no /dev/fd")

SAMPLES = 400


def samples(flight: Flight) -> list[TrackSample]:
    track = flight.track
    rows = zip(track.time_s, track.geodetic, track.enu_m, track.attitude_deg, track.current_waypoint, strict=True)
    return [
        TrackSample(t, *g, *e, *a, int(w), velocity_north_m_s=e[0] if k else np.nan, velocity_down_m_s=-0.5)
        for k, (t, g, e, a, w) in enumerate(list(rows)[:SAMPLES])
    ]


def test_its_kernel_is_ready_before_the_flight(flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    callers: list[threading.Thread] = []
    observed_by = CoverageMap.observed_by

    def noted(coverage: CoverageMap, observations: LevelObservations) -> BoolArray:
        callers.append(threading.current_thread())
        return observed_by(coverage, observations)

    monkeypatch.setattr(CoverageMap, "observed_by", noted)
    live = LiveRecording(tmp_path / "a", site=flight.site, coverage=flight.coverage, planned=flight.planned)
    assert callers == [threading.main_thread()], "its compiler would stop all threads while the vehicle flies"
    live.close()


@pytest.fixture(scope="module")
def grown(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("live") / "flight.rrd"
    live = LiveRecording(path.with_name(".growing"), site=flight.site, coverage=flight.coverage, planned=flight.planned)
    live.rename(path)
    for sample in samples(flight):
        live.take_sample(sample)
    for event in flight.events:
        live.take_event(event)
    live.take_state(VehicleState(4.0, 15.9, 93.0, 10, 0))
    live.close()
    assert live.error is None
    return path


def test_the_track_comes_back_exactly_and_says_that_it_ends_in_flight(flight: Flight, grown: Path) -> None:
    read = read_recorded_track_with_warnings(grown)
    np.testing.assert_array_equal(read.track.enu_m, flight.track.enu_m[:SAMPLES])
    np.testing.assert_array_equal(read.track.geodetic, flight.track.geodetic[:SAMPLES])
    np.testing.assert_array_equal(read.track.current_waypoint, flight.track.current_waypoint[:SAMPLES])
    np.testing.assert_array_equal(read.track.velocity_north_m_s, np.append(np.nan, flight.track.enu_m[1:SAMPLES, 0]))
    assert (read.track.velocity_down_m_s == -0.5).all()
    assert np.isnan(read.track.pictures_taken).all()
    assert "ends in flight" in read.warnings[0]
    assert os.listdir(grown.parent) == ["flight.rrd"]


def test_everything_is_in_it(flight: Flight, grown: Path) -> None:
    rows = {row.entity: row for row in describe_recording(grown)}
    assert {
        layout.TERRAIN, layout.PLANNED, layout.VEHICLE, layout.CAMERA, layout.FLOWN, layout.FOOTPRINT, layout.HEIGHT_AGL,
        layout.OBSERVED, layout.EVENTS, layout.BATTERY_PERCENT, layout.MAP_VEHICLE, f"{layout.COVERAGE}/*",
    } <= set(rows)  # fmt: skip
    assert rows[layout.EVENTS].samples == len(flight.events)


def test_cells_turn_as_a_level_camera_sees_them(flight: Flight, grown: Path) -> None:
    cells: dict[str, np.ndarray] = {}
    colors: dict[str, np.ndarray] = {}
    for chunk in RrdReader(grown).stream():
        if not chunk.entity_path.startswith(f"{layout.COVERAGE}/"):
            continue
        batch = chunk.to_record_batch()
        if chunk.is_static:
            cells[chunk.entity_path] = batch.column(layout.CELL_NUMBERS)[0].values.to_numpy()
        else:
            colors[chunk.entity_path] = batch.column("Mesh3D:vertex_colors")[-1].values.to_numpy()[::4]
    green = np.zeros(flight.coverage.grid.count, dtype=bool)
    for entity, rgba in colors.items():
        green[cells[entity]] = ((rgba >> 16) & 255) > 2 * (rgba >> 24)
    route = flight.track.current_waypoint[:SAMPLES] >= 1
    np.testing.assert_array_equal(
        green, flight.coverage.observed_by(LevelObservations.towards_north(flight.track.enu_m[:SAMPLES][route]))
    )
    assert green.sum() > 100


@pytest.mark.parametrize("fraction", [0.5, 0.999, 0.99999])
def test_a_file_that_ends_anywhere_gives_what_is_whole(
    flight: Flight, grown: Path, tmp_path: Path, fraction: float
) -> None:
    data = grown.read_bytes()
    cut = data[: int(len(data) * fraction)]
    (tmp_path / "cut.rrd").write_bytes(cut)
    assert 12 < whole_messages(cut) <= len(cut)
    # All samples were sent at once, so there are all of them or none.
    if fraction == 0.5:
        with pytest.raises(RecordingError, match="before its first sample"):
            read_recorded_track(tmp_path / "cut.rrd")
        return
    track = read_recorded_track(tmp_path / "cut.rrd")
    np.testing.assert_array_equal(track.time_s, flight.track.time_s[: len(track)])


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device here that is always full")
def test_a_full_disk_ends_the_recording_and_nothing_else(flight: Flight) -> None:
    live = LiveRecording(Path("/dev/full"), site=flight.site, coverage=flight.coverage, planned=flight.planned)
    for sample in samples(flight):
        live.take_sample(sample)
    live.close()
    assert live.error is not None
    assert "cannot be written" in live.error


def test_at_twenty_moments_the_file_can_be_read(flight: Flight, tmp_path: Path) -> None:
    """What the file holds at a moment is what a kill at that moment leaves."""
    rng = np.random.default_rng(20)
    moments = set(rng.choice(np.arange(5, SAMPLES), 20, replace=False).tolist())
    path = tmp_path / "flight.rrd"
    live = LiveRecording(path, site=flight.site, coverage=flight.coverage, planned=flight.planned)
    try:
        for number, sample in enumerate(samples(flight)):
            live.take_sample(sample)
            if number in moments:
                live.send()
                track = _track_when_copied(path, number + 1)
                np.testing.assert_array_equal(track.enu_m, flight.track.enu_m[: number + 1])
    finally:
        live.close()
    verify_track(flight.site, flight.coverage, track, None)


def _track_when_copied(path: Path, count: int) -> Track:
    """The track of a file, once the bytes that are on their way through the pipe have come to it."""
    deadline = time.monotonic() + 300.0
    while time.monotonic() < deadline:
        with contextlib.suppress(RecordingError):  # nothing of the track has come yet
            track = read_recorded_track(path)
            if len(track) >= count:
                return track
    raise AssertionError(f"{count} samples never came")


_KILLED = """
    import signal, sys
    from pathlib import Path
    from tests.recording.flights import make_flight
    from tests.recording.test_live import samples
    from uavcover.recording.writer import LiveRecording

    flight = make_flight("jacksboro", cell_size_m=20.0, line_spacing_m=90.0, speed_m_s=10.0, rate_hz=5.0, lines=4)
    live = LiveRecording(Path(sys.argv[1]), site=flight.site, coverage=flight.coverage, planned=flight.planned)
    for number, sample in enumerate(samples(flight)):
        live.take_sample(sample)
        if number == 200:
            print("half of it", flush=True)
            signal.pause()
"""


def test_a_kill_leaves_what_the_thread_has_sent_by_itself(flight: Flight, tmp_path: Path) -> None:
    path = tmp_path / "flight.rrd"
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(_KILLED), path], stdout=subprocess.PIPE, text=True,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "half of it\n"
        _track_when_copied(path, 201)
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    np.testing.assert_array_equal(read_recorded_track(path).enu_m, flight.track.enu_m[:201])


def test_a_real_viewer_shows_the_flight_while_it_goes_on(flight: Flight, grown: Path, tmp_path: Path) -> None:
    try:
        with viewer.headless_viewer(grown) as client:
            live = LiveRecording(
                tmp_path / "flight.rrd",
                site=flight.site,
                coverage=flight.coverage,
                planned=flight.planned,
                viewer_url=client.url,
            )
            try:
                ends_s = []
                for part in np.array_split(np.arange(SAMPLES), 2):
                    for number in part:
                        live.take_sample(samples(flight)[number])
                    live.send()
                    ends_s.append(_shown_until_s(client, at_least=flight.track.time_s[part[-1]]))
            finally:
                live.close()
    except RecordingError as error:
        if "no graphics driver" in str(error):
            pytest.skip(str(error))
        raise
    assert live.error is None
    np.testing.assert_allclose(ends_s, flight.track.time_s[[SAMPLES // 2 - 1, SAMPLES - 1]], atol=1e-6)


def _shown_until_s(client: ViewerClient, *, at_least: float) -> float:
    """Where the timeline of what the viewer shows ends, once it has come as far as that."""
    deadline = time.monotonic() + 300.0
    while time.monotonic() < deadline:
        for recording in client.get_state().recordings:
            for timeline in recording.timelines:
                if (
                    timeline.name == layout.TIMELINE
                    and timeline.end is not None
                    and timeline.end / 1e9 >= at_least - 1e-6
                ):
                    return float(timeline.end / 1e9)
    raise AssertionError(f"the viewer never showed {at_least} s")


def test_one_that_was_killed_before_its_first_sample_says_so(flight: Flight, tmp_path: Path) -> None:
    path = tmp_path / "flight.rrd"
    LiveRecording(path, site=flight.site, coverage=flight.coverage, planned=flight.planned).close()
    assert layout.TERRAIN in {row.entity for row in describe_recording(path)}
    with pytest.raises(
        RecordingError, match=r"flight\.rrd: the recording ends before its first sample; use track\.csv"
    ):
        read_recorded_track(path)
