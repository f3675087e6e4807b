"""Text output of ``plan`` and ``select``: a plan's figures, its missions, and warnings."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from mission_io.model.plain_text import counted
from uavcover.missions.fleet_schedule import makespan_s
from uavcover.missions.mission_compiler import CompiledMission, Sortie
from uavcover.model.limits import FlightLimits, window_text
from uavcover.model.route import Plan, RouteMember, RouteMetrics
from uavcover.model.scenario import Objective
from uavcover.planner.planner import SearchProgress
from uavcover.planner.selection_rule import missing_index, parse_rule, select
from uavcover.run.folder import RunFolder
from uavcover.run.user import User, percent, to_paste
from uavcover.scenario.airspace.flyable import flyable_area, wide_enough_m
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import own_sensors
from uavcover.sensing.photos import planned_poses, takes_photos
from uavcover.sensing.site_maps import judging_map

_TELLING_GAP = 0.3
"""A larger gap shows that the bound is weak, not that the route is bad."""
_MOST_FRACTIONS = 6
_MOST_RETURNS = 6
"""Intervals of unsafe returns that are printed."""
_SHOWN_ZONES = 6
_NEARLY_ALL = 0.999
_FLOWN_EXACTLY_M = 3.0
"""Accuracy of a flown route at best. In still air the mock vehicle was off by 2.9 m on ridge-obstacles, 6.3 m on ridge-25km2."""


def progress_text(progress: SearchProgress, unit: str, least: float | None) -> str:
    """Coverage, the shortest route with the required coverage, and its gap to the lower bound, if known.

    Args:
        progress: of the search.
        unit: of the minimised length, time or energy.
        least: lower bound in that unit.
    """
    words = f"{100.0 * progress.best_coverage:.1f} %"
    if progress.least_cost is not None:
        words += f", {progress.least_cost:.0f} {unit}"
        if least and progress.least_cost <= (1.0 + _TELLING_GAP) * least:
            words += f", gap {100.0 * (progress.least_cost / least - 1.0):.1f} %"
    return words


def print_summary(user: User, site: Site, result: Plan, flights: Sequence[Sortie]) -> None:
    """Print the planned flight, its requirements, and the origin of the route."""
    if flights:
        flown_s = [flight.compiled.flight_time_s for flight in flights]
        words = f"{counted(len(flights), 'flight')}, {math.fsum(flown_s) / 60.0:.1f} min in the air"
        if len(flights) > 1:
            words += f", completed after {makespan_s(site, flights) / 60.0:.1f} min including battery changes"
        used = [flight.compiled.battery_used for flight in flights]
        fractions = [f"{fraction:.0%}" for fraction in used if fraction is not None]
        user.say(f"{'mission':22}{words}" + (f", {_listed(fractions)} of a battery" if fractions else ""))
    if takes_photos(site.scenario) and not own_sensors(site.scenario):
        routes = [flight.route.waypoints_m for flight in flights] or [result.chosen.route.waypoints_m]
        words = f"{len(planned_poses(judging_map(site), routes).eyes)}"
        focal = site.scenario.sensor.focal_px
        if math.isfinite(focal):
            ends = [
                100.0 * m / focal
                for m in (result.chosen.metrics.min_height_agl_m, result.chosen.metrics.max_height_agl_m)
            ]
            words += f", {ends[0]:.2f} to {ends[1]:.2f} cm per pixel at nadir"
        user.say(f"{'photos':22}{words}")
    maker = result.chosen.origin
    beaten = any(member.origin == maker for member in result.baselines)
    user.say(f"{'route made by':22}{maker}; {search_text(result.evaluations, result.algorithm, beaten=beaten)}")


def search_text(evaluations: int, algorithm: str, *, beaten: bool) -> str:
    """Work of a search and whether it found the route; ``beaten`` if the selected route is a baseline."""
    if evaluations == 0 and beaten:
        return f"{algorithm} had no time to search; increase --budget"
    return f"{counted(evaluations, 'evaluation')} of {algorithm}" + (" found no better route" if beaten else "")


def _listed(fractions: Sequence[str]) -> str:
    if len(fractions) > _MOST_FRACTIONS:
        return f"{', '.join(fractions[:_MOST_FRACTIONS])} and so on"
    return " and ".join(filter(None, (", ".join(fractions[:-1]), fractions[-1])))


def print_plan(
    user: User, run: RunFolder, site: Site, result: Plan, bounds: Sequence[str], wall_s: float, *, requirement: str
) -> None:
    """Print the selected route with the baselines, the proved bounds, and missed requirements.

    Args:
        user: receives the output.
        run: folder of the plan.
        site: the scenario on its ground.
        result: the plan.
        bounds: proved bounds, one per line.
        wall_s: duration.
        requirement: requirement on the selected route.
    """
    objective = site.scenario.objective
    user.say(figures_header(objective))
    shown = [("chosen route", result.chosen)]
    plain = [member for member in result.baselines if member.origin == "boustrophedon"][:1]
    tuned = [member for member in result.baselines if member.origin != "boustrophedon"]
    rule = parse_rule(result.rule)
    if tuned and rule.kind != "index":
        # The baseline that the rule would select, for comparison.
        tuned = [tuned[select(tuned, rule).index]]
    for label, member in shown + [(m.origin, m) for m in plain + tuned[:1]]:
        user.say(figures_text(label, member, objective))
    user.say(f"{counted(len(result.members), 'route')} in the Pareto set, {wall_s:.1f} s")
    for line in bounds:
        user.say(line)
    if not result.rule_met:
        if missing := missing_index(parse_rule(result.rule), len(result.members)):
            user.warn(f"{missing}; wrote the route with the most coverage. To choose another, use: uavcover select")
        else:
            user.warn(
                f"no route meets {requirement}; wrote the best one. Lower the requirement, or use a larger --budget"
            )
    if result.interrupted:
        user.warn(f"interrupted; the best route so far was written to {run}")


def telling_bounds(site: Site, bounds: dict[str, Any]) -> dict[str, Any]:
    """The informative bounds: close to the result, and on the planner's objective."""
    length = site.scenario.objective == "length"
    return {
        name: entry
        for name, entry in bounds.items()
        if not isinstance(entry, dict)
        or ((length or name != "shortest_path_m") and entry["gap"] is not None and entry["gap"] <= _TELLING_GAP)
    }


def print_older(user: User, older: RunFolder | None) -> None:
    """Print the folder of a flown plan that another one has replaced."""
    if older is not None:
        user.warn(f"moved the previous plan, which was flown, to {older}, with its flight and verdict")


def print_missions(user: User, run: RunFolder, compiled: CompiledMission | None, sorties: Sequence[Sortie]) -> None:
    """Print the mission files, and the parts from which the autopilot's own return is not safe."""
    if compiled is not None:
        _print_return(user, compiled, "")
        user.say(f"wrote {run.file('mission.waypoints')}, with mission.plan, fence, rally and kml in the same folder")
    elif not sorties:
        user.say("wrote no mission files, because the scenario is not on Earth; add an [origin] and a [home]")
        return
    for number, sortie in enumerate(sorties, start=1):
        used = sortie.compiled.battery_used
        battery = "" if used is None else f"{used:.0%} of a battery, "
        user.say(
            f"sortie {number:<2}  waypoints {sortie.first} to {sortie.last}, {sortie.compiled.flight_time_s:.0f} s, {battery}"
            f"{len(sortie.compiled.mission.items)} items"
        )
        _print_return(user, sortie.compiled, f"sortie {number}: ")
    if sorties:
        user.say(f"wrote {run.file('sortie-1')} and the folders of the other sorties; fly each with --sortie N")


def upload_text(run: RunFolder, fleet: dict[str, Any] | None, sorties: int) -> str:
    """The command that uploads a plan: to all vehicles of a simultaneous flight, or its first flight.

    Args:
        run: its folder.
        fleet: of ``plan.json``.
        sorties: number of flights; 0 or 1: a single flight.
    """
    count = 1
    if fleet is not None and not fleet.get("one_at_a_time", False):
        rows = len(fleet.get("by_vehicle", []))
        count = rows if fleet.get("alike", True) else int(fleet["vehicles"])
    if count > 1:
        return to_paste("plan-upload", run, *(word for k in range(count) for word in ("--to", f"URL{k + 1}")))
    return to_paste("plan-upload", run, "--to", "URL", *(("--sortie", 1) if sorties > 1 else ()))


def print_size(user: User, plan: Plan) -> None:
    """Print the finish for other numbers of vehicles."""
    if line := sizes_by_vehicles_text([dataclasses.asdict(each) for each in plan.by_vehicles]):
        user.say(line)


def sizes_by_vehicles_text(sizes: Sequence[dict[str, Any]]) -> str:
    """The finish with fewer vehicles and with all (``mission.by_vehicles``); empty for one number."""
    each = [f"{size['vehicles']} in {size['makespan_s']:.0f} s (sorties: {size['sorties']})" for size in sizes]
    return f"mission time of this route by number of vehicles: {', '.join(each)}" if len(each) > 1 else ""


def print_zones(user: User, site: Site, metrics: RouteMetrics) -> None:
    """Print how no-fly zones affect the route."""
    scenario, area = site.scenario, flyable_area(site)
    window, timed = scenario.flight_window, sum(zone.entry.has_times for zone in site.zones)
    if window is not None and site.other_zones:
        names = ", ".join(repr(zone.name) for zone in site.other_zones[:_SHOWN_ZONES])
        more = f" and {len(site.other_zones) - _SHOWN_ZONES} more" if len(site.other_zones) > _SHOWN_ZONES else ""
        user.say(
            f"no-fly zones that are inactive from {window_text(window)} and were ignored: {names}{more}; fly "
            "only during this time"
        )
    if timed and window is None:
        user.say(f"{timed} nearby no-fly zones have schedules, but are treated as always active; set --at")
    for zone in area.closed[:_SHOWN_ZONES]:
        partly = "; to fly there, use a height band below its floor or above its ceiling" if zone in area.partly else ""
        user.say(
            f"no-fly zone {zone.name!r}, {zone.heights_text()}: the route keeps a distance of "
            f"{zone.entry.margin_m:g} m{partly}"
        )
    if len(area.closed) > _SHOWN_ZONES:
        user.say(f"and {len(area.closed) - _SHOWN_ZONES} more no-fly zones that the route avoids")
    if area.cut_off:
        user.warn("no-fly zones separate parts of the fence from home; the route does not enter these parts")
    if area.closed and metrics.coverage_of_coverable > 0.0:
        observed = metrics.coverage_fraction / metrics.coverage_of_coverable
        if observed < _NEARLY_ALL:
            user.warn(f"with the no-fly zones, {percent(observed)} of the area is visible ground")


_LEAST_BEYOND = 5e-5
"""Fraction of the area below which steps do not matter; it would be printed as 0.00 %."""


def print_steps(user: User, site: Site) -> None:
    """Warn of ground behind steps that are higher than the height band."""
    limits, area = site.scenario.limits, flyable_area(site)
    if area.undivided is None:
        return
    beyond = 1.0 - area.polygon.intersection(site.area).area / site.area.area
    if beyond < _LEAST_BEYOND:
        return
    enough_m = math.ceil(limits.min_height_agl_m + wide_enough_m(site) + 2.0 * limits.height_margin_m)
    user.warn(
        f"no leg can cross the terrain's cliffs within the height band, and {percent(beyond)} of the area is next to "
        "or behind them; the route stays on one side. To cross the cliffs, set limits.max_height_agl_m to at least "
        f"{enough_m}, or plan each side with its own [home]"
    )


def print_window(user: User, site: Site, flights: Sequence[Sortie]) -> None:
    """Warn of flights outside the time for which the no-fly zones were checked."""
    window = site.scenario.flight_window
    if window is None or not flights or not (site.zones or site.other_zones):
        return
    lasts_s = makespan_s(site, flights)
    has_s = (window[1] - window[0]).total_seconds()
    if lasts_s > has_s:
        user.warn(
            f"the mission takes {lasts_s / 60.0:.0f} min from the first take-off to the last landing, but the no-fly "
            f"zones were evaluated for {has_s / 60.0:.0f} min, {window_text(window)}: plan again with --at "
            "START/END"
        )


def print_hidden(user: User, site: Site) -> None:
    """Print the ground that the surface model hides."""
    fraction = judging_map(site).grid.hidden_fraction
    if fraction > 0.0:
        user.say(
            f"trees and roofs of the surface model hide {percent(fraction)} of the ground, so no route can cover it"
        )


def room_text(limits: FlightLimits, metrics: RouteMetrics) -> str | None:
    """Warning when a route is planned too close to the ends of the height band; None otherwise."""
    room_m = min(limits.max_height_agl_m - metrics.max_height_agl_m, metrics.min_height_agl_m - limits.min_height_agl_m)
    if room_m >= _FLOWN_EXACTLY_M:
        return None
    return (
        f"the route comes within {max(0.0, room_m):.1f} m of the limits of its height above ground "
        f"({limits.min_height_agl_m:g} to {limits.max_height_agl_m:g} m); no vehicle flies this accurately, so "
        "verify may fail the flight; increase limits.height_margin_m (the demo uses 8 m)"
    )


def _print_return(user: User, compiled: CompiledMission, which: str) -> None:
    advice = compiled.return_advice
    for zone in compiled.zones_left_out:
        user.warn(
            f"{which}no-fly zone {zone.name!r} ({zone.heights_text()}) is not in the uploaded fence, because the "
            "mission passes over or under it, and a fence has no floor or ceiling"
        )
    for line in advice.sentences[:_MOST_RETURNS]:
        user.warn(f"{which}the autopilot's own return is not safe {line}")
    if len(advice.sentences) > _MOST_RETURNS:
        user.warn(f"{which}{len(advice.sentences) - _MOST_RETURNS} more unsafe returns are listed in the report")
    if advice.sentences:
        user.warn(f"{which}{advice.remedy}")


def figures_header(objective: Objective) -> str:
    """The first line of a table of :func:`figures_text`."""
    energy = f"{'energy':>9} (seconds of hovering)" if objective == "energy" else ""
    return f"{'':22}{'coverage':>10}{'waypoints':>11}{'length':>12}{'time':>9}{energy}"


def figures_text(label: str, member: RouteMember, objective: Objective) -> str:
    """A route in one line of a table: coverage, waypoints, length, and the time of mission or route.

    Where energy is minimised, that of the mission comes last.
    """
    m = member.metrics
    counts = f"{percent(m.coverage_of_coverable):>10}{m.waypoint_count:>11}"
    energy = f"{m.mission_energy_hover_s:>7.0f} s" if objective == "energy" else ""
    return f"{label:22}{counts}{m.path_length_m:>10.0f} m{m.time_s:>7.0f} s{energy}"
