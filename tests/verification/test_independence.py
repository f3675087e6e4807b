"""Planners and software that are wrong on purpose: verification catches each, from the flown track alone."""

import numpy as np
import pytest

from tests.planner.sites import flat, ridge
from tests.verification.flights import Flight, changed, fly_along, make_site
from uavcover.model.verdict import VerificationReport
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.verify import verify_track

pytestmark = pytest.mark.usefixtures("attitudes_count")

FOOT_M = 0.3048


def kinds(report: VerificationReport) -> set[str]:
    return {violation.kind for violation in report.violations}


def test_coverage_that_is_overstated() -> None:
    # Two lines where three are needed, and a plan that claims to see everything.
    site = make_site(flat)
    path = np.array([[0.0, 40.0, 80.0], [300.0, 40.0, 80.0], [300.0, 60.0, 80.0], [0.0, 60.0, 80.0]])
    coverage = CoverageMap(site, cell_size_m=10.0)
    report = verify_track(site, coverage, fly_along(site, path), PlannedRoute(path, 1.0))
    assert not report.passed
    assert report.planned_coverage_fraction == 1.0
    # Flat ground: both footprints together reach 60 + 80 tan(35 deg) north.
    reach = 60.0 + 80.0 * np.tan(np.radians(35.0))
    assert report.coverage_fraction == pytest.approx(reach / 200.0, abs=0.03)
    assert report.gaps[0].reason == "never-in-range"


def test_a_leg_through_a_hill() -> None:
    # The planner looked at the waypoints only: both are 80 m above ground, the ridge between them is 100 m high.
    site = make_site(ridge(150.0, 100.0, 40.0), requirements={"min_coverage_of_coverable": 0.0})
    path = np.array([[0.0, 100.0, 80.0], [300.0, 100.0, 80.0]])
    report = verify_track(site, CoverageMap(site, cell_size_m=10.0), fly_along(site, path), PlannedRoute(path, 0.0))
    assert not report.passed
    (violation,) = report.violations
    assert (violation.kind, violation.worst) == ("below-band", pytest.approx(-20.0, abs=0.1))
    assert violation.east_m == pytest.approx(150.0, abs=0.1)
    assert report.min_height_agl_m == violation.worst


def test_longitude_and_latitude_swapped(hilly: Flight) -> None:
    swapped = changed(hilly.track, geodetic=hilly.track.geodetic[:, [1, 0, 2]].copy())
    report = hilly.verify(swapped)
    assert not report.passed
    assert report.coverage_fraction == 0.0
    assert any("swapped" in doubt for doubt in report.doubts)


@pytest.mark.parametrize("factor", [FOOT_M, 1.0 / FOOT_M])
def test_metres_taken_for_feet(hilly: Flight, factor: float) -> None:
    """Heights above home in feet where metres are meant, and the other way round; all columns agree with each other."""
    enu = hilly.track.enu_m.copy()
    enu[:, 2] *= factor
    assert hilly.site.frame is not None
    wrong = changed(hilly.track, enu_m=enu, geodetic=np.column_stack(hilly.site.frame.geodetic_from_enu(enu)))
    report = hilly.verify(wrong)
    assert not report.passed
    assert ("below-band" if factor < 1.0 else "above-band") in kinds(report)


@pytest.mark.parametrize("undulation_m", [-31.0, 47.0])
def test_heights_above_sea_level_taken_for_heights_above_the_ellipsoid(undulation_m: float) -> None:
    """The vehicle flies the numbers of the plan, but above another surface: too low where the geoid lies below, or too high."""
    flight = Flight(make_site(flat, limits={"min_height_agl_m": 60.0, "max_height_agl_m": 110.0}))
    assert flight.verify().passed
    enu = flight.track.enu_m - [0.0, 0.0, -undulation_m]
    assert flight.site.frame is not None
    wrong = changed(flight.track, enu_m=enu, geodetic=np.column_stack(flight.site.frame.geodetic_from_enu(enu)))
    report = flight.verify(wrong)
    assert not report.passed
    (violation,) = [v for v in report.violations if v.phase == "route"]
    expected = (
        ("below-band", 60.0 - (80.0 + undulation_m)) if undulation_m < 0.0 else ("above-band", undulation_m - 30.0)
    )
    assert (violation.kind, violation.excess) == (expected[0], pytest.approx(expected[1], abs=0.1))
    # A log whose geodetic heights alone are of the other kind contradicts its local columns.
    geodetic = flight.track.geodetic - [0.0, 0.0, -undulation_m]
    assert any(
        "contradicts itself" in doubt for doubt in flight.verify(changed(flight.track, geodetic=geodetic)).doubts
    )
