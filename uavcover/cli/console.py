"""What the commands say, and how: text or one JSON object on stdout, progress and logs on stderr."""

import json
import logging
import math
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from rich.console import Console as RichConsole
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

_SHOW_AFTER_S = 2.0


class Console:
    """Where a command writes to.

    Args:
        as_json: one JSON object on stdout at the end, and no other line there.
        verbosity: -1 quiet, 0 normal, 1 and more for logs.
    """

    def __init__(self, *, as_json: bool = False, verbosity: int = 0) -> None:
        self.as_json = as_json
        self.quiet = verbosity < 0
        level = logging.WARNING if verbosity <= 0 else logging.INFO if verbosity == 1 else logging.DEBUG
        logging.basicConfig(level=level, stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s", force=True)
        self._errors = RichConsole(stderr=True)

    def say(self, line: str = "") -> None:
        """A line for people; on stderr under --json, nowhere under -q."""
        if not self.quiet:
            sys.stderr.write(line + "\n") if self.as_json else sys.stdout.write(line + "\n")
            (sys.stderr if self.as_json else sys.stdout).flush()

    def warn(self, line: str) -> None:
        """A line that should not be missed; always on stderr."""
        sys.stderr.write(f"warning: {line}\n")
        sys.stderr.flush()

    def result(self, document: dict[str, Any]) -> None:
        """The command's answer as JSON, when that was asked for."""
        if self.as_json:
            sys.stdout.write(json.dumps(_plain(document), ensure_ascii=False) + "\n")
            sys.stdout.flush()

    @contextmanager
    def progress(self, what: str, total: float | None = None) -> Iterator["Bar"]:
        """A progress bar on a terminal, for what takes over two seconds; nothing when stderr is piped."""
        if self.quiet or not self._errors.is_terminal:
            yield Bar(None, None)
            return
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[note]}"),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=self._errors, transient=True) as progress:
            progress.live.auto_refresh = True
            task = progress.add_task(what, total=total, note="", visible=False)
            yield Bar(progress, task)


class Bar:
    """A progress bar, or nothing."""

    def __init__(self, progress: Progress | None, task: TaskID | None) -> None:
        self._progress, self._task = progress, task
        self._started_s = time.monotonic()

    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Show how far it is; appears once it has taken two seconds."""
        if self._progress is not None and self._task is not None:
            visible = time.monotonic() - self._started_s > _SHOW_AFTER_S
            self._progress.update(self._task, completed=done, total=total, note=note, visible=visible)

    def count(self, done: int, total: int) -> None:
        """Show ``done`` of ``total``."""
        self.update(done, total=total)


class Interrupts:
    """Counts Ctrl-C (and SIGTERM) instead of raising, so that work can end in good order; a third one raises."""

    def __init__(self) -> None:
        self.count = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Interrupts":
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._take)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _take(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self.count += 1
        if self.count > 2:
            raise KeyboardInterrupt

    def any(self) -> bool:
        """Whether the user wants to stop."""
        return self.count > 0


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def percent(share: float | None) -> str:
    """A share 0..1 for people."""
    return "-" if share is None else f"{100.0 * share:.2f} %"


def metres(value: float | None) -> str:
    """A length for people."""
    return "-" if value is None else f"{value:.1f} m"
