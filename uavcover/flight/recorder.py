"""Samples of a track from what the vehicle reports."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from mission_io.wire import messages as m
from uavcover.flight.tuning import RECORDS
from uavcover.model.active_times import is_flight_time
from uavcover.model.track import (
    VELOCITY_COLUMNS,
    TrackSample,
)
from uavcover.terrain.frames import LocalFrame

if TYPE_CHECKING:
    from uavcover.flight.monitor import Monitor


class Recorder:
    """Makes a sample of each position, with the latest attitude and mission item.

    Positions that come late or twice are left out: the track's time always goes on. Where no attitude of that moment is known it
    stays unknown; the heading that the position itself tells is taken then.
    """

    def __init__(
        self,
        monitor: "Monitor",  # what the vehicle says
        frame: LocalFrame,  # the scenario's local frame
        *,
        waypoint_of: Callable[[int], int],  # number of the planned waypoint that a mission item is, -1 for the others
        on_sample: Callable[[TrackSample], None],  # takes the samples
        utc_offset_s: float = math.nan,  # from the link's clock to UTC; NaN: when a position arrived is not recorded
    ) -> None:
        self._monitor, self._frame, self._on_sample = monitor, frame, on_sample
        self._utc_offset_s = utc_offset_s
        self.waypoint_of = waypoint_of
        self.count = 0
        self.first_s = self.last_s = -math.inf
        self._reports_velocity = False

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
        if attitude is not None and abs(age_s) <= RECORDS.max_attitude_age_s:
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
                pictures_taken=math.nan if (taken := self._monitor.photos_taken) is None else float(taken),
                unix_time_s=self._unix_time_s(position.time_boot_s),
                received_utc_s=self._utc_offset_s + (self._monitor.position_at_s or 0.0),
                **self._velocity(position),
            )
        )

    def _velocity(self, position: m.GlobalPositionInt) -> dict[str, float]:
        """The velocity columns; none before the first value that is not 0: zeros mean that none is reported."""
        velocity = {name: float(getattr(position, name)) for name in VELOCITY_COLUMNS}
        self._reports_velocity |= any(velocity.values())
        return velocity if self._reports_velocity else {}

    def _unix_time_s(self, time_boot_s: float) -> float:
        """UTC at a vehicle time, from the vehicle's clock; NaN before its receiver knows."""
        clock = self._monitor.latest(m.SystemTime)
        if clock is None or not is_flight_time(clock.time_unix_s):
            return math.nan
        return clock.time_unix_s + (time_boot_s - clock.time_boot_s)
