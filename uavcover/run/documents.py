"""Documents of a run folder, from the objects they describe and back, and the folders of its flights."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Bound, Plan, Question, Route
from uavcover.model.scenario import Scenario
from uavcover.model.vehicle import Fleet
from uavcover.model.verdict import VerificationReport
from uavcover.run.folder import SCHEMA_VERSION, RunFolder
from uavcover.run.provenance import sha256_of
from uavcover.run.user import to_paste
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import vehicle_sites


@dataclass(frozen=True, slots=True, eq=False)
class PlannedDocument:
    """Content of a ``plan.json`` that later stages need."""

    route: Route  # the chosen route
    coverage_fraction: float  # planned share of the area
    coverage_of_coverable: float  # planned fraction of the visible ground
    rule_met: bool  # whether the selection rule was met
    vehicles: int = 1  # how many fly it; a sortie, a gap mission or what is left of a flight is for one


def plan_document(
    site: Site,  # the scenario on its ground
    plan: Plan,  # what was planned
    *,
    seed: int,  # of every random number
    bounds: dict[str, Any],  # lower bounds
    sorties: Sequence[dict[str, Any]] = (),  # documents of several flights
    fleet: dict[str, Any] | None = None,  # document of several vehicles
    # as an older ``plan.json`` of the same set has them; default: the plan's
    baselines: Sequence[dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """``plan.json``: equal for equal seed and evaluations in everything but ``wall_s``."""
    frame = site.frame
    origin = None
    if frame is not None:
        origin = {"lat_deg": frame.lat_deg, "lon_deg": frame.lon_deg, "alt_amsl_m": frame.alt_amsl_m}
    return {
        "schema_version": SCHEMA_VERSION,
        "name": site.scenario.name,
        "seed": seed,
        "algorithm": plan.algorithm,
        "made_by": plan.chosen.origin,
        "evaluations": plan.evaluations,
        "interrupted": plan.interrupted,
        "wall_s": plan.wall_s,
        "origin": origin,
        "select": plan.rule,
        "rule_met": plan.rule_met,
        "objective": site.scenario.objective,
        "waypoints": _waypoints(site, plan.chosen.route.waypoints_m),
        **({"part_begins": list(plan.chosen.route.begins)} if plan.chosen.route.begins else {}),
        "metrics": dataclasses.asdict(plan.chosen.metrics),
        "mission": _mission(plan),
        "sorties": list(sorties),
        "fleet": fleet,
        "bounds": bounds,
        "baselines": [
            {"name": b.origin, "violation": b.violation, **dataclasses.asdict(b.metrics)} for b in plan.baselines
        ]
        if baselines is None
        else list(baselines),
    }


def _mission(plan: Plan) -> dict[str, Any] | None:
    """Figures of the mission, and with fewer vehicles; None where the plan has no sorties."""
    if plan.chosen.mission is None:
        return None
    others = [dataclasses.asdict(size) for size in plan.by_vehicles]
    return {**dataclasses.asdict(plan.chosen.mission), **({"by_vehicles": others} if others else {})}


def bound_document(bound: Bound) -> dict[str, Any]:
    """One entry of ``bounds``, under the name of its question."""
    required: dict[str, float] = {"for_coverage_of_coverable": bound.required}
    if bound.question == "most_coverage":
        required = {"with_waypoints": int(bound.required)}
    limit = "at_most" if bound.question == "most_coverage" else "at_least"
    return {
        **required, limit: bound.limit, "found": bound.found, "gap": bound.gap,
        "proved_on": bound.proved_on, "method": bound.method, "counted": bound.counted,
    }  # fmt: skip


def bound_text(question: str, entry: dict[str, Any]) -> str:
    """An entry of ``bounds`` as one line. Raises InputError: it is none."""
    try:
        found, gap = entry["found"], entry["gap"]
        if question == "most_coverage":
            what = f"most coverage with {entry['with_waypoints']} waypoints: at most {_percent(entry['at_most'])}"
            found_text = None if found is None else _percent(found)
        else:
            name, unit = ("fewest waypoints", "") if question == "fewest_waypoints" else ("shortest path", " m")
            what = f"{name} for {_percent(entry['for_coverage_of_coverable'])}: at least {entry['at_least']:.0f}{unit}"
            # Another route than the chosen one where the planner makes something else small.
            which = " (by the shortest of all routes)" if question == "shortest_path_m" else ""
            found_text = None if found is None else f"{found:.0f}{unit}{which}"
        text = f"{what}, found {found_text or 'none'}"
        gap_text = "" if gap is None else f", {_gap_text(gap)}"
        return f"{text}{gap_text}; proved for {entry['proved_on']}, by {entry['method']}"
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"plan.json: bounds.{question} is not a bound ({type(error).__name__}: {error})") from error


def _gap_text(gap: float) -> str:
    """The gap as a fraction of the bound, or as a multiple of it."""
    return f"gap {_percent(gap)}" if gap <= 1.0 else f"{1.0 + gap:.1f} times that"


def bounds_text(bounds: dict[str, Any]) -> list[str]:
    """The proved bounds of a plan, a line each."""
    return [bound_text(name, bounds[name]) for name in get_args(Question) if name in bounds]


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.2f} %"


def _waypoints(site: Site, points_m: FloatArray) -> list[dict[str, float | None]]:
    heights = site.ground.heights_agl_m(points_m)
    geodetic: list[tuple[float | None, float | None, float | None]] = [(None, None, None)] * len(points_m)
    if site.frame is not None:
        geodetic = [tuple(map(float, row)) for row in zip(*site.frame.geodetic_from_enu(points_m), strict=True)]  # type: ignore[misc]
    return [
        {
            "east_m": float(e), "north_m": float(n), "up_m": float(u),
            "lat_deg": lat, "lon_deg": lon, "alt_amsl_m": alt, "height_agl_m": float(h),
        }
        for (e, n, u), (lat, lon, alt), h in zip(points_m, geodetic, heights, strict=True)
    ]  # fmt: skip


def read_plan_document(document: dict[str, Any], *, source: str) -> PlannedDocument:
    """Read the content of a plan that later stages need.

    Raises:
        InputError: a key is missing or has the wrong kind; says which.
    """
    version = document.get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(f"{source}: schema_version {version} is not supported; this uavcover reads {SCHEMA_VERSION}")
    try:
        points = np.array([[w["east_m"], w["north_m"], w["up_m"]] for w in document["waypoints"]], dtype=float)
        metrics = document["metrics"]
        planned = PlannedDocument(
            Route(points.reshape(-1, 3), tuple(int(number) for number in document.get("part_begins", ()))),
            float(metrics["coverage_fraction"]),
            float(metrics["coverage_of_coverable"]),
            bool(document["rule_met"]),
            _vehicles(document.get("fleet")),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{source}: cannot read the file as a plan ({type(error).__name__}: {error}); create it again with: uavcover plan"
        ) from error
    if not np.isfinite(points).all():
        raise InputError(
            f"{source}: a waypoint has a coordinate that is not a number; create it again with: uavcover plan"
        )
    return planned


def _vehicles(fleet: Any) -> int:
    """Number of vehicles in the ``fleet`` of a plan."""
    return 1 if fleet is None else Fleet(vehicles=int(fleet["vehicles"])).vehicles


def verification_document(report: VerificationReport, *, source: str) -> dict[str, Any]:
    """``verification.json``."""
    return {"schema_version": SCHEMA_VERSION, "track": source, **dataclasses.asdict(report)}


# The plan of a run folder, read back.


def read_planned(run: RunFolder) -> tuple[Site, PlannedDocument]:
    """Site and chosen route of a run folder.

    Raises:
        InputError: a file is missing or broken; says which command makes it.
    """
    site = load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    document = run.read_json("plan.json", made_by="uavcover plan")
    return site, read_plan_document(document, source=str(run.file("plan.json")))


# Which vehicle of a run flew a log, where the vehicles differ.


def is_alike(own: Scenario, other: Scenario) -> bool:
    """Whether two vehicles have the same settings, home and sensor."""
    return (own.vehicle, own.home, own.sensor) == (other.vehicle, other.home, other.sensor)


def site_for(log: Path, run: RunFolder, site: Site) -> Site:
    """The site of the vehicle that flew a log: where vehicles differ, that of the plan beside it.

    Raises:
        InputError: the vehicle that flew it is unknown.
    """
    if not site.scenario.vehicles:
        return site
    inside = log.resolve().is_relative_to(run.path.resolve())
    if not inside:
        raise InputError(
            f"{log}: the vehicles of {run} differ, and the log does not show which one flew it: judge it with the "
            f"plan of that vehicle: {to_paste('verify', f'{run}/sortie-N', '--log', log)}"
        )
    beside = RunFolder(log.parent).file("scenario.toml")
    scenario = load_scenario(beside) if beside.exists() else site.scenario
    # Only the vehicle and its home are the sortie's; limits and ground are those of the whole run.
    for own in vehicle_sites(site):
        if is_alike(own.scenario, scenario):
            return own
    raise InputError(f"{beside}: its vehicle or home is not in {run.file('scenario.toml')}; plan again")


TRACK = "track.csv"
LINK = "resumes"
"""What ``run.json`` calls the flight that a resumed one goes on with."""
_FOLDER = "resumed"
GAP_FOLDER = "gaps"
"""The run folder, inside that of the flight, of the mission that closes its gaps."""


def flights_of(run: RunFolder) -> list[RunFolder]:
    """The run and the flights that resumed it, in order; a flight of an older run ends the list."""
    flights = [run]
    while True:
        folder = RunFolder(run.file(f"{_FOLDER}-{len(flights)}"))
        if not folder.file(TRACK).is_file() or not continues(folder, flights[-1]):
            return flights
        flights.append(folder)


def flown_tracks(run: RunFolder) -> list[Path]:
    """The tracks that count together: the run's, or those of its sorties, each with the flights that resumed it.

    Raises:
        InputError: nothing was flown.
    """
    if sorties := run.sorties():
        flown = [sortie for sortie in sorties if sortie.file(TRACK).is_file()]
        if not flown:
            run.existing(TRACK, made_by="uavcover fly --sortie 1")
        return [track for sortie in flown for track in flown_tracks(sortie)]
    run.existing(TRACK, made_by="uavcover fly")
    return [folder.file(TRACK) for folder in flights_of(run)]


def whole_run(folder: RunFolder) -> RunFolder:
    """The run that a flight is one of: the one whose sortie the folder is, or the folder itself."""
    parent = RunFolder(folder.path.resolve().parent)
    is_sortie = any(sortie.path.resolve() == folder.path.resolve() for sortie in parent.sorties())
    return RunFolder(folder.path.parent) if is_sortie else folder


def plans_of(run: RunFolder) -> list[RunFolder]:
    """Every folder whose plan this run flew: the run, its sorties, resumed flights and gap mission."""
    flights = [flight for folder in (run, *run.sorties()) for flight in flights_of(folder)]
    return [folder for folder in (*flights, RunFolder(run.file(GAP_FOLDER))) if folder.file("plan.json").is_file()]


def next_folder(run: RunFolder) -> RunFolder:
    """Folder of the flight that continues the latest one."""
    return RunFolder(run.file(f"{_FOLDER}-{len(flights_of(run))}"))


def continues(folder: RunFolder, before: RunFolder) -> bool:
    """Whether a flight continues the present state of the one before it."""
    try:
        link = folder.read_json("run.json", made_by="uavcover fly --resume").get(LINK)
    except InputError:
        return False
    return isinstance(link, dict) and link.get("track_sha256") == sha256_of(before.file(TRACK))
