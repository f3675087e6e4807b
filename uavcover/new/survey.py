"""The design of a survey, and its scenario as TOML, every key with its reason as a comment."""

import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

import jinja2

from mission_io.model.plain_text import plain_text
from uavcover.errors import InputError
from uavcover.model.area import Ring
from uavcover.new.catalog import CameraBody, VehicleType
from uavcover.new.quantities import SURVEY, TERRAIN, TEXT
from uavcover.new.terrain_look import SurfaceLook
from uavcover.scenario.areas.area_file import AreaQuery, FoundArea
from uavcover.terrain.terrain_source import TerrainSource


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyWish:
    """Requirements of a survey."""

    camera: CameraBody  # the camera
    gsd_m: float  # largest ground sample distance
    forward_overlap: float  # fraction of a photo's length that the next one shows again
    side_overlap: float  # fraction of its width that the next line shows again
    vehicle: VehicleType | None = None  # the vehicle, or none
    ceiling_agl_m: float | None = None  # largest height above ground; None: the usual limit
    speed_m_s: float | None = None  # speed over ground; None: the vehicle's usual one
    endurance_s: float | None = None  # time in the air on a full battery; None: the vehicle's
    margin_m: float | None = None  # how far beyond the area photos overlap; None: as far as they have to


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyDesign:
    """Flight values derived from the requirements.

    Distances on the ground are for flat ground.
    """

    wish: SurveyWish  # the requirements
    gsd_height_m: float  # height at which a pixel covers the required ground sample distance
    min_height_agl_m: float  # lower end of the height band
    max_height_agl_m: float  # upper end
    height_margin_m: float  # the planner stays this far inside both
    max_climb_angle_deg: float  # steepest leg; a multicopter climbs as steeply as the ground does
    photo_distance_m: float  # between two photos, for the overlap at the lower end
    line_distance_m: float  # between two lines, at the middle of the band
    speed_m_s: float  # over ground
    speed_reason: str  # why it is not the usual one; empty if it is
    endurance_s: float | None  # time in the air on a full battery; None: unknown
    margin_m: float  # how far the area is grown
    cell_size_m: float  # side of the cells on which results are judged
    range_m: float  # largest slant range, from the top of the band to the corners of a photo on a slope

    @property
    def is_capped(self) -> bool:
        """Whether the height limit, and not the ground sample distance, is the top of the band."""
        return self.max_height_agl_m < 0.99 * self.gsd_height_m

    def gsd_at_m(self, height_agl_m: float) -> float:
        """Ground sample distance straight below, from a height."""
        return height_agl_m / self.wish.camera.focal_px


def design_survey(wish: SurveyWish, *, slope_deg: float, area_m2: float, step_m: float = 0.0) -> SurveyDesign:
    """Heights, distances and speed of a survey.

    Args:
        wish: the requirements.
        slope_deg: slope that 95 % of the ground stays below; steeper ground gets a deeper height band, since straight legs cannot
            follow it as closely.
        area_m2: size of the area.
        step_m: tallest thing that lines pass over, trees or roofs of a surface model: the band has room for that step.

    Raises:
        InputError: it cannot be flown; says which of the wishes has to change.
    """
    camera = wish.camera
    gsd_height_m = wish.gsd_m * camera.focal_px
    ceiling_m = SURVEY.usual_ceiling_m if wish.ceiling_agl_m is None else wish.ceiling_agl_m
    top_m = math.floor(10.0 * min(gsd_height_m, ceiling_m)) / 10.0
    if top_m < SURVEY.lowest_top_m:
        _refuse_height(wish, gsd_height_m, top_m)
    steepness = min(max((slope_deg - SURVEY.flat_deg) / (SURVEY.steep_deg - SURVEY.flat_deg), 0.0), 1.0)
    bottom_m = math.ceil(min((0.75 - 0.15 * steepness) * top_m, top_m - 15.0))
    height_margin_m = 5.0 if top_m - bottom_m >= 20.0 else 3.5
    if step_m > 0.0:
        height_margin_m = 5.0
        bottom_m = min(bottom_m, math.floor(top_m - step_m - 2.0 * height_margin_m - 1.0))
        if bottom_m < SURVEY.lowest_bottom_m:
            raise InputError(
                f"--dsm: objects there are up to {step_m:.0f} m tall, so no lines fit between "
                f"{SURVEY.lowest_bottom_m:g} m above them and {top_m:g} m above open ground; use a coarser --gsd or "
                "a larger --max-height, or exclude these objects from the area"
            )
    across = camera.sensor_across_mm / camera.focal_length_mm
    along = camera.sensor_along_mm / camera.focal_length_mm
    photo_distance_m = (1.0 - wish.forward_overlap) * along * bottom_m
    line_distance_m = (1.0 - wish.side_overlap) * across * 0.5 * (bottom_m + top_m)
    speed_m_s, reason = _speed(wish, photo_distance_m)
    margin_m = wish.margin_m
    if margin_m is None:
        # a place at the edge is in as many photos as one inside when lines, and photos along them, reach as far beyond
        # the edge as a photo overlaps the next: f L along, s W / 2 across (docs/how-to/survey_from_files.md).
        margin_m = math.ceil(max(wish.forward_overlap * along, 0.5 * wish.side_overlap * across) * top_m)
    cell_m = min(max(math.sqrt(area_m2 / SURVEY.cells), SURVEY.finest_cell_m), max(line_distance_m / 4.0, 0.5))
    endurance_s = wish.endurance_s or (wish.vehicle.endurance_s if wish.vehicle is not None else None)
    diagonal = 0.5 * math.hypot(across, along)
    return SurveyDesign(
        wish=wish, gsd_height_m=gsd_height_m, min_height_agl_m=bottom_m, max_height_agl_m=top_m, height_margin_m=height_margin_m,
        max_climb_angle_deg=_climb_angle_deg(slope_deg),
        photo_distance_m=photo_distance_m, line_distance_m=line_distance_m, speed_m_s=speed_m_s, speed_reason=reason,
        endurance_s=endurance_s, margin_m=margin_m, cell_size_m=round(cell_m, 1),
        range_m=math.ceil(1.6 * top_m * math.hypot(1.0, diagonal)),
    )  # fmt: skip


def _climb_angle_deg(slope_deg: float) -> float:
    """Steepest leg over sloping ground, in steps of 5 degrees. It is steeper than the ground: lines across it end at the foot."""
    wanted_deg = 5.0 * math.ceil((slope_deg + SURVEY.climb_over_slope_deg) / 5.0)
    return min(max(wanted_deg, SURVEY.usual_climb_deg), SURVEY.steepest_climb_deg)


def _refuse_height(wish: SurveyWish, gsd_height_m: float, top_m: float) -> None:
    if gsd_height_m < SURVEY.lowest_top_m:
        coarser_cm = 100.0 * SURVEY.lowest_top_m / wish.camera.focal_px
        raise InputError(
            f"--gsd: {100.0 * wish.gsd_m:g} cm with {wish.camera.name} requires a height of {gsd_height_m:.1f} m "
            f"above ground, but the minimum is {SURVEY.lowest_top_m:g} m; use {coarser_cm:.2g} cm or more, or a "
            "camera with a longer lens"
        )
    raise InputError(
        f"--max-height: {top_m:g} m leaves no room for a height band above trees and houses; use "
        f"{SURVEY.lowest_top_m:g} m or more"
    )


def _speed(wish: SurveyWish, photo_distance_m: float) -> tuple[float, str]:
    """Speed over ground, and why it is not the usual one."""
    vehicle = wish.vehicle
    largest = vehicle.max_speed_m_s if vehicle is not None else None
    if wish.speed_m_s is not None and largest is not None and wish.speed_m_s > largest:
        raise InputError(
            f"--speed: {wish.speed_m_s:g} m/s exceeds the maximum of {wish.vehicle and wish.vehicle.name}, "
            f"{largest:g} m/s; use a lower speed"
        )
    usual = SURVEY.usual_speed_m_s
    if vehicle is not None and vehicle.cruise_speed_m_s is not None:
        usual = vehicle.cruise_speed_m_s
    elif largest is not None:
        usual = min(usual, SURVEY.speed_fraction * largest)
    speed = usual if wish.speed_m_s is None else wish.speed_m_s
    interval_s = wish.camera.min_interval_s
    if interval_s is None:
        return speed, ""
    fastest = photo_distance_m / (interval_s * SURVEY.trigger_slack)
    if speed <= fastest:
        return speed, ""
    needed = f"a photo every {photo_distance_m:.1f} m and the {interval_s:g} s interval of {wish.camera.name}"
    if wish.speed_m_s is not None or fastest < SURVEY.slowest_m_s:
        raise InputError(
            f"{'--speed' if wish.speed_m_s is not None else '--overlap'}: {needed} allow only {fastest:.1f} m/s; use "
            "less forward overlap, a coarser --gsd or a lower --speed, or use a faster camera"
        )
    return math.floor(10.0 * fastest) / 10.0, f"{needed} do not allow a higher speed"


# Flights over one area that belong together: one set of swaths, two that cross, or five directions for building models.

PATTERNS = ("single", "crosshatch", "oblique")
_COMPASS = (("north", 0.0), ("east", 90.0), ("south", 180.0), ("west", 270.0))


@dataclass(frozen=True, slots=True)
class View:
    """Camera view of one flight of a pattern."""

    name: str  # of the flight; empty where there is one
    pitch_deg: float  # of the camera's axis; -90 is straight down
    heading_deg: float | None  # that the camera keeps, clockwise from north; None: that of its legs
    line_heading_deg: float | None  # of the lines; None: the planner chooses every leg's

    @property
    def is_tilted(self) -> bool:
        """Whether the camera does not look straight down."""
        return self.pitch_deg > -90.0


SINGLE = View("", -90.0, None, None)


def views_of(pattern: str | None, *, along_deg: float) -> tuple[View, ...]:
    """The flights of a pattern.

    Args:
        pattern: one of ``PATTERNS``; None: single.
        along_deg: heading of the longer side of the area.

    Raises:
        InputError: there is no such pattern.
    """
    match "single" if pattern is None else pattern.casefold():
        case "single":
            return (SINGLE,)
        case "crosshatch":
            along = _whole(along_deg)
            return (View("along", -90.0, None, along), View("across", -90.0, None, (along + 90.0) % 180.0))
        case "oblique":
            tilted = (View(name, SURVEY.oblique_pitch_deg, heading, heading) for name, heading in _COMPASS)
            return (View("nadir", -90.0, None, _whole(along_deg)), *tilted)
    raise InputError(f"--pattern: must be {', '.join(PATTERNS[:-1])} or {PATTERNS[-1]}, not {pattern!r}")


def _whole(heading_deg: float) -> float:
    return float(math.floor(heading_deg + 0.5) % 180)


_NOTHING = "\0\n"
"""A line of the template without a value: it is taken out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyScenario:
    """All that goes into the file."""

    name: str  # of the scenario
    query: AreaQuery  # how the area was specified
    area: FoundArea  # what was read
    terrain_files: tuple[str, ...]  # the elevation data: files, folders or patterns
    terrain: TerrainSource  # how they are read
    vertical_datum: str  # of its heights
    datum_is_stated: bool  # whether the file, or the user, says so
    design: SurveyDesign  # heights, distances, speed
    home: tuple[float, float]  # latitude and longitude
    home_is_given: bool  # whether the user gave it
    return_height_m: float  # above home, over all ground around
    slope_deg: float  # slope that 95 % of the ground stays below
    autopilot: str  # whose conventions mission files follow
    mount: str  # "stabilised" or "fixed"
    no_fly: tuple[str, ...] = ()  # files of no-fly zones
    flight_window_utc: tuple[str, str] | None = None  # when it is flown; None: at any time
    view: View = SINGLE  # what this flight of a pattern looks at
    surface_files: tuple[str, ...] = ()  # a surface model: files, folders or patterns
    surface: SurfaceLook | None = None  # what was seen of it; None without one
    trust_heights: bool = False  # whether the user confirmed heights that do not look like ground
    fence: Ring | None = None  # ring in longitude and latitude; None for the default around area and home
    max_alt_amsl_m: float | None = None  # highest altitude of the whole flight; None without a limit
    rally: Ring | None = None  # rally points in longitude and latitude
    # fraction of the ground on which plain lines keep the overlap asked for, which is then required; None where they do not
    keeps_overlap: float | None = None


def return_height_m(highest_amsl_m: float, home_amsl_m: float) -> float:
    """Height above home from which a straight way home clears all ground around, in steps of 5 m."""
    return TEXT.step_m * math.ceil(
        max(highest_amsl_m - home_amsl_m + TEXT.transit_clearance_m + 10.0, 60.0) / TEXT.step_m
    )


def scenario_text(scenario: SurveyScenario, *, folder: Path) -> str:
    """The TOML of a survey; files are named relative to the folder that it will be in."""

    def path(name: str) -> str:
        return _relative(Path(name), folder)

    def paths(names: tuple[str, ...]) -> str | list[str]:
        return path(names[0]) if len(names) == 1 else [path(name) for name in names]

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=False,  # TOML, not HTML: key() writes values as TOML, and comments are plain text
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"repr": repr, "plain": plain_text}
    text = environment.get_template("survey.toml.jinja").render(
        survey=scenario, key=_line, path=path, paths=paths, top=_top(scenario.design), numbers=TEXT,
        hides_m=TERRAIN.hides_m, oblique_sample=SURVEY.oblique_sample,
        # The design's range, stretched where the camera looks ahead.
        range_m=float(math.ceil(scenario.design.range_m / math.sin(math.radians(-scenario.view.pitch_deg)))),
    )  # fmt: skip
    return text.replace(_NOTHING, "")


def name_of(text: str) -> str:
    """A short name for files and reports."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", text).strip("-.")[:40] or "survey"


def _line(key: str, value: object, reason: str) -> str:
    """One line of the file; for no value ``_NOTHING``, whose line is removed."""
    if value is None:
        return _NOTHING[:-1]
    return f"{f'{key} = {_toml(value)}':44} # {plain_text(reason)}"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(round(value, 6))
    return json.dumps(value, ensure_ascii=False)


def _top(design: SurveyDesign) -> str:
    """Reason of the upper limit of the height."""
    top = f"{100.0 * design.gsd_at_m(design.max_height_agl_m):.2g} cm per pixel at nadir"
    if design.is_capped:
        given = design.wish.ceiling_agl_m is not None
        limit = "--max-height" if given else f"the usual legal limit of {SURVEY.usual_ceiling_m:g} m"
        top += f"; {limit}, although the ground sample distance allows {design.gsd_height_m:.0f} m"
    return top


def _relative(path: Path, folder: Path) -> str:
    """A path as the scenario names it: relative where that stays short, so that the folder can be moved."""
    try:
        relative = os.path.relpath(path.resolve(), folder.resolve())
    except ValueError:  # another drive
        return path.resolve().as_posix()
    return Path(relative).as_posix() if relative.count("..") <= 3 else path.resolve().as_posix()
