"""A flight of a fleet: what it does, where it is, and how late it is."""

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.missions.fleet_schedule import PathPieces, Timeline
from uavcover.model.vehicle import Fleet

_KNOWN_AFTER_S, _MOST_LATER = 20.0, 1.0
"""Time in the air after which a flight's delay predicts its delay at the landing, and the largest one as a share of the rest."""
_UNDER_WAY_S = 3.0
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
    # the take-off, and the progress, by which it was on its plan when it had left the ground; none before
    lifted_s: tuple[float, float] | None = None
    seen_s: float = 0.0  # when it was there
    place_m: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) ENU, where it is
    held: bool = False  # whether it holds its place to let another one pass
    way_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))  # (k, 3) ENU, its return
    asked_s: float = math.inf  # when it first asked for that
    free_s: float = -math.inf  # when the place where it landed is free; for one that is lost, when it must be down

    @property
    def as_if_begun_s(self) -> float:
        """The take-off after which the plan would have it where it is."""
        return self.seen_s - self.progress_s

    @property
    def gets_later_s(self) -> float:
        """Further delay at its landing at the present pace: wind slows all of a flight."""
        if self.progress_s < _KNOWN_AFTER_S or self.lifted_s is None:
            return 0.0
        begun_s, progress_s = self.lifted_s
        each_s = (self.as_if_begun_s - begun_s) / max(self.progress_s - progress_s, _UNDER_WAY_S)
        return min(max(each_s, 0.0), _MOST_LATER) * (self.timeline.duration_s - self.progress_s)

    def note_lift(self) -> None:
        """Note that it has left the ground, if it has."""
        if self.lifted_s is None and self.progress_s >= _UNDER_WAY_S:
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
        return np.asarray(self.timeline.place_m[-1])
