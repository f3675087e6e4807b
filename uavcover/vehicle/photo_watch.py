"""Watches that the camera reports the photos that the mission takes."""

import math

import numpy as np

from mission_io.model.items import Command
from uavcover.kernels.arrays import FloatArray
from uavcover.vehicle.flight_plan import FlightPlan
from uavcover.vehicle.outcome import Ending
from uavcover.vehicle.progress import MissionProgress
from uavcover.vehicle.session import Session

_TAKES_PHOTO = (Command.DO_DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE)
_FEWEST = 3
_BY_CHANCE = 1e-5
"""Photos in a row without a report are an alarm where the link loses as many messages in a row more rarely than this."""


class PhotoWatch:
    """Compares the photos that a vehicle reports with those that its mission takes on the planned route.

    A vehicle that has reported no photo at all is watched where photos are required, and otherwise not: its camera may have no
    feedback.

    Args:
        session: with the vehicle.
        plan: what it flies.
        progress: along it.
    """

    def __init__(self, session: Session, plan: FlightPlan, progress: MissionProgress) -> None:
        self._session, self._progress = session, progress
        items = plan.mission.items
        self._trigger_m = max(
            (item.params[0] for item in items if item.command == Command.DO_SET_CAM_TRIGG_DIST), default=0.0
        )
        self._at_waypoints = not self._trigger_m and any(item.command in _TAKES_PHOTO for item in items)
        self._taken = session.monitor.photos_taken
        self._begin()

    def _begin(self) -> None:
        """Count from here: a photo was reported, or the camera is off."""
        self._from_m: FloatArray | None = None
        self._last_m: FloatArray | None = None
        self._expected, self._flown_m, self._since_s = 0, 0.0, self._session.monitor.time_s
        self._reached = self._progress.reached_count

    def look(self) -> None:
        """Look once."""
        session = self._session
        taken, now_s, here_m = session.monitor.photos_taken, session.monitor.time_s, self._progress.place_m
        if here_m is None or now_s is None or not (self._trigger_m or self._at_waypoints):
            return
        if taken != self._taken:
            self._taken = taken
            self._begin()
        elif self._at_waypoints or (session.on_mission and self._progress.heading_for > 0):
            self._count(here_m)
        else:
            self._from_m = self._last_m = None  # between the legs of the route the camera is off
        watched = taken is not None or session.photos_required
        missing = self._expected if watched and self._expected >= self._enough else None
        lasts_s = now_s - (now_s if self._since_s is None else self._since_s)
        session.watch.measure(
            Ending.PHOTOS_MISSING, missing,
            f"the camera has reported no photo for {self._flown_m:.0f} m, {lasts_s:.0f} s; {self._expected} were expected",
            "the camera reports photos again",
        )  # fmt: skip

    @property
    def _enough(self) -> float:
        link = self._session.client.statistics
        lost = link.lost / max(1, link.lost + link.frames_in)
        if lost >= 1.0:
            return math.inf
        return max(_FEWEST, math.ceil(math.log(_BY_CHANCE) / math.log(lost))) if lost > 0.0 else _FEWEST

    def _count(self, here_m: FloatArray) -> None:
        if self._last_m is not None:
            self._flown_m += float(np.linalg.norm(here_m - self._last_m))
        self._last_m = here_m
        if self._at_waypoints:
            self._expected = self._progress.reached_count - self._reached
        elif self._from_m is None:
            self._from_m = here_m
        elif (away_m := math.dist(here_m[:2], self._from_m[:2])) >= self._trigger_m:
            self._expected += int(away_m / self._trigger_m)
            self._from_m = here_m
