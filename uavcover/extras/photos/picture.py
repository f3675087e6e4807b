"""Metadata of a photo, from its file or a list beside it."""

import datetime
import math
import re
from dataclasses import dataclass
from enum import StrEnum

_HIGHEST_M = 20_000.0
_NO_ZOOM = 1.001
RTK_FIXED = 50.0
"""``RtkFlag`` of a fixed solution, whose heights are above the ellipsoid."""
_MOMENT = re.compile(
    r"(\d{4})[-:](\d\d)[-:](\d\d)[ T](\d\d):(\d\d):(\d\d)(\.\d{1,9})?\s*(?:(Z)|([+-]\d\d):?(\d\d))?", re.ASCII
)


class HeightDatum(StrEnum):
    """Datums of a photo's height."""

    SEA_LEVEL = "sea level"
    ELLIPSOID = "ellipsoid"


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """Metadata of a photo; unknown values are None.

    Attributes:
        name: of its file, or of its row.
        lat_deg: geodetic, WGS 84.
        lon_deg: geodetic, WGS 84.
        alt_m: height of the camera above ``datum``.
        datum: what that refers to.
        height_above_takeoff_m: the same above the place of take-off, as barometers tell it.
        time_s: when it was taken, in seconds on ``clock``.
        clock: whose time that is; seconds of two clocks have nothing in common. ``UTC`` only where the zone is known.
        utc_s: when it was taken in Unix time, where the zone or the satellites' time is known.
        yaw_deg: of the camera, clockwise from north; the direction of the photo's top when it looks straight down.
        pitch_deg: of the camera above the horizon: -90 looks straight down.
        roll_deg: of the camera, clockwise as it looks.
        vehicle_yaw_deg: of the vehicle's nose.
        vehicle_roll_deg: of the vehicle, right side down is positive.
        vehicle_pitch_deg: of the vehicle, nose up is positive.
        horizontal_error_m: of its place, one standard deviation.
        vertical_error_m: of its height.
        speed_m_s: over ground.
        exposure_s: time for which the shutter was open.
        camera: maker and model.
        pixels: longer and shorter side.
        focal_length_mm: of the lens.
        focal_length_35mm: of the lens with the same diagonal field of view on film of 36 x 24 mm.
        capture_id: of the exposure that it belongs to: bands of a multispectral camera, and cameras of a rig, share one.
        digital_zoom: how many times a digital zoom enlarged it.
        fault: why its file cannot be read.
    """

    name: str
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_m: float | None = None
    datum: HeightDatum = HeightDatum.SEA_LEVEL
    height_above_takeoff_m: float | None = None
    time_s: float | None = None
    clock: str | None = None
    utc_s: float | None = None
    yaw_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    vehicle_yaw_deg: float | None = None
    vehicle_roll_deg: float | None = None
    vehicle_pitch_deg: float | None = None
    horizontal_error_m: float | None = None
    vertical_error_m: float | None = None
    speed_m_s: float | None = None
    exposure_s: float | None = None
    camera: str | None = None
    pixels: tuple[int, int] | None = None
    focal_length_mm: float | None = None
    focal_length_35mm: float | None = None
    capture_id: str | None = None
    digital_zoom: float | None = None
    fault: str | None = None

    @property
    def has_direction(self) -> bool:
        """Whether it tells where its camera looked."""
        return self.pitch_deg is not None and self.yaw_deg is not None

    def lacks(self) -> str | None:
        """Reason why it shows nothing known; None if it does."""
        if self.fault is not None:
            return self.fault
        if self.digital_zoom is not None and self.digital_zoom > _NO_ZOOM:
            return f"digital zoom {self.digital_zoom:g}: its field of view is unknown; take photos without digital zoom"
        if self.lat_deg is None or self.lon_deg is None:
            return "no position"
        if not (abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0) or (self.lat_deg == self.lon_deg == 0.0):
            return f"position {self.lat_deg:g}, {self.lon_deg:g} is not on Earth"
        heights = [height for height in (self.alt_m, self.height_above_takeoff_m) if height is not None]
        if not heights:
            return "no height"
        if any(abs(height) > _HIGHEST_M for height in heights):
            return f"height {max(heights, key=abs):g} m is impossible for a flight"
        angles = (self.yaw_deg, self.pitch_deg, self.roll_deg, self.vehicle_yaw_deg)
        if any(angle is not None and abs(angle) > 360.0 for angle in angles):
            return "its angles exceed a full turn"
        return None


def finite(value: object) -> float | None:
    """A finite number from a file, also as text or as a fraction like 1/200; None for anything else."""
    try:
        if isinstance(value, str) and value.count("/") == 1:
            above, below = value.split("/")
            number = float(above) / float(below)
        else:
            number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def moment(text: str) -> tuple[float | None, bool]:
    """Seconds of a date and time as EXIF and ISO 8601 write them.

    Also whether they are Unix time, because the zone is known.

    >>> moment("2026:05:04 10:11:12.5"), moment("2026-05-04T12:11:12+02:00"), moment("0000:00:00 00:00:00")
    ((1777889472.5, False), (1777889472.0, True), (None, False))
    """
    found = _MOMENT.fullmatch(text.strip("\x00 "))
    if found is None:
        return None, False
    year, month, day, hour, minute, second = (int(part) for part in found.groups()[:6])
    try:
        whole_s = datetime.datetime(year, month, day, hour, minute, second, tzinfo=datetime.UTC).timestamp()
    except ValueError:
        return None, False
    hours, minutes = found[9] or "+00", found[10] or "00"
    ahead_s = 3600.0 * int(hours) + math.copysign(60.0 * int(minutes), float(f"{hours[0]}1"))
    return whole_s + float(found[7] or 0.0) - ahead_s, bool(found[8] or found[9])
