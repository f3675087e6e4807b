"""When a vehicle of a fleet must fly home before its sortie ends, so that its battery keeps the reserve."""

import math
from dataclasses import dataclass
from enum import Enum

from mission_io.wire.messages import SysStatus
from uavcover.errors import UavcoverError
from uavcover.model.vehicle import Vehicle
from uavcover.routes.flight_costs import way_home
from uavcover.run.fleet_jobs import Job
from uavcover.run.fleet_traffic import Traffic
from uavcover.run.session import Connected

_ROUNDING = 1.0
"""Percent by which a battery may hold less than it tells: it tells whole numbers."""
_CLIMB_S, _MEASURED_S = 25.0, 50.0
"""The climb uses more than what follows and does not count; after so long more, what was used tells more than the endurance."""
_USE_HOME, _USE_ON = 1.2, 1.05
"""How much more than the mean so far a second may use on the way home, straight into the wind, and on the rest of the mission."""
_TO_TURN_S = 20.0
"""To stop, and to be sent the way home."""
_LOOK_EVERY_S = 2.0


class BatteryAllows(Enum):
    """What a battery allows."""

    GO_ON = "it is enough to fly on"
    GO_HOME = "it is enough for the way home, and not for more"


@dataclass(slots=True)
class BatteryUse:
    """What a flight uses of its battery. Knows no clock: times are arguments.

    Attributes:
        vehicle: with its endurance and reserve.
        planned_each_s: percent that a second in the air is planned to use.
        first: time in the air, and what the battery told then, when it was asked first after the climb; none before.
        percent: what it told last.
        aloft_s: time in the air by then.
    """

    vehicle: Vehicle
    planned_each_s: float
    first: tuple[float, float] | None = None
    percent: float = math.nan
    aloft_s: float = 0.0

    def take(self, percent: float, *, aloft_s: float) -> None:
        """What the battery tells so long after take-off."""
        if self.first is None and aloft_s >= _CLIMB_S:
            self.first = aloft_s, percent
        self.percent, self.aloft_s = percent, aloft_s

    @property
    def each_s(self) -> float:
        """Percent of a battery that a second in the air uses: as planned at first, and as measured once it tells of any use."""
        if self.first is None or self.aloft_s - self.first[0] < _MEASURED_S or self.percent >= self.first[1]:
            return self.planned_each_s
        return (self.first[1] - self.percent) / (self.aloft_s - self.first[0])

    @property
    def spare(self) -> float:
        """Percent above the reserve."""
        return self.percent - _ROUNDING - 100.0 * self.vehicle.reserve_fraction

    def lasts_home(self, seconds: float) -> bool:
        """Whether the way home can still be begun a moment later."""
        return self.spare > _USE_HOME * self.each_s * (seconds + _TO_TURN_S)

    def lasts_on(self, seconds: float) -> bool:
        """Whether so much more of the mission keeps the reserve."""
        return self.spare >= _USE_ON * self.each_s * seconds

    def may_wait_s(self, seconds: float) -> float:
        """How long it may hang in the air before so much more of the mission; infinite while nothing is told of the battery."""
        if math.isnan(self.percent):
            return math.inf
        return self.spare / self.each_s - _USE_ON * seconds

    def allows(self, *, rest_s: float, home_s: float) -> BatteryAllows:
        """What it allows of a mission that takes ``rest_s`` to the landing, where the straight way home takes ``home_s``."""
        if home_s + _TO_TURN_S >= rest_s or self.lasts_home(home_s) or self.lasts_on(rest_s):
            return BatteryAllows.GO_ON
        return BatteryAllows.GO_HOME


class ReserveWatch:
    """Asks again and again whether a vehicle in flight must go home for its battery's sake.

    Args:
        job: what it flies.
        connected: tells its battery.
        traffic: knows where it is.
    """

    def __init__(self, job: Job, connected: Connected, traffic: Traffic) -> None:
        self._job, self._connected, self._traffic = job, connected, traffic
        vehicle, flight_s = job.site.scenario.vehicle, job.timeline.duration_s
        self._use = BatteryUse(vehicle, 100.0 * (job.battery_used or 0.0) / flight_s)
        self._next_s = -math.inf

    def may_wait_s(self, now: float) -> float:
        """How long its battery lets it hang in the air and then fly its mission to the end."""
        return self._use.may_wait_s(self._traffic.lands_s(self._job.name) - now)

    def must_go_home(self, now: float, *, aloft_s: float) -> str | None:
        """Why it must, as text; none while it may fly on, or where it tells nothing of its battery.

        Its way home is given to it before it stops. While others are in that way it flies on: the mission is kept apart from
        theirs and brings it home, too; to hold and wait would only empty the battery.

        Args:
            now: present time.
            aloft_s: time since its take-off.
        """
        status = self._connected.monitor.latest(SysStatus)
        percent = None if status is None else status.battery_remaining_percent
        if percent is None or self._use.vehicle.endurance_s is None or now < self._next_s:
            return None
        self._next_s = now + _LOOK_EVERY_S
        use, rest_s = self._use, self._traffic.lands_s(self._job.name) - now
        use.take(percent, aloft_s=aloft_s)
        if use.lasts_home(rest_s) or use.lasts_on(rest_s):  # the way home is shorter than that
            return None
        try:
            way_m, home_s = way_home(self._job.site, self._traffic.place_m(self._job.name))
        except UavcoverError:  # the ground below the way is not known
            return None
        if use.allows(rest_s=rest_s, home_s=home_s) is BatteryAllows.GO_ON:
            return None
        if not self._traffic.give_way_home(self._job.name, now, way_m, within_s=home_s + _TO_TURN_S):
            return None
        reserve = 100.0 * use.vehicle.reserve_fraction
        return (
            f"the battery has {percent:.0f} % left and uses {60.0 * use.each_s:.1f} % a minute: the way home takes "
            f"{home_s:.0f} s and the rest of the sortie {rest_s:.0f} s, which would use the reserve of {reserve:.0f} %; it "
            "flies home, and another sortie goes on here"
        )
