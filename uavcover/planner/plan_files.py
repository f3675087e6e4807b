"""The files of a plan in a run folder, written together."""

import dataclasses
import platform
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import Any

from uavcover.missions.mission_compiler import CompiledMission
from uavcover.missions.mission_files import mission_texts
from uavcover.missions.objectives import judge_member
from uavcover.missions.sorties import Sortie
from uavcover.model.route import Plan, Route
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.pareto_file import pareto_csv, pareto_routes_csv
from uavcover.planner.plan_bounds import bounds
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
from uavcover.scenario.scenario_file import dump_scenario
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import vehicle_sites
from uavcover.sensing.block_map import look_at_all, one_after_the_other
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.site_maps import judging_map, map_for

_LOOKED_AT_TOGETHER = 8
"""This number of sorties over a large area is evaluated while a block of its cells is in memory."""


def save_plan(
    run: RunFolder,  # the folder
    site: Site,  # the scenario on its ground
    result: Plan,  # the plan
    *,
    compiled: CompiledMission | None,  # its mission, none when there is none or several
    autopilot: AutopilotName,  # for whom the mission files are
    seed: int,  # of every random number
    command: Sequence[str],  # the command line, for ``run.json``
    # its flights when there are several; each gets a run folder of its own inside this one
    sorties: Sequence[Sortie] = (),
    fleet: dict[str, Any] | None = None,  # what ``plan.json`` says of several vehicles
    proved: dict[str, Any] | None = None,  # its :func:`bounds`; default: what there is of them without a plan
    # as ``plan.json`` of the same Pareto set has them already; default: the plan's
    baselines: Sequence[dict[str, Any]] | None = None,
    # of the scenario of a whole fleet, for the plan of one of its vehicles; default: the site's
    scenario_sha256: str | None = None,
) -> RunFolder | None:
    """Write the scenario, the Pareto set, the chosen route and its mission files, all or none.

    Files of an older plan in the same folder are removed too: its mission, upload, sorties and gap mission; a
    plan that was flown is moved, whole, into a folder ``older-N``.

    Returns:
        where the older plan and its flight are now; none when there was no flight.
    """
    scenario = dump_scenario(site.scenario)
    limits = bounds(site) if proved is None else proved
    texts = {"scenario.toml": scenario, **_set_texts(result)}
    if compiled is not None:
        texts |= mission_texts(compiled, autopilot=autopilot, name=site.scenario.name)
    rows = [_sortie_row(number, sortie) for number, sortie in enumerate(sorties, start=1)]
    document = plan_document(site, result, seed=seed, bounds=limits, sorties=rows, fleet=fleet, baselines=baselines)
    texts["plan.json"] = json_text(document)
    asked_sha256 = scenario_sha256 or sha256_of_content(scenario)
    about = _run_document(site, asked_sha256, seed=seed, command=command, plan_wall_s=result.wall_s)
    own_sites = vehicle_sites(site) if sorties else ()
    of_any_plan = {name: limit for name, limit in limits.items() if not isinstance(limit, dict)}
    for number, (row, sortie) in enumerate(zip(rows, sorties, strict=True)):
        own_site = own_sites[sortie.vehicle - 1] if own_sites else site
        judged = map_for(site, own_site) if own_sites else judging_map(site)
        if number % _LOOKED_AT_TOGETHER == 0:
            some = sorties[number : number + _LOOKED_AT_TOGETHER]
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
    """``run.json`` of a new plan: what it read, wrote and moved comes after what is recorded of older ones."""
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
    """A plan with a sortie's part of the chosen route, judged by itself, from the home of its vehicle."""
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
    """The surface model, where there is one."""
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
