"""A flight judged by blocks of cells, each with the observations near it: the same verdict on every cell."""

import dataclasses
import pickle

import numpy as np
import pytest

from tests.planner.sites import make_site, with_scenario
from tests.sensing.test_blocks import hard_site
from uavcover.model.scenario import Uncertainty
from uavcover.model.sensor import FrameCamera, NadirCamera
from uavcover.scenario.site import Site
from uavcover.sensing.site_maps import judging_block, judging_map, row_blocks
from uavcover.verification.flown_coverage import (
    CountedFlight,
    FlownCoverage,
    count_block,
    count_by,
    count_observations,
    joined_blocks,
    near_block,
)
from uavcover.verification.observations import Observations

FRAME = FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=45.0, range_m=180.0)
NARROW = NadirCamera(kind="nadir-camera", fov_deg=25.0, range_m=120.0)
EXACT, UNSURE = Uncertainty(), Uncertainty(position_m=4.0, attitude_deg=2.0)


def wandering(site: Site, count: int = 400, *, known: float = 1.0) -> Observations:
    """A vehicle that wanders over the area and leans this way and that."""
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 40.0, count)
    en = np.column_stack([150.0 + 170.0 * np.sin(0.31 * t), 100.0 + 120.0 * np.cos(0.47 * t)])
    positions = np.column_stack([en, site.ground.ups_m(en, 40.0 + 70.0 * rng.random(count))])
    axes = np.column_stack([0.3 * rng.normal(size=(count, 2)), -np.ones(count)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    tops = np.cross(axes, np.column_stack([np.cos(t), np.sin(t), np.zeros(count)]))
    tops /= np.linalg.norm(tops, axis=1)[:, None]
    return Observations(positions, axes, tops, t, rng.random(count) < known)


def same(one: FlownCoverage, other: FlownCoverage) -> bool:
    return all(
        np.array_equal(getattr(one, each.name), getattr(other, each.name), equal_nan=True)
        if getattr(one, each.name).dtype.kind == "f"
        else np.array_equal(getattr(one, each.name), getattr(other, each.name))
        for each in dataclasses.fields(FlownCoverage)
    )


@pytest.mark.parametrize("uncertainty", [EXACT, UNSURE], ids=["exact", "unsure"])
@pytest.mark.parametrize(("sensor", "known"), [(NARROW, 1.0), (FRAME, 0.8)], ids=["nadir", "frame"])
def test_every_cell_is_judged_the_same_in_blocks(sensor, known, uncertainty) -> None:
    site = with_scenario(hard_site(sensor), uncertainty=uncertainty)
    flight = CountedFlight(site, wandering(site, known=known))
    whole = count_observations(judging_map(site), flight.observations)
    assert 0.2 < whole.observed.mean() < 1.0
    for step in (1, 6):
        rows = judging_map(site).grid.cells.lattice.shape[0]
        pieces = [count_block(flight, (first, min(first + step, rows))) for first in range(0, rows, step)]
        assert same(joined_blocks(pieces), whole)


def test_a_block_asks_only_what_was_observed_near_it() -> None:
    site = make_site(ring=((0.0, 0.0), (100.0, 0.0), (100.0, 900.0), (0.0, 900.0)), cell_m=20.0)
    positions = np.column_stack([np.full(90, 50.0), np.linspace(0.0, 900.0, 90), np.full(90, 100.0)])
    down = np.tile([0.0, 0.0, -1.0], (90, 1))
    observations = Observations(
        positions, down, np.tile([0.0, 1.0, 0.0], (90, 1)), np.arange(90.0), np.ones(90, dtype=bool)
    )
    block = judging_block(site, range(3))
    near = near_block(block, observations)
    # 50 m of centres, and the camera's range of 200 m.
    assert near.positions_m[:, 1].max() == pytest.approx(250.0, abs=12.0)
    assert same(count_observations(block, near), count_observations(block, observations))
    assert len(near_block(judging_block(site, range(0)), observations)) == 0


class Elsewhere:
    """Workers that get and give everything as bytes, in another order."""

    count = 3

    def completed(self, function, shared, tasks, *, should_stop=lambda: False):
        del should_stop
        for task in reversed(tasks):
            # Protocol 5 keeps arrays read-only, which kernels are compiled for.
            sent = pickle.loads(pickle.dumps((function, shared, task), protocol=5))
            yield task, pickle.loads(pickle.dumps(sent[0](*sent[1:]), protocol=5))


def test_workers_count_what_this_process_counts() -> None:
    site = with_scenario(hard_site(), uncertainty=UNSURE)
    coverage, observations = judging_map(site), wandering(site)
    assert len(row_blocks(site, cells=300)) > 3
    assert same(
        count_by(Elsewhere(), block_cells=300)(coverage, observations), count_observations(coverage, observations)
    )
