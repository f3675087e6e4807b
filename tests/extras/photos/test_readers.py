"""Pictures' metadata of several makers, lists of pictures, and files that are none of these."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.extras.photos.camera_files import XMP, dji, write_jpeg
from tests.naive.photos import _rotation as rotation
from uavcover.errors import TrackError
from uavcover.extras.photos.photo import HeightDatum, Photo, finite
from uavcover.extras.photos.photo_verdict import clocks_of
from uavcover.extras.photos.readers import read_photo, read_photos
from uavcover.sensing.photos import camera_axes

POSITION = (-36.47625431, -84.21604127)
PIX4D = 'xmlns:Camera="http://pix4d.com/camera/1.0"'
PARROT = 'xmlns:drone-parrot="http://www.parrot.com/drone-parrot/1.0/"'


def only(*sources):
    found = read_photos(sources)
    assert len(found.photos) == 1
    return found.photos[0]


def test_exif_places_a_picture(tmp_path):
    write_jpeg(tmp_path / "a.jpg", position=POSITION, alt_m=412.5)
    photo = only(tmp_path)
    assert (photo.lat_deg, photo.lon_deg) == pytest.approx(POSITION, abs=1e-9)
    assert (photo.alt_m, photo.datum) == (412.5, HeightDatum.SEA_LEVEL)
    assert (photo.pixels, photo.focal_length_mm, photo.focal_length_35mm) == ((5280, 3956), 12.29, 24.0)
    assert photo.exposure_s == pytest.approx(0.001)
    assert photo.camera == "DJI M3E"
    assert not photo.has_direction
    assert photo.lacks() is None


@pytest.mark.parametrize(
    ("below", "alt_m", "datum"),
    [(0, 7.0, "sea level"), (1, -7.0, "sea level"), (2, 7.0, "ellipsoid"), (3, -7.0, "ellipsoid")],
)
def test_the_reference_of_a_height_counts(tmp_path, below, alt_m, datum):
    write_jpeg(tmp_path / "a.jpg", position=POSITION, alt_m=7.0, below=below)
    photo = only(tmp_path)
    assert (photo.alt_m, photo.datum) == (alt_m, datum)


def test_dji_tells_the_gimbal_and_a_fixed_solution_is_above_the_ellipsoid(tmp_path):
    reported = dji(
        GpsLatitude=POSITION[0], GpsLongtitude=POSITION[1], AbsoluteAltitude="+380.25", RelativeAltitude="+81.00",
        GimbalYawDegree="+45.10", GimbalPitchDegree="-89.90", GimbalRollDegree="+180.00", FlightYawDegree="+44.0",
        FlightXSpeed="+3.0", FlightYSpeed="-4.0", RtkFlag="50", RtkStdLat="0.011", RtkStdLon="0.013", RtkStdHgt="0.024",
    )  # fmt: skip
    write_jpeg(tmp_path / "a.jpg", position=(0.0, 0.0), alt_m=1.0, xmp=reported)
    photo = only(tmp_path)
    assert (photo.lat_deg, photo.lon_deg) == POSITION
    assert (photo.alt_m, photo.datum, photo.height_above_takeoff_m) == (380.25, HeightDatum.ELLIPSOID, 81.0)
    assert (photo.yaw_deg, photo.pitch_deg, photo.roll_deg) == (45.1, -89.9, 180.0)
    assert (photo.horizontal_error_m, photo.vertical_error_m) == (0.013, 0.024)
    assert photo.speed_m_s == pytest.approx(5.0)


def test_other_makers_tell_angles_in_their_own_ways(tmp_path):
    pix4d = XMP.format(
        spaces=PIX4D,
        attributes='Camera:Yaw="10" Camera:Pitch="5" Camera:Roll="-2" Camera:GPSXYAccuracy="3/2" Camera:GPSZAccuracy="4"',
    )
    parrot = XMP.format(
        spaces=PARROT,
        attributes='drone-parrot:CameraYawDegree="20" drone-parrot:CameraPitchDegree="-80" drone-parrot:CameraRollDegree="1"',
    )
    for name, xmp in (("a.jpg", pix4d), ("b.jpg", parrot)):
        write_jpeg(tmp_path / name, position=(10.0, 20.0 if name == "a.jpg" else 20.1), alt_m=50.0, xmp=xmp)
    one, other = read_photos([tmp_path]).photos
    assert (one.yaw_deg, one.pitch_deg, one.roll_deg) == (10.0, -85.0, -2.0)
    assert (one.horizontal_error_m, one.vertical_error_m) == (1.5, 4.0)
    assert (other.yaw_deg, other.pitch_deg, other.roll_deg) == (20.0, -80.0, 1.0)


@pytest.mark.parametrize("xmp", ["<x:xmpmeta", '<!DOCTYPE a [<!ENTITY b "c">]><x:xmpmeta/>', "\x00", "<a>" * 2000])
def test_xmp_that_is_damaged_or_dangerous_is_left_out(tmp_path, xmp):
    write_jpeg(tmp_path / "a.jpg", position=POSITION, alt_m=1.0, xmp=xmp)
    assert not only(tmp_path).has_direction


def test_bands_of_one_moment_are_one_picture(tmp_path):
    for band in range(5):
        write_jpeg(tmp_path / f"IMG_0001_{band}.jpg", position=POSITION, alt_m=99.0)
    write_jpeg(tmp_path / "IMG_0002_1.jpg", position=POSITION, alt_m=99.5, time="2026:05:04 10:11:14")
    found = read_photos([tmp_path])
    assert [photo.name for photo in found.photos] == ["IMG_0001_0.jpg", "IMG_0002_1.jpg"]
    assert "4 of 6 files" in found.notes[0]


def test_cards_with_the_same_names_are_kept_apart(tmp_path):
    for card, lon in (("100MEDIA", 20.0), ("101MEDIA", 21.0)):
        (tmp_path / card).mkdir()
        write_jpeg(tmp_path / card / "DJI_0001.JPG", position=(10.0, lon), alt_m=5.0)
    assert sorted(photo.lon_deg for photo in read_photos([tmp_path]).photos) == pytest.approx([20.0, 21.0])


def test_lists_that_count_from_one_lose_no_picture(tmp_path):
    row = "1\t{:.1f}\t[2065]\t 0,N\t 0,E\t 0,V\t43.1,Lat\t{},Lon\t245.1,Ellh\t0.01, 0.01, 0.02\t50,Q\n"
    for number, card in enumerate(("a", "b")):
        (tmp_path / f"{card}.MRK").write_text(row.format(10.0 + number, number) + row.format(20.0 + number, 5 + number))
    found = read_photos([tmp_path / "a.MRK", tmp_path / "b.MRK"])
    assert [p.name for p in found.photos] == ["0001", "b.MRK: 0001", "a.MRK: 0001", "b.MRK: 0001 (2)"]
    assert [p.lon_deg for p in found.photos] == [0.0, 1.0, 5.0, 6.0]


def test_geo_txt_moves_pictures_and_keeps_what_only_they_tell(tmp_path):
    reported = dji(AbsoluteAltitude="1", GimbalYawDegree="5", GimbalPitchDegree="-90", GimbalRollDegree="0")
    write_jpeg(tmp_path / "DJI_1.JPG", position=(0.5, 0.5), alt_m=1.0, xmp=reported)
    (tmp_path / "geo.txt").write_text("WGS84 UTM 16N\nDJI_1.JPG 500000.0 0.0 512.5 0 0 0 0.02 0.03\n")
    photo = only(tmp_path)
    assert (photo.lat_deg, photo.lon_deg) == pytest.approx((0.0, -87.0), abs=1e-7)
    assert (photo.alt_m, photo.horizontal_error_m, photo.vertical_error_m) == (512.5, 0.02, 0.03)
    assert photo.yaw_deg == 5.0


def test_other_lists(tmp_path):
    (tmp_path / "a_Timestamp.MRK").write_text(
        "1\t284364.470178\t[2065]\t    36,N\t     0,E\t   193,V\t43.14136393,Lat\t-1.44395281,Lon\t245.124,Ellh\t"
        "0.013021, 0.012437, 0.029812\t50,Q\n"
    )
    mrk = only(tmp_path / "a_Timestamp.MRK")
    assert (mrk.lat_deg, mrk.lon_deg, mrk.alt_m, mrk.datum) == (43.14136393, -1.44395281, 245.124, "ellipsoid")
    assert (mrk.horizontal_error_m, mrk.vertical_error_m) == (0.013021, 0.029812)
    row = {"filename": "x.jpg", "latitude": 1.5, "longitude": 2.5, "altitude": 80.0, "yaw": 30, "pitch": 10, "roll": 0}
    (tmp_path / "images.json").write_text(json.dumps([row]))
    odm = only(tmp_path / "images.json")
    assert (odm.yaw_deg, odm.pitch_deg) == (30.0, -80.0)
    (tmp_path / "tagged.csv").write_text(
        "\ufeffImage Name;Latitude;Longitude;Altitude;Yaw;Pitch;Roll\np1;1;2;3;4;-90;0\n"
    )
    table = only(tmp_path / "tagged.csv")
    assert (table.name, table.lat_deg, table.lon_deg, table.alt_m, table.pitch_deg) == ("p1", 1.0, 2.0, 3.0, -90.0)
    (tmp_path / "rtk.csv").write_text("name,lat,lon,ellh\np1,1,2,3\n")
    assert only(tmp_path / "rtk.csv").datum is HeightDatum.ELLIPSOID


BAD = {
    "nothing": (None, "no photos"),
    "empty.txt": ("", "is empty"),
    "geo.txt": ("EPSG:99999999\na 1 2 3\n", "not a projection"),
    "words.txt": ("EPSG:4326\na b c\n", "line 2"),
    "list.json": ("{}", "not an ODM list"),
    "torn.json": ("[", "the file is not valid JSON"),
    "a.MRK": ("1 2 3\n", "not a row of a DJI image log"),
    "a.csv": ("a,b\n1,2\n", "no column for name, lat_deg, lon_deg, alt_m"),
    "b.csv": ("name,lat,lon,alt\nx,1,2,high\n", "line 2: alt_m: 'high'"),
    "c.csv": ("", "is empty"),
    "d.csv": ("name,lat,lon,alt\nx,8 deg 61' 1\" N,2,3\n", "line 2: lat_deg: "),
    "e.csv": ("name,lat,lon,alt\nx,8 deg 1' 1\" E,2,3\n", "line 2: lat_deg: "),
    "f.csv": ("name,lat,lon,alt\nx,1,5,2,5,3\n", "line 2: 6 cells, but the header has 4 .*decimal points"),
    "g.csv": ("name;lat;lon;alt\nx;1,5;2.5;3\n", "decimal commas .* and decimal points"),
    "a.jpg": ("not a picture", "the photo cannot be read"),
    "a.raw": ("x", "neither a photo nor a list"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_one_line(tmp_path, name):
    text, words = BAD[name]
    if text is None:
        source = tmp_path
    else:
        source = tmp_path / name
        source.write_text(text)
    with pytest.raises(TrackError, match=words) as raised:
        read_photos([source])
    assert str(tmp_path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_file_that_is_not_there_is_said():
    with pytest.raises(TrackError, match="no such file or folder"):
        read_photos([Path("/nowhere/at/all")])


@pytest.mark.parametrize("seed", range(5))
def test_camera_axes_are_those_of_a_body_that_turns(seed):
    """A gimbal that looks ahead at pitch 0 is a body's forward axis; the top of its picture is the body's up."""
    yaw, pitch, roll = np.random.default_rng(seed).uniform(-180.0, 180.0, 3)
    axes, tops = camera_axes(np.array([yaw]), np.array([pitch]), np.array([roll]))
    forward, _, down = rotation(roll, pitch, yaw)
    np.testing.assert_allclose(axes[0], forward, atol=1e-12)
    np.testing.assert_allclose(tops[0], -down, atol=1e-12)


def test_numbers_as_files_hold_them():
    assert [finite(v) for v in ("+1.5", "3/2", 2, "1/0", "nan", "x", None, "1/2/3")] == [
        1.5, 1.5, 2.0, None, None, None, None, None,
    ]  # fmt: skip


def test_copies_and_views_from_one_place_count_once_whatever_their_times(tmp_path):
    for number, pitch in enumerate(("-90", "-90", "-90", "-45")):
        reported = dji(AbsoluteAltitude="500", GimbalYawDegree="5", GimbalPitchDegree=pitch, GimbalRollDegree="0")
        write_jpeg(
            tmp_path / f"a{number}.jpg", position=(1.0, 2.0), time=f"2026:05:04 10:11:{10 + number}", xmp=reported
        )
    write_jpeg(tmp_path / "b1.jpg", position=(1.0, 3.0), alt_m=5.0, time="")
    write_jpeg(tmp_path / "b2.jpg", position=(1.0, 3.0), alt_m=5.0, time="")
    found = read_photos([tmp_path])
    assert [photo.name for photo in found.photos] == ["a0.jpg", "a3.jpg", "b1.jpg"]
    assert any("3 of 6 photos have the same position and direction" in note for note in found.notes)


def test_broken_files_in_a_folder_do_not_count_and_say_why(tmp_path):
    for number in range(4):
        write_jpeg(tmp_path / f"{number}.jpg", position=(1.0 + number, 2.0), alt_m=5.0, pixels=(40_000, 30_000))
    whole = (tmp_path / "1.jpg").read_bytes()
    (tmp_path / "1.jpg").write_bytes(whole[:-20])
    (tmp_path / "2.jpg").write_bytes(b"")
    (tmp_path / "._3.jpg").write_bytes(b"of another operating system")
    (tmp_path / "padded.jpg").write_bytes(whole.replace(b"2026:05", b"2026:06") + bytes(100_000))
    why = {photo.name: photo.lacks() for photo in read_photos([tmp_path]).photos}
    assert set(why) == {"0.jpg", "1.jpg", "2.jpg", "3.jpg", "padded.jpg"}
    assert (why["0.jpg"], why["3.jpg"], why["padded.jpg"]) == (None, None, None)
    assert why["1.jpg"] == "the file is truncated; copy it again from the memory card"
    assert why["2.jpg"].startswith("the photo cannot be read")
    with pytest.raises(TrackError, match="the photo cannot be read"):
        read_photos([tmp_path / "2.jpg"])
    for name in ("0.jpg", "1.jpg", "3.jpg", "padded.jpg"):
        (tmp_path / name).unlink()
    with pytest.raises(TrackError, match=r"2\.jpg: the photo cannot be read"):
        read_photos([tmp_path])


def test_a_digital_zoom_does_not_count():
    assert Photo(name="a", lat_deg=1.0, lon_deg=1.0, alt_m=1.0, digital_zoom=1.0).lacks() is None
    zoomed = Photo(name="a", lat_deg=1.0, lon_deg=1.0, alt_m=1.0, digital_zoom=2.0)
    assert zoomed.lacks() == "the field of view is unknown with a digital zoom of 2; do not zoom digitally"


def test_the_time_of_a_camera_without_a_zone_is_its_clocks_and_no_ones_else(tmp_path):
    written = {
        "local": {},
        "zone": {"zone": "+02:00"},
        "west": {"zone": "-03:30"},
        "odd zone": {"zone": "CEST"},
        "satellites": {"satellites": ("2026:05:04", (8, 11, 11.5))},
        "odd satellites": {"satellites": ("2026:05:04", (25, 11, 11))},
    }
    read = {}
    for number, (name, reported) in enumerate(written.items()):
        write_jpeg(tmp_path / f"{number}.jpg", position=(1.0, 2.0), alt_m=5.0, **reported)
        read[name] = read_photo(tmp_path / f"{number}.jpg")
    local_s = read["local"].time_s
    assert (read["local"].clock, read["local"].utc_s) == ("the clock of DJI M3E", None)
    assert (read["zone"].clock, read["zone"].utc_s) == ("UTC", local_s - 7200.0)
    assert read["zone"].time_s == read["zone"].utc_s
    assert read["west"].utc_s == local_s + 12600.0
    assert (read["odd zone"].clock, read["odd zone"].utc_s) == ("the clock of DJI M3E", None)
    assert read["satellites"].utc_s == local_s - 7200.5
    assert read["satellites"].time_s == local_s
    assert read["odd satellites"].utc_s is None


def test_pictures_of_two_clocks_are_in_order_within_each(tmp_path):
    for number, (model, second, reported) in enumerate(
        [("M3E", 15, {"satellites": ("2026:05:04", (8, 11, 14))}), ("P1", 12, {}), ("M3E", 11, {}), ("P1", 13, {})]
    ):
        moment = f"2026:05:04 10:11:{second}"
        write_jpeg(
            tmp_path / f"{number}.jpg",
            position=(1.0, 2.0 + number),
            alt_m=5.0,
            model=("DJI", model),
            time=moment,
            **reported,
        )
    found = read_photos([tmp_path])
    assert [photo.name for photo in found.photos] == ["2.jpg", "0.jpg", "1.jpg", "3.jpg"]
    assert "times come from 2 clocks (the clock of DJI M3E, the clock of DJI P1)" in found.notes[0]
    first, second = clocks_of(found.photos)
    assert (first["pictures"], first["last_s"] - first["first_s"], first["utc_minus_clock_s"]) == (2, 4.0, -7201.0)
    assert second["utc_minus_clock_s"] is None


_ROW = "1\t303505.678\t[2312]\t   1,N\t  -2,E\t 193,V\t{lat},Lat\t-98.1,Lon\t345.6,Ellh\t0.011, 0.012, 0.033\t50,Q\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.MRK", _ROW.format(lat="33.2.1")),
        ("a.MRK", _ROW.format(lat="--5")),
        ("a.MRK", _ROW.format(lat="1" + "23.4," * 50_000)),
        ("images.json", '[{"filename": "a.jpg", "latitude": ' + "9" * 5000 + "}]"),
        ("a.csv", "name,latitude,longitude,altitude\n" + "a" * 200_000 + ",1,2,3\n"),
        ("geo.txt", "EPSG:5773\na.jpg 1 2 3\n"),
    ],
)
def test_found_by_fuzzing(tmp_path: Path, name: str, text: str) -> None:
    """Numbers that are none, or thousands of digits long, cells without an end, and a projection without places."""
    (tmp_path / name).write_text(text)
    with pytest.raises(TrackError, match=name):
        read_photos([tmp_path / name])


def test_a_row_of_an_image_log_is_read_as_before(tmp_path: Path) -> None:
    (tmp_path / "a.MRK").write_text(_ROW.format(lat="33.21912340"))
    (one,) = read_photos([tmp_path / "a.MRK"]).photos
    assert (one.lat_deg, one.lon_deg, one.alt_m) == (33.2191234, -98.1, 345.6)
    assert (one.horizontal_error_m, one.vertical_error_m) == (0.012, 0.033)


@pytest.mark.parametrize(
    ("space", "attribute"),
    [
        ('xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"', 'drone-dji:CaptureUUID="b7c1"'),
        ('xmlns:MicaSense="http://micasense.com/MicaSense/1.0/"', 'MicaSense:CaptureId="b7c1"'),
        ('xmlns:Camera="http://pix4d.com/camera/1.0/"', 'Camera:CaptureUUID="b7c1"'),
    ],
)
def test_the_capture_of_a_file_is_read_by_any_makers_name(tmp_path, space, attribute):
    write_jpeg(tmp_path / "a.JPG", position=POSITION, alt_m=500.0, xmp=XMP.format(spaces=space, attributes=attribute))
    assert read_photo(tmp_path / "a.JPG").capture_id == "b7c1"


_ROW_OF_EXIFTOOL = {
    "SourceFile": "./a/DJI_0001.JPG", "GPSLatitude": """8 deg 27' 55.22" S""", "GPSLongitude": """13 deg 12' 0.92" W""",
    "GPSAltitude": "390.7 m Above Sea Level", "DateTimeOriginal": "2025:04:16 07:25:57", "GimbalPitchDegree": "-80.00",
    "FlightYawDegree": "+90.10", "RelativeAltitude": "+80.5", "Make": "DJI", "Model": "FC8482", "ImageWidth": "8064",
    "ImageHeight": "6048", "FocalLength": "6.7 mm", "FocalLengthIn35mmFormat": "24 mm", "ExposureTime": "1/1000",
    "DigitalZoomRatio": "undef", "CaptureUUID": "c1", "SerialNumber": "1581F",
}  # fmt: skip
_NUMBERS_OF_EXIFTOOL = {
    "GPSLatitude": "8.46533889", "GPSLatitudeRef": "S", "GPSLongitude": "13.20025556", "GPSLongitudeRef": "West",
    "GPSAltitude": "390.7", "GPSAltitudeRef": "0", "FocalLength": "6.7", "FocalLengthIn35mmFormat": "24", "ExposureTime": "0.001",
}  # fmt: skip


def write_table(path, row, separator=",", decimal="."):
    def cell(text):
        return '"' + re.sub(r"(?<=\d)\.(?=\d)", decimal, text).replace('"', '""') + '"'

    path.write_text(separator.join(map(cell, row)) + "\n" + separator.join(map(cell, row.values())) + "\n")


@pytest.mark.parametrize("groups", ["", "XMP:"])
@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), ("\t", "."), (";", ".")])
@pytest.mark.parametrize("changed", [{}, _NUMBERS_OF_EXIFTOOL], ids=["printed", "numbers"])
def test_a_table_of_exiftool_is_read_as_it_prints_it(tmp_path, groups, separator, decimal, changed):
    row = _ROW_OF_EXIFTOOL | changed
    write_table(tmp_path / "a.csv", {f"{groups}{name}": value for name, value in row.items()}, separator, decimal)
    one = only(tmp_path / "a.csv")
    assert (one.lat_deg, one.lon_deg) == pytest.approx((-8.46533889, -13.20025556), abs=1e-8)
    assert (one.alt_m, one.datum, one.height_above_takeoff_m) == (390.7, HeightDatum.SEA_LEVEL, 80.5)
    assert (one.pitch_deg, one.yaw_deg, one.vehicle_yaw_deg) == (-80.0, None, 90.1)
    assert (one.camera, one.pixels, one.focal_length_mm, one.focal_length_35mm) == (
        "DJI FC8482",
        (8064, 6048),
        6.7,
        24.0,
    )
    assert (one.exposure_s, one.digital_zoom, one.capture_id) == (0.001, None, "c1")
    assert (one.time_s, one.utc_s, one.clock) == (1744788357.0, None, "a.csv DJI FC8482 1581F")


@pytest.mark.parametrize(
    ("latitude", "degrees"),
    [
        ("8 deg 27' 55.22\" N", 8.46533889), ("8°27′55.22″S", -8.46533889), ("N8 27.5", 8.45833333), ("8 59' 60.00\" s", -9.0),
        ("8:27:55.22", 8.46533889), ("-8.5", -8.5), ("8,5", 8.5), ("8.5 S", -8.5),
    ],
)  # fmt: skip
def test_degrees_as_people_write_them(tmp_path, latitude, degrees):
    write_table(tmp_path / "a.csv", {"name": "a", "lat": latitude, "lon": "2", "alt": "3"}, separator=";")
    assert only(tmp_path / "a.csv").lat_deg == pytest.approx(degrees, abs=1e-8)


@pytest.mark.parametrize(
    "latitude", ["-8 S", "8.5 deg 27' N", "8 27.5' 3\" N", "N 8 N", "8 deg 27' 61\" N", "8" + " " * 500 + "x"]
)
def test_degrees_that_say_two_things_are_refused(tmp_path, latitude):
    write_table(tmp_path / "a.csv", {"name": "a", "lat": latitude, "lon": "2", "alt": "3"})
    with pytest.raises(TrackError, match=r"line 2: lat_deg: .* is not a number"):
        read_photos([tmp_path / "a.csv"])


@pytest.mark.parametrize(
    ("reported", "alt_m", "datum"),
    [
        ({"GPSAltitude": "3 m Below Sea Level"}, -3.0, HeightDatum.SEA_LEVEL),
        ({"GPSAltitude": "3", "GPSAltitudeRef": "Below Sea Level"}, -3.0, HeightDatum.SEA_LEVEL),
        ({"GPSAltitude": "3", "GPSAltitudeRef": "Positive ellipsoidal height"}, 3.0, HeightDatum.ELLIPSOID),
        ({"AbsoluteAltitude": "+3", "RtkFlag": "50"}, 3.0, HeightDatum.ELLIPSOID),
        ({"AbsoluteAltitude": "+3", "GPSAltitude": "9 m"}, 3.0, HeightDatum.SEA_LEVEL),
    ],
)
def test_heights_of_tables_have_a_datum(tmp_path, reported, alt_m, datum):
    write_table(tmp_path / "a.csv", {"name": "a", "lat": "1", "lon": "2", **reported})
    assert (only(tmp_path / "a.csv").alt_m, only(tmp_path / "a.csv").datum) == (alt_m, datum)


def test_a_path_in_a_table_names_the_file_of_a_folder(tmp_path):
    write_jpeg(tmp_path / "DJI_0001.JPG")
    write_table(tmp_path / "a.csv", {"SourceFile": "./b/DJI_0001.JPG", "lat": "1", "lon": "2", "alt": "3"})
    one = only(tmp_path, tmp_path / "a.csv")
    assert (one.lat_deg, one.pixels) == (1.0, (5280, 3956))


def test_two_vehicles_of_one_model_have_clocks_of_their_own(tmp_path):
    for number, second in enumerate((11, 12, 13, 14)):
        reported = dji(AbsoluteAltitude="5", DroneSerialNumber=f"SN{number % 2}")
        write_jpeg(
            tmp_path / f"{number}.jpg", position=(1.0, 2.0 + number), time=f"2026:05:04 10:11:{second}", xmp=reported
        )
    found = read_photos([tmp_path])
    assert [photo.name for photo in found.photos] == ["0.jpg", "2.jpg", "1.jpg", "3.jpg"]
    assert "times come from 2 clocks (the clock of DJI M3E SN0, the clock of DJI M3E SN1)" in found.notes[0]
