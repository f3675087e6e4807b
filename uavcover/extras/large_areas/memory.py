"""Memory of a plan, and how a limit is kept: more parts, and fewer of them at a time.

What takes how much was measured, and some added: estimates are 6 to 36 % above what threads take, more with worker processes
(``scripts/bench/memory.py``, docs/results/large.md). It is estimated from the scenario alone, because the number of
parts decides what is planned: the same limit gives the same plan.
"""

from dataclasses import dataclass

from uavcover.errors import InputError
from uavcover.run.shared_file import can_share_files
from uavcover.scenario.site import Site
from uavcover.sensing.block_map import is_large

MIB = 2**20

_PROCESS = 330 * MIB
"""The program with its libraries and compiled code, in the command and in each worker process."""
_NODE = 24
_SHARED_NODE = 8
"""Bytes for each pixel of elevation data as it is read, or as a worker unpacks it; and in a file that all workers map."""
_OF_COMMAND = 420
"""Bytes for each cell of the whole area, in the command: the cells, what routes see of them, and judging side by side."""
_OF_LARGE_COMMAND = 60
_OF_BLOCKS = 500 * MIB
"""The same for an area so large that it is judged block by block, and all blocks that are looked at meanwhile."""
_OF_SAMPLE = 600
_SAMPLE_CELLS = 300_000
"""In its place where it is more: bytes for each cell on which lines over the whole area are looked at, and the most of them."""
_OF_PART = 850
_OF_LARGE_PART = 420
"""Bytes for each cell of a part while it is searched; in a large one there are no finer cells."""
_LARGE_PART_CELLS = 150_000
_LEAST_PART_CELLS = 5_000
"""Smaller parts are not made for the sake of memory: their seams would cost more than the rest."""


@dataclass(frozen=True, slots=True)
class MemoryNeed:
    """Approximate memory for planning a site, in bytes.

    Attributes:
        command: the command itself, without searching.
        worker: each process beside it, without searching; 0 for threads.
        cells: of the whole area, their number.
    """

    command: float
    worker: float
    cells: float

    def of_part(self, parts: int) -> float:
        """Memory of the search in one of this number of equal parts."""
        cells = self.cells / parts
        return max(cells * _OF_LARGE_PART, min(cells, _LARGE_PART_CELLS) * _OF_PART)

    def total(self, parts: int, at_a_time: int) -> float:
        """Memory with this number of parts, of which ``at_a_time`` are searched at a time."""
        return self.command + at_a_time * (self.worker + self.of_part(parts))


def memory_need(site: Site, *, processes: bool) -> MemoryNeed:
    """Memory for planning a site.

    Args:
        site: the scenario on its ground.
        processes: whether parts are searched by processes beside this one, instead of by its threads.
    """
    cells = site.area.area / site.scenario.area.cell_size_m**2
    nodes = site.ground.surface.up_m.size
    whole = max(cells * _OF_COMMAND, min(cells, _SAMPLE_CELLS) * _OF_SAMPLE)
    of_cells = _OF_BLOCKS + cells * _OF_LARGE_COMMAND if is_large(site) else whole
    mapped = processes and can_share_files()
    return MemoryNeed(
        command=_PROCESS + nodes * (_NODE + (_SHARED_NODE if mapped else 0)) + of_cells,
        worker=_PROCESS + nodes * (0 if mapped else _NODE) if processes else 0.0,
        cells=cells,
    )


def parts_within(need: MemoryNeed, limit: int, *, parts: int, most_parts: int, given: bool) -> int:
    """Number of parts of an area for which planning stays within a limit, with any workers.

    Args:
        need: what it takes.
        limit: in bytes, of all processes together.
        parts: how many there would be without the limit.
        most_parts: how many there can be.
        given: whether the user asked for that number.

    Raises:
        InputError: it takes more with any number of parts, or with the requested number.
    """
    if need.total(parts, 1) <= limit:
        return parts
    most = max(parts, min(most_parts, int(need.cells / _LEAST_PART_CELLS)))
    enough = next((count for count in range(parts, most + 1) if need.total(count, 1) <= limit), None)
    if enough is None:
        raise InputError(
            f"--memory: planning {need.cells:,.0f} cells takes at least about {in_words(need.total(most, 1))}; allow "
            "this amount, or set a larger area.cell_size_m"
        )
    if given:
        raise InputError(
            f"--memory: {parts} {'parts take' if parts > 1 else 'part takes'} about "
            f"{in_words(need.total(parts, 1))}; use --parts {enough} or --parts auto"
        )
    return enough


def at_a_time_within(need: MemoryNeed, limit: int, *, parts: int, workers: int) -> int:
    """Number of workers that may search at the same time; 1 at least."""
    each = need.worker + need.of_part(parts)
    return max(1, min(workers, int((limit - need.command) / each)))


def in_words(count: float) -> str:
    """Bytes, such as ``1.5 GiB``, rounded up."""
    tens = -(-count // (10 * MIB))
    return f"{10 * tens:.0f} MiB" if tens < 102 else f"{-(-count // (102.4 * MIB)) / 10:.1f} GiB"
