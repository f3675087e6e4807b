"""The scenario of a survey that somebody flew already: its area, its photos' camera, the height it was flown at."""

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from uavcover.errors import InputError
from uavcover.extras.photos.picture import Picture
from uavcover.new.cameras import CameraBody, camera_named
from uavcover.new.command import NewScenario, new_scenario
from uavcover.new.elevation_questions import NewRequest
from uavcover.new.tuning import SURVEY
from uavcover.run.folder import RunFolder
from uavcover.run.user import Unattended, User
from uavcover.scenario.site import Site

CAMERA_FILE = "camera.toml"
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
LENS_DIFFERS = 0.1
"""Share by which the focal lengths of one lens may differ, as photos round them."""
_FIRST_HEIGHT_M = 80.0
_LOWEST_M = 1.02 * SURVEY.lowest_top_m
"""A flight for what is missing is planned no lower."""


class _Unheard(Unattended):
    """For the first of two scenarios: the second one warns of the same."""

    def warn(self, line: str) -> None:
        """Nothing."""


def survey_as_flown(
    area: NewRequest,
    pictures: Sequence[Picture],
    height_agl_m: Callable[[Site], float],
    user: User,
    *,
    out: RunFolder,
    take_off: Callable[[Site], str] | None = None,
) -> NewScenario:
    """The survey with the camera named in the photos and the flown ground sample distance, unless the user gave others.

    Args:
        area: the required coverage, and other options of the user.
        pictures: of the flight; may be none where a camera was named.
        height_agl_m: the height above ground at which a site's flight was flown.
        user: receives notes on the survey.
        out: where a camera file is written.
        take_off: the place of take-off in a site's flight, "LAT,LON", as a home that the user did not give; none: not known.

    Raises:
        InputError: no camera is known, or something else is missing; the flight was not above the ground.
    """
    if area.camera is None:
        body, name, others = _camera_of(pictures, out)
        area = replace(area, camera=name)
        user.say(f"{'camera':18}{body}, from the photos' metadata; kept in {name}")
        if others:
            user.warn(
                f"{sum(others.values())} photos are from other cameras ({', '.join(sorted(others))}) and do not "
                "count: judge each camera on its own, with --camera and its photos"
            )
    camera = camera_named(str(area.camera))
    _compare_lens(camera, pictures, user)
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
                f"this one was flown {height_m:.0f} m above ground (median)"
            )
    return new_scenario(area, user, folder=out.path)


def _gsd_text(gsd_m: float) -> str:
    return f"{math.ceil(1000.0 * 100.0 * gsd_m) / 1000.0:g}cm"


def _camera_of(pictures: Sequence[Picture], out: RunFolder) -> tuple[str, str, Counter[str]]:
    """A camera file by what the photos tell; its title, its path, and how many photos other cameras took."""
    telling = [p for p in pictures if p.focal_length_mm and p.focal_length_35mm and p.pixels]
    if not telling:
        raise InputError(
            "the photos do not describe their camera (focal length, 35 mm equivalent, pixels): specify --camera NAME "
            "or a camera file (uavcover new --camera list)"
        )
    kinds = Counter((p.focal_length_mm, p.focal_length_35mm, p.pixels, p.camera) for p in telling)
    (focal_mm, film_mm, pixels, title), _ = kinds.most_common(1)[0]
    others = Counter(p.camera for p in pictures if p.camera not in (None, title))
    if focal_mm is None or film_mm is None or pixels is None:
        raise InputError("the photos do not describe their camera: specify --camera")
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


def _compare_lens(camera: CameraBody, pictures: Sequence[Picture], user: User) -> None:
    """Warn of a camera whose field of view is not that which the photos tell."""
    films_mm = [p.focal_length_35mm for p in pictures if p.focal_length_35mm]
    if not films_mm:
        return
    film_mm = float(np.median(films_mm))
    own_mm = FILM_DIAGONAL_MM * camera.focal_length_mm / math.hypot(camera.sensor_across_mm, camera.sensor_along_mm)
    if abs(own_mm / film_mm - 1.0) > LENS_DIFFERS:
        user.warn(
            f"--camera: {camera.name} has the field of view of {own_mm:.0f} mm on 35 mm film, but the photos say "
            f"{film_mm:.0f} mm: check the camera and zoom; without --camera, their camera is used"
        )
