"""Before arming, `fly` tells from where the vehicle's own return is unsafe, by the vehicle's real parameters."""

import numpy as np

from mission_io.model.items import FramedPoint
from tests.missions.compiled_routes import compiled, route
from tests.planner.sites import make_site, ridge
from uavcover.flight.applied_limits import return_warnings
from uavcover.missions.return_advice import OwnReturns

ROUTE = route((20, 150, 160), (200, 150, 160), (260, 150, 80), (260, 50, 80), (200, 50, 80))


def returns() -> OwnReturns:
    site = make_site(
        ridge(140.0, 100.0), vehicle={"return_height_m": 130.0},
        limits={"max_climb_angle_deg": 80.0, "max_height_agl_m": 180.0},
    )  # fmt: skip
    return compiled(site, ROUTE).own_returns


def test_the_plans_own_height_is_safe() -> None:
    assert returns().advice({}).sentences == ()


def test_the_vehicles_real_return_height_is_not() -> None:
    advice = returns().advice({"RTL_ALT": 6000.0})
    assert advice.return_height_m == 60.0
    words = return_warnings(advice)
    assert any("below the ground" in one and "from waypoint" in one for one in words)
    assert "set the autopilot's return height to at least" in words[-1]
    assert 115.0 < advice.needed_height_m <= 125.0


def test_parameters_that_change_are_judged_again() -> None:
    own = returns()
    assert own.advice({"RTL_ALT": 13000.0}).sentences == ()
    assert own.advice({"RTL_ALT": 13000.0, "FENCE_ENABLE": 1.0, "FENCE_ALT_MAX": 90.0}).sentences


def test_rally_points_that_the_vehicle_holds_count() -> None:
    own = returns()
    beside = FramedPoint(*own_lat_lon(own, 230.0, 100.0), 40.0)
    low = {"RTL_ALT": 6000.0}
    assert own.advice(low).unsafe_waypoints == (2, 3, 4)
    assert own.advice(low, rally=[beside]).unsafe_waypoints == (
        4,
    )  # where the point is farther than RALLY_LIMIT_KM, or home nearer
    sunk = own.advice(
        {"RTL_ALT": 13000.0, "RTL_ALT_FINAL": 500.0}, rally=[FramedPoint(*own_lat_lon(own, 140.0, 100.0), 120.0)]
    )
    assert any("descends" in one for one in sunk.sentences)


def own_lat_lon(own: OwnReturns, east_m: float, north_m: float) -> tuple[float, float]:
    assert own.site.frame is not None
    lat, lon, _ = own.site.frame.geodetic_from_enu(np.array([[east_m, north_m, 0.0]]))
    return float(lat[0]), float(lon[0])
