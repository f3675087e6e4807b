"""The camera of the mock vehicle: triggered by distance or by commands; it reports every photo.

As ArduPilot and PX4 do it, the next picture by distance is due where the straight line over ground from the last one reaches
the distance: the rule of :func:`uavcover.kernels.coverage.picture_places`, one step of flight after the other.
"""

import math

from mission_io.wire import messages as m
from uavcover.mock.body import MockBody
from uavcover.mock.dynamics import Vector
from uavcover.mock.itinerary import CameraOrder


class MockCamera:
    """Takes photos and makes the messages that report them.

    Args:
        body: what carries it; pictures are placed where it believes to be.
        ardupilot: whether it reports as ArduPilot does (CAMERA_FEEDBACK); otherwise as PX4 (CAMERA_IMAGE_CAPTURED).

    Attributes:
        taken: how many pictures it has taken since it was switched on.
        every: number of triggers for one photo.
        at_most: largest number of photos.
        reports: whether it reports its photos.
    """

    def __init__(self, body: MockBody, *, ardupilot: bool) -> None:
        self._body, self._ardupilot = body, ardupilot
        self.every, self.at_most, self.reports = 1, math.inf, True
        self.reset()

    def reset(self) -> None:
        """Stop, and count from 0, as after a reboot."""
        self.taken, self._triggered, self._distance_m = 0, 0, 0.0
        self._last_m: Vector | None = None

    def obey(self, order: CameraOrder, now: float) -> list[m.Message]:
        """Carry out the mission's camera orders; returns their reports.

        PX4 forgets the last picture with every new distance, ArduPilot only when it stops.
        """
        if order.distance_m is not None:
            self._distance_m = order.distance_m
            self._last_m = self._last_m if self._ardupilot and order.distance_m > 0.0 else None
        return self._shoot(now) if order.now else []

    def step(self, now: float) -> list[m.Message]:
        """Take a due photo by distance; PX4 takes the first one as soon as it is switched on."""
        if self._distance_m == 0.0:
            return []
        here = self._body.believed.position_m
        if self._last_m is None:
            if not self._ardupilot:
                return self._shoot(now)
            self._last_m = here
        return self._shoot(now) if math.dist(here[:2], self._last_m[:2]) >= self._distance_m else []

    def _shoot(self, now: float) -> list[m.Message]:
        self._triggered, self._last_m = self._triggered + 1, self._body.believed.position_m
        if (self._triggered - 1) % self.every or self.taken >= self.at_most:
            return []
        self.taken += 1
        return [self._report(now, self._last_m)] if self.reports else []

    def _report(self, now: float, place_m: Vector) -> m.Message:
        body, point = self._body, self._body.point
        here = body.geodetic_of(place_m)
        above_home_m = here.alt_amsl_m - body.home.alt_amsl_m
        roll, pitch, yaw = point.roll_rad, point.pitch_rad, point.yaw_rad
        if self._ardupilot:
            return m.CameraFeedback(
                now, self.taken, here.lat_deg, here.lon_deg, here.alt_amsl_m, above_home_m,
                math.degrees(roll), math.degrees(pitch), math.degrees(yaw) % 360.0, self.taken,
            )  # fmt: skip
        return m.CameraImageCaptured(
            now,
            here.lat_deg,
            here.lon_deg,
            here.alt_amsl_m,
            above_home_m,
            _quaternion(roll, pitch, yaw),
            self.taken - 1,
            1,
        )


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """The rotation from body to north-east-down (w, x, y, z), yaw-pitch-roll order."""
    cr, sr, cp, sp = math.cos(0.5 * roll), math.sin(0.5 * roll), math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
    )  # fmt: skip
