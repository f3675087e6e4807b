"""Files of a plan in its run folder, with bounds and the flights of its fleet."""

import dataclasses
import math
import platform
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import Any

from uavcover.missions.fleet_cuts import allocate
from uavcover.missions.fleet_schedule import makespan_s
from uavcover.missions.flights import mission_texts
from uavcover.missions.mission_compiler import CompiledMission, Sortie
from uavcover.missions.objectives import judge_member
from uavcover.model.route import Plan, Route
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.planner.pareto_file import pareto_csv, pareto_routes_csv
from uavcover.plugins import loaded
from uavcover.run.documents import plan_document
from uavcover.run.folder import (
    SCHEMA_VERSION,
    RunFolder,
    json_text,
    moves_of_an_older_plan,
    remove_empty_folders,
    stale_files,
)
from uavcover.run.provenance import obstacles_sha256, run_document, sha256_of_content, version, with_entry
from uavcover.run.user import User
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import groups_of, vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import fleet_map, judging_map, look_at_all, map_for, one_after_the_other

_EVALUATED_TOGETHER = 8
"""This number of sorties over a large area is evaluated while a block of its cells is in memory."""


def save_plan(
    run: RunFolder,  # the folder
    site: Site,  # the scenario on its ground
    result: Plan,  # the plan
    *,
    compiled: CompiledMission | None,  # its mission; None without one, or if there are several
    autopilot: AutopilotName,  # for whom the mission files are
    seed: int,  # of every random number
    command: Sequence[str],  # the command line, for ``run.json``
    # its flights if there are several; each gets a run folder inside this one
    sorties: Sequence[Sortie] = (),
    fleet: dict[str, Any] | None = None,  # what ``plan.json`` says of several vehicles
    proved: dict[str, Any] | None = None,  # its :func:`bounds`; default: the bounds that need no plan
    # as ``plan.json`` of the same Pareto set has them already; default: the plan's
    baselines: Sequence[dict[str, Any]] | None = None,
    # of the scenario of a whole fleet, for the plan of one of its vehicles; default: the site's
    scenario_sha256: str | None = None,
) -> RunFolder | None:
    """Write the scenario, the Pareto set, the selected route and its mission files, all or none.

    Remove the files of an older plan in the folder: mission, upload, sorties and gap mission. Move a plan that was flown to a
    folder ``older-N``.

    Returns:
        The new folder of the older plan and its flight; None without a flight.
    """
    scenario = dump_scenario(site.scenario)
    limits = bounds(site) if proved is None else proved
    texts = {"scenario.toml": scenario, **_set_texts(result)}
    if compiled is not None:
        texts |= mission_texts(compiled, autopilot=autopilot, name=site.scenario.name)
    rows = [_sortie_row(number, sortie) for number, sortie in enumerate(sorties, start=1)]
    document = plan_document(site, result, seed=seed, bounds=limits, sorties=rows, fleet=fleet, baselines=baselines)
    texts["plan.json"] = json_text(document)
    requested_sha256 = scenario_sha256 or sha256_of_content(scenario)
    about = _run_document(site, requested_sha256, seed=seed, command=command, plan_wall_s=result.wall_s)
    own_sites = vehicle_sites(site) if sorties else ()
    of_any_plan = {name: limit for name, limit in limits.items() if not isinstance(limit, dict)}
    for number, (row, sortie) in enumerate(zip(rows, sorties, strict=True)):
        own_site = own_sites[sortie.vehicle - 1] if own_sites else site
        judged = map_for(site, own_site) if own_sites else judging_map(site)
        if number % _EVALUATED_TOGETHER == 0:
            some = sorties[number : number + _EVALUATED_TOGETHER]
            look_at_all(judged, [each.route.waypoints_m for each in some], one_after_the_other)
        plan = _plan_of_sortie(judged, result, sortie)
        own_name = own_site.scenario.vehicle.autopilot if own_sites else autopilot
        own = {"scenario.toml": dump_scenario(own_site.scenario) if own_sites else scenario, **_set_texts(plan)}
        title = f"{site.scenario.name}, sortie {row['number']}"
        if fleet is not None:
            title = f"{site.scenario.name}, vehicle {sortie.vehicle}, sortie {row['number']}"
        own |= mission_texts(sortie.compiled, autopilot=own_name, name=title)
        own["plan.json"] = json_text(plan_document(site, plan, seed=seed, bounds=of_any_plan))
        own["run.json"] = _recorded(RunFolder(run.file(row["folder"])), about, own)
        texts |= {f"{row['folder']}/{name}": text for name, text in own.items()}
    moved = moves_of_an_older_plan(run)
    texts["run.json"] = _recorded(run, about, texts, moved=moved)
    run.write_together(texts, stale=() if moved else stale_files(run, texts), moved=moved)
    remove_empty_folders(run)
    return RunFolder(run.file(next(iter(moved.values()))).parent) if moved else None


def _recorded(
    run: RunFolder, about: dict[str, Any], texts: Mapping[str, str], *, moved: Mapping[str, str] | None = None
) -> str:
    """``run.json`` of a new plan, appended to the record of older ones."""
    older = run_document(run).get("provenance", [])
    wrote = {name: sha256_of_content(text) for name, text in texts.items()}
    document = with_entry(
        {**about, "provenance": older}, "plan",
        command=about["command"], inputs=about["inputs"], wrote=wrote, moved=dict(moved or {}),
    )  # fmt: skip
    return json_text(document)


def _set_texts(result: Plan) -> dict[str, str]:
    return {"pareto.csv": pareto_csv(result), "pareto_routes.csv": pareto_routes_csv(result)}


def _sortie_row(number: int, sortie: Sortie) -> dict[str, Any]:
    return {
        "number": number,
        "folder": f"sortie-{number}",
        "first_waypoint": sortie.first,
        "last_waypoint": sortie.last,
        "flight_time_s": sortie.compiled.flight_time_s,
        "battery_used": sortie.compiled.battery_used,
        "route_length_m": sortie.route.length_m,
        "path_length_m": Route(sortie.compiled.path_m).length_m,
        "mission_items": len(sortie.compiled.mission.items),
        "vehicle": sortie.vehicle,
        "takeoff_s": sortie.start_s,
    }


def _plan_of_sortie(judged: CoverageMap, whole: Plan, sortie: Sortie) -> Plan:
    """A plan with one sortie of the selected route, evaluated separately, from the home of its vehicle."""
    member = judge_member(judged, sortie.route, whole.chosen.origin, margin_m=0.0)
    return dataclasses.replace(whole, chosen=member, members=(member,), baselines=(), by_vehicles=())


def _run_document(
    site: Site, scenario_sha256: str, *, seed: int, command: Sequence[str], plan_wall_s: float
) -> dict[str, Any]:
    packages = ("numpy", "scipy", "numba", "pyproj", "rasterio", "shapely", "pymavlink", "rerun-sdk")
    return {
        "schema_version": SCHEMA_VERSION,
        "command": list(command),
        "seed": seed,
        "python": platform.python_version(),
        "platform": sys.platform,
        "packages": {"uavcover": version(), **{name: _version(name) for name in packages}},
        "inputs": {
            "scenario": {"sha256": scenario_sha256},
            "terrain": {
                "source": site.bare_ground.source,
                "sha256": site.bare_ground.sha256 or None,
                "largest_error_m": site.bare_ground.error_m,
            },
            **_surface_document(site),
            "obstacles": {"sha256": obstacles_sha256(site.scenario.obstacles)},
        },
        "stages": {"plan": {"wall_s": plan_wall_s}},
    }


def _surface_document(site: Site) -> dict[str, Any]:
    """The surface model, if any."""
    if not site.ground.surface_sha256:
        return {}
    return {
        "surface": {
            "source": site.ground.source, "sha256": site.ground.surface_sha256, "largest_error_m": site.ground.error_m,
        }
    }  # fmt: skip


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # run from a source folder that is not installed
        return None


def least_length_m(site: Site, rule: str) -> float | None:
    """The largest lower bound on path length for the coverage of a selection rule; None without one.

    Raises:
        InputError: the rule is invalid.
    """
    proved = [prover.least_length_m(site, rule) for prover in loaded("uavcover.bounds").values()]
    return max((length_m for length_m in proved if length_m is not None), default=None)


def bounds(site: Site, result: Plan | None = None, *, time_s: float | None = None) -> dict[str, Any]:
    """Known bounds on any plan, and reference values: ``bounds`` of ``plan.json``.

    - ``coverable_fraction``: fraction of the area that permitted positions observe; a lower limit if only some were tried.
    - ``length_reference_m``: map area divided by the swath width on flat ground. It is not a bound, because slopes widen the
      swath. Only for sensors that observe along the path.
    - ``shortest_path_m``, ``fewest_waypoints``, ``most_coverage``: results of the installed provers.

    Args:
        site: the scenario on its ground.
        result: a plan; without one nothing is proved.
        time_s: for the proofs; 0: only those without a solver; None: the quick ones.
    """
    coverage = fleet_map(site)
    found: dict[str, Any] = {"coverable_fraction": coverage.fraction(coverage.coverable)}
    if site.scenario.sensor.looks_along_path:
        width = 2.0 * site.scenario.sensor.half_width_m(best_height_agl_m(site))
        found["length_reference_m"] = float(site.area.area) / width
    if result is not None:
        for prover in loaded("uavcover.bounds").values():
            found |= prover.proved(site, result, time_s=time_s)
    return found


def fleet_document(site: Site, flights: Sequence[Sortie]) -> dict[str, Any] | None:
    """``fleet`` of ``plan.json``; None for one vehicle.

    Args:
        site: the scenario on its ground.
        flights: as :func:`uavcover.missions.flights.compile_flights`; empty without a mission.
    """
    fleet = site.scenario.fleet
    if fleet.vehicles == 1:
        return None
    alike = not site.scenario.vehicles
    document: dict[str, Any] = {"vehicles": fleet.vehicles, "alike": alike, "separation_m": fleet.separation_m}
    document |= {"one_at_a_time": fleet.one_at_a_time, "launch_points": site.scenario.has_launch_points}
    if not flights:
        return document
    times_s = [flight.compiled.flight_time_s for flight in flights]
    done_s = makespan_s(site, flights)
    one_s = math.fsum(times_s) + fleet.turnaround_s * _landings_of_one(site, flights)
    if fleet.one_at_a_time:
        together_s = done_s
    elif alike:
        together_s = allocate(times_s, fleet.vehicles, fleet.turnaround_s).makespan_s
    else:
        together_s = _at_once_s(site, flights)
    return document | {
        "makespan_s": done_s,
        "one_vehicle_s": one_s,
        "of_one_vehicle": done_s / one_s,
        "kept_apart_s": max(0.0, done_s - together_s),
        "by_vehicle": [_row(number, flights) for number in sorted({flight.vehicle for flight in flights})],
        "homes": _homes(site),
        **_parts(site, flights),
    }


def _landings_of_one(site: Site, flights: Sequence[Sortie]) -> int:
    """Number of landings of one vehicle between these sorties.

    It lands after each; between parts of the area it lands only for a new battery.
    """
    longest_s = site.scenario.vehicle.longest_flight_s
    if not groups_of(site.scenario):
        return len(flights) - 1
    if longest_s is None:
        return 0
    return math.ceil(math.fsum(flight.compiled.flight_time_s for flight in flights) / longest_s) - 1


def _parts(site: Site, flights: Sequence[Sortie]) -> dict[str, Any]:
    """Waypoints of each part of the area, and its vehicles; empty if all vehicles cover the whole area together."""
    rows = []
    for group in groups_of(site.scenario):
        own = [flight for flight in flights if flight.vehicle in group]
        first, last = min(flight.first for flight in own), max(flight.last for flight in own)
        rows.append({"vehicles": list(group), "first_waypoint": first, "last_waypoint": last})
    return {"parts": rows} if rows else {}


def _at_once_s(site: Site, flights: Sequence[Sortie]) -> float:
    """Finish of different vehicles without separation from each other."""
    each_s = {
        number: [f.compiled.flight_time_s for f in flights if f.vehicle == number]
        for number in {flight.vehicle for flight in flights}
    }
    pause_s = site.scenario.fleet.turnaround_s
    return max(math.fsum(times_s) + pause_s * (len(times_s) - 1) for times_s in each_s.values())


def _homes(site: Site) -> list[dict[str, float]] | None:
    """Home of each vehicle, vehicle 1 first; None if all start at [home]."""
    homes = []
    for own in vehicle_sites(site):
        if own.frame is not None and own.home_m is not None:
            lat, lon, alt = own.frame.geodetic_from_enu(own.home_m)
            homes.append({"lat_deg": float(lat[0]), "lon_deg": float(lon[0]), "alt_amsl_m": float(alt[0])})
    return homes or None


def _row(vehicle: int, flights: Sequence[Sortie]) -> dict[str, Any]:
    own = sorted((k for k, f in enumerate(flights) if f.vehicle == vehicle), key=lambda k: _start_s(flights[k]))
    times_s = [flights[k].compiled.flight_time_s for k in own]
    used = [fraction for k in own if (fraction := flights[k].compiled.battery_used) is not None]
    return {
        "vehicle": vehicle,
        "sorties": [k + 1 for k in own],
        "takeoffs_s": [_start_s(flights[k]) for k in own],
        "landed_s": max(_start_s(flights[k]) + time_s for k, time_s in zip(own, times_s, strict=True)),
        "flight_time_s": math.fsum(times_s),
        "least_battery_left": 1.0 - max(used) if used else None,
    }


def _start_s(flight: Sortie) -> float:
    return 0.0 if flight.start_s is None else flight.start_s


def print_fleet(user: User, document: dict[str, Any] | None) -> None:
    """Print the table of the vehicles and the time that they save."""
    if document is None or "by_vehicle" not in document:
        return
    for number, pad in enumerate([] if document["launch_points"] else document["homes"] or [], start=1):
        user.say(
            f"vehicle {number:<2} take-off and landing at latitude {pad['lat_deg']:.7f}, longitude {pad['lon_deg']:.7f}"
        )
    for row in document["by_vehicle"]:
        each = ", ".join(
            f"{number} at {start_s:.0f} s" for number, start_s in zip(row["sorties"], row["takeoffs_s"], strict=True)
        )
        left = row["least_battery_left"]
        battery = "" if left is None else f", battery left at least {100.0 * left:.0f} %"
        user.say(
            f"{_whose(document, row['vehicle'])} sorties {each}; flight time {row['flight_time_s']:.0f} s, last "
            f"landing at {row['landed_s']:.0f} s{battery}"
        )
    flying = {row["vehicle"] for row in document["by_vehicle"]}
    idle = [] if document["alike"] else [k for k in range(1, document["vehicles"] + 1) if k not in flying]
    for number in idle:
        if document["launch_points"]:
            user.say(f"{_whose(document, number)} no sorties, because no flight from there is possible or shorter")
            continue
        user.say(f"vehicle {number:<2} stays on the ground, because it would not shorten the mission")
    if document["one_at_a_time"]:
        user.say(f"one sortie at a time: mission completed after {document['makespan_s']:.0f} s")
        return
    waits = document["kept_apart_s"]
    apart = (
        f" (including {waits:.0f} s of waiting to keep {document['separation_m']:g} m of separation)"
        if waits >= 1.0
        else ""
    )
    used = len(document["by_vehicle"])
    what = f"{used} vehicles" if used == document["vehicles"] else f"{used} of {document['vehicles']} vehicles"
    user.say(
        f"{what}: mission completed after {document['makespan_s']:.0f} s{apart}; with one vehicle and the same "
        f"sorties: {document['one_vehicle_s']:.0f} s (x {document['of_one_vehicle']:.2f})"
    )
    if used < document["vehicles"] and document["alike"]:
        user.warn("more vehicles would not shorten the mission, because transits and separation take too long")


def _whose(document: dict[str, Any], vehicle: int) -> str:
    """Vehicle or home of a document's entry."""
    if not document["launch_points"]:
        return f"vehicle {vehicle:<2}"
    return "from home          " if vehicle == 1 else f"from launch point {vehicle - 1:<2}"
