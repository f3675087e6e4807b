"""One table of the actions of all vehicles of a fleet, and the user interface of each vehicle's workflow."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from uavcover.run.user import PauseRequests, ProgressBar, StopRequests, User


@dataclass(slots=True)
class VehicleRow:
    """State of a vehicle."""

    sortie: str = "-"  # which sortie it flies, as text
    does: str = "waits"  # what it does
    waypoint: int = 0  # planned waypoint that it flies to
    waypoints: int = 0  # how many its sortie has
    late_s: float | None = None  # seconds behind the plan; none on the ground
    nearest: float | None = None  # distance of the nearest other vehicle in the air, metres; None without one


class Board:
    """The rows of all vehicles; each message of one begins with its number.

    Args:
        user: receives messages.
        vehicles: how many there are.
    """

    def __init__(self, user: User, vehicles: int) -> None:
        self.rows = {number: VehicleRow() for number in range(1, vehicles + 1)}
        self._user = user
        self._lock = threading.RLock()

    def lines(self, since_first_s: float) -> list[str]:
        """The table as text."""
        with self._lock:
            rows = [f"{since_first_s:7.0f} s  vehicle  sortie     does                  waypoint     late  nearest"]
            for number, row in self.rows.items():
                waypoint = f"{row.waypoint} of {row.waypoints}" if row.waypoints else "-"
                nearest = "-" if row.nearest is None else f"{row.nearest:.0f} m"
                late = "-" if row.late_s is None else f"{row.late_s:+.0f} s"
                rows.append(
                    f"{'':9}  {number:<7}  {row.sortie:<9}  {row.does:<20}  {waypoint:<9}  {late:>7}  {nearest}"
                )
            return rows

    def say(self, line: str) -> None:
        """Print a message of the whole fleet."""
        with self._lock:
            self._user.say(line)

    def show_limits(self, head: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Print a vehicle's table of limits."""
        with self._lock:
            self._user.show_limits(head, rows)

    def warn(self, line: str) -> None:
        """Print a warning of the whole fleet."""
        with self._lock:
            self._user.warn(line)

    def ring(self) -> None:
        """Draw attention."""
        with self._lock:
            self._user.ring()


@dataclass(frozen=True, slots=True)
class _Requests:
    """Requests of the user to one vehicle."""

    stops: Callable[[], int]
    pauses: Callable[[], bool]

    @property
    def count(self) -> int:
        """Number of the user's requests to stop."""
        return self.stops()

    def any(self) -> bool:
        """Whether the user wants to stop."""
        return self.stops() > 0

    @contextmanager
    def no_longer_than(self, seconds: float, ready: Callable[[], bool]) -> Iterator[None]:
        """Never raise: the workflow of a vehicle is not in the main thread."""
        del seconds, ready
        yield

    def paused(self) -> bool:
        """Whether the vehicle is to hold its position."""
        return self.pauses()


class VehicleUser:
    """The user as one vehicle's workflow sees it: a :class:`~uavcover.run.user.User`.

    Args:
        board: where its row is.
        number: of the vehicle.
        stops: how often the user has asked to stop; raises KeyboardInterrupt to abort.
        pauses: whether the vehicle is to hold its place.
    """

    def __init__(self, board: Board, number: int, *, stops: Callable[[], int], pauses: Callable[[], bool]) -> None:
        self._board, self._number = board, number
        self._requests = _Requests(stops, pauses)

    def say(self, line: str = "") -> None:
        """Print a message of this vehicle."""
        self._board.say(f"vehicle {self._number}: {line.strip()}")

    def show_limits(self, head: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Print this vehicle's table of limits; each row names the vehicle."""
        name = f"vehicle {self._number}"
        named = [{**row, "what": f"{name}: {row['what']}"} for row in rows]
        self._board.show_limits(f"{name}: {head.strip()}", named)

    def warn(self, line: str) -> None:
        """Print a warning of this vehicle."""
        self._board.warn(f"vehicle {self._number}: {line}")

    def agrees(self, question: str) -> bool:
        """No: vehicles in flight do not wait for an answer."""
        del question
        return False

    def ring(self) -> None:
        """Draw attention."""
        self._board.ring()

    @contextmanager
    def progress(self, what: str, total: float | None = None) -> Iterator[ProgressBar]:
        """Show the current stage and its progress in the row."""
        row = self._board.rows[self._number]
        row.does = what
        yield _Cells(row, counts=what == "flying", total=total)

    @contextmanager
    def stop_requests(self, first: str) -> Iterator[StopRequests]:
        """Those of the whole fleet."""
        del first
        yield self._requests

    @contextmanager
    def pause_requests(self) -> Iterator[PauseRequests]:
        """Those of the whole fleet, and of its traffic."""
        yield self._requests


class _Cells:
    """The cells of a row that show how far a flight is."""

    def __init__(self, row: VehicleRow, *, counts: bool, total: float | None) -> None:
        self._row, self._counts = row, counts
        if counts:
            row.waypoint, row.waypoints = 0, int(total or 0)

    def update(self, done: float, *, total: float | None = None, note: str = "") -> None:
        """Show how far it is."""
        del note
        if self._counts:
            self._row.waypoint, self._row.waypoints = int(done), int(total or self._row.waypoints)

    def count(self, done: int, total: int) -> None:
        """Show ``done`` of ``total``."""
        self.update(done, total=total)

    def draw(self, lon_lat_deg: Callable[[], Sequence[Sequence[float]]]) -> None:
        """Nothing: there is no map."""

    def status(self, line: str, *, at_s: float) -> None:
        """Nothing: the table of all vehicles shows it."""
