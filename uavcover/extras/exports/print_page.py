"""A plan on paper: one HTML page that prints on A4, opens without a network and runs no script."""

import base64
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from mission_io.model.plain_text import plain_lines
from uavcover.extras.exports.export import ExportRequest, flights_for, refuse_unlike, time_with_stops_s, write_exported
from uavcover.extras.exports.print_drawings import map_svg, place_text, profile_svg, style_of
from uavcover.missions.sorties import Sortie
from uavcover.model.vehicle import AutopilotName
from uavcover.run.folder import RunFolder
from uavcover.run.planned import read_planned
from uavcover.run.provenance import sha256_of_content
from uavcover.scenario.site import Site
from uavcover.sensing.sensors import trigger_distance_m

_PAGE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class PrintNotes:
    """Entries that only the pilot knows.

    An empty one becomes a line to fill in by hand.

    Attributes:
        pilot: who flies.
        contact: whom to call in an emergency.
        weather: the weather window, such as "07:00 to 10:00, wind below 6 m/s".
    """

    pilot: str = ""
    contact: str = ""
    weather: str = ""


def print_plan(run: RunFolder, request: ExportRequest, notes: PrintNotes) -> int:
    """Write the print-out of a run, of all flights or of one sortie, split as the files that are flown.

    With an aircraft in the request these are the flights of its ``wpml`` files, with stops.

    Returns:
        How many flights are on it.

    Raises:
        InputError: the run cannot be read, or has no place or home.
        InfeasibleError: a leg breaks a limit.
        OutputError: the page is there already, or cannot be written.
    """
    folder = run if request.sortie is None else run.flight(request.sortie)
    site, planned = read_planned(folder)
    refuse_unlike(site, run, request.sortie)
    name = request.autopilot or site.scenario.vehicle.autopilot
    flights = flights_for(site, planned.route, request, vehicles=planned.vehicles)
    plan_sha256 = sha256_of_content(folder.file("plan.json").read_text(encoding="utf-8"))
    page = render_print(
        site, flights, notes=notes, autopilot=name, coverage=planned.coverage_of_coverable, plan_sha256=plan_sha256,
        aircraft=None if request.aircraft is None else request.aircraft.title,
    )  # fmt: skip
    write_exported(request.out, {request.out.name: page.encode()}, force=request.force)
    return len(flights)


def render_print(
    site: Site, flights: Sequence[Sortie], *, notes: PrintNotes, autopilot: AutopilotName, coverage: float,
    plan_sha256: str, aircraft: str | None = None,
) -> str:  # fmt: skip
    """The page; every text from files and options is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_PAGE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    drawing, interval_m = map_svg(site, flights)
    style = (_PAGE / "print.css").read_text(encoding="utf-8")
    return plain_lines(
        environment.get_template("print.html").render(
            scenario=site.scenario,
            site=site,
            home=_home(site),
            map=drawing,
            interval_m=interval_m,
            flights=[
                _flight_row(site, number, sortie, autopilot, stops=aircraft is not None)
                for number, sortie in enumerate(flights)
            ],
            aircraft=aircraft,
            limits=_limits(site, flights),
            camera=_camera(site),
            notes={field.name: getattr(notes, field.name) for field in fields(notes)},
            return_height_m=_return_height_m(flights),
            zones_on_return=sorted({name for sortie in flights for name in sortie.compiled.return_advice.no_fly}),
            coverage=coverage,
            plan=plan_sha256[:12],
            version=metadata.version("uavcover"),
            style=Markup(style),
            policy=f"default-src 'none'; style-src 'sha256-{_hash(style)}'",
        )
    )


def _hash(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _home(site: Site) -> dict[str, str]:
    if site.frame is None or site.home_m is None:
        return {"place": "", "alt": ""}
    lat, lon, alt = site.frame.geodetic_from_enu(site.home_m)
    return {"place": place_text(float(lat[0]), float(lon[0])), "alt": f"{float(alt[0]):.0f} m"}


def _flight_row(site: Site, number: int, sortie: Sortie, autopilot: AutopilotName, *, stops: bool) -> dict[str, Any]:
    compiled, longest_s = sortie.compiled, site.scenario.vehicle.longest_flight_s
    home_alt_m = 0.0 if site.home_m is None else float(site.alts_amsl_m(site.home_m)[0])
    return {
        "number": number + 1,
        "style": style_of(number),
        "waypoints": f"{sortie.first} to {sortie.last}",
        "points": len(compiled.path_m),
        "length_m": float(sum(math.dist(a, b) for a, b in zip(compiled.path_m[:-1], compiled.path_m[1:], strict=True))),
        "time": clock(time_with_stops_s(site, compiled, autopilot) if stops else compiled.flight_time_s),
        "battery": "" if stops or compiled.battery_used is None else f"{compiled.battery_used:.0%}",
        "latest": "" if longest_s is None else clock(longest_s),
        "highest_m": compiled.max_height_above_home_m,
        "highest_amsl_m": compiled.max_height_above_home_m + home_alt_m,
        "unsafe_return": len(compiled.return_advice.unsafe_waypoints),
        "profile": profile_svg(site, sortie, number),
    }


def clock(seconds: float) -> str:
    """Minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def _return_height_m(flights: Sequence[Sortie]) -> float | None:
    """Height above home from which the straight way home is clear from everywhere; none where ground is unknown."""
    safe_m = [sortie.compiled.return_advice.safe_return_height_m for sortie in flights]
    return math.ceil(max(safe_m)) if all(map(math.isfinite, safe_m)) else None


def _limits(site: Site, flights: Sequence[Sortie]) -> list[tuple[str, str]]:
    limits, vehicle, wind = site.scenario.limits, site.scenario.vehicle, site.scenario.wind
    home = site.home_m
    reach_m = 0.0
    if home is not None:
        reach_m = max(math.dist(place[:2], home[:2]) for sortie in flights for place in sortie.compiled.path_m)
    sea = [
        (word, alt_m)
        for word, alt_m in (("from", limits.min_alt_amsl_m), ("to", limits.max_alt_amsl_m))
        if alt_m is not None
    ]
    rows = [
        ("Height above ground", f"{limits.min_height_agl_m:g} to {limits.max_height_agl_m:g} m, on the route"),
        ("Clearance on outbound and return transit", f"{limits.transit_clearance_m:g} m"),
        ("Height above sea level", " ".join(f"{word} {alt_m:g} m" for word, alt_m in sea)),
        ("Greatest distance from home", f"{reach_m:.0f} m"),
        ("Ground speed", f"{vehicle.cruise_speed_m_s:g} m/s"),
        ("Climb, descent", f"{vehicle.max_climb_m_s:g} m/s, {vehicle.max_descent_m_s:g} m/s"),
        ("Planned wind", f"{wind.speed_m_s:g} m/s from {wind.from_deg:g}°" if wind.speed_m_s else "none"),
        ("Batteries last in wind of up to", f"{wind.most_m_s:g} m/s from any side" if wind.most_m_s else ""),
        ("Largest airspeed", "" if vehicle.max_airspeed_m_s is None else f"{vehicle.max_airspeed_m_s:g} m/s"),
        ("Battery", "" if vehicle.endurance_s is None else (
            f"{clock(vehicle.endurance_s)} min of hovering when full, {vehicle.reserve_fraction:.0%} in reserve"
        )),
        ("Active no-fly zones", ", ".join(f"{zone.name} ({zone.heights_in_words()})" for zone in site.zones)),
    ]  # fmt: skip
    return [(name, text) for name, text in rows if text]


def _camera(site: Site) -> str:
    """The camera in one line; empty for other sensors."""
    sensor = site.scenario.sensor
    if not sensor.is_camera:
        return ""
    distance_m = trigger_distance_m(site.scenario)
    pictures = "photos are not triggered by the mission" if distance_m is None else f"a photo every {distance_m:.1f} m"
    if not sensor.looks_along_path:
        pictures = "a photo at each waypoint"
    return f"{sensor.mount}, {sensor.pitch_deg:g}° (-90° is straight down), {pictures}"
