import math
from dataclasses import astuple, replace
from pathlib import Path

import numpy as np
import pytest

from uavcover.errors import OutputError, TrackError
from uavcover.model.track import COLUMNS, OPTIONAL_COLUMNS, TrackSample
from uavcover.run.track_file import TrackWriter, read_track, read_track_with_warnings


def sample(n: int, **changes) -> TrackSample:
    first = TrackSample(
        10.0 + n / 3.0,
        36.5 + n * 1e-7,
        -84.2 - n * 1e-7,
        312.345 + n,
        0.1 * n,
        -1.0 / 7.0,
        1e-17,
        -2.5,
        3.25,
        359.99,
        n - 1,
        0.05 * n,
        float(n // 2),
        1_780_000_000.25 + n,
        1.7e9 + n / 3.0,
        5.01 - n,
        -0.02 * n,
        1.0 / 3.0,
        float(n % 2),
    )
    return replace(first, **changes)


def write(path: Path, count: int = 5) -> list[TrackSample]:
    samples = [sample(n) for n in range(count)]
    with TrackWriter(path) as writer:
        for each in samples:
            writer.write(each)
    return samples


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A track of five samples."""
    write(tmp_path / "track.csv")
    return tmp_path / "track.csv"


def test_what_was_written_is_read_to_the_last_bit(tmp_path):
    samples = write(tmp_path / "track.csv")
    track = read_track(tmp_path / "track.csv")
    expected = np.array([astuple(s) for s in samples])
    columns = [
        track.time_s, track.geodetic, track.enu_m, track.attitude_deg, track.current_waypoint, track.attitude_age_s,
        track.pictures_taken, track.unix_time_s, track.received_utc_s,
        track.velocity_north_m_s, track.velocity_east_m_s, track.velocity_down_m_s, track.has_fix,
    ]  # fmt: skip
    assert np.array_equal(np.column_stack(columns), expected)
    assert len(track) == 5
    assert not track.enu_m.flags.writeable


def test_the_header_is_the_columns(tmp_path):
    write(tmp_path / "track.csv", 1)
    header, row = (tmp_path / "track.csv").read_text().splitlines()
    assert header == ",".join([*COLUMNS, *OPTIONAL_COLUMNS])
    assert row.endswith(",-1,0.0,0.0,1780000000.25,1700000000.0,5.01,-0.0,0.3333333333333333,0.0")


def test_attitude_that_is_not_known_stands_there_empty(tmp_path):
    path = tmp_path / "track.csv"
    unknown = {"roll_deg": math.nan, "pitch_deg": math.nan, "attitude_age_s": math.nan}
    with TrackWriter(path) as writer:
        writer.write(sample(0, **unknown))
        writer.write(sample(1))
    assert (
        path.read_text()
        .splitlines()[1]
        .endswith(",,,359.99,-1,,0.0,1780000000.25,1700000000.0,5.01,-0.0,0.3333333333333333,0.0")
    )
    track = read_track(path)
    assert np.isnan(track.attitude_deg[0]).tolist() == [True, True, False]
    assert np.isfinite(track.attitude_deg[1]).all()
    assert np.isnan(track.attitude_age_s).tolist() == [True, False]


def test_a_track_without_the_last_columns_is_read(path):
    names = OPTIONAL_COLUMNS[::-1]
    for count in range(1, len(names) + 1):
        path.write_text("".join(line.rpartition(",")[0] + "\n" for line in path.read_text().splitlines()))
        track = read_track(path)
        assert len(track) == 5
        for name in names:
            assert np.isnan(getattr(track, name)).all() == (name in names[:count])


def test_every_row_is_in_the_file_at_once(tmp_path):
    writer = TrackWriter(tmp_path / "track.csv")
    writer.write(sample(0))
    assert len(read_track(tmp_path / "track.csv")) == 1
    writer.close()
    writer.close()


def test_a_track_is_not_overwritten_by_mistake(tmp_path):
    write(tmp_path / "track.csv")
    with pytest.raises(OutputError, match="the file already"):
        TrackWriter(tmp_path / "track.csv")
    TrackWriter(tmp_path / "track.csv", overwrite=True).close()
    with pytest.raises(TrackError, match="no samples"):
        read_track(tmp_path / "track.csv")


def test_a_place_that_cannot_be_written_to_is_an_error(tmp_path):
    with pytest.raises(OutputError, match="cannot be written: No such file or directory"):
        TrackWriter(tmp_path / "missing" / "track.csv")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_an_error_that_says_how_far_it_came():
    with pytest.raises(OutputError, match="the file cannot be written after 0 samples: No space left"):
        TrackWriter(Path("/dev/full"), overwrite=True)


def test_a_last_line_that_was_cut_off_is_left_out_and_said(path):
    path.write_text(path.read_text()[:-30])
    read = read_track_with_warnings(path)
    assert len(read.track) == 4
    assert len(read.warnings) == 1
    assert "the last line is incomplete" in read.warnings[0]


def test_of_a_whole_file_nothing_is_said_and_an_empty_one_is_no_track(path):
    read = read_track_with_warnings(path)
    assert read.warnings == ()
    assert len(read.track) == 5
    # As some programs write it: a blank line at the end, and a byte order mark.
    path.write_text("\ufeff" + path.read_text() + "\n", encoding="utf-8")
    read = read_track_with_warnings(path)
    assert (read.warnings, len(read.track)) == ((), 5)
    path.write_text("")
    with pytest.raises(TrackError, match="line 1: the column time_s is missing"):
        read_track(path)


def test_other_columns_and_another_order_are_read(path):
    lines = [line.split(",") for line in path.read_text().splitlines()]
    path.write_text("".join(",".join([*reversed(line), "x"]) + "\n" for line in lines))
    assert read_track(path).time_s[0] == 10.0


@pytest.mark.parametrize(
    ("line", "column", "value", "message"),
    [
        (0, "yaw_deg", "heading", "line 1: the column yaw_deg is missing"),
        (2, "lat_deg", "north", "line 3, lat_deg: 'north' is not a number"),
        (2, "roll_deg", "1_0.0", "line 3, roll_deg: '1_0.0' is not a number"),
        (2, "east_m", "\u0663", "line 3, east_m: '\u0663' is not a number"),
        (3, "up_m", "nan", "line 4, up_m: 'nan' is not a finite number"),
        (3, "roll_deg", "inf", "line 4, roll_deg: 'inf' is not a finite number"),
        (3, "time_s", "1.0", "line 4, time_s: 1.0 is not later than"),
        (
            3,
            "time_s",
            repr(10.0 + 1 / 3.0),
            r"line 4, time_s: 10\.333333333333334 is not later than the previous 10\.333333333333334",
        ),
        (2, "east_m", "", "line 3, east_m: '' is not a number"),
        (2, "current_waypoint", "", "line 3, current_waypoint: '' is not a number"),
        (2, "lat_deg", "91.0", "line 3, lat_deg: 91.0, .* is not a position on Earth"),
        (2, "lat_deg", "-90.1", "line 3, lat_deg: -90.1, .* is not a position on Earth"),
        (2, "lon_deg", "180.1", "line 3, lat_deg: .*, 180.1 is not a position on Earth"),
        (2, "lon_deg", "-181.0", "line 3, lat_deg: .*, -181.0 is not a position on Earth"),
        (2, "current_waypoint", "1.5", "line 3, current_waypoint: 1.5 is not a whole number"),
        (2, "alt_amsl_m", "", "line 3, alt_amsl_m: '' is not a number"),
        *((3, "pictures_taken", count, "line 4, pictures_taken") for count in ("-1.0", "2.5", "many", "inf")),
        *((3, "unix_time_s", time, "line 4, unix_time_s") for time in ("0.0", "12.5", "1e300", "-5", "noon")),
    ],
)
def test_what_is_wrong_is_said_with_line_and_column(path, line, column, value, message):
    rows = [row.split(",") for row in path.read_text().splitlines()]
    rows[line][[*COLUMNS, *OPTIONAL_COLUMNS].index(column)] = value
    path.write_text("".join(",".join(row) + "\n" for row in rows))
    with pytest.raises(TrackError, match=message):
        read_track(path)


def test_a_column_that_stands_there_twice_is_refused(path):
    rows = path.read_text().splitlines()
    path.write_text("".join(f"{row},{extra}\n" for row, extra in zip(rows, ["roll_deg", *"12345"], strict=True)))
    with pytest.raises(TrackError, match="line 1: 2 columns are named roll_deg; keep only one of them"):
        read_track(path)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be"])
def test_a_table_that_a_spreadsheet_saved_as_unicode_text_is_read(path, encoding):
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    before = read_track(path)
    path.write_bytes((mark + path.read_text().replace(",", "\t")).encode(encoding))
    assert read_track(path).geodetic.tolist() == before.geodetic.tolist()


def test_the_poles_and_the_antimeridian_are_places(tmp_path):
    path = tmp_path / "track.csv"
    with TrackWriter(path) as writer:
        for n, (lat, lon) in enumerate([(90.0, 180.0), (-90.0, -180.0), (0.0, 0.0)]):
            writer.write(sample(n, lat_deg=lat, lon_deg=lon))
    assert read_track(path).geodetic[:, :2].tolist() == [[90.0, 180.0], [-90.0, -180.0], [0.0, 0.0]]


def test_a_short_line_inside_the_file_is_an_error(path):
    lines = path.read_text().splitlines()
    lines[2] = lines[2].rsplit(",", 10)[0]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(TrackError, match="line 3, yaw_deg: the value is missing; the line has 9 values"):
        read_track(path)


def test_what_is_no_track_at_all_is_an_error(tmp_path):
    with pytest.raises(TrackError, match="cannot be read: No such file"):
        read_track(tmp_path / "track.csv")
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(TrackError, match="the column time_s is missing"):
        read_track(tmp_path / "empty.csv")
    (tmp_path / "flight.bin").write_bytes(bytes(range(128, 256)))
    with pytest.raises(TrackError, match="not a text file"):
        read_track(tmp_path / "flight.bin")
