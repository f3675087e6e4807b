"""The judge and no-fly zones: entries with time, place and depth, between samples, under floors and over ceilings."""

import dataclasses

import numpy as np
import pytest

from tests.planner.test_no_fly import circle, ring
from tests.verification.flights import fly_along, make_site, taken
from tests.verification.test_cells import verdict_on
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.decision import requirement_rows
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import verify_track

ZONE = ring((140, 50), (150, 50), (150, 150), (140, 150), name="prison")
ALONG = np.array([[145.0, 0.0, 80.0], [145.0, 200.0, 80.0]])


def test_an_entry_with_time_place_and_depth():
    site = make_site(no_fly=(ZONE,))
    verdict = verdict_on(site, ALONG)
    (violation,) = verdict.report.violations
    assert (violation.kind, violation.phase, violation.unit, violation.name) == ("no-fly-zone", "route", "m", "prison")
    assert violation.worst == pytest.approx(5.0, abs=1e-3)
    assert violation.limit == 0.0
    assert 55.0 <= violation.north_m <= 145.0
    # In it from 50 m to 150 m north, by samples of 2 m.
    assert violation.start_s == pytest.approx(105.0, abs=0.21)
    assert violation.end_s == pytest.approx(115.0, abs=0.21)
    assert verdict.report.verdict == "failed"
    (row,) = [row for row in requirement_rows(site.scenario, verdict.report) if row.name == "Outside no-fly zones"]
    assert (row.required, row.found, row.holds) == ("1 zone", "left 1 time", "no")


@pytest.mark.parametrize("aside", [4.9, 5.0, 9.0])
def test_the_margin_is_for_planning_and_not_for_the_judge(aside):
    path = ALONG + np.array([5.0 + aside - 5.0, 0.0, 0.0]) * (aside >= 5.0)
    found = verdict_on(make_site(no_fly=(ZONE,)), path).report.violations
    assert [v.kind for v in found] == (["no-fly-zone"] if aside < 5.0 else [])


@pytest.mark.parametrize(
    ("keys", "enters"),
    [
        ({"floor_agl_m": 81.0}, False),
        ({"floor_agl_m": 79.0}, True),
        ({"ceiling_agl_m": 79.0}, False),
        ({"ceiling_agl_m": 81.0}, True),
        ({"floor_amsl_m": 481.0}, False),  # the local frame lies at 400 m
        ({"floor_amsl_m": 479.0, "ceiling_amsl_m": 600.0}, True),
    ],
)
def test_floors_and_ceilings(keys, enters):
    site = make_site(no_fly=(circle(145, 100, 20, **keys),))
    assert bool(verdict_on(site, ALONG).report.violations) == enters


def test_a_zone_narrower_than_the_way_between_two_samples_is_seen():
    # Samples are 2 m apart; this is 20 cm, between two of them.
    site = make_site(no_fly=(ring((100, 100.9), (200, 100.9), (200, 101.1), (100, 101.1)),))
    (violation,) = verdict_on(site, ALONG).report.violations
    assert violation.worst == pytest.approx(0.1, abs=0.01)
    assert violation.north_m == pytest.approx(101.0, abs=0.11)


def test_over_a_gap_in_the_track_nothing_is_claimed():
    site = make_site(no_fly=(ring((100, 90), (200, 90), (200, 110), (100, 110)),))
    track = fly_along(site, ALONG)
    keep = (track.enu_m[:, 1] < 80.0) | (track.enu_m[:, 1] > 120.0)
    verdict = verify_track(site, CoverageMap(site, cell_size_m=20.0), taken(track, keep), PlannedRoute(ALONG, 0.0))
    assert "no-fly-zone" not in {v.kind for v in verdict.violations}
    assert verdict.verdict != "passed"


@pytest.mark.parametrize("where", ["way there", "take-off", "landing", "way home"])
def test_ways_and_columns_are_judged_too(where):
    site = make_site(no_fly=(circle(-60, 50, 8, name="x"),))
    ends = [(-100.0, 50.0, 0.0), (-100.0, 50.0, 80.0), (-100.0, 0.0, 80.0), (0.0, 0.0, 80.0)]
    path = np.array([*ends, (100.0, 0.0, 80.0), *ends[::-1]])
    corner = {"way there": 2, "way home": 6}.get(where)
    if corner is not None:
        path[corner] = [-60.0, 50.0, 80.0]
    elif where == "take-off":
        path[:2, 0] = -60.0
    else:
        path[-2:, 0] = -60.0
    track = fly_along(site, path, first=3, count=2)
    found = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, PlannedRoute(path[3:5], 0.0)).violations
    assert ("no-fly-zone", "transit", "x") in {(v.kind, v.phase, v.name) for v in found}


WEDNESDAY_NOON = 1_780_488_000.0  # 2026-06-03 12:00 UTC


@pytest.mark.parametrize(
    ("active", "window", "unix_s", "verdict", "said"),
    [
        # Planned for a time at which it is not in force, and flown when it was, and the other way round.
        ("WED 11:00-13:00Z", ("2026-06-03T14:00Z", "2026-06-03T15:00Z"), WEDNESDAY_NOON, "entered", "flown from 2026-06-03 12:0"),
        ("WED 14:00-15:00Z", ("2026-06-03T14:00Z", "2026-06-03T15:00Z"), WEDNESDAY_NOON, "free", "flown from 2026-06-03 12:0"),
        ("WED 11:00-13:00Z", None, WEDNESDAY_NOON, "entered", None),
        ("THU", None, WEDNESDAY_NOON, "free", None),
        ("THU", None, None, "entered", "judged as always active"),
        ("THU", ("2026-06-04T14:00Z", "2026-06-04T15:00Z"), None, "entered", "judged as in flight_window_utc"),
        ("WED", ("2026-06-04T14:00Z", "2026-06-04T15:00Z"), None, "unknown", "judged as in flight_window_utc"),
    ],
)  # fmt: skip
def test_zones_with_times_are_judged_by_the_time_of_day_of_the_track(active, window, unix_s, verdict, said):
    zone = dataclasses.replace(ZONE, active=(active,))
    site = make_site(no_fly=(zone,), flight_window_utc=window)
    track = fly_along(site, ALONG)
    if unix_s is not None:
        track = dataclasses.replace(track, unix_time_s=unix_s + track.time_s)
    report = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, PlannedRoute(ALONG, 0.0))
    assert bool(report.violations) == (verdict == "entered")
    reported = (
        "the vehicle entered no-fly zone prison, which is inactive in flight_window_utc; the track has no time of day"
    )
    assert any(reported in doubt for doubt in report.doubts) == (verdict == "unknown")
    findings = [line for line in report.findings if "no-fly zone" in line]
    assert findings == [] if said is None else said in findings[0]
    assert (report.flown_utc is None) == (unix_s is None)
    rows = {row.name: row.required for row in requirement_rows(site.scenario, report)}
    assert rows["Outside no-fly zones"] == ("1 zone" if verdict == "entered" else "0 zones")


def test_a_zone_whose_hours_end_in_the_middle_of_the_flight_counts_until_then():
    zone = dataclasses.replace(ZONE, active=("WED 11:00-12:01:52Z",))  # entered at 12:01:45, left at 12:01:55
    site = make_site(no_fly=(zone,))
    track = fly_along(site, ALONG)
    track = dataclasses.replace(track, unix_time_s=WEDNESDAY_NOON + track.time_s)
    report = verify_track(site, CoverageMap(site, cell_size_m=20.0), track, PlannedRoute(ALONG, 0.0))
    (violation,) = report.violations
    assert (violation.start_s, violation.end_s) == (pytest.approx(105.0, abs=0.21), pytest.approx(112.0, abs=0.41))


def test_zones_that_are_not_in_force_are_not_judged():
    site = make_site(no_fly=(ZONE,))
    without = dataclasses.replace(site, zones=())
    assert verdict_on(without, ALONG).report.violations == ()
