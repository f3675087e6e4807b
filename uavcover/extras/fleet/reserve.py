"""Check when a vehicle of a fleet must return before its sortie ends, to keep its battery's reserve."""

import math

from mission_io.wire.messages import SysStatus
from uavcover.errors import UavcoverError
from uavcover.extras.fleet.jobs import Job
from uavcover.extras.fleet.traffic import Traffic
from uavcover.flight.connect import Connected
from uavcover.flight.reserve import TO_TURN_S, BatteryAllows, BatteryUse
from uavcover.missions.flight_costs import way_home

_LOOK_EVERY_S = 2.0


class ReserveWatch:
    """Check repeatedly whether a vehicle in flight must return for its battery.

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
        """Time that its battery lets it hold before it flies its mission to the end."""
        return self._use.may_wait_s(self._traffic.lands_s(self._job.name) - now)

    def must_go_home(self, now: float, *, aloft_s: float) -> str | None:
        """Reason to return now, as text; none while it may fly on, or reports no battery.

        Its return is given to it before it stops. While others are in that way it flies on: the mission is kept apart from
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
        if use.lasts_home(rest_s) or use.lasts_on(rest_s):  # the return is shorter than that
            return None
        try:
            way_m, home_s = way_home(self._job.site, self._traffic.place_m(self._job.name))
        except UavcoverError:  # the ground below the way is not known
            return None
        if use.allows(rest_s=rest_s, home_s=home_s) is BatteryAllows.GO_ON:
            return None
        if not self._traffic.give_way_home(self._job.name, now, way_m, within_s=home_s + TO_TURN_S):
            return None
        reserve = 100.0 * use.vehicle.reserve_fraction
        return (
            f"the battery has {percent:.0f} % left and uses {60.0 * use.each_s:.1f} % a minute: the return takes "
            f"{home_s:.0f} s and the rest of the sortie {rest_s:.0f} s, which would use the reserve of {reserve:.0f} %; it "
            "returns, and another sortie continues here"
        )
