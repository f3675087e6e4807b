"""The observations of a flight counted by the workers of a scheduler, block by block."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager

from uavcover.run.scheduling import Workers, workers_of
from uavcover.sensing.coverage_map import CoverageMap, row_blocks
from uavcover.verification.flown_blocks import CountedFlight, count_block, joined_blocks
from uavcover.verification.flown_coverage import FlownCoverage, count_observations
from uavcover.verification.observations import Observations
from uavcover.verification.verify import CountObservations

_BLOCK_CELLS = 250_000


@contextmanager
def counter_of(scheduler: str | None) -> Iterator[CountObservations]:
    """Who counts the observations; see :func:`uavcover.run.scheduling.workers_of`; none: threads of this process."""
    if scheduler is None:
        yield count_observations
        return
    with workers_of(scheduler) as workers:
        yield count_by(workers)


def count_by(workers: Workers, *, block_cells: int = _BLOCK_CELLS) -> CountObservations:
    """Count by workers, in blocks of about so many cells; the result does not depend on either."""

    def count(coverage: CoverageMap, observations: Observations) -> FlownCoverage:
        # A copy of the site has nothing that can be computed again.
        flight = CountedFlight(dataclasses.replace(coverage.site), observations)
        tasks = [(rows.start, rows.stop) for rows in row_blocks(coverage.site, cells=block_cells)]
        found = dict(workers.completed(count_block, flight, tasks))
        return joined_blocks([found[task] for task in tasks])

    return count
