"""The stages in their order, as functions: what the commands call, and what a script can call.

``load_site`` -> ``plan`` -> ``compile_plan`` -> ``upload`` -> ``fly`` -> ``verify``; each takes what the one before gave.
``save_*`` and ``read_*`` put the same into a run folder and take it out again.
"""

import dataclasses
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, get_args

from mission_io.client.client import Client
from mission_io.client.read_back import Verification
from mission_io.formats import csv as csv_format
from mission_io.formats import geojson, kml, wpl
from mission_io.formats import plan as plan_format
from uavcover.errors import InputError
from uavcover.judging.phases import PlannedRoute
from uavcover.judging.verify import verify_track
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.scenario import PlannerAlgorithm, PlannerSettings, RasterTerrain, Scenario
from uavcover.model.track import Track
from uavcover.model.vehicle import AutopilotName
from uavcover.model.verdict import VerificationReport
from uavcover.planning.baselines.boustrophedon import best_height_agl_m
from uavcover.planning.bounds import are_quick, least_path_length_m, path_bounds, waypoint_bounds
from uavcover.planning.planner import Effort, Progress, plan_routes
from uavcover.planning.selection import parse_rule
from uavcover.planning.set_cover.solvers import SolverEffort
from uavcover.routes.leg_checks import measure_violations
from uavcover.routes.mission_compiler import AUTOPILOTS, CompiledMission, compile_mission
from uavcover.routes.objectives import judge
from uavcover.routes.sorties import Sortie, compile_sorties
from uavcover.run.documents import (
    PlannedDocument,
    bound_document,
    pareto_csv,
    pareto_routes_csv,
    plan_document,
    read_plan_document,
)
from uavcover.run.files import FLIGHT_FILES, moves_of_an_older_plan, remove_empty_folders, stale_files
from uavcover.run.folder import SCHEMA_VERSION, RunFolder, json_text
from uavcover.run.provenance import note_files, obstacles_sha256, run_document, sha256_of_content, version, with_entry
from uavcover.scenario.scenario_file import dump_scenario, load_scenario, terrain_path
from uavcover.scenario.site import Site, build_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.sensors import reach_at_height_m
from uavcover.vehicle.modes import require_multirotor

EXPORT_FORMATS = ("waypoints", "plan", "kml", "geojson", "csv")


def load_site(scenario: str | Path | Scenario) -> Site:
    """A scenario (a file, the name of a bundled one, or loaded already) on its ground.

    Raises:
        ScenarioError, TerrainError: it cannot be understood, or its elevation data cannot be used.
    """
    loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    terrain = loaded.terrain
    return build_site(loaded, terrain_file=terrain_path(terrain) if isinstance(terrain, RasterTerrain) else None)


def plan(
    site: Site,
    *,
    seed: int | None = None,
    evaluations: int | None = None,
    budget_s: float | None = None,
    algorithm: str | None = None,
    max_waypoints: int | None = None,
    select: str | None = None,
    workers: int | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Plan:
    """Plan the sensing route. What is not given is taken from the scenario.

    Args:
        site: the scenario on its ground.
        seed: of every random number.
        evaluations: full route evaluations, 50 proposals of the local search counted as one; equal seed and evaluations
            give an equal plan.
        budget_s: search this long instead.
        algorithm: "memetic", "local-search", "imodbo", "modbo", "nsga2" or "moead".
        max_waypoints: capacity of the "waypoints" encoding.
        select: the rule by which one route is chosen.
        workers: threads; the result does not depend on it. Default: one a core.
        should_stop: asked after every round of the search; the best so far is returned.
        on_progress: told after every round.

    Raises:
        InfeasibleError: no route keeps the limits.
        InputError: an argument is out of range.
    """
    settings = _settings(site.scenario.planner, seed, evaluations, algorithm, max_waypoints)
    if budget_s is not None and not budget_s > 0.0:
        raise InputError(f"budget: {budget_s} s must be above 0")
    if workers is not None and workers < 1:
        raise InputError(f"workers: {workers} must be at least 1")
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as executor:
        return plan_routes(
            site,
            settings=settings,
            select_rule=select if select is not None else site.scenario.select,
            effort=Effort(settings.evaluations, budget_s, time.monotonic),
            executor=executor,
            should_stop=should_stop,
            on_progress=on_progress,
        )


def _settings(
    base: PlannerSettings, seed: int | None, evaluations: int | None, algorithm: str | None, max_waypoints: int | None
) -> PlannerSettings:
    if algorithm is not None and algorithm not in get_args(PlannerAlgorithm):
        raise InputError(f"algorithm: {algorithm!r} is not one of {', '.join(get_args(PlannerAlgorithm))}")
    changes: dict[str, Any] = {
        "seed": seed,
        "evaluations": evaluations,
        "algorithm": algorithm,
        "max_waypoints": max_waypoints,
    }
    try:
        return dataclasses.replace(base, **{key: value for key, value in changes.items() if value is not None})
    except ValueError as error:
        raise InputError(str(error)) from error


def compile_plan(site: Site, route: Route, *, autopilot: AutopilotName | None = None) -> CompiledMission:
    """The mission of a planned route, every leg checked; see :func:`uavcover.routes.mission_compiler.compile_mission`."""
    return compile_mission(site, route, autopilot=autopilot or site.scenario.vehicle.autopilot)


def compile_flights(site: Site, route: Route, *, autopilot: AutopilotName | None = None) -> tuple[Sortie, ...]:
    """The missions of a planned route: one, or several where endurance or items ask for it (`uavcover.routes.sorties`)."""
    return compile_sorties(site, route, autopilot=autopilot or site.scenario.vehicle.autopilot)


def upload(
    client: Client,
    compiled: CompiledMission,
    *,
    progress: Callable[[str, int, int], None] | None = None,
    in_flight: bool = False,
) -> list[Verification]:
    """Upload mission, fence and rally points, read each back and compare.

    Args:
        client: connected, with a vehicle found.
        compiled: what to send.
        progress: told the list's name, items across and items in all.
        in_flight: whether an armed vehicle is meant.

    Raises:
        VehicleError: the vehicle is no multirotor; nothing was sent.
        MissionIoError: the vehicle refused, or fell silent; says what it holds now.
    """
    require_multirotor(client)
    results = []
    for name, content in (("mission", compiled.mission), ("fence", compiled.fence), ("rally", compiled.rally)):
        results.append(client.upload_and_verify(content, progress=_named(progress, name), in_flight=in_flight))
    return results


def _named(progress: Callable[[str, int, int], None] | None, name: str) -> Callable[[int, int], None] | None:
    return None if progress is None else partial(progress, name)


def verify(site: Site, track: Track, planned: PlannedRoute | None = None) -> VerificationReport:
    """Coverage and safety of what was flown, on the cells of the area; see :mod:`uavcover.judging`."""
    return verify_track(site, judging_map(site), track, planned)


def judging_map(site: Site) -> CoverageMap:
    """The cells that results are judged on."""
    return CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)


def least_length_m(site: Site, rule: str) -> float | None:
    """A length that no path which sees what a rule asks for is shorter than; none where there is nothing to compare with it.

    Args:
        site: the scenario on its ground.
        rule: see :mod:`uavcover.planning.selection`; there is a limit when it names a coverage, for a sensor that looks
            along the path and an objective that is a length.

    Raises:
        InputError: the rule cannot be understood.
    """
    share = parse_rule(rule).required_coverage
    in_metres = site.scenario.planner.objective == "length" and site.scenario.sensor.sensing == "along-path"
    return least_path_length_m(judging_map(site), share) if in_metres and share is not None else None


def bounds(site: Site, result: Plan | None = None, *, time_s: float | None = None) -> dict[str, Any]:
    """What no plan can beat, as far as it is known, and what it can be measured by: ``bounds`` of ``plan.json``.

    ``coverable_fraction``: share of the area that some allowed place sees (tried places: at least this much).
    ``length_reference_m``: area of the map over the width of flat ground that the sensor sweeps; a reference, no bound,
    because slopes widen the swath. Only for sensors that look along the path.
    ``shortest_path_m``, ``fewest_waypoints``, ``most_coverage``: proved limits beside what was found (docs/planning.md).

    Args:
        site: the scenario on its ground.
        result: a plan; without one there is nothing to compare with.
        time_s: for branch and bound, half of it for each question; 0: proofs that take no solver alone; default: linear
            relaxations too, where they are quick.
    """
    coverage = judging_map(site)
    found: dict[str, Any] = {"coverable_fraction": coverage.share(coverage.coverable)}
    if site.scenario.sensor.sensing == "along-path":
        width = 2.0 * reach_at_height_m(site.scenario.sensor, best_height_agl_m(site))
        found["length_reference_m"] = float(site.area.area) / width
    if result is None:
        return found
    proved = path_bounds(coverage, result)
    if time_s is not None and time_s > 0.0:
        proved += waypoint_bounds(coverage, result, SolverEffort(time_s=0.5 * time_s))
    elif time_s is None and are_quick(coverage):
        proved += waypoint_bounds(coverage, result, SolverEffort(nodes=0))
    return found | {bound.question: bound_document(bound) for bound in proved}


def save_plan(
    run: RunFolder,
    site: Site,
    result: Plan,
    *,
    compiled: CompiledMission | None,
    autopilot: AutopilotName,
    seed: int,
    command: Sequence[str],
    sorties: Sequence[Sortie] = (),
    proved: dict[str, Any] | None = None,
    baselines: Sequence[dict[str, Any]] | None = None,
) -> RunFolder | None:
    """Write the scenario, the Pareto set, the chosen route and its mission files, all or none.

    What belonged to an older plan in the same folder goes with it: its mission, upload, sorties and gap mission are removed; a
    plan that was flown is moved, whole, into a folder ``older-N``.

    Args:
        run: the folder.
        site: the scenario on its ground.
        result: the plan.
        compiled: its mission, none when there is none or several.
        autopilot: for whom the mission files are.
        seed: of every random number.
        command: how it was asked for.
        sorties: its flights when there are several; each gets a run folder of its own inside this one.
        proved: its :func:`bounds`; default: what there is of them without a plan.
        baselines: as ``plan.json`` of the same Pareto set has them already; default: the plan's.

    Returns:
        where the older plan and its flight are now; none when there was no flight.
    """
    scenario = dump_scenario(site.scenario)
    limits = bounds(site) if proved is None else proved
    texts = {"scenario.toml": scenario, **_set_texts(result)}
    if compiled is not None:
        texts |= mission_texts(compiled, autopilot=autopilot, name=site.scenario.name)
    rows = [_sortie_row(number, sortie) for number, sortie in enumerate(sorties, start=1)]
    document = plan_document(site, result, seed=seed, bounds=limits, sorties=rows, baselines=baselines)
    texts["plan.json"] = json_text(document)
    about = _run_document(site, scenario, seed=seed, command=command, plan_wall_s=result.wall_s)
    judged = judging_map(site) if sorties else None
    of_any_plan = {name: limit for name, limit in limits.items() if not isinstance(limit, dict)}
    for row, sortie in zip(rows, sorties, strict=True):
        if judged is None:
            break
        plan = _plan_of_sortie(judged, result, sortie)
        own = {"scenario.toml": scenario, **_set_texts(plan)}
        own |= mission_texts(sortie.compiled, autopilot=autopilot, name=f"{site.scenario.name}, sortie {row['number']}")
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
        "route_length_m": sortie.route.length_m,
        "path_length_m": Route(sortie.compiled.path_m).length_m,
        "mission_items": len(sortie.compiled.mission.items),
    }


def _plan_of_sortie(judged: CoverageMap, whole: Plan, sortie: Sortie) -> Plan:
    """A plan with the part of the chosen route that a sortie flies, judged by itself."""
    route = sortie.route
    violation = measure_violations(judged.site, route.waypoints_m, margin_m=0.0).total
    member = RouteMember(route, judge(judged, route), violation, whole.chosen.origin)
    return dataclasses.replace(whole, chosen=member, members=(member,), baselines=())


def mission_texts(compiled: CompiledMission, *, autopilot: AutopilotName, name: str) -> dict[str, str]:
    """The texts of MISSION_FILES by their names."""
    home = compiled.mission.home
    if home is None:
        raise InputError("the mission has no home")
    return {
        "mission.waypoints": wpl.write_mission(compiled.mission),
        "fence.waypoints": wpl.write_fence(compiled.fence, home),
        "rally.waypoints": wpl.write_rally(compiled.rally, home),
        "mission.plan": export_text(compiled, "plan", autopilot=autopilot, name=name),
        "mission.kml": export_text(compiled, "kml", autopilot=autopilot, name=name),
    }


def export_text(compiled: CompiledMission, file_format: str, *, autopilot: AutopilotName, name: str) -> str:
    """A compiled mission in one of EXPORT_FORMATS.

    Raises:
        InputError: another format.
    """
    match file_format:
        case "waypoints":
            return wpl.write_mission(compiled.mission)
        case "plan":
            return plan_format.write(
                plan_format.PlanFile(
                    mission=compiled.mission,
                    fence=compiled.fence,
                    rally=compiled.rally,
                    mav_autopilot=AUTOPILOTS[autopilot].mav_autopilot,
                )
            )
        case "kml":
            return kml.write_mission(compiled.mission, name=name)
        case "geojson":
            return geojson.write_mission(compiled.mission, name=name)
        case "csv":
            return csv_format.write_mission(compiled.mission)
    raise InputError(f"format {file_format!r} is not one of {', '.join(EXPORT_FORMATS)}")


def read_planned(run: RunFolder) -> tuple[Site, PlannedDocument]:
    """Site and chosen route of a run folder.

    Raises:
        InputError: a file is missing or broken; says which command makes it.
    """
    site = load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    document = run.read_json("plan.json", made_by="uavcover plan")
    return site, read_plan_document(document, source=str(run.file("plan.json")))


def upload_document(site: Site, compiled: CompiledMission, url: str, results: Sequence[Verification]) -> dict[str, Any]:
    """``upload.json``: what was sent, what came back, every difference and why it is or is not acceptable."""
    limit = compiled.max_height_above_home_m + 10.0
    return {
        "schema_version": SCHEMA_VERSION,
        "name": site.scenario.name,
        "url": url,
        "passed": all(result.passed for result in results),
        "first_waypoint_item": compiled.first_waypoint_item,
        "waypoint_count": compiled.waypoint_count,
        "return_advice": dataclasses.asdict(compiled.return_advice),
        "autopilot_max_height_above_home_m": limit,
        "lists": [result.as_json() for result in results],
    }


def _run_document(
    site: Site, scenario: str, *, seed: int, command: Sequence[str], plan_wall_s: float
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
            "scenario": {"sha256": sha256_of_content(scenario)},
            "terrain": {
                "source": site.ground.source,
                "sha256": site.ground.sha256 or None,
                "largest_error_m": site.ground.error_m,
            },
            "obstacles": {"sha256": obstacles_sha256(site.scenario.obstacles)},
        },
        "stages": {"plan": {"wall_s": plan_wall_s}},
    }


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:  # run from a source folder that is not installed
        return None


def seal_flight(run: RunFolder, *, samples: int, command: Sequence[str]) -> None:
    """Record the hashes of the track and of what was recorded beside it when a flight has ended: later changes are noticed.

    Raises:
        InputError, OutputError: ``run.json`` cannot be read or written.
    """
    there = [name for name in FLIGHT_FILES if run.file(name).exists()]
    note_files(run, "fly", there, command=command, samples=samples)


def add_stage(run: RunFolder, name: str, wall_s: float) -> None:
    """Note in ``run.json`` how long a stage took."""
    stages = run.read_json("run.json", made_by="uavcover plan").get("stages")
    note_in_run(run, "stages", {**(stages if isinstance(stages, dict) else {}), name: {"wall_s": wall_s}})


def note_in_run(run: RunFolder, key: str, value: dict[str, Any]) -> None:
    """Put something into ``run.json``, in place of what was there under that key."""
    document = run.read_json("run.json", made_by="uavcover plan")
    run.write_json("run.json", {**document, key: value})
