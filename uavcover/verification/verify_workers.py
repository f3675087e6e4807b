"""The observations of a flight counted by the workers of a scheduler, block by block."""

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields

import numpy as np

from uavcover.run.scheduling import Workers, workers_of
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, judging_block, row_blocks
from uavcover.verification.flown_coverage import FlownCoverage, count_observations
from uavcover.verification.observations import Observations
from uavcover.verification.verify import CountObservations

_BLOCK_CELLS = 250_000


@contextmanager
def counter_of(scheduler: str | None) -> Iterator[CountObservations]:
    """The workers that count the observations (:func:`uavcover.run.scheduling.workers_of`); None: threads of this process."""
    if scheduler is None:
        yield count_observations
        return
    with workers_of(scheduler) as workers:
        yield count_by(workers)


def count_by(workers: Workers, *, block_cells: int = _BLOCK_CELLS) -> CountObservations:
    """Count by workers, in blocks of about ``block_cells`` cells; the result does not depend on either."""

    def count(coverage: CoverageMap, observations: Observations) -> FlownCoverage:
        # A copy of the site has nothing that can be computed again.
        flight = CountedFlight(dataclasses.replace(coverage.site), observations)
        tasks = [(rows.start, rows.stop) for rows in row_blocks(coverage.site, cells=block_cells)]
        found = dict(workers.completed(count_block, flight, tasks))
        return joined_blocks([found[task] for task in tasks])

    return count


# Coverage of a flown track by blocks of cells: each is a task of its own, for any worker.
#
# Whether a cell is observed does not depend on other cells, and it is the same cell in a block as among all. No difference arises
# along the edges of blocks, and a block needs no more of the flight than what was observed within the sensor's reach of it.


@dataclass(frozen=True, slots=True, eq=False)
class CountedFlight:
    """Data shared by the tasks of a flight.

    Attributes:
        site: the scenario on its ground.
        observations: of the flight, in order of time.
    """

    site: Site
    observations: Observations


def count_block(flight: CountedFlight, rows: tuple[int, int]) -> FlownCoverage:
    """Count every observation of the cells in some rows of the lattice: from the first number to before the second."""
    block = judging_block(flight.site, range(*rows))
    return count_observations(block, near_block(block, flight.observations))


def near_block(block: CoverageMap, observations: Observations) -> Observations:
    """Observations that may see some cell of a block under any error within the scenario's [uncertainty]."""
    centre_m = block.grid.cells.centre_m
    if len(centre_m) == 0:
        return observations.where(np.zeros(len(observations), dtype=bool))
    uncertainty = block.site.scenario.uncertainty
    halo_m = block.sight.reach_m + 2.0 * (uncertainty.position_m + block.site.vertical_uncertainty_m) + 1.0
    places_m = observations.places_m
    near = np.ones(len(observations), dtype=bool)
    for axis in range(2):
        near &= places_m[:, axis] >= centre_m[:, axis].min() - halo_m
        near &= places_m[:, axis] <= centre_m[:, axis].max() + halo_m
    return observations.where(near)


def joined_blocks(blocks: Sequence[FlownCoverage]) -> FlownCoverage:
    """Blocks in the order of their rows, as what they are together."""
    return FlownCoverage(
        **{each.name: np.concatenate([getattr(block, each.name) for block in blocks]) for each in fields(FlownCoverage)}
    )
