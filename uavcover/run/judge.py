"""The stages after a flight: read its logs, judge them, close the gaps; and their files in the run folder."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import InfeasibleError, InputError
from uavcover.judging.flown_coverage import FlownCoverage
from uavcover.judging.gaps import REASONS, gaps_geojson, reason_codes
from uavcover.judging.phases import PlannedRoute
from uavcover.judging.track_logs.reading import READERS, read_foreign_log
from uavcover.judging.verify import FlownTrack, Verdict, verify_flight, verify_track
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.track import ReadTrack, Track
from uavcover.model.verdict import VerificationReport
from uavcover.planning.gap_route import ClosingRoute, plan_closing_route
from uavcover.routes.leg_checks import measure_violations
from uavcover.routes.mission_compiler import CompiledMission, compile_continuation
from uavcover.routes.objectives import judge
from uavcover.run import files as run_files
from uavcover.run import flight_status
from uavcover.run.documents import (
    read_plan_document,
    verification_document,
)
from uavcover.run.folder import RunFolder, json_text
from uavcover.run.geotiff import Band, geotiff
from uavcover.run.judged_inputs import JudgedInputs
from uavcover.run.mission import compile_plan, mission_texts
from uavcover.run.plan_files import save_plan
from uavcover.run.provenance import note_files
from uavcover.run.resume import TRACK
from uavcover.scenario.site import Site
from uavcover.sensing.coverage_map import CoverageMap, judging_map
from uavcover.vehicle.track_file import read_track_with_warnings

GAP_FOLDER = "gaps"
"""The run folder, inside that of the flight, of the mission that closes its gaps."""

LOG_ENDINGS = (".csv", ".rrd", *READERS)


def read_log(path: Path, site: Site) -> ReadTrack:
    """A flown track from a file, by its ending: uavcover's own (.csv, .rrd), or another program's.

    Raises:
        InputError: no such file, an ending that is not known, a file without a track; or a log of another program for a
            scenario that has no place on Earth.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; a track is recorded by: uavcover fly")
    ending = path.suffix.lower()
    if ending == ".csv":
        read = read_track_with_warnings(path)
        return replace(read, warnings=(*read.warnings, *_of_its_standing(path)))
    if ending == ".rrd":
        # Importing rerun takes a second that other logs need not wait for.
        from uavcover.recording.reader import read_recorded_track_with_warnings

        return read_recorded_track_with_warnings(path)
    if ending not in READERS:
        raise InputError(
            f"{path}: {path.suffix or 'no ending'} is not a track that can be read; use {', '.join(LOG_ENDINGS)}"
        )
    if site.frame is None:
        raise InputError(f"{path}: scenario {site.scenario.name} has no place on Earth, so this log has no place in it")
    return read_foreign_log(path, site.frame)


def _of_its_standing(path: Path) -> list[str]:
    """What is to be said of the track of a flight that goes on, or that nobody followed to its end."""
    if path.name != TRACK:
        return []
    match flight_status.settled_ending(RunFolder(path.parent)):
        case flight_status.FLYING:
            return [f"{path}: this flight goes on: what it sees from now on is not in the track yet"]
        case flight_status.INTERRUPTED:
            return [
                f"{path}: this flight was interrupted: the program that followed it ended before it; fly --resume goes on"
            ]
        case _:
            return []


def read_planned_route(run: RunFolder) -> PlannedRoute | None:
    """What a run folder's plan promised; none when it has no plan.

    Raises:
        InputError: the plan cannot be read.
    """
    if not run.file("plan.json").exists():
        return None
    document = run.read_json("plan.json", made_by="uavcover plan")
    planned = read_plan_document(document, source=str(run.file("plan.json")))
    return PlannedRoute(planned.route.waypoints_m, planned.coverage_fraction)


def planned_for(log: Path, run: RunFolder) -> PlannedRoute | None:
    """The plan that a log followed: the one beside it, as in the folder of a gap mission or a sortie, otherwise the run folder's.

    Raises:
        InputError: the plan cannot be read.
    """
    beside = RunFolder(log.parent)
    planned = read_planned_route(beside if beside.file("plan.json").exists() else run)
    if planned is None or not any(sortie.path in log.parents for sortie in run.sorties()):
        return planned
    # The flights of one plan count together, and so does what it promised.
    whole = read_planned_route(run)
    return planned if whole is None else replace(planned, coverage_fraction=whole.coverage_fraction)


def judge_tracks(site: Site, tracks: Sequence[tuple[Track, PlannedRoute | None]]) -> Verdict:
    """The verdict on one or several tracks as one flight, each with the plan it followed, on the cells of the area."""
    return verify_flight(site, judging_map(site), [FlownTrack(track, planned) for track, planned in tracks])


def save_verdict(
    run: RunFolder,
    verdict: Verdict,
    *,
    sources: Sequence[str],
    inputs: JudgedInputs,
    command: Sequence[str],
) -> dict[str, Any]:
    """Write ``verification.json`` and, for a site on Earth, ``coverage.tif``, together.

    Args:
        run: whose verdict it is.
        verdict: what was found.
        sources: names of the logs.
        inputs: what was judged; its changes were accepted.
        command: how it was asked for.

    Returns:
        what ``verification.json`` says.
    """
    document = verification_document(verdict.report, source=", ".join(sources)) | {
        "inputs": inputs.hashes,
        "accepted_changes": [asdict(change) for change in inputs.changes],
        "unsealed_tracks": list(inputs.unsealed),
    }
    files: dict[str, str | bytes] = {"verification.json": json_text(document)}
    raster = coverage_raster(verdict.coverage, verdict.flown)
    if raster is not None:
        files["coverage.tif"] = raster
    run.write_together(files)
    note_files(run, "verify", list(files), command=command, read=inputs.hashes)
    return document


def coverage_raster(coverage: CoverageMap, flown: FlownCoverage) -> bytes | None:
    """What was seen of each cell as a GeoTIFF; none for a site that has no place on Earth."""
    site, cells = coverage.site, coverage.grid.cells
    if site.frame is None:
        return None
    sureness = flown.seen.astype(float) + flown.possibly_seen + flown.surely_seen
    codes = ", ".join(f"{code} {reason}" for code, reason in enumerate(("seen", *REASONS)))
    layers: list[tuple[str, str, NDArray[Any]]] = [
        ("looks", "separate passes that saw the cell", flown.passes),
        ("first_seen_s", "vehicle time in seconds", flown.first_seen_s),
        ("ground_sample_m", "smallest ground sample distance in metres", flown.ground_sample_m),
        ("incidence_deg", "smallest incidence angle in degrees", flown.incidence_deg),
        ("distance_m", "shortest distance in metres", flown.nearest_m),
        ("sureness", "0 not seen, 1 possibly, 2 seen if measurements are exact, 3 surely", sureness),
        ("reason", codes, reason_codes(coverage, flown)),
    ]
    inside = cells.lattice >= 0

    def on_lattice(values: NDArray[Any]) -> FloatArray:
        out = np.full(cells.lattice.shape, np.nan)
        out[inside] = values[cells.lattice[inside]]
        return out

    return geotiff(
        site.frame,
        [Band(name, unit, on_lattice(values)) for name, unit, values in layers],
        east0_m=cells.east0_m,
        north0_m=cells.north0_m,
        up_m=float(cells.centre_m[:, 2].mean()),
        step_m=cells.size_m,
    )


@dataclass(frozen=True, slots=True, eq=False)
class GapMission:
    """A mission that sees what a flight has missed.

    Attributes:
        closing: the route, and what it sees of the gaps.
        compiled: the mission, from take-off at home to landing there.
        continuation: the same route for a vehicle in the air, from where it is; none when that was not asked for.
        plan: the same as a plan of its own, for its run folder.
        coverage_after: share of the coverable area that is seen after it, together with the flight.
    """

    closing: ClosingRoute
    compiled: CompiledMission
    continuation: CompiledMission | None
    plan: Plan
    coverage_after: float

    @property
    def wanted(self) -> CompiledMission:
        """The mission that was asked for."""
        return self.compiled if self.continuation is None else self.continuation


def check_gap_request(*, min_area_m2: float, target: float | None) -> None:
    """Refuse what cannot be asked of a gap mission.

    Raises:
        InputError: an area below 0, or a target outside 0..1.
    """
    if not min_area_m2 >= 0.0 or not math.isfinite(min_area_m2):
        raise InputError(f"min area: {min_area_m2} square metres must not be negative")
    if target is not None and not 0.0 < target <= 1.0:
        raise InputError(f"target: {target} is a share of the coverable area, above 0 and at most 1")


def plan_gap_mission(
    site: Site,
    verdict: Verdict,
    *,
    min_area_m2: float = 0.0,
    target: float | None = None,
    in_the_air: Track | None = None,
) -> GapMission:
    """The mission that closes the coverable gaps of a flight and lands at home.

    Args:
        site: the scenario on its ground.
        verdict: on what was flown.
        min_area_m2: smaller gaps are left open.
        target: share of the coverable area that is enough, 0..1; default: everything.
        in_the_air: of a vehicle that has not landed: the mission begins at the last sample; default: take-off at home.

    Raises:
        InputError: an argument is out of range, or the site has no home.
        InfeasibleError: there is nothing to close, or no checked mission for it.
    """
    check_gap_request(min_area_m2=min_area_m2, target=target)
    if site.home_m is None:
        raise InputError(
            f"scenario {site.scenario.name}: has no [home]; a mission needs the place to take off and land"
        )
    started = time.monotonic()
    coverage, seen = verdict.coverage, verdict.flown.seen
    missing = np.zeros(coverage.grid.count, dtype=bool)
    for region in verdict.gaps:
        if region.gap.coverable and region.gap.area_m2 >= min_area_m2:
            missing[region.cells] = True
    if not missing.any():
        raise InfeasibleError("there are no gaps to close that could be seen and are large enough")
    needed_m2 = None
    if target is not None:
        lacking = target - coverage.share_of_coverable(seen)
        if lacking <= 0.0:
            raise InfeasibleError(f"there is nothing to close: the flight has reached {100 * target:g} % already")
        needed_m2 = lacking * float(coverage.grid.weight_m2[coverage.coverable].sum())
    start_m = site.home_m if in_the_air is None else _last_place_m(site, in_the_air)
    closing = plan_closing_route(coverage, missing, start_m=start_m, end_m=site.home_m, needed_m2=needed_m2)
    compiled = compile_plan(site, closing.route)
    continuation = None if in_the_air is None else _continuation(site, closing.route, in_the_air)
    route = closing.route
    margin_m = site.scenario.limits.height_margin_m
    member = RouteMember(
        route,
        judge(coverage, route),
        measure_violations(site, route.waypoints_m, margin_m=margin_m).total,
        "gap-closing",
    )
    after = coverage.share_of_coverable(seen | coverage.seen(route.waypoints_m))
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="gaps", rule_met=target is None or after >= target,
        algorithm="gap-closing", evaluations=0, wall_s=time.monotonic() - started,
    )  # fmt: skip
    return GapMission(closing, compiled, continuation, plan, after)


def _last_place_m(site: Site, track: Track) -> FloatArray:
    """(3,) ENU of the last sample, by its geodetic columns.

    Raises:
        InputError: the scenario has no place on Earth.
    """
    if site.frame is None:
        raise InputError(f"scenario {site.scenario.name}: has no place on Earth, so there is no mission to fly")
    lat_deg, lon_deg, alt_amsl_m = track.geodetic[-1].tolist()
    place_m: FloatArray = site.frame.enu_from_geodetic(lat_deg, lon_deg, alt_amsl_m)[0]
    return place_m


def _continuation(site: Site, route: Route, track: Track) -> CompiledMission:
    lat_deg, lon_deg, alt_amsl_m = track.geodetic[-1].tolist()
    return compile_continuation(
        site, route, lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=alt_amsl_m,
        flown_s=float(track.time_s[-1] - track.time_s[0]), autopilot=site.scenario.vehicle.autopilot,
    )  # fmt: skip


def save_gaps(run: RunFolder, verdict: Verdict, *, command: Sequence[str]) -> None:
    """Write ``gaps.geojson``.

    Raises:
        InputError: the scenario has no place on Earth.
    """
    run.write_json("gaps.geojson", gaps_geojson(verdict.coverage, verdict.gaps))
    note_files(run, "gaps", ["gaps.geojson"], command=command)


def save_gap_mission(
    run: RunFolder, site: Site, mission: GapMission, *, command: Sequence[str], force: bool
) -> RunFolder:
    """Write ``gap_mission.waypoints``, and a run folder inside this one that can be uploaded and flown from home.

    Raises:
        OutputError: there is such a folder already and ``force`` was not said.
    """
    folder = RunFolder(run.file(GAP_FOLDER))
    autopilot = site.scenario.vehicle.autopilot
    with folder.reserved((*run_files.PLAN_FILES, *run_files.OF_A_PLAN), force=force):
        save_plan(
            folder, site, mission.plan, compiled=mission.compiled, autopilot=autopilot,
            seed=site.scenario.planner.seed, command=command,
        )  # fmt: skip
    texts = mission_texts(mission.wanted, autopilot=autopilot, name=site.scenario.name)
    run.write_text("gap_mission.waypoints", texts["mission.waypoints"])
    note_files(run, "gaps", ["gap_mission.waypoints"], command=command)
    return folder


def verify(site: Site, track: Track, planned: PlannedRoute | None = None) -> VerificationReport:
    """Coverage and safety of what was flown, on the cells of the area; see :mod:`uavcover.judging`."""
    return verify_track(site, judging_map(site), track, planned)
