"""From an area, elevation data and a camera to a scenario that can be planned, as ``new`` and ``plan`` do it."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from mission_io.model.plain_text import counted
from uavcover.errors import InfeasibleError, InputError
from uavcover.missions.flights import compile_sorties
from uavcover.missions.objectives import mission_cost
from uavcover.model.limits import NoFly, window_of
from uavcover.model.route import Route
from uavcover.model.vehicle import autopilot_name
from uavcover.new import quantities
from uavcover.new.catalog import CAMERAS, VEHICLES, CameraBody
from uavcover.new.elevation_questions import (
    NewRequest,
    ask_about_heights,
    ask_about_surface,
    inside_data,
    over_lakes,
    requested_ground,
    requested_surface,
)
from uavcover.new.quantities import TERRAIN
from uavcover.new.survey import (
    SurveyDesign,
    SurveyScenario,
    SurveyWish,
    View,
    design_survey,
    name_of,
    return_height_m,
    scenario_text,
    views_of,
)
from uavcover.new.terrain_look import SurfaceLook, TerrainLook, look_at_terrain, position_for_home
from uavcover.planner.baselines.boustrophedon import (
    angle_of_heading_rad,
    fly_layout,
    heading_of_angle_deg,
    long_side_angle_rad,
    plain_boustrophedon,
)
from uavcover.run.user import User
from uavcover.scenario.airspace.zone_file import read_zones
from uavcover.scenario.airspace.zones import local_zones
from uavcover.scenario.areas.area_file import read_area
from uavcover.scenario.scenario_file import parse_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import path_lengths_m
from uavcover.sensing.photos import FLOWN_OVERLAP_FRACTION, photos_required, planned_photos
from uavcover.sensing.sensors import trigger_distance_m
from uavcover.sensing.site_maps import judging_map
from uavcover.terrain.elevation_file import read_height_amsl_m
from uavcover.terrain.frames import datum_named
from uavcover.terrain.suspect_heights import confirmed_trust

_MOUNTS = {"stabilised": "stabilised", "gimbal": "stabilised", "fixed": "fixed"}


@dataclass(frozen=True, slots=True, eq=False)
class NewScenario:
    """Result of ``new``."""

    text: str  # the TOML
    site: Site  # the scenario on its ground
    design: SurveyDesign  # heights, distances, speed
    look: TerrainLook  # at the terrain
    view: View  # which flight of a pattern it is
    surface: SurfaceLook | None  # at the surface model; None without one


def new_scenario(request: NewRequest, user: User, *, folder: Path) -> NewScenario:
    """As :func:`new_scenarios`, for a survey of one flight. Raises InputError: also for a pattern of several."""
    scenarios = new_scenarios(request, user, folder=folder)
    if len(scenarios) > 1:
        raise InputError(
            f"--pattern: {request.pattern} consists of {len(scenarios)} missions; create their scenarios with "
            "uavcover new, and plan each one"
        )
    return scenarios[0]


def new_scenarios(request: NewRequest, user: User, *, folder: Path) -> tuple[NewScenario, ...]:
    """Design a survey and write its scenarios, one for each flight of its pattern.

    Raises:
        InputError: something is missing, or cannot be used; says which option and what to do.
    """
    area = read_area(request.area)
    for note in area.notes:
        user.warn(f"{request.area.source}: {note}")
    wish = _wish(request)
    dem = requested_ground(request, area)
    wanted = None if request.vertical_datum is None else datum_named(request.vertical_datum)
    look = look_at_terrain(dem, area.parts, where=request.area.source, around_m=TERRAIN.around_m, datum=wanted)
    if dem.water_height_m is not None:
        user.warn(
            f"--water-height: missing elevation data in and around {dem.name} is treated as open water at "
            f"{dem.water_height_m:g} m above sea level, even if it is land"
        )
    closed = _closed_to_home(request, look, user)
    dem = over_lakes(dem, look, user)
    datum, stated = _datum(look, user)
    around = look.area.convex_hull.buffer(TERRAIN.around_m)
    trust = confirmed_trust(dem, datum, around, look.frame, user, trusted=request.trust_dem)
    surface = requested_surface(request, area, dem, look, datum)
    ask_about_surface(dem, user, beside_surface=surface is not None)
    ask_about_heights(dem, user, option="--dem")
    step_m = 0.0 if surface is None else surface.tallest_m
    design = design_survey(wish, slope_deg=look.slope_deg, area_m2=look.area_m2, step_m=step_m)
    design = inside_data(design, dem, look, user)
    is_open = None if surface is None else surface.is_open
    given = request.home
    home = position_for_home(dem, look, avoid=closed, is_open=is_open) if given is None else _near(given, look)
    home_m = read_height_amsl_m(dem, datum, lat_deg=home[0], lon_deg=home[1])
    highest_m = look.highest_amsl_m if surface is None else max(look.highest_amsl_m, surface.highest_amsl_m)
    vehicle = wish.vehicle
    mount = _mount(request.mount)
    along_deg = heading_of_angle_deg(long_side_angle_rad(look.area))
    views = views_of(request.pattern, along_deg=along_deg)
    if mount == "fixed" and any(view.is_tilted for view in views):
        raise InputError("--mount: a fixed camera cannot be tilted in flight; use stabilised, or another --pattern")
    scenario = SurveyScenario(
        name=name_of(area.name), query=request.area, area=area, terrain_files=request.dem, terrain=dem,
        vertical_datum=datum, datum_is_stated=stated,
        design=design, home=home, home_is_given=request.home is not None,
        return_height_m=return_height_m(highest_m, home_m), slope_deg=look.slope_deg,
        autopilot=autopilot_name(request.autopilot, (vehicle.autopilot if vehicle is not None else None) or "ardupilot"),
        mount=mount, no_fly=request.no_fly, flight_window_utc=_requested_window(request),
        surface_files=request.dsm, surface=surface, trust_heights=trust, fence=request.fence, rally=request.rally,
        max_alt_amsl_m=_length(request.max_alt, "--max-alt", "900m"),
    )  # fmt: skip
    if design.speed_reason:
        user.warn(f"speed {design.speed_m_s:g} m/s: {design.speed_reason}")
    if wish.camera.min_interval_s is None:
        user.warn(
            f"the minimum photo interval of {wish.camera.name} is unknown; check that the camera can take a photo "
            f"every {design.photo_distance_m / design.speed_m_s:.1f} s"
        )
    return tuple(_in_full(scenario, view, look, request, folder=folder) for view in views)


def _in_full(
    scenario: SurveyScenario, view: View, look: TerrainLook, request: NewRequest, *, folder: Path
) -> NewScenario:
    """One flight of the pattern."""
    named = replace(scenario, view=view, name="-".join(part for part in (scenario.name, view.name) if part))
    text = scenario_text(named, folder=folder)
    site = load_site(parse_scenario(text, source=request.area.source, folder=folder))
    if _keeps_overlap(site, view):
        text = scenario_text(replace(named, keeps_overlap=FLOWN_OVERLAP_FRACTION), folder=folder)
        site = replace(site, scenario=parse_scenario(text, source=request.area.source, folder=folder))
    return NewScenario(text, site, scenario.design, look, view, scenario.surface)


def _plain_route(site: Site, view: View) -> tuple[Route, int]:
    """Plain parallel lines over the area, and how many they are."""
    heading_deg = view.line_heading_deg
    layout = plain_boustrophedon(site, angle_rad=None if heading_deg is None else angle_of_heading_rad(heading_deg))
    return fly_layout(site, layout), len(layout.heights_agl_m)


def _keeps_overlap(site: Site, view: View) -> bool:
    """Whether an overlap is required and plain swaths keep it: then a flight can be required to."""
    if photos_required(site.scenario.sensor) is None or view.is_tilted:
        return False
    try:
        route, _ = _plain_route(site, view)
    except InfeasibleError:
        return False
    photos = planned_photos(judging_map(site), [route.waypoints_m])
    return photos is not None and bool(photos.overlap_holds)


def print_design(scenario: NewScenario, user: User) -> dict[str, object]:
    """Print the derived survey; return it as a document."""
    design, site = scenario.design, scenario.site
    drawn_ha = scenario.look.area_m2 / 1e4
    user.say(
        f"{'area':18}{drawn_ha:.4g} ha, covered with a margin of {design.margin_m:g} m: {site.area.area / 1e4:.4g} ha"
    )
    ground = f"{scenario.look.lowest_amsl_m:.0f} to {scenario.look.highest_amsl_m:.0f} m above sea level"
    user.say(f"{'ground':18}{ground}, 95 % of it below {scenario.look.slope_deg:.0f} degrees")
    if (surface := scenario.surface) is not None:
        hidden = f"hide {100.0 * surface.hidden_fraction:.0f} % of the ground, which no flight can observe"
        user.say(f"{'trees and roofs':18}up to {surface.tallest_m:.0f} m above the ground; they {hidden}")
    low, high = design.min_height_agl_m, design.max_height_agl_m
    gsd = f"{100.0 * design.gsd_at_m(low):.2f} to {100.0 * design.gsd_at_m(high):.2f} cm per pixel"
    above = "ground" if scenario.surface is None else "ground, trees and roofs"
    user.say(f"{'height band':18}{low:g} to {high:g} m above {above}, {gsd}")
    if design.is_capped:
        user.say(f"{'':18}{100.0 * design.wish.gsd_m:g} cm would allow {design.gsd_height_m:.0f} m; raise --max-height")
    every_s = design.photo_distance_m / design.speed_m_s
    user.say(f"{'photo distance':18}{design.photo_distance_m:.1f} m, every {every_s:.1f} s at {design.speed_m_s:g} m/s")
    user.say(f"{'line distance':18}{design.line_distance_m:.0f} m on level ground")
    home = site.scenario.home
    if home is not None and home.lat_deg is not None and home.lon_deg is not None:
        user.say(f"{'home':18}{home.lat_deg:.6f}, {home.lon_deg:.6f}, {site.alt_amsl_offset_m:.0f} m above sea level")
    return {
        "area_m2": scenario.look.area_m2, "seen_area_m2": float(site.area.area), "margin_m": design.margin_m,
        "min_height_agl_m": low, "max_height_agl_m": high, "picture_distance_m": design.photo_distance_m,
        "line_distance_m": design.line_distance_m, "speed_m_s": design.speed_m_s,
        **({} if surface is None else {"tallest_m": surface.tallest_m, "hidden_share": surface.hidden_fraction}),
    }  # fmt: skip


def print_estimate(scenario: NewScenario, user: User) -> dict[str, object]:
    """Print photos, time and batteries of plain parallel lines, which the search improves; return them as a document."""
    site, vehicle = scenario.site, scenario.site.scenario.vehicle
    route, lines = _plain_route(site, scenario.view)
    length_m = float(path_lengths_m(route.waypoints_m)[-1])
    photos = math.floor(length_m / (trigger_distance_m(site.scenario) or length_m)) + 1
    time_s = mission_cost(site, route).time_s
    words = f"about {counted(photos, 'photo')}, {counted(lines, 'line')}, {length_m / 1000.0:.1f} km, {time_s / 60.0:.0f} min"
    batteries, rest = None, " (simple parallel lines; for the number of batteries, add --battery)"
    if vehicle.longest_flight_s is not None:
        try:
            batteries = len(compile_sorties(site, route, autopilot=vehicle.autopilot))
        except InfeasibleError:
            batteries = math.ceil(time_s / vehicle.longest_flight_s)
        rest = f", {batteries} batter{'y' if batteries == 1 else 'ies'} (simple parallel lines)"
    user.say(f"{f'estimate {scenario.view.name}'.strip():18}{words}{rest}")
    return {"pictures": photos, "flight_time_s": time_s, "batteries": batteries}


def _requested_window(request: NewRequest) -> tuple[str, str] | None:
    return None if request.at is None else quantities.flight_window(request.at, option="--at")


def _closed_to_home(request: NewRequest, look: TerrainLook, user: User) -> shapely.Geometry:
    """Ground without take-off: the no-fly zones that begin at the ground, with margins. Reports how many zones count."""
    west, south, east, north = look.area.bounds
    lats, lons, _ = look.frame.geodetic_from_enu(np.array([[west, south, 0.0], [east, north, 0.0]]))
    lons[1] += 360.0 if lons[1] < lons[0] else 0.0
    requested = _requested_window(request)
    window = None if requested is None else window_of(*requested, "--at")
    shapes: list[shapely.Geometry] = []
    for file in request.no_fly:
        try:
            near, _ = read_zones(NoFly(file=file), near=(lons[0], lats[0], lons[1], lats[1]))
        except InputError as error:
            raise InputError(f"--no-fly: {error}") from error
        zones = [zone for zone in near if zone.in_force(window)]
        idle = (
            f"; ignored {len(near) - len(zones)}, which are inactive during the flight"
            if len(zones) < len(near)
            else ""
        )
        user.say(f"--no-fly: included {counted(len(zones), 'zone')} from {file}{idle}")
        around = look.area.buffer(TERRAIN.farthest_home_m)
        for zone in local_zones(zones, look.frame, around):
            if zone.entry.floor_agl_m is None and zone.entry.floor_amsl_m is None:
                shapes.append(zone.grown(zone.entry.margin_m + TERRAIN.beside_zones_m))
    if request.fence is not None:
        fence = shapely.Polygon(look.frame.en_from_lon_lat(request.fence))
        shapes.append(look.area.buffer(2.0 * TERRAIN.farthest_home_m).difference(fence.buffer(-TERRAIN.beside_zones_m)))
    return shapely.union_all(shapes)


def _wish(request: NewRequest) -> SurveyWish:
    missing = [
        f"{option} {example}"
        for option, value, example in (
            ("--dem", request.dem or None, "dem.tif"), ("--camera", request.camera, "NAME"), ("--gsd", request.gsd, "2.5cm"),
        )
        if value is None
    ]  # fmt: skip
    if missing:
        raise InputError(
            f"{request.area.source}: an area also requires {', '.join(missing)} (to show the cameras, use uavcover "
            "new --camera list; the default --overlap is 75/70)"
        )
    camera: CameraBody = CAMERAS.named(str(request.camera))
    forward, side = quantities.overlaps(request.overlap if request.overlap is not None else "75/70")

    no_margin = request.margin is not None and request.margin.strip().rstrip("m") in {"0", "0.0"}
    return SurveyWish(
        camera=camera, gsd_m=quantities.length_m(str(request.gsd), option="--gsd", example="2.5cm"), forward_overlap=forward,
        side_overlap=side, vehicle=None if request.vehicle is None else VEHICLES.named(request.vehicle),
        ceiling_agl_m=_length(request.max_height, "--max-height", "120m"),
        speed_m_s=None if request.speed is None else quantities.speed_m_s(request.speed, option="--speed", example="8m/s"),
        endurance_s=None if request.battery is None else quantities.time_s(request.battery, option="--battery", example="25min"),
        margin_m=0.0 if no_margin else _length(request.margin, "--margin", "40m"),
    )  # fmt: skip


def _length(text: str | None, option: str, example: str) -> float | None:
    return None if text is None else quantities.length_m(text, option=option, example=example)


def _datum(look: TerrainLook, user: User) -> tuple[str, bool]:
    if len(look.datums) > 1:
        user.warn(
            "the elevation data does not state its vertical datum, so its heights are interpreted as above sea level "
            "(EGM96); if they are above the ellipsoid, all heights are wrong by up to 100 m; specify "
            "--vertical-datum EGM96, EGM2008 or ellipsoid"
        )
    return look.datums[0], len(look.datums) == 1


def _near(text: str, look: TerrainLook) -> tuple[float, float]:
    lat, lon = quantities.lat_lon(text, option="--home")
    position = shapely.Point(look.frame.enu_from_geodetic(lat, lon, 0.0)[0, :2])
    away_m = float(look.area.distance(position))
    if not away_m <= TERRAIN.farthest_home_m:
        raise InputError(
            f"--home: {text} is {away_m / 1000.0:.0f} km from the area; the limit is "
            f"{TERRAIN.farthest_home_m / 1000.0:g} km; specify a closer position, with latitude first"
        )
    return lat, lon


def _mount(text: str | None) -> str:
    if text is None:
        return "stabilised"
    if text.casefold() not in _MOUNTS:
        raise InputError(f"--mount: must be stabilised (a gimbal) or fixed, not {text!r}")
    return _MOUNTS[text.casefold()]
