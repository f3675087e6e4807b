"""Whether the vehicle stands on the ground or fell: from its landed state, height and motion together.

The landed state alone proves nothing: ArduCopter reports ON_GROUND as soon as it is disarmed, even in the air, while it falls.
"""

import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from mission_io.data_tables import data_table
from mission_io.model.enums import LandedState
from mission_io.wire import messages as m


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ground:
    settle_s: float
    still_sink_m_s: float
    still_speed_m_s: float
    still_height_m: float
    moves_sink_m_s: float
    moves_speed_m_s: float
    near_m: float
    falls_m_s: float
    fallen_m: float
    before_s: float
    old_s: float
    keep_s: float


GROUND = data_table(_Ground, "uavcover/data/flight.toml", "ground")


GroundAt = Callable[[float, float], float | None]
"""Height of the ground above sea level (metres) by latitude and longitude (degrees); None where unknown."""

_FALL_GAINS_M_S2, _FAST_M_S = 4.0, 5.0
"""A fall begins with a far larger acceleration than any controller commands, and ends at terminal velocity."""


@dataclass(frozen=True, slots=True)
class _Position:
    """A moment of the flight: vehicle time, height above home and above the ground, sink rate, speed over ground."""

    time_s: float
    above_home_m: float
    above_ground_m: float | None
    sink_m_s: float
    speed_m_s: float

    @property
    def height_m(self) -> float:
        return self.above_home_m if self.above_ground_m is None else self.above_ground_m


@dataclass(frozen=True, slots=True)
class Fall:
    """A vehicle that came down without motors."""

    height_m: float  # from where
    above: str  # above what: the ground, or home where the ground is not known
    sink_m_s: float  # measured sink rate

    def __str__(self) -> str:
        """For people."""
        return f"{max(0.0, self.height_m):.0f} m above {self.above}, descending at {self.sink_m_s:.1f} m/s"


class GroundContact:
    """Collects the evidence for ground contact. All times are vehicle time."""

    def __init__(self) -> None:
        self._positions: deque[_Position] = deque()
        self._said: bool | None = None
        self._said_since_s = 0.0
        self._said_count = 0
        self._ground_at: GroundAt | None = None
        self._home_ground_alt_amsl_m = 0.0

    def know_ground(self, ground_at: GroundAt | None, *, home_alt_amsl_m: float) -> None:
        """Measure heights above the ground from here on.

        Args:
            ground_at: height of the ground; None if unknown.
            home_alt_amsl_m: height of the ground at home, by the same terrain.
        """
        self._ground_at, self._home_ground_alt_amsl_m = ground_at, home_alt_amsl_m

    def forget(self) -> None:
        """Forget what was said and where it was, as after a restart; the ground is still known."""
        self._positions.clear()
        self._said, self._said_count = None, 0

    def take_position(self, here: m.GlobalPositionInt) -> None:
        """Take a position of the vehicle."""
        if self._positions and here.time_boot_s <= self._positions[-1].time_s:
            return
        ground_m = None if self._ground_at is None else self._ground_at(here.lat_deg, here.lon_deg)
        above_m = here.alt_above_home_m
        self._positions.append(
            _Position(
                here.time_boot_s,
                above_m,
                None if ground_m is None else above_m + self._home_ground_alt_amsl_m - ground_m,
                here.velocity_down_m_s,
                (here.velocity_north_m_s**2 + here.velocity_east_m_s**2) ** 0.5,
            )
        )
        while self._positions[-1].time_s - self._positions[0].time_s > GROUND.keep_s:
            self._positions.popleft()

    def take_word(self, state: int, time_s: float | None) -> None:
        """Take the vehicle's landed state (MAV_LANDED_STATE)."""
        said = None if state == LandedState.UNDEFINED else state == LandedState.ON_GROUND
        if said is not self._said:
            self._said, self._said_since_s, self._said_count = said, time_s or 0.0, 0
        self._said_count += 1

    @property
    def reports_landed(self) -> bool | None:
        """The vehicle's landed state; None without a report."""
        return self._said

    @property
    def height_m(self) -> float:
        """Latest height above the ground, above home where the ground is not known; 0 before the first position."""
        return self._positions[-1].height_m if self._positions else 0.0

    def on_ground(self, now_s: float | None) -> bool | None:
        """Whether it stands on the ground at ``now_s``.

        True only after its report, height and motion have agreed for a while. False if it reports flight, or moves as no vehicle
        on the ground does. None without a report, or if its report alone is contradicted: by a height of more than a few metres
        above the ground (above home if the ground is unknown), or by missing positions.
        """
        if self._said is not True:
            return self._said
        recent = self._since(now_s, GROUND.settle_s)
        if len(recent) < 2 or now_s is None:
            return None
        if all(abs(p.sink_m_s) > GROUND.moves_sink_m_s or p.speed_m_s > GROUND.moves_speed_m_s for p in recent[-2:]):
            return False
        settled = self._said_count > 1 and now_s - self._said_since_s >= GROUND.settle_s
        return True if settled and self._is_still(recent) and abs(recent[-1].height_m) <= GROUND.near_m else None

    def fall(self, since_s: float | None, now_s: float | None) -> Fall | None:
        """Whether a vehicle without motors since about ``since_s`` has fallen or falls; None when it has not.

        What counts is that it sank faster than any autopilot lands, that it lost height that no landing explains, or that nothing
        was heard of it since it was above the ground. Ground that is higher or lower than home is none of these.
        """
        if since_s is None or not self._positions:
            return None
        after = [p for p in self._positions if p.time_s >= since_s - GROUND.before_s] or [self._positions[-1]]
        sink_m_s = max(p.sink_m_s for p in after)
        highest = max(after, key=lambda p: p.height_m)
        since_highest = after[after.index(highest) :]
        lost_m = highest.above_home_m - after[-1].above_home_m - _landed_m(since_highest)
        sinks = sum(p.sink_m_s > GROUND.falls_m_s for p in after) > 1
        here, recent = after[-1], since_s - after[-1].time_s <= GROUND.old_s
        lost = recent and now_s is not None and now_s - here.time_s > GROUND.old_s and here.height_m > GROUND.near_m
        if not (sinks or lost or (lost_m > GROUND.fallen_m and sink_m_s > GROUND.still_sink_m_s)):
            return None
        begin = _begin_of_fall(list(self._positions), len(after)) if sinks else highest
        return Fall(begin.height_m, "home" if begin.above_ground_m is None else "the ground", sink_m_s)

    def is_still(self, now_s: float | None) -> bool:
        """Whether it has been at rest for a while."""
        recent = self._since(now_s, GROUND.settle_s)
        return len(recent) > 1 and self._is_still(recent)

    def lies(self, now_s: float | None) -> bool:
        """Whether a disarmed vehicle lies on the ground: it is at rest near it, even if it reports flight."""
        return self.is_still(now_s) and abs(self.height_m) <= GROUND.near_m

    def _since(self, now_s: float | None, window_s: float) -> list[_Position]:
        """The latest reports, at least two; nothing when they are old."""
        if now_s is None or not self._positions or now_s - self._positions[-1].time_s > GROUND.old_s:
            return []
        recent = [p for p in self._positions if p.time_s >= now_s - window_s]
        return recent if len(recent) > 1 else list(self._positions)[-2:]

    @staticmethod
    def _is_still(positions: list[_Position]) -> bool:
        quiet = all(
            abs(p.sink_m_s) <= GROUND.still_sink_m_s and p.speed_m_s <= GROUND.still_speed_m_s for p in positions
        )
        return quiet and abs(positions[-1].above_home_m - positions[0].above_home_m) <= GROUND.still_height_m


def _landed_m(positions: list[_Position]) -> float:
    """Height that was lost at the reported sink rates of a landing: it may have disarmed at the end of these positions."""
    sinks = ((max(a.sink_m_s, b.sink_m_s, 0.0), b.time_s - a.time_s) for a, b in itertools.pairwise(positions))
    return sum(sink_m_s * lasts_s for sink_m_s, lasts_s in sinks if sink_m_s <= GROUND.falls_m_s)


def _begin_of_fall(positions: list[_Position], latest: int) -> _Position:
    """Start of the fall that led to the largest sink rate of the ``latest`` positions."""
    number = max(range(len(positions) - latest, len(positions)), key=lambda index: positions[index].sink_m_s)
    while number > 0:
        before, here = positions[number - 1], positions[number]
        gained_m_s2 = (here.sink_m_s - before.sink_m_s) / (here.time_s - before.time_s)
        if gained_m_s2 < _FALL_GAINS_M_S2 and here.sink_m_s < _FAST_M_S:
            break
        number -= 1
    return positions[number]
