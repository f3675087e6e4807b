"""A survey's scenario as TOML, every key with its reason as a comment."""

import json
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

from uavcover.model.area import Rings
from uavcover.new.patterns import SINGLE, View
from uavcover.new.surface_look import SurfaceLook
from uavcover.new.survey import SurveyDesign
from uavcover.new.tuning import SURVEY, TERRAIN, TEXT
from uavcover.scenario.areas.area_file import AreaQuery, FoundArea
from uavcover.terrain.terrain_source import TerrainSource

_COMMENT_AT = 44


@dataclass(frozen=True, slots=True, kw_only=True)
class SurveyScenario:
    """All that goes into the file.

    Attributes:
        name: of the scenario.
        query: how the area was specified.
        area: what was read.
        terrain_files: the elevation data: files, folders or patterns.
        terrain: how they are read.
        vertical_datum: of its heights.
        datum_is_stated: whether the file, or the user, says so.
        design: heights, distances, speed.
        home: latitude and longitude.
        home_is_given: whether the user gave it.
        return_height_m: above home, over all ground around.
        slope_deg: slope that 95 % of the ground stays below.
        autopilot: whose conventions mission files follow.
        mount: "stabilised" or "fixed".
        no_fly: files of no-fly zones.
        flight_window_utc: when it is flown; none: at any time.
        view: what this flight of a pattern looks at.
        surface_files: a surface model: files, folders or patterns.
        surface: what was seen of it; none without one.
        trust_heights: whether the user confirmed heights that do not look like ground.
        keeps_overlap: share of the ground on which plain lines keep the overlap asked for, which is then required; none where
            they do not.
    """

    name: str
    query: AreaQuery
    area: FoundArea
    terrain_files: tuple[str, ...]
    terrain: TerrainSource
    vertical_datum: str
    datum_is_stated: bool
    design: SurveyDesign
    home: tuple[float, float]
    home_is_given: bool
    return_height_m: float
    slope_deg: float
    autopilot: str
    mount: str
    no_fly: tuple[str, ...] = ()
    flight_window_utc: tuple[str, str] | None = None
    view: View = SINGLE
    surface_files: tuple[str, ...] = ()
    surface: SurfaceLook | None = None
    trust_heights: bool = False
    keeps_overlap: float | None = None


def return_height_m(highest_amsl_m: float, home_amsl_m: float) -> float:
    """Height above home from which a straight way home clears all ground around, in steps of 5 m."""
    return TEXT.step_m * math.ceil(
        max(highest_amsl_m - home_amsl_m + TEXT.transit_clearance_m + 10.0, 60.0) / TEXT.step_m
    )


def scenario_text(scenario: SurveyScenario, *, folder: Path) -> str:
    """The TOML of a survey; files are named relative to the folder that it will be in."""
    sections = (
        _head(scenario),
        _area(scenario, folder),
        _terrain(scenario, folder),
        _home(scenario),
        _sensor(scenario),
    )
    zones = [_zone_file(name, folder) for name in scenario.no_fly]
    return "\n".join(
        "\n".join(lines) + "\n"
        for lines in (*sections, _limits(scenario), _vehicle(scenario), *_lines(scenario), _goal(scenario), *zones)
    )


def name_of(text: str) -> str:
    """A short name for files and reports."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", text).strip("-.")[:40] or "survey"


def _line(key: str, value: object, reason: str) -> str:
    return f"{f'{key} = {_toml(value)}':{_COMMENT_AT}} # {reason}"


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(round(value, 6))
    return json.dumps(value, ensure_ascii=False)


def _head(scenario: SurveyScenario) -> list[str]:
    design = scenario.design
    wish = design.wish
    asked = (
        f"{100.0 * wish.gsd_m:g} cm, {100.0 * wish.forward_overlap:g} % forward and "
        f"{100.0 * wish.side_overlap:g} % side overlap, {wish.camera.title}"
    )
    window = scenario.flight_window_utc
    reason = "first take-off, last landing: no-fly zones that are not in force then do not count"
    return [
        f"# A survey, written by `uavcover new`: {asked}.",
        "# Change what you like; `uavcover plan` with this file plans it. Every key: docs/reference/scenario.md.",
        _line("name", scenario.name, "in files and reports"),
        _line("select", f"coverage>={TEXT.coverage}", "the quickest mission with this coverage of the visible ground"),
        *([] if window is None else [_line("flight_window_utc", list(window), reason)]),
    ]


def _area(scenario: SurveyScenario, folder: Path) -> list[str]:
    query, design = scenario.query, scenario.design
    lines = ["[area]"]
    if scenario.area.is_file:
        lines.append(_line("file", _relative(Path(query.source), folder), "the area; relative to this file"))
        chosen = (("layer", query.layer), ("feature", query.feature), ("crs", query.crs))
        lines += [_line(key, value, "as given on the command line") for key, value in chosen if value is not None]
        flags = (("make_valid", query.make_valid), ("swap_axes", query.swap_axes))
        lines += [_line(key, True, "as given on the command line") for key, value in flags if value]
    else:
        lines.append(f"# {' '.join(query.source.split())}")
        lines.append(_rings("polygons_lon_lat_deg", scenario.area.parts))
    side = "overlap holds up to its edge" if design.margin_m > 0.0 else "photos at the edge overlap less"
    lines.append(_line("margin_m", float(design.margin_m), f"the area is grown by this, so that {side}"))
    lines.append(_line("cell_size_m", float(design.cell_size_m), "coverage is judged on cells of this size"))
    return lines


def _rings(key: str, parts: tuple[Rings, ...]) -> str:
    polygons = ",\n".join(
        "  [" + ", ".join("[" + ", ".join(f"[{lon!r}, {lat!r}]" for lon, lat in ring) + "]" for ring in rings) + "]"
        for rings in parts
    )
    return f"{key} = [\n{polygons},\n]"


def _relative(path: Path, folder: Path) -> str:
    """A path as the scenario names it: relative where that stays short, so that the folder can be moved."""
    try:
        relative = os.path.relpath(path.resolve(), folder.resolve())
    except ValueError:  # another drive
        return path.resolve().as_posix()
    return Path(relative).as_posix() if relative.count("..") <= 3 else path.resolve().as_posix()


def _terrain(scenario: SurveyScenario, folder: Path) -> list[str]:
    names = _files(scenario.terrain_files, folder)
    stated = "as the file says" if scenario.datum_is_stated else "above sea level; the file does not say more: check it"
    source = scenario.terrain
    lines = [
        "[terrain]",
        _line("kind", "raster", "an elevation model"),
        _line("file", names, "relative to this file"),
        _line("vertical_datum", scenario.vertical_datum, stated),
    ]
    if source.crs is not None:
        lines.append(_line("crs", source.crs, "as given on the command line"))
    if source.band is not None:
        lines.append(_line("band", source.band, "as given on the command line"))
    if source.height_unit is not None:
        lines.append(_line("height_unit", source.height_unit, "as given on the command line"))
    if source.fill_no_data_m > 0.0:
        lines.append(
            _line("fill_no_data_m", source.fill_no_data_m, "gaps up to this long are interpolated from their rim")
        )
    if source.water_height_m is not None:
        lines.append(_line("water_height_m", source.water_height_m, "open water wherever the files have no height"))
    if scenario.trust_heights:
        lines.append(_line("trust_heights", True, "heights that do not look like ground were confirmed"))
    if scenario.surface is not None:
        lines += _surface(scenario.surface, _files(scenario.surface_files, folder))
    return lines


def _files(names: tuple[str, ...], folder: Path) -> str | list[str]:
    relative = [_relative(Path(name), folder) for name in names]
    return relative[0] if len(relative) == 1 else relative


def _surface(surface: SurfaceLook, names: str | list[str]) -> list[str]:
    lines = [_line("surface_file", names, "trees and roofs: heights are kept above them, and they hide the ground")]
    given = (
        ("surface_vertical_datum", surface.vertical_datum, "as the file says"),
        ("surface_crs", surface.source.crs, "as given on the command line"),
        ("surface_height_unit", surface.source.height_unit, "as given on the command line"),
    )
    lines += [_line(key, value, reason) for key, value, reason in given if value is not None]
    lines.append(_line("surface_hides_m", TERRAIN.hides_m, "ground farther than this under them cannot be observed"))
    return lines


def _home(scenario: SurveyScenario) -> list[str]:
    why = (
        "as given"
        if scenario.home_is_given
        else "the lowest level ground at the edge of the area: check that you can stand there"
    )
    lat, lon = scenario.home
    return [
        "[home]",
        _line("lat_deg", lat, f"take-off and landing, {why}"),
        _line("lon_deg", lon, "longitude of the same position"),
    ]


def _sensor(scenario: SurveyScenario) -> list[str]:
    design = scenario.design
    wish = design.wish
    camera = wish.camera
    interval = (
        f"at least {camera.min_interval_s:g} s apart" if camera.min_interval_s else "its shortest interval is not known"
    )
    every_s = design.picture_distance_m / design.speed_m_s
    view = scenario.view
    if view.is_tilted:
        sample = _line(
            "max_ground_sample_m", round(SURVEY.oblique_sample * wish.gsd_m, 6),
            f"{SURVEY.oblique_sample:g} times the required one straight below: the middle of a tilted photo is farther away",
        )  # fmt: skip
        overlap = "of the tilted photo, from the lower end of the band"
        tilt = [_line("pitch_deg", view.pitch_deg, "tilted, for walls")]
    else:
        sample = _line("max_ground_sample_m", wish.gsd_m, "a cell counts only where a pixel covers at most this")
        overlap = f"a photo every {design.picture_distance_m:.1f} m, {every_s:.1f} s; {interval}"
        tilt = []
    if view.heading_deg is not None:
        tilt.append(_line("heading_deg", view.heading_deg, "the camera keeps it on every swath, in both directions"))
    return [
        f"[sensor] # {camera.title}, {camera.focal_length_mm:g} mm; source: {camera.source or 'not stated'}",
        _line("kind", "frame-camera", "photos with straight sides, taken by distance"),
        _line("fov_across_deg", camera.fov_across_deg, f"sensor {camera.sensor_across_mm:g} mm wide, landscape"),
        _line("fov_along_deg", camera.fov_along_deg, f"sensor {camera.sensor_along_mm:g} mm high"),
        _line("pixels_across", camera.pixels_across, "for the ground sample distance"),
        sample,
        *tilt,
        _line("forward_overlap", wish.forward_overlap, overlap),
        _line("side_overlap", wish.side_overlap, f"lines about {design.line_distance_m:.0f} m apart"),
        _line("range_m", _range_m(scenario), "beyond the corners of a photo on slopes; the sample distance limits it"),
        _line(
            "mount",
            scenario.mount,
            "a gimbal keeps it level" if scenario.mount == "stabilised" else "it tilts with the vehicle",
        ),
    ]


def _range_m(scenario: SurveyScenario) -> float:
    """The design's, stretched where the camera looks ahead."""
    return float(math.ceil(scenario.design.range_m / math.sin(math.radians(-scenario.view.pitch_deg))))


def _lines(scenario: SurveyScenario) -> list[list[str]]:
    heading_deg = scenario.view.line_heading_deg
    if heading_deg is None:
        return []
    return [
        [
            "[planner]",
            _line("algorithm", "lines", "parallel lines, as this flight is one of several over the area"),
            _line("line_heading_deg", heading_deg, "clockwise from north"),
        ]
    ]


def _limits(scenario: SurveyScenario) -> list[str]:
    design = scenario.design
    ceiling = design.wish.ceiling_agl_m
    top = f"{100.0 * design.gsd_at_m(design.max_height_agl_m):.2g} cm a pixel straight below"
    if design.is_capped:
        limit = "--max-height" if ceiling is not None else f"the usual legal limit of {SURVEY.usual_ceiling_m:g} m"
        top += f"; {limit}, where {design.gsd_height_m:.0f} m would do"
    return [
        "[limits]",
        _line("max_height_agl_m", float(design.max_height_agl_m), top),
        _line(
            "min_height_agl_m", float(design.min_height_agl_m),
            f"room for straight legs over ground of up to {scenario.slope_deg:.0f} degrees; sets the photo distance",
        ),
        _line("height_margin_m", design.height_margin_m, "the planner stays this far inside the band: no vehicle flies exactly"),
        _line("max_climb_angle_deg", design.max_climb_angle_deg, "steepest leg; steeper than the ground, which lines follow"),
        _line("transit_clearance_m", TEXT.transit_clearance_m, "above ground on outbound and return transit"),
    ]  # fmt: skip


def _vehicle(scenario: SurveyScenario) -> list[str]:
    design = scenario.design
    vehicle = design.wish.vehicle
    whose = vehicle.title if vehicle is not None else "no --vehicle was given"
    lines = [f"[vehicle] # {whose}{f'; source: {vehicle.source}' if vehicle is not None and vehicle.source else ''}"]
    lines.append(_line("cruise_speed_m_s", design.speed_m_s, design.speed_reason or "over ground along the lines"))
    if vehicle is not None:
        known = (
            ("max_climb_m_s", vehicle.max_climb_m_s, "largest upward speed"),
            ("max_descent_m_s", vehicle.max_descent_m_s, "largest downward speed"),
            ("acceleration_m_s2", vehicle.acceleration_m_s2, "over ground"),
        )
        lines += [_line(key, value, reason) for key, value, reason in known if value is not None]
    if design.endurance_s is not None:
        lines.append(_line("endurance_s", design.endurance_s, "a full battery; longer missions become several flights"))
        lines.append(_line("reserve_fraction", 0.2, "of it, left by every flight"))
    else:
        lines.append(
            "# endurance_s = 1500.0                      # a full battery; without it everything is one flight"
        )
    lines.append(
        _line("return_height_m", scenario.return_height_m, "above home: clears all ground around on a straight return")
    )
    lines.append(_line("autopilot", scenario.autopilot, "whose conventions the mission files follow"))
    return lines


def _zone_file(name: str, folder: Path) -> list[str]:
    return [
        "[[no_fly]]",
        _line("file", _relative(Path(name), folder), "zones that no leg enters; relative to this file"),
        _line("margin_m", TEXT.no_fly_margin_m, "planned legs stay this far outside of them"),
    ]


def _goal(scenario: SurveyScenario) -> list[str]:
    lines = [
        "[requirements]",
        _line("min_coverage_of_coverable", TEXT.coverage, "verify requires of the flight what the plan promises"),
    ]
    if scenario.keeps_overlap is not None:
        reason = "of the ground is in as many photos as the overlap requires; verify requires it of the flight"
        lines.append(_line("min_overlap_fraction", scenario.keeps_overlap, reason))
    return lines
