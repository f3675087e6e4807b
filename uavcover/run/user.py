"""The user of a workflow: receives messages and progress, and may stop or pause it.

The workflows of :mod:`uavcover.run` talk to a :class:`User`. On the command line that is a terminal
(:class:`uavcover.cli.console.Console`); for scripts and notebooks it is :class:`Unattended`, which logs.
"""

import logging
import os
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Protocol


def to_paste(*words: object) -> str:
    """A command of uavcover that can be pasted into a shell, with any characters in file names."""
    return shlex.join(("uavcover", *map(str, words)))


class ProgressBar(Protocol):
    """Shows how far one task is."""

    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Show how far it is."""

    def count(self, done: int, total: int) -> None:
        """Show ``done`` of ``total``."""

    def draw(self, lon_lat_deg: Callable[[], Sequence[Sequence[float]]]) -> None:
        """Draw a route on a map, where there is one; its (n, 2) places are computed only then."""

    def status(self, line: str, *, at_s: float) -> None:
        """Show what a vehicle does ``at_s`` seconds after its take-off; an empty line ends it."""


class StopRequests(Protocol):
    """Number of the user's requests to stop."""

    @property
    def count(self) -> int:
        """Once: end in good order; twice: in a flight, hold and leave the vehicle there."""

    def any(self) -> bool:
        """Whether the user wants to stop."""

    def no_longer_than(self, seconds: float, ready: Callable[[], bool]) -> AbstractContextManager[None]:
        """Raise StageOver in the context's code after this time, or soon after a request to stop, once ``ready`` is true."""


class PauseRequests(Protocol):
    """Whether the user wants a flight to pause."""

    def paused(self) -> bool:
        """Whether the vehicle is to wait now."""


class User(Protocol):
    """The user that a workflow reports to and takes requests from."""

    def say(self, line: str = "") -> None:
        """Tell something."""

    def show_limits(self, head: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Tell the head of a vehicle's table of limits, whose lines follow, and its rows as values for programs."""

    def warn(self, line: str) -> None:
        """Tell something that must not be missed."""

    def agrees(self, question: str) -> bool:
        """Ask something that only a person may answer with yes; without one the answer is no."""

    def ring(self) -> None:
        """Draw attention, as a terminal's bell does."""

    def progress(self, what: str, total: float | None = None) -> AbstractContextManager[ProgressBar]:
        """Show progress while the context lasts."""

    def stop_requests(self, first: str) -> AbstractContextManager[StopRequests]:
        """Count requests to stop instead of raising; the first request shows the text ``first``."""

    def pause_requests(self) -> AbstractContextManager[PauseRequests]:
        """Take requests to pause while the context lasts."""


class Unattended:
    """No user: messages go to the log, and no request to stop comes. Ctrl-C raises ``KeyboardInterrupt``."""

    def __init__(self) -> None:
        self._log = logging.getLogger("uavcover")

    def say(self, line: str = "") -> None:
        """Log at level INFO."""
        if line:
            self._log.info(line)

    def show_limits(self, head: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Log the head at level INFO."""
        del rows
        self.say(head)

    def warn(self, line: str) -> None:
        """Log at level WARNING."""
        self._log.warning(line)

    def agrees(self, question: str) -> bool:
        """No: there is no user to answer."""
        del question
        return False

    def ring(self) -> None:
        """Nothing."""

    @contextmanager
    def progress(self, what: str, total: float | None = None) -> Iterator[ProgressBar]:
        """Log what begins."""
        del total
        self._log.debug(what)
        yield _NoBar()

    @contextmanager
    def stop_requests(self, first: str) -> Iterator[StopRequests]:
        """Never any."""
        del first
        yield _NoRequests()

    @contextmanager
    def pause_requests(self) -> Iterator[PauseRequests]:
        """Never any."""
        yield _NoRequests()


class _NoBar:
    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Show nothing."""

    def count(self, done: int, total: int) -> None:
        """Show nothing."""

    def draw(self, lon_lat_deg: Callable[[], Sequence[Sequence[float]]]) -> None:
        """Draw nothing."""

    def status(self, line: str, *, at_s: float) -> None:
        """Show nothing."""


class _NoRequests:
    count = 0

    @contextmanager
    def no_longer_than(self, seconds: float, ready: Callable[[], bool]) -> Iterator[None]:
        """Never raise: there is no main thread to interrupt for certain."""
        del seconds, ready
        yield

    def any(self) -> bool:
        """No request comes."""
        return False

    def paused(self) -> bool:
        """No request comes."""
        return False


def percent(fraction: float | None) -> str:
    """A share 0..1 as text."""
    return "-" if fraction is None else f"{100.0 * fraction:.2f} %"


def metres(value: float | None) -> str:
    """A length as text."""
    return "-" if value is None else f"{value:.1f} m"


@contextmanager
def compiled_code_silenced() -> Iterator[None]:
    """Discard what compiled code writes to stderr, out of Python's reach."""
    kept = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
