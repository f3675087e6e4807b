"""Pictures that foreign logs tell of: those that came back count, what the track contradicts does not."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.verification.flights import Flight
from tests.verification.flights import make_site as nimble_site
from tests.verification.track_logs.samples import (
    COUNT,
    FRAME,
    Photo,
    photos_at,
    write_dataflash,
    write_tlog,
    write_ulog,
)
from uavcover.errors import TrackError
from uavcover.model.sensor import SphereSensor
from uavcover.model.track import ReadTrack
from uavcover.verification.observations import reports_photos
from uavcover.verification.track_logs.logged_rows import LoggedRows
from uavcover.verification.track_logs.readers import LOGS, assemble_track, read_foreign_log

WRITERS = {"x.tlog": write_tlog, "x.bin": write_dataflash, "x.ulg": write_ulog}
formats = pytest.mark.parametrize("name", WRITERS)
SAMPLES = [4, 11, 12, 25, 38]


def read(folder: Path, name: str, photos: list[Photo]) -> ReadTrack:
    WRITERS[name](folder / name, photos=photos)
    return read_foreign_log(folder / name, FRAME)


def samples_of(loaded: ReadTrack) -> list[int]:
    """At which samples the count of pictures rises."""
    return (np.flatnonzero(np.diff(loaded.track.pictures_taken) > 0) + 1).tolist()


@formats
@pytest.mark.parametrize("kind", ["picture", "other"])
def test_every_picture_that_came_back_counts_where_it_was_taken(tmp_path: Path, name: str, kind: str) -> None:
    photos = [dataclasses.replace(each, kind=kind) for each in photos_at(SAMPLES)]
    loaded = read(tmp_path, name, photos)
    assert reports_photos(loaded.track)
    assert samples_of(loaded) == SAMPLES
    assert loaded.track.pictures_taken[-1] == len(SAMPLES)
    # A trigger is told of as what it is; CAMERA_IMAGE_CAPTURED is a picture as CAMERA_FEEDBACK is.
    reported = any("count as photos" in warning for warning in loaded.warnings)
    assert reported == (kind == "other" and name != "x.tlog")


@formats
def test_triggers_beside_pictures_are_not_counted_again(tmp_path: Path, name: str) -> None:
    triggers = [dataclasses.replace(each, kind="other") for each in photos_at([4, 8, 11, 20])]
    loaded = read(tmp_path, name, photos_at([4, 11]) + triggers)
    assert samples_of(loaded) == [4, 11]
    assert not any("count as photos" in warning for warning in loaded.warnings)


@formats
def test_a_log_without_a_camera_message_knows_nothing_of_pictures(tmp_path: Path, name: str) -> None:
    loaded = read(tmp_path, name, [])
    assert np.isnan(loaded.track.pictures_taken).all()
    assert not reports_photos(loaded.track)


@pytest.mark.parametrize("name", ["x.tlog", "x.ulg"])
def test_a_picture_that_failed_or_was_told_of_twice(tmp_path: Path, name: str) -> None:
    good = photos_at(SAMPLES)
    failed = dataclasses.replace(good[1], taken=False)
    again = dataclasses.replace(good[2], time_s=good[2].time_s + 1.0)
    loaded = read(tmp_path, name, [good[0], failed, *good[2:], again])
    assert samples_of(loaded) == [4, 12, 25, 38]
    assert any("failed to take 1 of" in warning for warning in loaded.warnings)
    none = read(tmp_path, name, [dataclasses.replace(each, taken=False) for each in good])
    assert samples_of(none) == []
    assert reports_photos(none.track), "the camera told that it took none"


def test_a_picture_whose_message_the_link_lost_is_counted_by_the_next_one(tmp_path: Path) -> None:
    photos = photos_at(SAMPLES)
    loaded = read(tmp_path, "x.tlog", [*photos[:1], *photos[3:]])
    assert samples_of(loaded) == [4, 25, 38]
    assert loaded.track.pictures_taken[[4, 24, 25, 38]].tolist() == [1.0, 1.0, 4.0, 5.0]


def moved(photo: Photo, rng: np.random.Generator) -> Photo:
    """Somewhere else: farther than any error, up to two kilometres."""
    away_m, angle = rng.uniform(3.0 * LOGS.photo_position_error_m, 2000.0), rng.uniform(0.0, 2.0 * np.pi)
    lat = photo.lat_deg + away_m * np.sin(angle) / 111_000.0
    return dataclasses.replace(photo, lat_deg=lat, lon_deg=photo.lon_deg + away_m * np.cos(angle) / 89_000.0)


def of_another_flight(photo: Photo, rng: np.random.Generator) -> Photo:
    """A time before or after everything that was recorded."""
    return dataclasses.replace(photo, time_s=float(rng.choice([rng.uniform(0.0, 19.9), rng.uniform(29.0, 900.0)])))


def later(photo: Photo, rng: np.random.Generator) -> Photo:
    """A time of the flight when the vehicle was elsewhere: it flies 10 m a second."""
    return dataclasses.replace(photo, time_s=photo.time_s + float(rng.uniform(2.5, 3.5)))


def swapped(photo: Photo, _: np.random.Generator) -> Photo:
    """Latitude and longitude in each other's place."""
    return dataclasses.replace(photo, lat_deg=photo.lon_deg, lon_deg=photo.lat_deg)


FALSIFIED: list[Callable[[Photo, np.random.Generator], Photo]] = [moved, of_another_flight, later, swapped]


@pytest.mark.parametrize("name", ["x.bin", "x.ulg"])
@pytest.mark.parametrize("falsify", FALSIFIED)
@pytest.mark.parametrize("seed", range(4))
def test_what_the_track_contradicts_is_no_picture(
    tmp_path: Path, name: str, falsify: Callable[[Photo, np.random.Generator], Photo], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    samples = sorted(rng.choice(np.arange(2, COUNT - 18), 6, replace=False).tolist())
    photos = photos_at(samples)
    wrong = set(rng.choice(6, int(rng.integers(1, 7)), replace=False).tolist())
    reported = [falsify(each, rng) if k in wrong else each for k, each in enumerate(photos)]
    loaded = read(tmp_path, name, reported)
    assert samples_of(loaded) == [at for k, at in enumerate(samples) if k not in wrong]
    assert reports_photos(loaded.track), "a log whose pictures are all wrong proves none"
    assert any("do not count as evidence" in warning for warning in loaded.warnings)


@pytest.mark.parametrize("seed", range(4))
def test_pictures_of_a_telemetry_log_that_name_another_place(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    photos = photos_at(SAMPLES)
    wrong = set(rng.choice(5, int(rng.integers(1, 5)), replace=False).tolist())
    loaded = read(tmp_path, "x.tlog", [moved(each, rng) if k in wrong else each for k, each in enumerate(photos)])
    assert samples_of(loaded) == [at for k, at in enumerate(SAMPLES) if k not in wrong]


def test_a_capture_without_its_fields_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "x.ulg"
    write_ulog(path, photos=photos_at(SAMPLES))
    path.write_bytes(path.read_bytes().replace(b"int8_t result;", b"int8_t answer;"))
    with pytest.raises(TrackError, match=r"camera_capture messages have no result"):
        read_foreign_log(path, FRAME)


def test_only_pictures_that_came_back_are_seen_by_the_verdict(tmp_path: Path) -> None:
    site = nimble_site(sensor=SphereSensor(kind="sphere", range_m=110.0))
    flight = Flight(site)
    frame, track = site.frame, flight.track
    assert frame is not None
    rows = np.column_stack([track.time_s, track.geodetic])
    attitudes = np.column_stack([track.time_s, track.attitude_deg])
    positions = frame.enu_from_geodetic(*track.geodetic.T)
    reached = [int(np.argmin(np.linalg.norm(positions - point, axis=1))) for point in flight.planned.waypoints_m]

    def verdict(photos: np.ndarray | None):  # type: ignore[no-untyped-def]
        return flight.verify(assemble_track(tmp_path, LoggedRows(rows, attitudes, photos), frame).track)

    without = verdict(None)
    assert any("the vehicle reported no photo" in line for line in without.findings)
    whole = verdict(rows[reached, :3])
    assert not any("photo" in line for line in whole.findings)
    assert whole.coverage_fraction == pytest.approx(without.coverage_fraction, abs=0.01)
    some = verdict(rows[reached[:1], :3])
    assert 0.0 < some.coverage_fraction < whole.coverage_fraction
    assert any("only reported photos count" in line for line in some.findings)
    elsewhere = rows[reached, :3] + [0.0, 0.01, 0.0]
    none = verdict(elsewhere)
    assert none.coverage_fraction == 0.0
    assert not none.passed
