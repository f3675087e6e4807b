"""Metadata of a photo, from its file or a list beside it."""

import datetime
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from mission_io.model.plain_text import counted
from uavcover.errors import InputError
from uavcover.new.catalog import CAMERAS, CameraBody
from uavcover.new.command import NewScenario, new_scenario
from uavcover.new.elevation_questions import NewRequest
from uavcover.new.quantities import SURVEY
from uavcover.run.folder import RunFolder
from uavcover.run.user import Unattended, User
from uavcover.scenario.site import Site

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
class Photo:
    """Metadata of a photo; unknown values are None."""

    name: str  # of its file, or of its row
    lat_deg: float | None = None  # geodetic, WGS 84
    lon_deg: float | None = None  # geodetic, WGS 84
    alt_m: float | None = None  # height of the camera above ``datum``
    datum: HeightDatum = HeightDatum.SEA_LEVEL  # what that refers to
    height_above_takeoff_m: float | None = None  # the same above the place of take-off, as barometers tell it
    time_s: float | None = None  # when it was taken, in seconds on ``clock``
    # whose time that is; seconds of two clocks have nothing in common. ``UTC`` only where the zone is known.
    clock: str | None = None
    utc_s: float | None = None  # when it was taken in Unix time, where the zone or the satellites' time is known
    # of the camera, clockwise from north; the direction of the photo's top when it looks straight down
    yaw_deg: float | None = None
    pitch_deg: float | None = None  # of the camera above the horizon: -90 looks straight down
    roll_deg: float | None = None  # of the camera, clockwise as it looks
    vehicle_yaw_deg: float | None = None  # of the vehicle
    vehicle_roll_deg: float | None = None  # of the vehicle, right side down is positive
    vehicle_pitch_deg: float | None = None  # of the vehicle, nose up is positive
    horizontal_error_m: float | None = None  # of its position, one standard deviation
    vertical_error_m: float | None = None  # of its height
    speed_m_s: float | None = None  # over ground
    exposure_s: float | None = None  # time for which the shutter was open
    camera: str | None = None  # maker and model
    pixels: tuple[int, int] | None = None  # longer and shorter side
    focal_length_mm: float | None = None  # of the lens
    focal_length_35mm: float | None = None  # of the lens with the same diagonal field of view on film of 36 x 24 mm
    # of the exposure that it belongs to: bands of a multispectral camera, and cameras of a rig, share one
    capture_id: str | None = None
    digital_zoom: float | None = None  # how many times a digital zoom enlarged it
    fault: str | None = None  # reason why its file cannot be read

    @property
    def has_position(self) -> bool:
        """Whether its position is known."""
        return self.lat_deg is not None and self.lon_deg is not None

    @property
    def is_zoomed(self) -> bool:
        """Whether a digital zoom enlarged it, so that its field of view is unknown."""
        return self.digital_zoom is not None and self.digital_zoom > 1.001

    @property
    def has_direction(self) -> bool:
        """Whether the direction of its camera is known."""
        return self.pitch_deg is not None and self.yaw_deg is not None

    def lacks(self) -> str | None:
        """Reason why it proves nothing; None if it does."""
        if self.fault is not None:
            return self.fault
        if self.is_zoomed:
            return f"the field of view is unknown with a digital zoom of {self.digital_zoom:g}; do not zoom digitally"
        if self.lat_deg is None or self.lon_deg is None:
            return "no position"
        if not (abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0) or (self.lat_deg == self.lon_deg == 0.0):
            return f"position {self.lat_deg:g}, {self.lon_deg:g} is not on Earth"
        heights = [height for height in (self.alt_m, self.height_above_takeoff_m) if height is not None]
        if not heights:
            return "no height"
        if any(abs(height) > 20_000.0 for height in heights):
            return f"height {max(heights, key=abs):g} m is not possible for a flight"
        angles = (self.yaw_deg, self.pitch_deg, self.roll_deg, self.vehicle_yaw_deg)
        if any(angle is not None and abs(angle) > 360.0 for angle in angles):
            return "the angles exceed a full turn"
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


# The scenario of a survey that was already flown: its area, the camera of its photos, and its height.

CAMERA_FILE = "camera.toml"
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
LENS_DIFFERS = 0.1
"""Largest relative difference of the focal lengths of one lens, because photos round them."""
_FIRST_HEIGHT_M = 80.0
_LOWEST_M = 1.02 * SURVEY.lowest_top_m
"""Lowest height of a flight for missing photos."""


class _Unheard(Unattended):
    """For the first of two scenarios: the second one warns of the same."""

    def warn(self, line: str) -> None:
        """Nothing."""


def survey_as_flown(
    area: NewRequest,  # the required coverage, and other options of the user
    photos: Sequence[Photo],  # of the flight; may be none where a camera was named
    height_agl_m: Callable[[Site], float],  # the height above ground at which a site's flight was flown
    user: User,  # receives notes on the survey
    *,
    out: RunFolder,  # where a camera file is written
    # the place of take-off in a site's flight, "LAT,LON", as a home that the user did not give; None: not known
    take_off: Callable[[Site], str] | None = None,
) -> NewScenario:
    """The survey with the camera named in the photos and the flown ground sample distance, unless the user gave others.

    Raises:
        InputError: no camera is known, or something else is missing; the flight was not above the ground.
    """
    if area.camera is None:
        body, name, others = _camera_of(photos, out)
        area = replace(area, camera=name)
        user.say(f"{'camera':18}{body}, from the photo metadata; saved in {name}")
        if others:
            user.warn(
                f"{counted(sum(others.values()), 'photo is', 'photos are')} from other cameras "
                f"({', '.join(sorted(others))}) and not counted; judge each camera separately, with --camera and its photos"
            )
    camera = CAMERAS.named(str(area.camera))
    _compare_lens(camera, photos, user)
    gsd_m = _FIRST_HEIGHT_M / camera.focal_px
    wants_home = area.home is None and take_off is not None
    if area.gsd is None or wants_home:
        # The first scenario only gives the places; the second is made for the height at which it was flown.
        first = new_scenario(replace(area, gsd=area.gsd or _gsd_text(gsd_m)), _Unheard(), folder=out.path)
        height_m = height_agl_m(first.site)
        if wants_home and take_off is not None:
            area = replace(area, home=take_off(first.site))
        if area.gsd is None:
            area = replace(area, gsd=_gsd_text(max(height_m, _LOWEST_M) / camera.focal_px))
            user.say(
                f"{'ground sample':18}no limit; a flight for the missing photos is planned for {area.gsd}, because "
                f"this flight was {height_m:.0f} m above ground (median)"
            )
    return new_scenario(area, user, folder=out.path)


def _gsd_text(gsd_m: float) -> str:
    return f"{math.ceil(1000.0 * 100.0 * gsd_m) / 1000.0:g}cm"


def _camera_of(photos: Sequence[Photo], out: RunFolder) -> tuple[str, str, Counter[str]]:
    """A camera file from the photos' metadata; its title, its path, and the number of photos from other cameras."""
    telling = [p for p in photos if p.focal_length_mm and p.focal_length_35mm and p.pixels]
    if not telling:
        raise InputError(
            "the photos do not describe their camera (focal length, 35 mm equivalent, pixels): specify --camera NAME "
            "or a camera file (uavcover new --camera list)"
        )
    kinds = Counter((p.focal_length_mm, p.focal_length_35mm, p.pixels, p.camera) for p in telling)
    (focal_mm, film_mm, pixels, title), _ = kinds.most_common(1)[0]
    others = Counter(p.camera for p in photos if p.camera not in (None, title))
    if focal_mm is None or film_mm is None or pixels is None:
        raise InputError("the photos do not describe their camera; specify --camera")
    diagonal_mm = FILM_DIAGONAL_MM * focal_mm / film_mm
    pitch_mm = diagonal_mm / math.hypot(*pixels)
    lines = [
        f"title = {_quoted(title or 'camera of the photos')}",
        f"sensor_mm = [{pitch_mm * pixels[0]:.4f}, {pitch_mm * pixels[1]:.4f}]",
        f"pixels = [{pixels[0]}, {pixels[1]}]",
        f"focal_length_mm = {focal_mm:g}",
        f'source = "the photos\' metadata: {focal_mm:g} mm, as {film_mm:g} mm on 35 mm film"',
    ]
    out.write_text(CAMERA_FILE, "\n".join(lines) + "\n")
    return (
        title or "camera of the photos",
        str(out.file(CAMERA_FILE)),
        Counter({str(k): n for k, n in others.items()}),
    )


def _quoted(text: str) -> str:
    """As TOML and JSON both have it."""
    return json.dumps("".join(letter for letter in text if letter.isprintable()))


def _compare_lens(camera: CameraBody, photos: Sequence[Photo], user: User) -> None:
    """Warn of a camera whose field of view contradicts the photos."""
    films_mm = [p.focal_length_35mm for p in photos if p.focal_length_35mm]
    if not films_mm:
        return
    film_mm = float(np.median(films_mm))
    own_mm = FILM_DIAGONAL_MM * camera.focal_length_mm / math.hypot(camera.sensor_across_mm, camera.sensor_along_mm)
    if abs(own_mm / film_mm - 1.0) > LENS_DIFFERS:
        user.warn(
            f"--camera: the focal length of {camera.name} corresponds to {own_mm:.0f} mm on 35 mm film, but that of "
            f"the photos to {film_mm:.0f} mm; check the camera and zoom, or omit --camera to use the photos' camera"
        )
