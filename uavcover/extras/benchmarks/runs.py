"""Runs of a benchmark in processes that end with this one, kept as one JSON file each, and tables about them.

Each process has one BLAS thread, so that thread pools do not fight for cores. Files are written whole: a killed benchmark
continues where it stopped.
"""

import csv
import io
import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar, cast

from uavcover.errors import InputError, OutputError, UavcoverError
from uavcover.run.file_group import remove_half_written
from uavcover.run.folder import RunFolder, json_text, write_text
from uavcover.run.scheduling import workers_of

Task = TypeVar("Task")
Result = TypeVar("Result")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def available_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def completed(
    function: Callable[[Task], Result], tasks: Sequence[Task], *, processes: int
) -> Iterator[tuple[Task, Result]]:
    """Each task with its result, in the order in which they get done.

    Every process has one BLAS thread. Leaving the iteration, by an exception too, kills the processes at once; killing this
    process ends them as well.

    Args:
        function: importable by name, as its tasks and results pickle.
        tasks: what it is called with, begun in this order.
        processes: how many at a time, at least 1.

    Raises:
        UavcoverError: a process was killed from outside; names its task.
        Exception: what ``function`` raised.
    """
    context = multiprocessing.get_context("spawn")
    waiting = list(reversed(tasks))
    crew: dict[Connection, tuple[BaseProcess, Task | None]] = {}  # what each process is at
    try:
        with _one_thread_each():
            for _ in range(min(processes, len(tasks))):
                ours, theirs = context.Pipe()
                worker: BaseProcess = context.Process(target=_work, args=(function, theirs), daemon=True)
                worker.start()
                theirs.close()
                crew[ours] = (worker, None)
        for pipe in crew:
            _give_next(pipe, waiting, crew)
        while any(task is not None for _, task in crew.values()):
            for pipe in cast("list[Connection]", wait([pipe for pipe, (_, task) in crew.items() if task is not None])):
                task = cast("Task", crew[pipe][1])
                result: Result = _received(pipe, task)
                _give_next(pipe, waiting, crew)
                yield task, result
    finally:
        for pipe, (worker, _) in crew.items():
            pipe.close()
            worker.kill()
            worker.join()


def completed_by(
    scheduler: str | None, function: Callable[[Task], Result], tasks: Sequence[Task], *, processes: int | None
) -> Iterator[tuple[Task, Result]]:
    """Each task with its result: by processes of this benchmark, or by the workers of a scheduler.

    Args:
        scheduler: see :func:`uavcover.run.scheduling.workers_of`; None: processes.
        function: as :func:`completed` takes it; its result depends on its task alone.
        tasks: as :func:`completed` takes them.
        processes: how many at a time; None: one for each core.

    Raises:
        InputError: both were given, or the scheduler cannot be used.
        UavcoverError: a process was killed, or the scheduler is gone.
    """
    if scheduler is None:
        yield from completed(function, tasks, processes=processes or available_cores())
        return
    if processes is not None:
        raise InputError("--processes cannot be combined with --scheduler; omit one of them")
    with workers_of(scheduler) as workers:
        yield from workers.completed(_called, function, tasks)


def _called(function: Callable[[Task], Result], task: Task) -> Result:
    return function(task)


def _give_next(pipe: Connection, waiting: list[Task], crew: dict[Connection, tuple[BaseProcess, Task | None]]) -> None:
    task = waiting.pop() if waiting else None
    if task is not None:
        pipe.send(task)
    crew[pipe] = (crew[pipe][0], task)


def _received(pipe: Connection, task: object) -> Any:
    try:
        well, answer = pipe.recv()
    except (EOFError, ConnectionResetError):
        raise UavcoverError(
            f"{task}: the process was killed, possibly for lack of memory; finished work is kept; run the same command again"
        ) from None
    if not well:
        raise answer
    return answer


def _work(function: Callable[[Task], Result], pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        answer: tuple[bool, Result | Exception]
        try:
            answer = (True, function(task))
        except Exception as error:
            answer = (False, error)
        pipe.send(answer)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes begun inside have one thread for linear algebra; a library reads this when it is imported."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


_SETTINGS = "settings.json"


@contextmanager
def reserved_folder(path: Path, settings: Mapping[str, str | int | float], *, runs: str) -> Iterator[None]:
    """Make a folder of runs, or take up one made with the same settings, and keep other processes out of it.

    Args:
        path: the folder.
        settings: what its runs have in common.
        runs: the folder in it that has the files of the runs.

    Raises:
        InputError: its runs were made with other settings.
        OutputError: it has files but is not one of ours, or cannot be written to.
    """
    with RunFolder(path).reserved([], force=False):
        file = path / _SETTINGS
        if file.exists():
            before = _document(file)
            if before != settings:
                raise InputError(
                    f"{path}: the runs in this folder use {_words_of(before)}, not {_words_of(settings)}; use another folder"
                )
        elif any(path.iterdir()):
            raise OutputError(f"{path}: this folder has files, but no {_SETTINGS} of a benchmark; use another folder")
        else:
            write_text(file, json_text(dict(settings)))
        remove_half_written((path / runs).rglob("*"))
        yield


def write_run(path: Path, text: str) -> None:
    """Write the file of a run, whole or not at all. Raises OutputError: it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path.parent}: cannot create the folder ({error.strerror})") from error
    write_text(path, text)


class KeptRuns:
    """Folder of a benchmark's runs: ``runs/KEY.json``; a key has slashes, as ``R2-ray/imodbo/1``.

    Attributes:
        path: the folder.
        settings: what all its runs have in common; runs of different settings are not mixed.
    """

    def __init__(self, path: Path, settings: Mapping[str, str | int | float]) -> None:
        self.path = path
        self.settings = dict(settings)

    def reserved(self) -> AbstractContextManager[None]:
        """As `reserved_folder` does it."""
        return reserved_folder(self.path, self.settings, runs="runs")

    def file(self, key: str) -> Path:
        """File of a run."""
        return self.path / "runs" / f"{key}.json"

    def has(self, key: str) -> bool:
        """Whether a run is done."""
        return self.file(key).is_file()

    def done(self) -> list[str]:
        """Every run that is done, sorted by its parts, numbers by their size."""
        root = self.path / "runs"
        found = (path.relative_to(root).with_suffix("") for path in root.rglob("*.json"))
        return sorted((key.as_posix() for key in found), key=_by_parts)

    def write(self, key: str, document: dict[str, Any]) -> None:
        """Write a run, whole or not at all; with exact numbers. Raises OutputError: it cannot be written."""
        write_run(self.file(key), json_text(document))

    def read(self, key: str) -> dict[str, Any]:
        """A run as it was written. Raises InputError: the file cannot be read."""
        return _document(self.file(key))


def kept(
    folder: KeptRuns,
    make: Callable[[Task], dict[str, Any]],
    runs: Sequence[Task],
    *,
    processes: int | None,
    scheduler: str | None = None,
) -> Iterator[Task]:
    """Make runs in parallel, and yield each once it is in the folder under its text as a key.

    Arguments are those of :func:`completed_by`; what a run comes to does not depend on the workers.

    Raises:
        UavcoverError: a process was killed, or a run failed; what is done is kept.
    """
    for run, document in completed_by(scheduler, make, runs, processes=processes):
        folder.write(str(run), document)
        yield run


def _document(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(document, dict):
            raise ValueError("expected an object")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot read the file ({error}); delete it and run the command again") from error
    return document


def _by_parts(key: str) -> list[tuple[int, int, str]]:
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in key.split("/")]


def _words_of(settings: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {value}" for name, value in settings.items())


def csv_text(header: Sequence[object], rows: Iterable[Iterable[object]]) -> str:
    """A table as CSV; numbers unrounded.

    >>> print(csv_text(["a", "b"], [[1, 0.5]]), end="")
    a,b
    1,0.5
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    return text.getvalue()


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table.

    >>> print(markdown(["a", "b"], [["1", "2"]]))
    | a | b |
    |---|---|
    | 1 | 2 |
    """
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("|" + "|".join(f" {cell} " if cell != "---" else cell for cell in line) + "|" for line in lines)


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write texts by the names of their files; returns the files. Raises OutputError: one cannot be written."""
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


@contextmanager
def drawn(path: Path, *, dpi: int) -> Iterator[Any]:
    """``matplotlib.pyplot`` without a window; the figure that is made inside is written to the file, and closed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    try:
        yield pyplot
        pyplot.savefig(path, dpi=dpi)
    finally:
        pyplot.close()
