"""Pictures of flight logs: where they were taken, and how a camera that hangs on the vehicle looked."""

import numpy as np
import pytest

from tests.naive.photos import _rotation as rotation
from tests.verification.track_logs.samples import (
    FRAME,
    flight,
    photos_at,
    write_dataflash,
    write_gpx,
    write_tlog,
    write_ulog,
)
from uavcover.errors import TrackError
from uavcover.extras.photos.placing import Assumptions, locate_photos
from uavcover.extras.photos.readers import read_photos
from uavcover.model.sensor import FrameCamera

WRITERS = {"x.tlog": write_tlog, "x.bin": write_dataflash, "x.ulg": write_ulog}
SAMPLES = [4, 11, 12, 25, 38]
CAMERA = FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=45.0, range_m=200.0)
STABILISED = FrameCamera(
    kind="frame-camera", fov_across_deg=60.0, fov_along_deg=45.0, range_m=200.0, mount="stabilised"
)


@pytest.mark.parametrize("name", WRITERS)
def test_pictures_of_a_log_are_where_they_were_taken(tmp_path, name):
    WRITERS[name](tmp_path / name, photos=photos_at(SAMPLES))
    found = read_photos([tmp_path / name])
    positions, _ = flight()
    reported = np.array([(p.lat_deg, p.lon_deg) for p in found.photos])
    np.testing.assert_allclose(reported, positions[SAMPLES, 1:3], atol=2e-7)
    # A picture is noted 0.05 s before its sample, and the vehicle climbs 2.5 m/s: its height is that of its time in the log.
    assert [p.alt_m for p in found.photos] == pytest.approx(positions[SAMPLES, 3].tolist(), abs=0.55)
    assert [p.name for p in found.photos] == [f"x-{k:04d}" for k in range(1, 6)]
    assert f"5 photos of {name}" in found.notes


@pytest.mark.parametrize("name", WRITERS)
def test_a_fixed_camera_leans_as_its_vehicle_does(tmp_path, name):
    WRITERS[name](tmp_path / name, photos=photos_at(SAMPLES))
    photos = read_photos([tmp_path / name]).photos
    placed = locate_photos(photos, FRAME, Assumptions(mounted=CAMERA))
    assert placed.direction_known.all()
    for k, photo in enumerate(photos):
        forward, _, down = rotation(photo.vehicle_roll_deg, photo.vehicle_pitch_deg, photo.vehicle_yaw_deg)
        np.testing.assert_allclose(placed.axes[k], down, atol=1e-9)
        np.testing.assert_allclose(placed.tops[k], forward, atol=1e-9)
    level = locate_photos(photos, FRAME, Assumptions(mounted=STABILISED))
    np.testing.assert_allclose(level.axes, np.tile([0.0, 0.0, -1.0], (5, 1)), atol=1e-12)
    unknown = locate_photos(photos, FRAME, Assumptions())
    assert not unknown.direction_known.any()
    assert (unknown.turn_deg == 10.0).all()


def test_pictures_outside_the_track_are_told(tmp_path):
    early, *rest = photos_at(SAMPLES)
    write_ulog(tmp_path / "x.ulg", photos=[type(early)(1.0, early.lat_deg, early.lon_deg, early.number), *rest])
    found = read_photos([tmp_path / "x.ulg"])
    assert len(found.photos) == 4
    assert any(
        "1 photo was taken outside the time of the track and therefore has no height; it is not counted" in note
        for note in found.notes
    )


def test_logs_without_pictures_or_with_pictures_elsewhere_in_time_are_one_line(tmp_path):
    write_tlog(tmp_path / "x.tlog")
    with pytest.raises(TrackError, match="records no photos"):
        read_photos([tmp_path / "x.tlog"])
    positions, _ = flight()
    late = [type(p)(p.time_s + 900.0, p.lat_deg, p.lon_deg, p.number) for p in photos_at(SAMPLES)]
    write_ulog(tmp_path / "x.ulg", photos=late)
    assert positions[-1, 0] < 900.0
    with pytest.raises(TrackError, match="outside the time of the track"):
        read_photos([tmp_path / "x.ulg"])
    write_gpx(tmp_path / "x.gpx")
    with pytest.raises(TrackError, match="neither a photo nor a list"):
        read_photos([tmp_path / "x.gpx"])
