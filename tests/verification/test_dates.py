"""The date of a track counts only when it is plausible."""

import dataclasses
import struct
from pathlib import Path

import numpy as np
import pytest

from tests.planner.test_no_fly import ring
from tests.verification.flights import fly_along, make_site
from uavcover.errors import TrackError
from uavcover.model.track import Track
from uavcover.model.verdict import VerificationReport
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.run_logs import (
    ROLLOVER_S,
    DateBounds,
    Firmware,
    clocks_apart,
    dated,
    firmware_of,
    read_log,
)
from uavcover.verification.verify import FlownTrack, verify_flight

NOON_S = 1_780_488_000.0
"""2026-06-03 12:00 UTC."""
BOUNDS = DateBounds(planned_s=NOON_S - 3600.0, written_s=NOON_S + 3600.0)
HOUR_S, DAY_S = 3600.0, 86_400.0


def track_at(unix_s: float, *, received_s: float | None = None, jump_s: float = 0.0) -> Track:
    track = fly_along(make_site(), np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]]))
    own_s = track.time_s - track.time_s[0]
    received = {} if received_s is None else {"received_utc_s": received_s + own_s}
    return dataclasses.replace(track, unix_time_s=unix_s + own_s + jump_s * (own_s > 10.0), **received)


@pytest.mark.parametrize(
    ("track", "bounds"),
    [
        (track_at(NOON_S), BOUNDS),
        (track_at(NOON_S), DateBounds()),
        (track_at(NOON_S - HOUR_S - 300.0), BOUNDS),
        (track_at(NOON_S, received_s=NOON_S + 60.0), BOUNDS),
        (track_at(NOON_S, received_s=NOON_S - 1200.0), BOUNDS),
        (track_at(NOON_S, jump_s=900.0), BOUNDS),
    ],
)
def test_a_plausible_date_counts(track: Track, bounds: DateBounds) -> None:
    found, findings = dated(track, bounds)
    assert findings == ()
    np.testing.assert_array_equal(found.unix_time_s, track.unix_time_s)


@pytest.mark.parametrize(
    ("track", "bounds", "why"),
    [
        (track_at(NOON_S - DAY_S), BOUNDS, "the plan dates from 2026-06-03 11:00"),
        (track_at(NOON_S - 2.0 * HOUR_S), BOUNDS, "the plan dates from 2026-06-03 11:00"),
        (track_at(NOON_S + 2.0 * DAY_S), BOUNDS, "the log file dates from 2026-06-03 13:00"),
        (track_at(1e9), BOUNDS, "no firmware that writes such logs is older than 2015"),
        (track_at(NOON_S, received_s=NOON_S + HOUR_S), BOUNDS, "the ground station received it on 2026-06-03 13:00"),
        (
            track_at(NOON_S, received_s=NOON_S - 30.0 * DAY_S),
            DateBounds(),
            "the ground station received it on 2026-05-04",
        ),
        (track_at(NOON_S, jump_s=5.0 * HOUR_S), DateBounds(), "the track's clock jumps by 5.0 hours at"),
        (track_at(NOON_S, jump_s=-2.0 * HOUR_S), BOUNDS, "the track's clock jumps by -2.0 hours at"),
    ],
)
def test_one_that_is_not_does_not_and_is_named(track: Track, bounds: DateBounds, why: str) -> None:
    found, (finding,) = dated(track, bounds)
    assert np.isnan(found.unix_time_s).all()
    assert why in finding
    assert "rolled over" not in finding


@pytest.mark.parametrize("bounds", [BOUNDS, DateBounds()])
def test_a_date_of_1024_weeks_before_is_a_rollover(bounds: DateBounds) -> None:
    found, (finding,) = dated(track_at(NOON_S - ROLLOVER_S), bounds)
    assert np.isnan(found.unix_time_s).all()
    assert "2006-10-18 12:00 to 12:00 UTC, is implausible" in finding
    assert (
        "a date 1,024 weeks later is plausible (2026-06-03 12:00 to 12:00 UTC), because the receiver's week number rolled over"
        in finding
    )


def test_a_zone_that_was_closed_on_the_true_day_is_no_place_to_fly_by_a_false_date() -> None:
    zone = ring((100, 80), (200, 80), (200, 120), (100, 120), name="prison")
    zone = dataclasses.replace(zone, from_utc="2026-06-03T00:00Z", until_utc="2026-06-04T00:00Z")
    site = make_site(no_fly=(zone,))
    coverage = CoverageMap(site, cell_size_m=20.0)

    def report(unix_s: float, bounds: DateBounds) -> VerificationReport:
        return verify_flight(site, coverage, [FlownTrack(track_at(unix_s), dates=bounds)]).report

    day_before = report(NOON_S - DAY_S, DateBounds())
    assert {violation.kind for violation in day_before.violations}.isdisjoint({"no-fly-zone"})
    for early_s in (DAY_S, ROLLOVER_S):
        rolled = report(NOON_S - early_s, BOUNDS)
        assert "no-fly-zone" in {violation.kind for violation in rolled.violations}
        assert any("is implausible" in finding for finding in rolled.findings)
        assert rolled.flown_utc is None


@pytest.mark.parametrize("by_s", [-900.0, -8.0, 6.0, 40.0, 5.0 * HOUR_S])
def test_time_that_one_of_two_clocks_does_not_know_was_inserted_or_taken_out(by_s: float) -> None:
    track = track_at(NOON_S, jump_s=by_s)
    found = clocks_apart(track)
    assert found is not None
    assert f"{abs(by_s):.1f} s more than the" in found
    site = make_site()
    report = verify_flight(site, CoverageMap(site, cell_size_m=20.0), [FlownTrack(track)]).report
    assert f"the {'satellites' if by_s > 0.0 else 'vehicle'}' clock advances" in " ".join(report.doubts).replace(
        "'s", "'"
    )


def test_a_slow_part_is_time_inserted_too_and_a_simulation_that_runs_fast_is_not() -> None:
    track = track_at(NOON_S)
    own_s = track.time_s - track.time_s[0]
    slow = dataclasses.replace(track, time_s=track.time_s + np.interp(own_s, [10.0, 16.0], [0.0, 8.0]))
    assert clocks_apart(slow) is not None
    fast = dataclasses.replace(track, unix_time_s=NOON_S + 3.0 * own_s)
    assert clocks_apart(fast) is None
    assert clocks_apart(track) is None
    assert clocks_apart(track_at(NOON_S, jump_s=3.0)) is None
    assert clocks_apart(dataclasses.replace(track, unix_time_s=np.full(len(track), np.nan))) is None


RELEASED = Firmware("ardupilot", 4, 6, official=True)
YEAR_S = 365.0 * DAY_S


def test_no_flight_is_older_than_its_firmware() -> None:
    assert dated(track_at(NOON_S), DateBounds(firmware=RELEASED))[1] == ()
    bounds = DateBounds(written_s=NOON_S, firmware=RELEASED)
    found, (finding,) = dated(track_at(NOON_S - 2.0 * YEAR_S), bounds)
    assert np.isnan(found.unix_time_s).all()
    assert "the firmware, ArduPilot 4.6, dates from 2025-04" in finding
    assert "rolled over" not in finding
    # A week number that rolled over may fall after 2015: only the firmware tells.
    late_s = NOON_S + 10.0 * YEAR_S
    assert dated(track_at(late_s - ROLLOVER_S), DateBounds())[1] == ()
    (finding,) = dated(track_at(late_s - ROLLOVER_S), DateBounds(firmware=RELEASED))[1]
    assert "1,024 weeks later is plausible (2036-05-31" in finding
    # Builds on the way to a version, and versions that are not in the table, keep the floor of 2015 or of a version before.
    built = dataclasses.replace(RELEASED, official=False)
    assert dated(track_at(NOON_S - 2.0 * YEAR_S), DateBounds(firmware=built))[1] == ()
    unknown = dataclasses.replace(RELEASED, major=9)
    assert dated(track_at(NOON_S - 6.0 * YEAR_S), DateBounds(firmware=unknown))[1] == ()
    assert dated(track_at(1e9), DateBounds(firmware=unknown))[1] != ()


def message(version: int) -> bytes:
    return b"\xfd\x3c\x00\x00\x07\x01\x01\x94\x00\x00" + struct.pack("<QQI", 0xFFFF, 12, version) + bytes(40)


@pytest.mark.parametrize(
    ("name", "content", "firmware"),
    [
        ("1.bin", b"..MSG ArduCopter V4.5.7 (2a3dc4b7)", Firmware("ardupilot", 4, 5, official=True)),
        ("1.BIN", b"ArduPlane V4.7.0-dev (2598e9d4)", Firmware("ardupilot", 4, 7, official=False)),
        ("1.bin", b"ArduCopter V4.6.0-beta1 (2598e9d4)", Firmware("ardupilot", 4, 6, official=False)),
        ("1.ulg", b"ULog..uint32_t ver_sw_release" + bytes([255, 0, 15, 1]), Firmware("px4", 1, 15, official=True)),
        ("1.ulg", b"uint32_t ver_sw_release" + bytes([64, 0, 17, 1]), Firmware("px4", 1, 17, official=False)),
        ("flight.tlog", b"....." + message(0x040407FF), Firmware("ardupilot", 4, 4, official=True)),
        ("flight.tlog", message(0x010E0300 | 192), Firmware("px4", 1, 14, official=False)),
        ("1.bin", b"no version", None),
        ("1.gpx", b"ArduCopter V4.5.7", None),
        ("flight.tlog", b"", None),
    ],
)
def test_the_firmware_stands_in_the_log(name: str, content: bytes, firmware: Firmware | None, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    assert firmware_of(tmp_path / name) == firmware
    beside = firmware if name == "flight.tlog" else None
    assert firmware_of(tmp_path / "track.csv") == beside


def test_a_track_of_weeks_is_refused(tmp_path: Path) -> None:
    """A time with one damaged bit asked for 27 TiB of memory."""
    point = '<trkpt lat="36.5" lon="-84.2"><ele>500</ele><time>2026-06-{day:02}T12:00:00Z</time></trkpt>'
    text = "".join(point.format(day=day) for day in (1, 9, 20))
    path = tmp_path / "far.gpx"
    path.write_text(f"<gpx><trk><trkseg>{text}</trkseg></trk></gpx>")
    with pytest.raises(TrackError, match=f"{path}: the track lasts 1641600 s, longer than any flight"):
        read_log(path, make_site())
