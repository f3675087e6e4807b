"""A survey's scenario as TOML, every key with its reason as a comment."""

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
from uavcover.new.survey import SurveyDesign
from uavcover.new.terrain_look import SurfaceLook
from uavcover.new.tuning import SURVEY, TERRAIN, TEXT
from uavcover.scenario.areas.area_file import AreaQuery, FoundArea
from uavcover.terrain.terrain_source import TerrainSource

# Flights over one area that belong together: one set of swaths, two that cross, or five directions for building models.

PATTERNS = ("single", "crosshatch", "oblique")
_COMPASS = (("north", 0.0), ("east", 90.0), ("south", 180.0), ("west", 270.0))


@dataclass(frozen=True, slots=True)
class View:
    """Camera view of one flight of a pattern."""

    name: str  # of the flight; empty where there is one
    pitch_deg: float  # of the camera's axis; -90 is straight down
    heading_deg: float | None  # that the camera keeps, clockwise from north; none: that of its legs
    line_heading_deg: float | None  # of the lines; none: the planner chooses every leg's

    @property
    def is_tilted(self) -> bool:
        """Whether the camera does not look straight down."""
        return self.pitch_deg > -90.0


SINGLE = View("", -90.0, None, None)


def views_of(pattern: str | None, *, along_deg: float) -> tuple[View, ...]:
    """The flights of a pattern.

    Args:
        pattern: one of ``PATTERNS``; none: single.
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
    flight_window_utc: tuple[str, str] | None = None  # when it is flown; none: at any time
    view: View = SINGLE  # what this flight of a pattern looks at
    surface_files: tuple[str, ...] = ()  # a surface model: files, folders or patterns
    surface: SurfaceLook | None = None  # what was seen of it; none without one
    trust_heights: bool = False  # whether the user confirmed heights that do not look like ground
    fence: Ring | None = None  # ring in longitude and latitude; none for the default around area and home
    max_alt_amsl_m: float | None = None  # highest altitude of the whole flight; none without a limit
    rally: Ring | None = None  # rally points in longitude and latitude
    # share of the ground on which plain lines keep the overlap asked for, which is then required; none where they do
    # not
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
