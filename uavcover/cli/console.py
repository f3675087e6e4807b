"""Output of the commands: text or one JSON object on stdout, progress and logs on stderr."""

import contextlib
import logging
import math
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self, TextIO

from rich.console import Console as RichConsole
from rich.console import RenderableType
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

from mission_io.model.plain_text import plain_lines, plain_text, plain_values
from uavcover.errors import OutputError, StageOver
from uavcover.run.folder import json_line

_STATUS_EVERY_S, _LINE_EVERY_S, _EVENT_EVERY_S, _DRAWN_EVERY_S = 30.0, 60.0, 0.2, 1.0


class Console:
    """The output of a command.

    Args:
        as_json: one JSON object on stdout at the end, and no other line there.
        verbosity: -1 quiet, 0 normal, 1 and more for logs.
    """

    def __init__(self, *, as_json: bool = False, verbosity: int = 0) -> None:
        self.as_json = as_json
        self.quiet = verbosity < 0
        level = logging.WARNING if verbosity <= 0 else logging.INFO if verbosity == 1 else logging.DEBUG
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(_PlainFormatter("%(levelname)s %(name)s: %(message)s"))
        logging.basicConfig(level=level, handlers=[handler], force=True)
        self._terminal = RichConsole(stderr=True)
        self._bar_is_there = False

    def say(self, line: str = "") -> None:
        """A line as text; on stderr under --json, nowhere under -q."""
        if not self.quiet:
            self._write(sys.stderr if self.as_json else sys.stdout, line)

    def show_limits(self, head: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """The head of a table of limits; its lines follow."""
        del rows
        self.say(head)

    def suggest(self, *commands: str) -> None:
        """Suggest the commands to run next, one a line."""
        for number, command in enumerate(commands):
            self.say(f"{'Next:' if number == 0 else '     '} {command}")

    def warn(self, line: str) -> None:
        """A line that should not be missed; always on stderr."""
        self._write(sys.stderr, f"warning: {line}")

    def agrees(self, question: str) -> bool:
        """Ask on the terminal; False without one."""
        if self.as_json or not sys.stdin.isatty():
            return False
        self._write(sys.stderr, f"{question} [y/N]")
        return sys.stdin.readline().strip().lower() in ("y", "yes")

    def ring(self) -> None:
        """The terminal's bell; nothing where stderr is none."""
        if not sys.stderr.isatty():
            return
        try:
            sys.stderr.write("\a")
            sys.stderr.flush()
        except OSError:
            discard(sys.stderr)

    def result(self, document: dict[str, Any]) -> None:
        """Print the command's answer as JSON under ``--json``. Raises OutputError: stdout cannot be written to."""
        if not self.as_json:
            return
        try:
            sys.stdout.write(json_line(plain_values(document)) + "\n")
            sys.stdout.flush()
        except OSError as error:
            discard(sys.stdout)
            raise OutputError(f"standard output cannot be written ({error.strerror})") from error

    def _write(self, stream: TextIO, line: str) -> None:
        line = plain_text(line)
        try:
            if self._bar_is_there and stream.isatty():
                self._terminal.print(line, markup=False, highlight=False, emoji=False, soft_wrap=True)
                return
            stream.write(line + "\n")
            stream.flush()
        except OSError:
            # The reader has gone (`uavcover fly ... | head`) or its disk is full. A vehicle in the air needs us anyway.
            discard(stream)

    @contextmanager
    def progress(self, what: str, total: float | None = None) -> Iterator["Bar"]:
        """A progress bar on a terminal, for what takes over two seconds; a line every minute when stderr is piped."""
        if self.quiet or not self._terminal.is_interactive:
            yield Bar(None, None, self, what=what, total=total)
            return
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=24),  # so that a note of 36 characters fits beside it into 80
            TextColumn("{task.fields[note]}", markup=False),
            TimeRemainingColumn(),
        )
        progress = _OneLine(
            *columns, console=self._terminal, transient=True, redirect_stdout=False, redirect_stderr=False
        )
        task = progress.add_task(plain_text(what), total=total, note="", status="")
        appears = threading.Timer(2.0, progress.start)
        appears.daemon = True
        appears.start()
        self._bar_is_there = True
        try:
            yield Bar(progress, task, self)
        finally:
            self._bar_is_there = False
            appears.cancel()
            appears.join()
            with contextlib.suppress(OSError):  # the terminal may have been closed
                progress.stop()

    def stop_requests(self, first: str) -> "Interrupts":
        """Counts Ctrl-C and its like while the context lasts; ``first`` is written when the first one comes."""
        return Interrupts(first)

    def pause_requests(self) -> "PauseKey":
        """Takes the pause key while the context lasts."""
        return PauseKey(self)


class EventConsole(Console):
    """Writes messages and progress as JSON lines to stderr.

    Each is an object with ``say``, ``warn``, ``next`` (commands), ``progress``, ``route`` (places) or ``status``; that of
    the head of a vehicle's table of limits also has ``limits``.
    """

    def say(self, line: str = "") -> None:
        """A message."""
        self.write_event({"say": line})

    def show_limits(self, head: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """A vehicle's table of limits."""
        self.write_event({"say": head, "limits": list(rows)})

    def suggest(self, *commands: str) -> None:
        """The commands to run next."""
        self.write_event({"next": list(commands)})

    def warn(self, line: str) -> None:
        """A message that should not be missed."""
        self.write_event({"warn": line})

    def write_event(self, event: dict[str, Any]) -> None:
        """Write one line."""
        self._write(sys.stderr, json_line(plain_values(event)))

    @contextmanager
    def progress(self, what: str, total: float | None = None) -> Iterator["Bar"]:
        """Progress as events, the first one at once."""
        yield _EventBar(self, what, total)


class _OneLine(Progress):
    """A progress bar, or the line of its task's status as far as it fits."""

    def get_renderables(self) -> Iterable[RenderableType]:
        """Renderables of the progress display."""
        lines = [task.fields["status"] for task in self.tasks if task.fields["status"]]
        yield Text(lines[-1], no_wrap=True, overflow="ellipsis") if lines else self.make_tasks_table(self.tasks)


class Bar:
    """A progress bar, or nothing; then a line of progress every minute, of status every 30 s."""

    def __init__(
        self, progress: Progress | None, task: TaskID | None, console: Console, *, what: str = "",
        total: float | None = None, clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self._progress, self._task, self._console = progress, task, console
        self._what, self._total, self._clock = what, total, clock
        self._said_s = 0.0
        self._began_s = self._line_s = clock()

    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Show how far it is."""
        self._total = total if total is not None else self._total
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, completed=done, total=total, note=plain_text(note))
        elif (now := self._clock()) - self._line_s >= _LINE_EVERY_S:
            self._line_s = now
            self._console.say(
                f"  {self._what}: {self._fraction(done, now - self._began_s)}{f'; {note}' if note else ''}"
            )

    def _fraction(self, done: float, took_s: float) -> str:
        if not self._total or done <= 0.0:
            return f"{took_s / 60.0:.0f} min so far"
        left_min = took_s / 60.0 * (self._total / done - 1.0)
        return f"{min(1.0, done / self._total):.0%} done, about {max(0.0, left_min):.0f} min left"

    def count(self, done: int, total: int) -> None:
        """Show ``done`` of ``total``."""
        self.update(done, total=total)

    def draw(self, lon_lat_deg: Callable[[], Sequence[Sequence[float]]]) -> None:
        """Draw nothing: there is no map."""

    def status(self, line: str, *, at_s: float) -> None:
        """Show this line, or the bar when it is empty; piped output gets one every 30 s."""
        if self._progress is not None and self._task is not None:
            self._progress.update(self._task, status=plain_text(line))
        elif line and at_s >= self._said_s + _STATUS_EVERY_S:
            self._said_s = at_s
            self._console.say(f"  {at_s:.1f} s {line}")


class _EventBar(Bar):
    """Progress and status as events."""

    def __init__(
        self, console: EventConsole, what: str, total: float | None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(None, None, console, what=what, total=total, clock=clock)
        self._events = console
        self._written_s = self._drawn_s = -math.inf
        self.update(0.0)

    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Write how far it is."""
        self._total = total if total is not None else self._total
        if self._clock() >= self._written_s + _EVENT_EVERY_S or (self._total and done >= self._total):
            self._written_s = self._clock()
            progress = {"what": self._what, "done": done, "total": self._total, "note": note}
            self._events.write_event({"progress": progress})

    def draw(self, lon_lat_deg: Callable[[], Sequence[Sequence[float]]]) -> None:
        """Write the places of a route, once a second at most."""
        if self._clock() >= self._drawn_s + _DRAWN_EVERY_S:
            self._drawn_s = self._clock()
            self._events.write_event({"route": [[round(value, 7) for value in position] for position in lon_lat_deg()]})

    def status(self, line: str, *, at_s: float) -> None:
        """Write the vehicle's status."""
        if line:
            self._events.write_event({"status": line, "at_s": at_s})


_ORDERLY_S = 0.15
"""A stage may end in good order for this long after a request to stop."""


class Interrupts:
    """Counts Ctrl-C, SIGTERM and SIGHUP instead of raising, so that work can end in good order; a third one raises.

    Args:
        first: what to say at once when the first one comes.
    """

    def __init__(self, first: str) -> None:
        self.count = 0
        self._first = first
        self._before: dict[int, Any] = {}
        self._ready: Callable[[], bool] | None = None

    def __enter__(self) -> "Interrupts":
        for number in stop_signals():
            self._before[number] = signal.signal(number, self._take)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _take(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self.count += 1
        if self.count == 1:
            with contextlib.suppress(OSError):
                os.write(2, f"\n{self._first}\n".encode())  # sys.stderr may be in the middle of a write
        if self.count > 2:
            raise KeyboardInterrupt
        if self._ready is not None:
            _set_alarm(_ORDERLY_S)

    @contextlib.contextmanager
    def no_longer_than(self, seconds: float, ready: Callable[[], bool]) -> Iterator[None]:
        """Raise StageOver in the context's code after this time, or soon after a request to stop, once ``ready`` is true.

        Code that waits for a lock is interrupted, too; only calls into compiled code end first.
        """
        if not hasattr(signal, "setitimer"):  # Windows
            yield
            return
        before = signal.signal(signal.SIGALRM, self._end_stage)
        self._ready = ready
        try:
            _set_alarm(_ORDERLY_S if self.count else seconds)
            yield
        except Exception as error:
            # Code that was interrupted may make another error of it.
            if self._ready is None:
                raise StageOver from error
            raise
        finally:
            self._ready = None
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def _end_stage(self, number: int, frame: FrameType | None) -> None:
        del number
        if self._ready is not None and self._ready() and _may_be_interrupted(frame):
            self._ready = None  # once: what follows ends in good order
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            raise StageOver

    def any(self) -> bool:
        """Whether the user wants to stop."""
        return self.count > 0


_WHOLE = frozenset(("numba", "llvmlite", "importlib"))
"""Packages whose work is not ended halfway: a kernel or a module that is half loaded would be broken for what follows."""


def _may_be_interrupted(frame: FrameType | None) -> bool:
    """Whether no package of ``_WHOLE`` is at work; the alarm comes again soon."""
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] in _WHOLE:
            return False
        frame = frame.f_back
    return True


def _set_alarm(seconds: float) -> None:
    """Send SIGALRM after this time and then again, until what it is to end is ready for it."""
    if hasattr(signal, "setitimer") and math.isfinite(seconds):
        signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3), 0.05)


def discard(stream: TextIO) -> None:
    """Let a stream that cannot be written to swallow what still comes, also at the end of the process."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


PAUSE_KEY = "p"


class PauseKey:
    """Whether the user wants the vehicle to wait: each p, or SIGUSR1, changes that. A context manager.

    Keys are looked for where stdin is a terminal that this process is in the foreground of; they are read one by one without
    Enter, and the terminal is as it was afterwards. Ctrl-C works as ever.
    """

    def __init__(self, console: "Console") -> None:
        self._console = console
        self._wanted = False
        self._terminal: Any = None
        self._before: Any = None

    def paused(self) -> bool:
        """Whether the vehicle is to wait now."""
        if self._terminal is not None:
            with contextlib.suppress(OSError):
                while select.select([sys.stdin], [], [], 0.0)[0]:
                    keys = os.read(sys.stdin.fileno(), 64).decode(errors="replace").lower()
                    if not keys:
                        break
                    if keys.count(PAUSE_KEY) % 2:
                        self._change()
        return self._wanted

    def __enter__(self) -> Self:
        if sys.platform != "win32":
            self._before = signal.signal(signal.SIGUSR1, self._take)
            self._read_keys()
        return self

    def __exit__(self, *_: object) -> None:
        if sys.platform == "win32":
            return
        signal.signal(signal.SIGUSR1, self._before)
        if self._terminal is not None:
            import termios

            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._terminal)
            self._terminal = None

    def _read_keys(self) -> None:
        import termios
        import tty

        try:
            if not sys.stdin.isatty() or os.tcgetpgrp(sys.stdin.fileno()) != os.getpgrp():
                return
            before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        except (OSError, ValueError, termios.error):  # no stdin, or none that is one
            return
        self._terminal = before
        self._console.say(f"{PAUSE_KEY} pauses the flight, {PAUSE_KEY} again continues it; Ctrl-C starts the return")

    def _take(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self._change()

    def _change(self) -> None:
        self._wanted = not self._wanted


class _PlainFormatter(logging.Formatter):
    """Log lines that a terminal shows as they are: one line for each record, besides its traces."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """The line of a record."""
        return plain_text(super().formatMessage(record))

    def formatException(self, ei: Any) -> str:  # noqa: N802 - logging's name
        """The trace of a record."""
        return plain_lines(super().formatException(ei))


def stop_signals() -> list[signal.Signals]:
    """The signals that request a stop: Ctrl-C, SIGTERM, and SIGHUP unless it is ignored (nohup)."""
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers
