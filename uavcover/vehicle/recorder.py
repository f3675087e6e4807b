"""Turns the vehicle's messages into samples of the track."""

import math
from collections.abc import Callable

from mission_io.wire import messages as m
from uavcover.model.track import TrackSample
from uavcover.scenario.frames import LocalFrame
from uavcover.vehicle.monitor import Monitor

MAX_ATTITUDE_AGE_S = 1.0
"""Largest age difference between an attitude and a position in one sample."""


class Recorder:
    """Makes a sample of each position, with the latest attitude and mission item.

    Positions that come late or twice are left out: the track's time always goes on. Where no attitude of that moment is known it
    stays unknown; the heading that the position itself tells is taken then.

    Args:
        monitor: what the vehicle says.
        frame: the scenario's local frame.
        waypoint_of: number of the planned waypoint that a mission item is, -1 for the others.
        on_sample: takes the samples.
    """

    def __init__(
        self,
        monitor: Monitor,
        frame: LocalFrame,
        *,
        waypoint_of: Callable[[int], int],
        on_sample: Callable[[TrackSample], None],
    ) -> None:
        self._monitor, self._frame, self._on_sample = monitor, frame, on_sample
        self.waypoint_of = waypoint_of
        self.count = 0
        self.first_s = self.last_s = -math.inf

    def start(self) -> None:
        """Record from the next position on."""
        self._monitor.on_position = self._record

    def stop(self) -> None:
        """Record no more."""
        self._monitor.on_position = None

    def _record(self, position: m.GlobalPositionInt) -> None:
        if position.time_boot_s <= self.last_s:
            return
        self.last_s = position.time_boot_s
        if self.count == 0:
            self.first_s = position.time_boot_s
        self.count += 1
        attitude = self._monitor.latest(m.Attitude)
        age_s = math.nan if attitude is None else position.time_boot_s - attitude.time_boot_s
        roll = pitch = yaw = math.nan
        if attitude is not None and abs(age_s) <= MAX_ATTITUDE_AGE_S:
            roll, pitch, yaw = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rad
        if math.isnan(yaw) and position.heading_deg is not None:
            yaw = math.radians(position.heading_deg)
        lat, lon, alt = position.lat_deg, position.lon_deg, position.alt_amsl_m
        east, north, up = self._frame.enu_from_geodetic(lat, lon, alt)[0].tolist()
        self._on_sample(
            TrackSample(
                time_s=position.time_boot_s,
                lat_deg=lat,
                lon_deg=lon,
                alt_amsl_m=alt,
                east_m=east,
                north_m=north,
                up_m=up,
                roll_deg=math.degrees(roll),
                pitch_deg=math.degrees(pitch),
                yaw_deg=math.degrees(yaw) % 360.0,
                current_waypoint=self.waypoint_of(self._monitor.current_seq),
                attitude_age_s=age_s,
            )
        )
