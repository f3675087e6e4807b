"""A sensor whose view is its own method on arrays: where that says the same as the kernels, the same cells are observed."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.planner.sites import hills, make_site, ridge
from uavcover.kernels import observation_counting as kernels
from uavcover.kernels.observation_counting import Camera, SensorPoses
from uavcover.kernels.sight import local_slopes
from uavcover.model.limits import Obstacle, Obstacles
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, Sensor, SphereSensor
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.sensing.sensors import add_observations

FRAME = FrameCamera(
    kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=150.0, pixels_across=4000,
    max_ground_sample_m=0.03, max_incidence_deg=60.0,
)  # fmt: skip
BUILT_IN: dict[str, Sensor] = {
    "sphere": SphereSensor(kind="sphere", range_m=90.0, sensing="along-path"),
    "disc": DiscSensor(kind="disc", radius_m=35.0, sensing="along-path"),
    "nadir": NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=150.0, max_incidence_deg=40.0),
    "frame": FRAME,
    "frame held north-east": dataclasses.replace(FRAME, mount="stabilised", heading_deg=45.0, pitch_deg=-60.0),
}


def own(sensor: Sensor) -> Sensor:
    """The sensor with its view as a method of another class: the same, for the arrays say what the kernels say."""
    built_in = type(sensor)

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Own(built_in):  # type: ignore[misc, valid-type]
        def in_view(self, rays: Any) -> Any:
            return built_in.in_view(self, rays)

    return Own(**{field.name: getattr(sensor, field.name) for field in dataclasses.fields(sensor)})


def maps(sensor: Sensor, **changes: Any) -> tuple[CoverageMap, CoverageMap]:
    tower = Obstacle(
        rings_east_north_m=(((140.0, 90.0), (150.0, 90.0), (150.0, 110.0), (140.0, 110.0)),), height_m=30.0
    )
    both = [
        make_site(
            lambda e, n: hills(e, n) + ridge(150.0, 60.0)(e, n),
            sensor=each,
            obstacles=Obstacles(prisms=(tower,)),
            **changes,
        )
        for each in (sensor, own(sensor))
    ]
    assert both[1].scenario.sensor.has_own_view
    first, second = (CoverageMap(site, cell_size_m=8.0) for site in both)
    return first, second


@pytest.mark.parametrize("sensor", BUILT_IN.values(), ids=BUILT_IN.keys())
def test_the_same_cells_are_seen_from_a_route_and_can_be_covered(sensor: Sensor) -> None:
    first, second = maps(sensor)
    assert not first.site.scenario.sensor.has_own_view
    rng = np.random.default_rng(5)
    route = rng.uniform((0.0, 0.0, 60.0), (300.0, 200.0, 150.0), (7, 3))
    observed = first.observed(route)
    assert 20 < observed.sum() < observed.size
    np.testing.assert_array_equal(second.observed(route), observed)
    observations = first.observations(route)
    np.testing.assert_array_equal(second.first_observed(observations), first.first_observed(observations))
    np.testing.assert_array_equal(second.coverable, first.coverable)


def test_a_view_wider_than_the_one_it_is_planned_by_is_seen_whole() -> None:
    wide = NadirCamera(kind="nadir-camera", fov_deg=90.0, range_m=150.0)

    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Wider(NadirCamera):
        def in_view(self, rays: Any) -> Any:
            return NadirCamera.in_view(wide, rays)

    first, _ = maps(wide)
    second, _ = maps(Wider(kind="nadir-camera", fov_deg=30.0, range_m=150.0))
    route = np.random.default_rng(6).uniform((0.0, 0.0, 60.0), (300.0, 200.0, 150.0), (5, 3))
    observations = first.observations(route)
    observed = first.observed_by(observations)
    assert 20 < observed.sum() < observed.size
    np.testing.assert_array_equal(second.observed_by(observations), observed)


def test_as_many_looks_count() -> None:
    sensor = dataclasses.replace(BUILT_IN["sphere"], sensing="at-waypoints")
    first, second = maps(sensor, requirements={"looks": 3, "look_distance_m": 25.0})
    positions = np.random.default_rng(2).uniform((0.0, 0.0, 60.0), (300.0, 200.0, 120.0), (40, 3))
    positions[7] = np.nan
    found = first.first_observed(LevelObservations.towards_north(positions))
    assert 20 < (found >= 0).sum() < found.size
    np.testing.assert_array_equal(second.first_observed(LevelObservations.towards_north(positions)), found)


@pytest.mark.parametrize("sensor", BUILT_IN.values(), ids=BUILT_IN.keys())
@pytest.mark.parametrize("needed", [1, 2])
def test_observations_of_a_flight_are_counted_alike(sensor: Sensor, needed: int) -> None:
    rng = np.random.default_rng(11)
    count = 60
    eyes = np.column_stack(
        [np.linspace(-20.0, 320.0, count), rng.uniform(60.0, 140.0, count), rng.uniform(60, 130, count)]
    )
    eyes[4, 0] = np.nan
    turn = sensor.camera_turn(np.column_stack([rng.uniform(-15, 15, (count, 2)), rng.uniform(0.0, 360.0, count)]))
    poses = SensorPoses(eyes, turn.axes, turn.tops, np.arange(count, dtype=float))
    exact = Camera(focal_px=sensor.focal_px, pass_gap_s=1.5, offset_m=0.0, horizontal_m=0.0, lift_m=0.0, turn_rad=0.0,
                   needed=needed, apart_m=12.0 * (needed - 1))  # fmt: skip
    counted = []
    for coverage in maps(sensor):
        counts = kernels.no_observations(coverage.grid.count, needed)
        slopes = local_slopes(coverage.site.ground.surface)
        add_observations(coverage.site, slopes, coverage.sight, exact, coverage.grid.cells, poses, counts)
        counted.append(counts)
    first, second = counted
    assert 20 < (first.first >= 0).sum() < first.first.size
    for name in (
        "passes",
        "first",
        "last_s",
        "nearest_m",
        "ground_sample_m",
        "cos_incidence",
        "outcome",
        "sure",
        "possible",
    ):
        np.testing.assert_array_equal(getattr(second, name), getattr(first, name), err_msg=name)


def test_nothing_is_sure_of_a_view_that_states_no_margins_and_all_that_it_sees_is_possible() -> None:
    errors = Camera(focal_px=900.0, pass_gap_s=1.5, offset_m=2.0, horizontal_m=2.0, lift_m=1.0, turn_rad=0.02)
    poses = SensorPoses(
        np.array([[100.0, 100.0, 90.0]]), np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 1.0, 0.0]]), np.array([0.0])
    )
    first, second = maps(BUILT_IN["nadir"])
    counted = []
    for coverage in (first, second):
        counts = kernels.no_observations(coverage.grid.count)
        slopes = local_slopes(coverage.site.ground.surface)
        add_observations(coverage.site, slopes, coverage.sight, errors, coverage.grid.cells, poses, counts)
        counted.append(counts)
    assert counted[0].sure.any()
    assert not counted[1].sure.any()
    np.testing.assert_array_equal(counted[1].passes, counted[0].passes)
    assert (counted[1].possible[counted[0].possible > 0] > 0).all()


def test_a_view_that_states_its_margins_is_counted_as_surely_as_that_of_the_kernels() -> None:
    @dataclasses.dataclass(frozen=True, kw_only=True)
    class Ball(SphereSensor):
        def in_view(self, rays: Any) -> Any:
            return rays.distance2 <= self.range_m**2

        def surely_in_view(self, rays: Any, *, offset_m: float, turn_rad: float) -> Any:  # noqa: ARG002
            return np.sqrt(rays.distance2) + offset_m <= self.range_m

        def possibly_in_view(self, rays: Any, *, offset_m: float, turn_rad: float) -> Any:  # noqa: ARG002
            return np.sqrt(rays.distance2) - offset_m <= self.range_m

    errors = Camera(focal_px=np.nan, pass_gap_s=1.5, offset_m=5.0, horizontal_m=4.0, lift_m=3.0, turn_rad=0.0)
    rng = np.random.default_rng(3)
    eyes = rng.uniform((0.0, 0.0, 60.0), (300.0, 200.0, 110.0), (12, 3))
    poses = SensorPoses(eyes, np.tile([0.0, 0.0, -1.0], (12, 1)), np.tile([0.0, 1.0, 0.0], (12, 1)), np.arange(12.0))
    counted = []
    for sensor in (BUILT_IN["sphere"], Ball(kind="sphere", range_m=90.0, sensing="along-path")):
        coverage = CoverageMap(make_site(hills, sensor=sensor), cell_size_m=8.0)
        counts = kernels.no_observations(coverage.grid.count)
        slopes = local_slopes(coverage.site.ground.surface)
        add_observations(coverage.site, slopes, coverage.sight, errors, coverage.grid.cells, poses, counts)
        counted.append(counts)
    assert 0 < counted[0].sure.sum() < counted[0].passes.astype(bool).sum() < counted[0].possible.sum()
    for name in ("passes", "first", "sure", "possible"):
        np.testing.assert_array_equal(getattr(counted[1], name), getattr(counted[0], name), err_msg=name)
