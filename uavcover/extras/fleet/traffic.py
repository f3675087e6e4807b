"""Keep the vehicles of a fleet apart in flight: where each is and how late, starts, holds and returns.

Where each vehicle really is counts, not only when it was to be there: a flight that is late is taken as one that took off later.
All times are seconds on one clock that all vehicles of the fleet share.
"""

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from uavcover.errors import InfeasibleError
from uavcover.extras.fleet.tuning import FLEET
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.fleet_schedule import PathPieces, Timeline, pieces_of, segment_distances_m, unsafe_starts
from uavcover.model.vehicle import Fleet

_KNOWN_AFTER_S, _MOST_LATER = 20.0, 1.0
"""Time in the air after which a flight's delay predicts its delay at the landing, and the largest one as a fraction of the
rest."""
_MOVING_S = 3.0
"""Progress at which a vehicle has left the ground: a delay before it does not grow."""


class FleetPhase(Enum):
    """Phase of a flight."""

    WAITING = "waits"
    FLYING = "flies"
    HOLDING = "holds during its return"
    HOMEWARD = "returns"
    DOWN = "has landed"
    LOST = "is lost"


@dataclass(slots=True, eq=False)
class FleetPosition:
    """A flight and where it is."""

    timeline: Timeline  # as planned
    pieces: PathPieces  # of it, for pairs of starts
    planned_s: float  # its take-off, since the first take-off of all
    pace_m_s: tuple[float, float]  # how fast it flies home, over ground and vertically
    phase: FleetPhase = FleetPhase.WAITING  # what it does
    progress_s: float = 0.0  # time since take-off at which the plan has it where it is
    began_s: float = 0.0  # when it took off
    # the take-off, and the progress, by which it was on its plan when it had left the ground; None before
    lifted_s: tuple[float, float] | None = None
    observed_s: float = 0.0  # when it was there
    position_m: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) ENU, where it is
    held: bool = False  # whether it holds its place to let another one pass
    path_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  # (k, 3) ENU, its return
    requested_s: float = math.inf  # when it first asked for that
    free_s: float = -math.inf  # when the place where it landed is free; for one that is lost, when it must be down

    @property
    def as_if_begun_s(self) -> float:
        """The take-off after which the plan would have it where it is."""
        return self.observed_s - self.progress_s

    @property
    def gets_later_s(self) -> float:
        """Further delay at its landing at the present pace: wind slows all of a flight."""
        if self.progress_s < _KNOWN_AFTER_S or self.lifted_s is None:
            return 0.0
        begun_s, progress_s = self.lifted_s
        each_s = (self.as_if_begun_s - begun_s) / max(self.progress_s - progress_s, _MOVING_S)
        return min(max(each_s, 0.0), _MOST_LATER) * (self.timeline.duration_s - self.progress_s)

    def note_lift(self) -> None:
        """Note that it has left the ground, if it has."""
        if self.lifted_s is None and self.progress_s >= _MOVING_S:
            self.lifted_s = self.as_if_begun_s, self.progress_s

    def may_fly(self, now: float, fleet: Fleet) -> bool:
        """Whether a lost vehicle may still obstruct the others: until it must have landed and been removed.

        It is taken as flying on as planned. Those on the ground wait longer, until its battery must be empty.
        """
        late_s = self.gets_later_s + fleet.timing_error_fraction * self.timeline.duration_s + fleet.pad_s
        return self.held or now < self.as_if_begun_s + self.timeline.duration_s + late_s

    @property
    def home_m(self) -> FloatArray:
        """(3,) ENU, where it lands."""
        return np.asarray(self.timeline.position_m[-1])


_AHEAD_S, _AHEAD_TO_GO_ON_S = 45.0, 60.0
"""Time for which two vehicles are checked ahead; longer before a holding one continues, so that it does not stop again at
once."""
_ERROR_S, _ERROR_FRACTION = 2.0, 0.02
"""Uncertainty of the prediction: at once, and for each second ahead."""
_BACK_S, _BEYOND_S = 2.0, 20.0
"""A vehicle is looked for in the plan from a little before where it was to a little after where it may be by now."""


_Ahead = Callable[[FloatArray], FloatArray]
"""(n, 3) ENU places at (n,) seconds from now."""
_IN_THE_AIR = frozenset({FleetPhase.FLYING, FleetPhase.HOLDING, FleetPhase.HOMEWARD, FleetPhase.LOST})


class Traffic:
    """The flights of a fleet; its methods may be called from several threads.

    Args:
        fleet: how far apart they are kept.
    """

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet
        self._flights: dict[str, FleetPosition] = {}
        self._unsafe: dict[tuple[str, str], FloatArray] = {}
        self._lock = threading.RLock()
        self._first_s: float | None = None

    def add(self, name: str, timeline: Timeline, *, planned_s: float, pace_m_s: tuple[float, float]) -> None:
        """Add a flight with its planned take-off time after the first take-off of all."""
        with self._lock:
            self._flights[name] = FleetPosition(timeline, pieces_of(timeline, self._fleet), planned_s, pace_m_s)

    def drop(self, name: str) -> None:
        """Remove a flight that will not take place, so that no other waits for it."""
        with self._lock:
            self._flights.pop(name, None)

    def since_first_s(self, now: float) -> float:
        """Time since the first take-off; 0 before it."""
        return 0.0 if self._first_s is None else now - self._first_s

    def lands_s(self, name: str) -> float:
        """When a flight in the air lands, as it goes now."""
        with self._lock:
            flight = self._flights[name]
            return flight.as_if_begun_s + flight.timeline.duration_s

    def position_m(self, name: str) -> FloatArray:
        """(3,) ENU, the last known position of a flight."""
        with self._lock:
            return self._flights[name].position_m

    @property
    def begun(self) -> bool:
        """Whether one flight has taken off."""
        return self._first_s is not None

    def phase(self, name: str) -> FleetPhase | None:
        """Phase of a flight; None for one that was dropped."""
        with self._lock:
            flight = self._flights.get(name)
            return None if flight is None else flight.phase

    def late_s(self, name: str) -> float:
        """By how much a flight in the air is behind its plan; negative when it is ahead."""
        with self._lock:
            flight = self._flights[name]
            return flight.as_if_begun_s - (self._first_s or 0.0) - flight.planned_s

    def start(self, name: str, now: float) -> bool:
        """Let a flight take off in its turn, not before its time, and apart from all others.

        Returns:
            Whether it may; then it is taken as in the air from here on.
        """
        with self._lock:
            own = self._flights[name]
            if any(
                f.phase is FleetPhase.WAITING and (f.planned_s, n) < (own.planned_s, name)
                for n, f in self._flights.items()
            ):
                return False
            if self._first_s is not None and now < self._first_s + own.planned_s:
                return False
            if not all(self._apart_from_start(name, own, n, f, now) for n, f in self._others(name)):
                return False
            if self._first_s is None:
                self._first_s = now - own.planned_s
            own.phase, own.began_s, own.observed_s, own.progress_s = FleetPhase.FLYING, now, now, 0.0
            own.lifted_s = None
            own.position_m = np.asarray(own.timeline.position_m[0])
            return True

    def moved(self, name: str, now: float, position_m: FloatArray) -> None:
        """Where a flight is now, (3,) ENU."""
        with self._lock:
            flight = self._flights[name]
            if flight.phase in (FleetPhase.FLYING, FleetPhase.LOST):  # one that was lost may be heard again
                latest_s = flight.progress_s + (now - flight.observed_s) + _BEYOND_S
                flight.progress_s = max(
                    flight.progress_s,
                    flight.timeline.nearest_time_s(position_m, from_s=flight.progress_s - _BACK_S, to_s=latest_s),
                )
            flight.observed_s, flight.position_m = now, position_m
            flight.note_lift()

    def must_hold(self, name: str, now: float, *, may_wait_s: float = math.inf) -> bool:
        """Whether a flight is to hold its position now because another one would come too near.

        Args:
            name: which flight.
            now: present time.
            may_wait_s: how long its battery lets it wait; without any time left it no longer waits for one that is lost, which
                may be elsewhere: both were planned apart.
        """
        with self._lock:
            own = self._flights[name]
            if own.phase is not FleetPhase.FLYING or own.progress_s <= 0.0:
                return False
            ahead_s = _AHEAD_TO_GO_ON_S if own.held else _AHEAD_S
            others = [(n, f) for n, f in self._others(name) if self._counts(f, now)]
            if may_wait_s <= 0.0:
                others = [(n, f) for n, f in others if f.phase is not FleetPhase.LOST]
            own.held = any(self._yields(name, own, n, f, now, ahead_s) for n, f in others)
            return own.held

    def give_return(self, name: str, now: float, path_m: FloatArray, *, within_s: float) -> bool:
        """Give a flight on its mission the return, before it stops; all others then keep clear of it.

        Args:
            name: which flight.
            now: present time.
            path_m: (k, 3) ENU from where it is to the ground at home.
            within_s: time in which it has flown it.

        Returns:
            Whether it has it: no other flies home, waits for that, or comes near the return in this time.
        """
        with self._lock:
            own = self._flights[name]
            if own.phase is not FleetPhase.FLYING:
                return False
            others = [f for _, f in self._others(name) if self._counts(f, now)]
            if any(f.phase in (FleetPhase.HOMEWARD, FleetPhase.HOLDING) for f in others):
                return False
            times_s = np.arange(0.0, within_s + FLEET.step_s, FLEET.step_s)
            for other in others:
                if other.phase is FleetPhase.DOWN and now + within_s >= other.free_s:
                    continue
                if other.phase is FleetPhase.DOWN:
                    positions = other.home_m[None]
                elif other.phase in _IN_THE_AIR:
                    # One that holds now may go on at any time.
                    flies = other.phase is FleetPhase.FLYING
                    going_on = _as_planned(other)(times_s) if flies else other.position_m[None]
                    positions = np.vstack([going_on, self._from_now(other, now)(times_s)])
                else:
                    continue
                if self._least_m(positions, path_m) < self._fleet.held_apart_m:
                    return False
            own.phase, own.path_m, own.requested_s, own.held = FleetPhase.HOMEWARD, path_m, now, False
            return True

    def may_go_home(self, name: str, now: float, path_m: FloatArray, *, all_return: bool) -> bool:
        """Whether a vehicle that holds may fly (k, 3) legs home now; one that was given its return may.

        Args:
            name: which flight.
            now: present time.
            path_m: from where it holds to the ground at home, ENU metres.
            all_return: whether all others come home too: then one after the other, when all hold.

        Raises:
            InfeasibleError: those that hold are in each other's way.
        """
        with self._lock:
            own = self._flights[name]
            if own.phase is FleetPhase.HOMEWARD:
                own.path_m = path_m
                return True
            own.phase, own.path_m, own.requested_s = FleetPhase.HOLDING, path_m, min(own.requested_s, now)
            all_return = all_return and now - own.requested_s < FLEET.holds_within_s
            others = [f for _, f in self._others(name) if f.phase in _IN_THE_AIR and self._counts(f, now)]
            if any(f.phase is FleetPhase.HOMEWARD or (all_return and f.phase is FleetPhase.FLYING) for f in others):
                return False
            if any(f.phase is FleetPhase.DOWN and self._meets_landed(own, f, now) for _, f in self._others(name)):
                return False
            waiting = [f for f in others if f.phase is FleetPhase.HOLDING]
            if any(len(f.path_m) == 0 for f in waiting):
                return False
            free = [f for f in (own, *waiting) if self._passes_holders(f, [own, *waiting])]
            moving = [f for f in others if f.phase in (FleetPhase.FLYING, FleetPhase.LOST)]
            if not free and not moving:
                raise InfeasibleError("the returns of the holding vehicles do not keep the separation from each other")
            if own not in free or _length_m(own.path_m) > min(_length_m(f.path_m) for f in free):
                return False
            if any(self._meets(_along_path(own), self._from_now(f, now), _path_s(own)) for f in moving):
                return False
            own.phase = FleetPhase.HOMEWARD
            return True

    def landed(self, name: str, now: float) -> None:
        """A flight is over, and its vehicle is on the ground."""
        with self._lock:
            flight = self._flights[name]
            flight.phase, flight.free_s = FleetPhase.DOWN, now + self._fleet.pad_s

    def lost(self, name: str, *, down_by_s: float, stays: bool = False) -> None:
        """Mark a vehicle's position as unknown: it may fly on as planned, or it ``stays``."""
        with self._lock:
            flight = self._flights[name]
            flight.phase, flight.free_s, flight.held = FleetPhase.LOST, down_by_s, stays

    def nearest_m(self, name: str) -> float | None:
        """Distance of the nearest other flight in the air."""
        with self._lock:
            own = self._flights[name]
            others = [f.position_m for _, f in self._others(name) if f.phase in _IN_THE_AIR]
            return min((float(np.linalg.norm(position_m - own.position_m)) for position_m in others), default=None)

    def _others(self, name: str) -> Iterator[tuple[str, FleetPosition]]:
        return ((n, f) for n, f in self._flights.items() if n != name)

    def _counts(self, flight: FleetPosition, now: float) -> bool:
        """Whether a flight may block one in the air."""
        return flight.phase is not FleetPhase.LOST or flight.may_fly(now, self._fleet)

    def _apart_from_start(self, name: str, own: FleetPosition, other: str, flight: FleetPosition, now: float) -> bool:
        match flight.phase:
            case FleetPhase.WAITING:
                return True
            case FleetPhase.DOWN:
                away_m = float(np.linalg.norm(flight.home_m - own.timeline.position_m[0]))
                near = away_m < self._fleet.planned_separation_m
                return not near or now >= flight.free_s
            case FleetPhase.FLYING:
                difference_s = now - flight.as_if_begun_s
                if (other, name) not in self._unsafe:
                    self._unsafe[other, name] = unsafe_starts(flight.pieces, own.pieces, self._fleet)
                begin, end = self._unsafe[other, name].T
                return not ((begin < difference_s) & (end > difference_s - flight.gets_later_s)).any()
            case FleetPhase.LOST:
                return now >= flight.free_s
            case _:
                return False

    def _yields(
        self, name: str, own: FleetPosition, other: str, flight: FleetPosition, now: float, ahead_s: float
    ) -> bool:
        """Whether of two flights that would come too near this one holds."""
        if flight.phase is FleetPhase.HOMEWARD:
            return self._meets_path(own, flight, ahead_s)
        if flight.phase is FleetPhase.DOWN:
            return now < flight.free_s and self._meets(
                _as_planned(own), lambda _: flight.home_m[None], min(ahead_s, flight.free_s - now)
            )
        if flight.phase not in (FleetPhase.FLYING, FleetPhase.HOLDING, FleetPhase.LOST):
            return False
        if not self._meets(_as_planned(own), self._until_gone(flight, now), ahead_s):
            return False
        if flight.phase is not FleetPhase.FLYING or flight.held:
            return True
        own_blocks = self._blocks_path(own, flight, ahead_s)
        other_blocks = self._blocks_path(flight, own, ahead_s)
        if own_blocks is not other_blocks:
            return other_blocks
        return (own.planned_s, name) > (flight.planned_s, other)

    def _from_now(self, flight: FleetPosition, now: float) -> _Ahead:
        """Positions of a flight at times from now, by its present phase."""
        if flight.phase is FleetPhase.HOLDING or flight.held:
            return lambda times_s: np.broadcast_to(flight.position_m, (len(times_s), 3))
        begun_s = now - flight.as_if_begun_s if flight.phase is FleetPhase.LOST else flight.progress_s
        return lambda times_s: flight.timeline.positions_m(begun_s + times_s)

    def _until_gone(self, flight: FleetPosition, now: float) -> _Ahead:
        """The same, but infinitely far away once it has landed and been taken off the pad.

        A landing that is late is seen in its progress, and :meth:`landed` reports it.
        """
        ahead = self._from_now(flight, now)
        if flight.phase is not FleetPhase.FLYING or flight.held:
            return ahead
        gone_s = flight.timeline.duration_s - flight.progress_s + self._fleet.pad_s
        return lambda times_s: np.where((times_s > gone_s)[:, None], math.inf, ahead(times_s))

    def _meets(self, one: _Ahead, other: _Ahead, ahead_s: float) -> bool:
        times_s = np.arange(0.0, ahead_s + FLEET.step_s, FLEET.step_s)
        a, b = one(times_s), np.broadcast_to(other(times_s), (len(times_s), 3))
        apart_m = np.linalg.norm(a[:, None] - b[None], axis=2)
        error_s = _ERROR_S + _ERROR_FRACTION * times_s
        at_once = np.abs(times_s[:, None] - times_s[None]) <= error_s[:, None]
        return bool((apart_m[at_once] < self._fleet.held_apart_m).any())

    def _meets_path(self, own: FleetPosition, homeward: FleetPosition, ahead_s: float) -> bool:
        """Whether a flight comes near the return of another one, or near where that is, within a time."""
        positions = own.timeline.positions_m(own.progress_s + np.arange(0.0, ahead_s, FLEET.step_s))
        path = np.vstack([homeward.position_m, homeward.path_m])
        return self._least_m(positions, path) < self._fleet.held_apart_m

    def _meets_landed(self, own: FleetPosition, landed: FleetPosition, now: float) -> bool:
        """Whether a return ends where another vehicle still stands."""
        if float(np.linalg.norm(own.path_m[-1] - landed.home_m)) >= self._fleet.held_apart_m:
            return False
        return now + _path_s(own) < landed.free_s

    def _blocks_path(self, holder: FleetPosition, flight: FleetPosition, ahead_s: float) -> bool:
        positions = flight.timeline.positions_m(flight.progress_s + np.arange(0.0, ahead_s, FLEET.step_s))
        return float(np.linalg.norm(positions - holder.position_m, axis=1).min()) < self._fleet.held_apart_m

    def _passes_holders(self, own: FleetPosition, holders: list[FleetPosition]) -> bool:
        path = np.vstack([own.position_m, own.path_m])
        return all(
            self._least_m(holder.position_m[None], path) >= self._fleet.separation_m
            for holder in holders
            if holder is not own
        )

    @staticmethod
    def _least_m(positions_m: FloatArray, path_m: FloatArray) -> float:
        """Least distance of (n, 3) positions from a (k, 3) line."""
        begin = np.repeat(path_m[:-1], len(positions_m), axis=0)
        end = np.repeat(path_m[1:], len(positions_m), axis=0)
        points = np.tile(positions_m, (len(path_m) - 1, 1))
        return float(segment_distances_m(points, points, begin, end).min())


def _as_planned(flight: FleetPosition) -> _Ahead:
    """Positions of a flight at times from now if it goes on, also one that holds now."""
    return lambda times_s: flight.timeline.positions_m(flight.progress_s + times_s)


def _length_m(path_m: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())


def _path_times_s(flight: FleetPosition) -> tuple[FloatArray, FloatArray]:
    """When a vehicle that flies home now passes the points of its way, and these."""
    path_m = np.vstack([flight.position_m, flight.path_m])
    legs_m = np.diff(path_m, axis=0)
    over_s = np.hypot(legs_m[:, 0], legs_m[:, 1]) / flight.pace_m_s[0]
    return np.concatenate([[0.0], np.cumsum(np.maximum(over_s, np.abs(legs_m[:, 2]) / flight.pace_m_s[1]))]), path_m


def _path_s(flight: FleetPosition) -> float:
    return float(_path_times_s(flight)[0][-1])


def _along_path(flight: FleetPosition) -> _Ahead:
    times, path_m = _path_times_s(flight)
    return lambda times_s: np.column_stack([np.interp(times_s, times, axis) for axis in path_m.T])
