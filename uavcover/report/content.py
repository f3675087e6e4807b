"""What a report is made of: a run folder, read and judged."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavcover import after_flight, pipeline
from uavcover.coverage.coverage_map import CoverageMap
from uavcover.documents import PlannedDocument, read_plan_document
from uavcover.model.track import Track
from uavcover.pareto_file import ParetoRow, read_pareto
from uavcover.resumption import flown_tracks
from uavcover.run_folder import RunFolder
from uavcover.site import Site
from uavcover.verification.verify import Verdict, track_positions_m

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """What was flown.

    Attributes:
        source: name of the file that the track came from.
        track: what was flown.
        enu_m: (n, 3) its positions, the ones that were judged.
        height_agl_m: (n,) above ground, NaN where there is no elevation.
    """

    source: str
    track: Track
    enu_m: FloatArray
    height_agl_m: FloatArray

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return float(self.track.time_s[-1] - self.track.time_s[0])


@dataclass(frozen=True, slots=True, eq=False)
class ReportContent:
    """A run, whole.

    Attributes:
        site: the scenario on its ground.
        coverage: the cells of the area.
        plan: ``plan.json`` as it stands there.
        planned: the chosen route.
        members: the Pareto set, empty where there is no ``pareto.csv``.
        about: ``run.json``, empty where there is none.
        upload: ``upload.json``, empty where there is none.
        flights: what was flown, counted as one flight; empty before a flight.
        verdict: coverage and safety, recomputed here from the tracks; none before a flight.
        warnings: what was odd in the tracks' files.
    """

    site: Site
    coverage: CoverageMap
    plan: dict[str, Any]
    planned: PlannedDocument
    members: tuple[ParetoRow, ...]
    about: dict[str, Any]
    upload: dict[str, Any]
    flights: tuple[Flight, ...]
    verdict: Verdict | None
    warnings: tuple[str, ...]


def read_run(run: RunFolder, *, logs: Sequence[Path]) -> ReportContent:
    """Read a run folder and judge what was flown.

    Args:
        run: with a plan.
        logs: the flown tracks, as ``verify`` takes them; none: the run's own track, where there is one.

    Raises:
        InputError: a file is missing or broken.
        TrackError: a track cannot be judged.
    """
    site = pipeline.load_site(run.existing("scenario.toml", made_by="uavcover plan"))
    plan = run.read_json("plan.json", made_by="uavcover plan")
    flown = any(folder.file("track.csv").is_file() for folder in (run, *run.sorties()))
    paths = list(logs) or (flown_tracks(run) if flown else [])
    read = [after_flight.read_log(path, site) for path in paths]
    verdict = None
    if read:
        tracks = [(r.track, after_flight.planned_for(path, run)) for r, path in zip(read, paths, strict=True)]
        verdict = after_flight.judge_tracks(site, tracks)
    pareto = run.file("pareto.csv")
    return ReportContent(
        site=site,
        coverage=pipeline.judging_map(site) if verdict is None else verdict.coverage,
        plan=plan,
        planned=read_plan_document(plan, source=str(run.file("plan.json"))),
        members=read_pareto(pareto) if pareto.is_file() else (),
        about=_optional_json(run, "run.json"),
        upload=_optional_json(run, "upload.json"),
        flights=tuple(_flight(site, _shown(path, run), r.track) for r, path in zip(read, paths, strict=True)),
        verdict=verdict,
        warnings=tuple(warning for r in read for warning in r.warnings),
    )


def _flight(site: Site, source: str, track: Track) -> Flight:
    enu = track_positions_m(site, track)
    return Flight(source, track, enu, enu[:, 2] - site.ground.heights_m(enu[:, :2]))


def _shown(path: Path, run: RunFolder) -> str:
    """A sortie's track with its folder, any other log by its name."""
    return f"{path.parent.name}/{path.name}" if path.parent.parent == run.path else path.name


def _optional_json(run: RunFolder, name: str) -> dict[str, Any]:
    return run.read_json(name, made_by="uavcover plan-upload") if run.file(name).is_file() else {}
