"""Listen to a lost vehicle of a fleet: the others keep clear of it, and its landing frees the air."""

import numpy as np

from mission_io.wire.messages import GlobalPositionInt
from uavcover.extras.fleet.clock import FleetClock
from uavcover.extras.fleet.jobs import Job
from uavcover.extras.fleet.sortie import is_down
from uavcover.extras.fleet.traffic import Traffic
from uavcover.flight.connect import Connected

_LATELY_S = 5.0
_STAYS_OUT = (
    "it gets no more sorties, because its state is unknown and its sorties are reassigned; check "
    "it, and fly the rest at the end"
)


class LostVehicle:
    """Messages of a vehicle whose flight was given up because it was silent.

    Args:
        job: what it flew.
        connected: its link, still open.
        traffic: that keeps the others apart.
    """

    def __init__(self, job: Job, connected: Connected, traffic: Traffic) -> None:
        self._job, self._connected, self._traffic = job, connected, traffic
        self._heard = False

    def look(self, clock: FleetClock, seconds: float) -> str | None:
        """Listen for at most this time, and inform the others of each message.

        Returns:
            What the user must know: that it is heard again, or is down; none when there is nothing new.
        """
        client, monitor, site = self._connected.client, self._connected.monitor, self._job.site
        client.poll(seconds)
        now = clock.now()
        here = monitor.latest(GlobalPositionInt)
        if here is None or site.frame is None or monitor.silence_s(client.clock.now()) > _LATELY_S:
            return None
        place_m = site.frame.enu_from_geodetic(here.lat_deg, here.lon_deg, here.alt_amsl_m)[0]
        where = f"at {here.lat_deg:.6f}, {here.lon_deg:.6f}"
        if is_down(self._connected):
            self._traffic.landed(self._job.name, now)
            return f"is heard again, on the ground {where}; {_STAYS_OUT}"
        self._traffic.moved(self._job.name, now, np.asarray(place_m))
        again = f"is heard again, in the air {where}; the others keep apart from it; {_STAYS_OUT}"
        message, self._heard = None if self._heard else again, True
        return message
