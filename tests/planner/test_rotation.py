"""Nothing knows where north is: a scenario turned by a quarter gives the same coverage of turned routes, and plans as good."""

import dataclasses
import statistics
from typing import Any

import numpy as np
import pytest

from tests.planner.sites import hills, make_site, tower
from tests.planner.test_planner import frozen
from uavcover.missions.leg_checks import measure_violations
from uavcover.model.limits import Obstacles
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, Sensor, SphereSensor
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.planner import Effort, plan_routes
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap

TURN_M = 400.0
"""A quarter turn against the clock takes east, north to TURN_M - north, east: the nodes of the test ground onto each other."""

RING = ((0.0, 0.0), (300.0, 0.0), (300.0, 160.0), (180.0, 200.0), (0.0, 200.0))
HOME = (-100.0, 50.0)
TOWER = tower(140.0, 60.0, 170.0, 90.0, 35.0)
LIMITS = {"height_margin_m": 5.0, "max_climb_angle_deg": 25.0}


def turned_positions(positions: np.ndarray) -> np.ndarray:
    """(n, 2) or (n, 3) ENU places after a quarter turn."""
    return np.column_stack([TURN_M - positions[:, 1], positions[:, 0], *positions.T[2:]])


def turned_ring(ring: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    return tuple((TURN_M - north, east) for east, north in ring)


def twins(sensor: Sensor, turned_sensor: Sensor | None = None, **options: Any) -> tuple[Site, Site]:
    """A site, and the same turned by a quarter: ground, area, home, obstacle and camera."""
    ring, limits = TOWER.rings_east_north_m[0], options.pop("limits", LIMITS)
    turned_tower = dataclasses.replace(TOWER, rings_east_north_m=(turned_ring(ring),))
    plain = make_site(
        hills, ring=RING, home=HOME, sensor=sensor, limits=limits,
        obstacles=Obstacles(prisms=(TOWER,), clearance_beside_m=10.0), **options,
    )  # fmt: skip
    turned = make_site(
        lambda east, north: hills(north, TURN_M - east), ring=turned_ring(RING), home=turned_ring((HOME,))[0],
        sensor=turned_sensor or sensor, limits=limits,
        obstacles=Obstacles(prisms=(turned_tower,), clearance_beside_m=10.0), **options,
    )  # fmt: skip
    return plain, turned


def camera(heading_deg: float | None, sensing: str) -> FrameCamera:
    return FrameCamera(
        kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=220.0, pitch_deg=-70.0,
        heading_deg=heading_deg, sensing=sensing,
        mount="fixed" if heading_deg is None else "stabilised",
    )  # fmt: skip


SENSORS = {
    "sphere": (SphereSensor(kind="sphere", range_m=110.0), None),
    "disc along the path": (DiscSensor(kind="disc", radius_m=60.0, sensing="along-path"), None),
    "nadir camera": (NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0), None),
    "picture that turns with the legs": (camera(None, "along-path"), None),
    "picture with a heading": (camera(130.0, "at-waypoints"), camera(40.0, "at-waypoints")),
}


@pytest.mark.parametrize("name", SENSORS)
def test_a_route_turned_with_its_scenario_sees_the_same_cells(name: str) -> None:
    plain, turned = twins(*SENSORS[name], cell_m=10.0)
    rng = np.random.default_rng(7)
    positions = rng.uniform([-20.0, -20.0], [320.0, 220.0], (9, 2))
    route = np.column_stack([positions, plain.ground.heights_m(positions) + rng.uniform(30.0, 125.0, 9)])
    observed = []
    for site, points in ((plain, route), (turned, turned_positions(route))):
        coverage = CoverageMap(site, cell_size_m=10.0)
        cells = coverage.observed(points)
        photo = np.where(coverage.grid.cells.lattice >= 0, cells[coverage.grid.cells.lattice], -1)
        observed.append(
            (photo, coverage.fraction(cells), coverage.fraction_of_coverable(cells), coverage.coverable.sum())
        )
    assert 0.2 < observed[0][1] < 0.999
    np.testing.assert_array_equal(np.rot90(observed[0][0], k=-1), observed[1][0])
    assert observed[0][1:] == pytest.approx(observed[1][1:], rel=1e-12)
    breaches = [
        measure_violations(site, r, margin_m=5.0).total
        for site, r in ((plain, route), (turned, turned_positions(route)))
    ]
    assert breaches[0] > 0.0
    assert breaches[0] == pytest.approx(breaches[1], rel=1e-9)


def test_lines_laid_over_turned_terrain_are_the_turned_lines() -> None:
    lengths = [fly_layout(site, plain_boustrophedon(site)).length_m for site in twins(*SENSORS["nadir camera"])]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-9)


@pytest.mark.parametrize(
    ("sensor", "rule", "options"),
    [
        ("nadir camera", "coverage>=0.95", {}),
        (
            "sphere", "coverage>=0.9",
            {
                "planner": {"encoding": "waypoints", "max_waypoints": 12},
                "limits": {"height_margin_m": 5.0, "applies_to": "waypoints"},
            },
        ),
    ],
    ids=["along the path", "free order"],
)  # fmt: skip
@pytest.mark.no_cover
def test_a_turned_scenario_is_planned_as_well(sensor: str, rule: str, options: dict[str, Any]) -> None:
    costs: list[list[float]] = []
    for site in twins(*SENSORS[sensor], cell_m=20.0, **options):
        found = []
        for seed in (1, 2, 3):
            settings = dataclasses.replace(site.scenario.planner, seed=seed, algorithm="memetic")
            plan = plan_routes(site, settings=settings, select_rule=rule, effort=Effort(500, None, frozen))
            assert plan.rule_met
            found.append(plan.chosen.metrics.cost)
        costs.append(found)
    # Seeds differ by a tenth after so few evaluations; lines that run the wrong way cost more than that.
    plain, turned = map(statistics.mean, costs)
    assert abs(plain - turned) < 0.15 * plain
