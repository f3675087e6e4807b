"""What the vehicle believes of its place, beside where it is; and the log of the truth."""

import csv
import math

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT
from mission_io.wire import messages as m
from tests.mock.bench import Bench, go
from uavcover.errors import InputError
from uavcover.mock.body import GpsError, Positioning
from uavcover.mock.dynamics import Airframe, PointMass
from uavcover.mock.state import TruthSample
from uavcover.mock.telemetry import TruthFile

STEP_S = 0.02


def at_rest(error: GpsError, seed: int = 1) -> Positioning:
    point = PointMass(Airframe(), step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
    return Positioning(point, error, rng=np.random.default_rng(seed))


def test_without_an_error_it_believes_the_truth():
    point = PointMass(Airframe(), step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
    believed = Positioning(point, GpsError(), rng=np.random.default_rng(1))
    for _ in range(100):
        point.step((3.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        believed.step()
        assert believed.position_m == point.position_m
    assert believed.error_m == (0.0, 0.0, 0.0)


def test_the_error_has_its_spread_from_the_start_and_wanders():
    starts = [at_rest(GpsError(horizontal_m=1.5, vertical_m=3.0), seed).error_m for seed in range(400)]
    assert np.std(starts, axis=0) == pytest.approx([1.5, 1.5, 3.0], rel=0.15)
    believed = at_rest(GpsError(horizontal_m=1.5, time_s=2.0))
    errors = []
    for _ in range(40_000):
        believed.step()
        errors.append(believed.error_m)
    track = np.array(errors)
    assert track[:, 0].std() == pytest.approx(1.5, rel=0.2)
    assert np.abs(np.diff(track[:, 0])).max() < 1.0  # it does not jump
    assert not track[:, 2].any()


def test_the_receiver_tells_old_positions():
    point = PointMass(Airframe(max_jerk_m_s3=1e6), step_s=STEP_S, position_m=(0.0, 0.0, 0.0))
    believed = Positioning(point, GpsError(latency_s=0.6), rng=np.random.default_rng(1))
    for _ in range(500):
        point.step((5.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        believed.step()
    behind_m = point.position_m[0] - believed.receiver_m[0]
    assert 5.0 * 0.6 - 0.1 <= behind_m <= 5.0 * (0.6 + 0.2) + 0.1


def test_without_a_fix_it_drifts_and_with_one_it_comes_back():
    believed = at_rest(GpsError())
    believed.step()
    before = believed.receiver_m
    believed.lose_fix()
    for _ in range(500):
        believed.step()
    assert math.hypot(*believed.error_m[:2]) == pytest.approx(0.6 * 10.0)
    assert believed.receiver_m == before
    believed.lost = False
    for _ in range(1000):
        believed.step()
    assert believed.error_m == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("make", [lambda: GpsError(horizontal_m=-1.0), lambda: GpsError(time_s=0.0)])
def test_impossible_errors_are_refused(make):
    with pytest.raises(ValueError, match="must"):
        make()


def test_the_truth_log_stands_beside_what_it_tells(tmp_path):
    reported: list[TruthSample] = []
    bench = Bench(ARDUPILOT, gps=GpsError(horizontal_m=1.0, vertical_m=1.0), on_truth=reported.append)
    bench.run(3.0)
    bench.take_off(go(0, 60, 20))
    bench.run(10.0)
    positions = bench.heard(m.GlobalPositionInt)
    assert [sample.time_s for sample in reported] == [position.time_boot_s for position in positions]
    for sample, position in zip(reported[::20], positions[::20], strict=True):
        north_m = (position.lat_deg - sample.lat_deg) * 110_990.0
        assert north_m == pytest.approx(sample.north_error_m, abs=0.02)
        assert position.alt_amsl_m - sample.alt_amsl_m == pytest.approx(sample.up_error_m, abs=0.02)
    # It flies to where it believes the waypoint to be: really beside it by its error.
    assert max(math.hypot(s.east_error_m, s.north_error_m) for s in reported) > 0.2
    with TruthFile(tmp_path / "truth.csv") as write:
        for sample in reported:
            write(sample)
    with (tmp_path / "truth.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["lat_deg"]) for row in rows] == [sample.lat_deg for sample in reported]


def test_a_truth_file_that_cannot_be_made_is_an_error(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        TruthFile(tmp_path / "no" / "such.csv")
