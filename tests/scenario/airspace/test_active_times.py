"""When zones are in force: periods, days and hours against every minute, and what is no period."""

import json
import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from tests.naive.active_times import in_force_in
from uavcover.model.limits import DAYS, NoFly, active_period, flown_window, is_flight_time, window_text
from uavcover.scenario.airspace.zone_file import read_zones

MONDAY = datetime(2026, 6, 1, tzinfo=UTC)


def at(text):
    return datetime.fromisoformat(text)


@pytest.mark.parametrize(
    ("period", "window", "counts"),
    [
        ("MON-FRI 08:00-17:00Z", ("2026-06-01T16:59Z", "2026-06-01T18:00Z"), True),
        ("MON-FRI 08:00-17:00Z", ("2026-06-01T17:01Z", "2026-06-02T07:59Z"), False),
        ("MON-FRI 08:00-17:00Z", ("2026-06-06T00:00Z", "2026-06-07T23:59Z"), False),  # the weekend
        ("FRI-MON", ("2026-06-02T00:01Z", "2026-06-04T23:59Z"), False),
        ("sat,sun", ("2026-06-05T23:00Z", "2026-06-06T00:00Z"), True),
        ("22:00-06:00Z", ("2026-06-02T05:59Z", "2026-06-02T21:00Z"), True),  # the night before
        ("MON 22:00-06:00Z", ("2026-06-02T05:59Z", "2026-06-02T21:00Z"), True),
        ("TUE 22:00-06:00Z", ("2026-06-02T05:59Z", "2026-06-02T21:00Z"), False),
        ("MON 00:00-02:00+05:00", ("2026-05-31T19:00Z", "2026-05-31T20:00Z"), True),  # Sunday in UTC
        ("MON 00:00-02:00+05:00", ("2026-06-01T00:00Z", "2026-06-01T02:00Z"), False),
        ("00:00-24:00Z", ("2026-06-01T12:00Z", "2026-06-01T12:01Z"), True),
        ("2026-06-01T06:00Z/2026-06-03T18:00Z", ("2026-06-03T18:00Z", "2026-06-04T00:00Z"), True),
        ("2026-06-01T06:00Z/2026-06-03T18:00Z", ("2026-06-03T18:01Z", "2026-06-04T00:00Z"), False),
        ("../2026-06-03T18:00Z WED", ("2026-06-03T17:00Z", "2026-06-30T00:00Z"), True),
        ("../2026-06-03T18:00Z WED", ("2026-06-04T00:00Z", "2026-06-30T00:00Z"), False),
        ("9999-01-01T00:00Z/..", ("2026-06-01T00:00Z", "2027-06-04T00:00Z"), False),
        ("SUN", ("2026-06-01T00:00Z", "2027-06-04T00:00Z"), True),
    ],
)
def test_periods(period, window, counts):
    assert active_period(period, "active").meets(tuple(map(at, window))) == counts


def test_periods_against_every_minute():
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(300):
        days = [DAYS[k] for k in sorted(rng.choice(7, size=int(rng.integers(0, 4)), replace=False))]
        hours = None if rng.random() < 0.2 else tuple(int(15 * k) for k in rng.integers(0, 96, size=2))
        offset_h = int(rng.integers(-11, 14)) if hours else 0
        first = MONDAY + timedelta(minutes=int(rng.integers(0, 20_000)))
        interval = None if rng.random() < 0.5 else (first, first + timedelta(minutes=int(rng.integers(1, 9_000))))
        begin = MONDAY + timedelta(minutes=int(rng.integers(0, 20_000)))
        window = begin, begin + timedelta(minutes=int(rng.integers(1, 600)))
        words = [] if interval is None else [f"{interval[0].isoformat()}/{interval[1].isoformat()}"]
        words += [",".join(days)] if days else []
        if hours:
            zone = f"{'-' if offset_h < 0 else '+'}{abs(offset_h):02d}:00"
            words.append("-".join(f"{minute // 60:02d}:{minute % 60:02d}" for minute in hours) + zone)
        if not words:
            continue
        expected = in_force_in(window, interval=interval, days=days, hours=hours, offset_h=offset_h)
        assert active_period(" ".join(words), "active").meets(window) == expected, (words, window)
        hits += expected
    assert 50 < hits < 250


@pytest.mark.parametrize(
    "text",
    ["", "MON-", "MOON", "08:00-17:00", "8-17Z", "25:00-26:00Z", "08:61-09:00Z", "24:00-25:00Z", "08:00-17:00+25:00", "MON TUE",
     "08:00-09:00Z 10:00-11:00Z", "2026-06-01/2026-06-02", "2026-06-03T00:00Z/2026-06-01T00:00Z", "a/b", "/", "always"],
)  # fmt: skip
def test_what_is_no_period_is_one_line(text):
    with pytest.raises(ValueError, match=r"^active\.0: ") as error:
        NoFly(center_east_north_m=(0.0, 0.0), radius_m=5.0, active=(text,))
    assert "\n" not in str(error.value)


def test_periods_and_ends_hold_together():
    zone = NoFly(
        center_east_north_m=(0.0, 0.0), radius_m=5.0, from_utc="2026-06-08T00:00Z", active=("MON", "WED 10:00-11:00Z")
    )
    assert not zone.in_force((at("2026-06-01T10:00Z"), at("2026-06-01T11:00Z")))
    assert zone.in_force((at("2026-06-08T10:00Z"), at("2026-06-08T11:00Z")))
    assert not zone.in_force((at("2026-06-10T11:01Z"), at("2026-06-10T12:00Z")))
    assert zone.in_force(None)


def test_times_that_no_flight_has():
    for unix_s in (0.0, 1234.5, -1.0, math.nan, math.inf, 1e300):
        assert not is_flight_time(unix_s)
    assert is_flight_time(1_780_000_000.0)
    assert flown_window(np.array([np.nan, np.nan])) is None
    begin, end = flown_window(np.array([np.nan, 1_780_000_000.0, 1_780_000_090.0]))
    assert window_text((begin, end)) == f"{begin:%Y-%m-%d %H:%M} to {end:%H:%M} UTC"


JUNE = "2026-06-01T00:00:00Z/2026-06-30T00:00:00Z"
RING = [[8.0, 46.5], [8.02, 46.5], [8.02, 46.52], [8.0, 46.5]]


def zones_of(tmp_path, periods, *, standard="ED-269"):
    projection = {"type": "Polygon", "coordinates": [RING]}
    if standard == "ED-269":
        document = {"features": [{"identifier": "X1", "name": "zone", "restriction": "PROHIBITED", "applicability": periods,
                                  "geometry": [{"uomDimensions": "M", "horizontalProjection": projection}]}]}  # fmt: skip
    else:
        geometry = projection | {"layer": {"lower": 0, "upper": 120}}
        properties = {"identifier": "X1", "type": "PROHIBITED", "limitedApplicability": periods}
        document = {"type": "FeatureCollection", "features": [
            {"type": "Feature", "properties": properties, "geometry": geometry}]}  # fmt: skip
    path = tmp_path / "zones.json"
    path.write_text(json.dumps(document))
    return read_zones(NoFly(file=str(path)))


@pytest.mark.parametrize("standard", ["ED-269", "ED-318"])
@pytest.mark.parametrize(
    ("periods", "expected", "noted"),
    [
        ([{"permanent": "YES"}], (None, None, ()), False),
        ([{"permanent": "YES", "schedule": [{"day": ["MON", "FRI"], "startTime": "08:00:00.00Z", "endTime": "17:00:00.00Z"}]}],
         (None, None, ("MON,FRI 08:00:00.00-17:00:00.00Z",)), False),
        ([{"startDateTime": "2026-06-01T00:00:00Z", "endDateTime": "2026-06-30T00:00:00Z",
           "schedule": [{"day": ["ANY"], "startTime": "22:00Z", "endTime": "06:00Z"}, {"day": ["SUN"]}]}],
         (None, None, (f"{JUNE} 22:00-06:00Z", f"{JUNE} SUN")),
         False),
        ([{"startDateTime": "2026-06-01T00:00:00Z"}], ("2026-06-01T00:00:00Z", None, ()), False),
        ([{"startDateTime": "2026-06-01T00:00:00Z", "endDateTime": "2026-06-02T00:00:00Z"},
          {"startDateTime": "2026-07-01T00:00:00Z", "endDateTime": "2026-07-02T00:00:00Z"}],
         (None, None, ("2026-06-01T00:00:00Z/2026-06-02T00:00:00Z", "2026-07-01T00:00:00Z/2026-07-02T00:00:00Z")), False),
        ([{"startDateTime": "2026-06-01T00:00:00Z", "schedule": [{"day": ["ANY"], "startEvent": "SR", "endEvent": "SS"}]}],
         ("2026-06-01T00:00:00Z", None, ()), True),
        ([{"permanent": "YES", "schedule": [{"day": ["HOL"], "startTime": "08:00Z", "endTime": "09:00Z"}]}],
         (None, None, ()), True),
        ([{"permanent": "YES", "schedule": [{"day": ["MON"], "startTime": "08:00", "endTime": "09:00"}]}],
         (None, None, ()), True),
    ],
)  # fmt: skip
def test_the_files_own_times(tmp_path, standard, periods, expected, noted):
    (zone,), notes = zones_of(tmp_path, periods, standard=standard)
    assert (zone.from_utc, zone.until_utc, zone.active) == expected
    assert any("treated as active all day" in note for note in notes) == noted


def test_times_of_geojson_and_openair(tmp_path):
    feature = {
        "type": "Feature",
        "properties": {"active": "SAT,SUN"},
        "geometry": {"type": "Polygon", "coordinates": [RING]},
    }
    path = tmp_path / "z.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    (zone,), _ = read_zones(NoFly(file=str(path)))
    assert zone.active == ("SAT,SUN",)
    text = "AC R\nAN {}\n{}AL GND\nAH 500ft AGL\nV X=46:30:00 N 008:00:00 E\nDC 1\n\n"
    path = tmp_path / "z.txt"
    path.write_text(
        text.format("a", "AA 2026-06-01T12:00Z/2026-06-01T13:00Z\nAA 2026-06-02T12:00Z/NONE\n")
        + text.format("b", "AA by NOTAM\n")
        + text.format("c", "")
    )
    (a, b, c), _ = read_zones(NoFly(file=str(path)))
    assert a.active == ("2026-06-01T12:00Z/2026-06-01T13:00Z", "2026-06-02T12:00Z/..")
    assert b.active == c.active == ()
