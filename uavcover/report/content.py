"""The content of a report: a run folder, read and judged, and the sizes of its drawings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from mission_io.data_tables import data_table
from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.observation_counting import SensorPoses
from uavcover.model.route import Route
from uavcover.model.track import Track
from uavcover.model.verdict import PhotoStatistics
from uavcover.planner.pareto_file import ParetoRow, read_pareto
from uavcover.run.documents import PlannedDocument, read_plan_document, site_for
from uavcover.run.folder import RunFolder
from uavcover.run.judged_inputs import judged_logs, was_flown
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import groups_of, own_sensors, vehicle_sites
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import PhotoCounts, count_photos, photo_statistics, planned_poses, takes_photos
from uavcover.sensing.site_maps import fleet_map, map_for
from uavcover.terrain.frames import Bounds
from uavcover.verification.command import judge_tracks, log_name
from uavcover.verification.flown_route import PlannedRoute
from uavcover.verification.judged_track import track_positions_m
from uavcover.verification.run_logs import date_bounds, flights_of_logs
from uavcover.verification.verify import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class _Figures:
    dpi: int
    side_nodes: int
    top_nodes: int
    max_numbers: int
    relief_pixels: int
    jpeg_quality: int
    surface_nodes: int
    max_samples: int
    pad_m: float
    ramp_steps: int
    max_table_rows: int
    along_steps: int
    flight_colors: int


FIGURES = data_table(_Figures, "uavcover/data/report.toml", "figures")
"""Sizes of the report's drawings."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """A flown track with its values for the report."""

    name: str  # name of the track's file, with its path inside the run folder
    track: Track  # the flown track
    planned_m: FloatArray  # (k, 3) waypoints of its plan, which ``track.current_waypoint`` counts; empty without a plan
    enu_m: FloatArray  # (n, 3) its positions as judged
    height_agl_m: FloatArray  # (n,) above ground, NaN where there is no elevation
    clock_s: FloatArray  # (n,) time on the common clock of all flights, 0 at the start of the first

    @property
    def duration_s(self) -> float:
        """Time from the first sample to the last."""
        return float(self.track.time_s[-1] - self.track.time_s[0])


@dataclass(frozen=True, slots=True, eq=False)
class PlannedView:
    """Coverage that the plan promises."""

    observed: BoolArray  # (cells,) whether it sees each cell
    poses: SensorPoses  # from where it observes
    # how many of these, as single pictures, show each cell; None for a sensor that takes no single pictures
    photos: PhotoCounts | None
    statistics: PhotoStatistics | None  # of these pictures


@dataclass(frozen=True, slots=True, eq=False)
class ReportContent:
    """The content of a whole run."""

    site: Site  # the scenario on its ground
    coverage: CoverageMap  # the cells of the area
    plan: dict[str, Any]  # the content of ``plan.json``
    planned: PlannedDocument  # the selected route
    # (k, 3) waypoints of each sortie that the plan is flown in; None when it is one flight
    sorties_m: tuple[FloatArray, ...]
    planned_view: PlannedView  # what they promise to see
    members: tuple[ParetoRow, ...]  # the Pareto set, empty where there is no ``pareto.csv``
    about: dict[str, Any]  # ``run.json``, empty without one
    upload: dict[str, Any]  # ``upload.json``, empty without one
    flights: tuple[Flight, ...]  # the flown tracks, counted as one flight; empty before a flight
    verdict: Verdict | None  # coverage and safety, recomputed here from the tracks; None before a flight
    warnings: tuple[str, ...]  # irregularities in the track files
    notices: tuple[str, ...] = ()  # how the judged tracks relate to the plan and to ``verification.json``


def read_run(
    run: RunFolder, *, logs: Sequence[Path], notices: Sequence[str] = (), judged: bool = True
) -> ReportContent:
    """Read a run folder and judge its flights.

    Args:
        run: a run folder with a plan.
        logs: the flown tracks, as ``verify`` takes them; empty: the run's own track, where there is one.
        notices: notices about the files for the first screen.
        judged: whether flights are read; otherwise only the plan.

    Raises:
        InputError: a file is missing or broken.
        TrackError: a track cannot be judged.
    """
    site = load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    plan = run.read_json("plan.json", made_by="uavcover plan")
    paths = judged_logs(run, logs) if judged and (logs or was_flown(run)) else []
    flown = flights_of_logs(paths, run, site)
    verdict, flights = None, tuple[Flight, ...]()
    if flown.paths:
        sites = [site_for(path, run, site) for path in flown.paths]
        dates = [date_bounds(path, run) for path in flown.paths]
        verdict = judge_tracks(site, flown.tracks, sites=sites, dates=dates)
        flights = _flights(site, [log_name(path, run) for path in flown.paths], flown.tracks, verdict.shifts_s)
    pareto = run.file("pareto.csv")
    coverage = fleet_map(site) if verdict is None else verdict.coverage
    planned = read_plan_document(plan, source=str(run.file("plan.json")))
    sorties_m = tuple(_planned_of(folder).route.waypoints_m for folder in run.sorties())
    return ReportContent(
        site=site,
        coverage=coverage,
        plan=plan,
        planned=planned,
        sorties_m=sorties_m,
        planned_view=_planned_view(coverage, planned.route, sorties_m),
        members=read_pareto(pareto) if pareto.is_file() else (),
        about=_optional_json(run, "run.json"),
        upload=_optional_json(run, "upload.json"),
        flights=flights,
        verdict=verdict,
        warnings=(*flown.warnings, *flown.notes),
        notices=tuple(notices),
    )


def _planned_view(coverage: CoverageMap, route: Route, sorties_m: Sequence[FloatArray]) -> PlannedView:
    """The trigger of pictures by distance begins anew with every sortie."""
    parts_m = [part.waypoints_m for part in route.parts]
    poses = planned_poses(coverage, sorties_m or parts_m)
    photos = count_photos(coverage, poses) if takes_photos(coverage.site.scenario) else None
    statistics = None if photos is None else photo_statistics(coverage, photos)
    site = coverage.site
    eyes = [map_for(site, vehicle_sites(site)[group[0] - 1]) for group in groups_of(site.scenario)] or [coverage]
    observed = np.logical_or.reduce([eye.observed(part_m) for eye, part_m in zip(eyes, parts_m, strict=True)], axis=0)
    if own_sensors(site.scenario):  # pictures of different cameras are not counted together
        return PlannedView(observed, poses, None, None)
    return PlannedView(observed, poses, photos, statistics)


def _planned_of(folder: RunFolder) -> PlannedDocument:
    return read_plan_document(
        folder.read_json("plan.json", made_by="uavcover plan"), source=str(folder.file("plan.json"))
    )


def _flights(
    site: Site,
    names: Sequence[str],
    tracks: Sequence[tuple[Track, PlannedRoute | None]],
    shifts_s: Sequence[float],
) -> tuple[Flight, ...]:
    start_s = float(tracks[0][0].time_s[0])
    flights = []
    for name, (track, planned), shift_s in zip(names, tracks, shifts_s, strict=True):
        enu = track_positions_m(site, track)
        height = site.ground.heights_agl_m(enu)
        planned_m = np.empty((0, 3)) if planned is None else planned.waypoints_m
        flights.append(Flight(name, track, planned_m, enu, height, track.time_s + shift_s - start_s))
    return tuple(flights)


def _optional_json(run: RunFolder, name: str) -> dict[str, Any]:
    return run.read_json(name, made_by="uavcover plan-upload") if run.file(name).is_file() else {}


def bounds_m(site: Site) -> Bounds:
    """The displayed bounds: fence and area with a margin."""
    west, south, east, north = shapely.union_all([site.area, site.fence]).bounds
    return west - FIGURES.pad_m, south - FIGURES.pad_m, east + FIGURES.pad_m, north + FIGURES.pad_m
