"""Making the runs of an MMF benchmark that are not there yet, in processes."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from uavcover.benchmarks.contenders import Budget, solve
from uavcover.benchmarks.mmf import PROBLEMS
from uavcover.benchmarks.mmf_folder import MmfFolder, RunId
from uavcover.benchmarks.processes import completed


@dataclass(frozen=True, slots=True)
class _Task:
    folder: Path
    run: RunId
    budget: Budget

    def __str__(self) -> str:
        return str(self.run)


def missing_runs(
    folder: MmfFolder, *, functions: Collection[str], algorithms: Collection[str], runs: int
) -> list[RunId]:
    """What is still to be done, first runs first, so that a benchmark that is stopped early has seen everything once."""
    done = set(folder.runs())
    wanted = (
        RunId(number, function, algorithm)
        for number in range(1, runs + 1)
        for function in functions
        for algorithm in algorithms
    )
    return [run for run in wanted if run not in done]


def make_runs(folder: MmfFolder, runs: Collection[RunId], budget: Budget, *, processes: int) -> Iterator[RunId]:
    """Make the runs and yield each once it is in the folder; the result does not depend on the number of processes.

    Raises:
        UavcoverError: a process was killed, or a run failed; what is done is kept.
    """
    tasks = [_Task(folder.path, run, budget) for run in runs]
    for task, _ in completed(_make, tasks, processes=processes):
        yield task.run


def _make(task: _Task) -> None:
    x, objectives = solve(PROBLEMS[task.run.function], task.run.algorithm, seed=task.run.number, budget=task.budget)
    MmfFolder(task.folder).write(task.run, x, objectives)
