"""What one look finds, and what several at one place come to, against the naive twin."""

import math

import numpy as np
import pytest

from tests.compiled_kernels import cases
from tests.kernels.test_observation_counting import DOWN, EXACT, flat_ground, one_cell, tops_of
from tests.naive import detection as naive
from uavcover.kernels import coverage as kernels
from uavcover.kernels import observation_counting
from uavcover.kernels.sight import CONE, RAY, Sight, local_slopes


def some_table(rng):
    samples = np.cumsum(rng.uniform(0.001, 0.02, int(rng.integers(1, 7))))
    angles = np.append(0.0, np.cumsum(rng.uniform(1.0, 25.0, int(rng.integers(0, 4)))))
    return kernels.detection_table(samples, angles, rng.uniform(0.0, 1.0, (angles.size, samples.size)))


@pytest.mark.parametrize("seed", range(cases(compiled=60, interpreted=6)))
def test_a_look_equals_its_naive_twin(seed):
    rng = np.random.default_rng(seed)
    table = some_table(rng)
    for _ in range(20):
        sample_m = float(rng.choice([rng.uniform(0.0, 0.1), rng.choice(table.sample_m)]))
        angle_deg = float(rng.choice([rng.uniform(0.0, 90.0), rng.choice(table.off_vertical_deg)]))
        expected = naive.of_one_look(table.sample_m, table.off_vertical_deg, table.probability, sample_m, angle_deg)
        assert kernels.look_probability(table, sample_m, angle_deg) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("away", "side"),
    [
        ((0, 0, 50), 0),
        ((30, 0, 50), 0),
        ((0, 60, 50), 1),
        ((60, 1, 50), 2),
        ((-10, -90, 50), 3),
        ((-60, 59, 50), 4),
        ((59, 60, 50), 1),
    ],
)
def test_looks_are_kept_by_the_side_they_come_from(away, side):
    table = kernels.detection_table(np.array([1.0]), np.array([0.0, 90.0]), np.array([[0.4], [0.4]]))
    looks = kernels.no_looks(2)
    for _ in range(2):
        kernels.note_look(table, looks, 1, 0.5, *map(float, away))
    assert looks.best[1].tolist() == [0.4 if k == side else 0.0 for k in range(kernels.SIDES)]
    assert looks.missed.tolist() == pytest.approx([1.0, 0.36])
    assert not looks.best[0].any()


def test_only_looks_that_show_a_cell_count_and_only_where_somebody_searches():
    table = kernels.detection_table(np.array([0.2]), np.array([0.0, 90.0]), np.array([[0.3], [0.3]]))
    ground, sight = flat_ground(), Sight(CONE, 500.0, math.tan(math.radians(30.0)), 0.0, RAY)
    eyes = np.array([[0.0, 0.0, 80.0], [20.0, 0.0, 80.0], [70.0, 0.0, 80.0]])  # the last one looks past the cell
    axes = np.repeat(DOWN, 3, axis=0)
    poses = observation_counting.SensorPoses(eyes, axes, tops_of(axes), np.arange(3.0))
    for searched in (True, False):
        counts = observation_counting.no_observations(1, searched=searched)
        camera = EXACT._replace(detection=table)
        observation_counting.count_rows(ground, local_slopes(ground), sight, camera, one_cell(), poses, (0, 1), counts)
        assert counts.looks.missed.tolist() == pytest.approx([0.49] if searched else [])
