"""The names of a run folder's files and of the run folders inside it; what becomes of those of an older plan or flight."""

import contextlib
import re
from collections.abc import Iterable, Iterator
from pathlib import PurePosixPath

from uavcover.run.folder import RunFolder

PLAN_FILES = ("scenario.toml", "run.json", "pareto.csv", "pareto_routes.csv", "plan.json")
MISSION_FILES = ("mission.waypoints", "mission.plan", "fence.waypoints", "rally.waypoints", "mission.kml")
UPLOAD_FILE = "upload.json"
FLIGHT_FILES = ("track.csv", "flight.rrd", "flight.tlog")
VERDICT_FILES = ("report.html", "gaps.geojson", "gap_mission.waypoints", "coverage.tif", "verification.json")
"""What follows from a verdict, and the verdict."""

AFTER_FLIGHT_FILES = (*FLIGHT_FILES, *VERDICT_FILES)
OF_A_PLAN = (*MISSION_FILES, UPLOAD_FILE, *AFTER_FLIGHT_FILES)
"""What belongs to one plan, and says nothing about the next one in the same folder."""

_INSIDE = re.compile(r"gaps|(sortie|resumed)-[1-9][0-9]*")
_RESUMED = re.compile(r"resumed-[1-9][0-9]*")


def run_folders_inside(run: RunFolder) -> list[RunFolder]:
    """The run folders of sorties, of flights that resumed it and of the mission that closes its gaps."""
    if not run.path.is_dir():
        return []
    return [RunFolder(path) for path in sorted(run.path.iterdir()) if _INSIDE.fullmatch(path.name) and path.is_dir()]


def has_a_flight(run: RunFolder) -> bool:
    """Whether something that was flown is recorded in a run folder, or in one inside it."""
    return any(run.file(name).exists() for name in FLIGHT_FILES) or any(map(has_a_flight, run_folders_inside(run)))


def flown_in(run: RunFolder) -> list[str]:
    """What there is of flights and verdicts: files of a run folder, and the folders inside that have been flown."""
    files = [name for name in AFTER_FLIGHT_FILES if run.file(name).exists()]
    return files + [folder.path.name for folder in run_folders_inside(run) if has_a_flight(folder)]


def moves_of_an_older_plan(run: RunFolder) -> dict[str, str]:
    """New names, in a folder ``older-N``, for everything of a plan that was flown; none when it was not."""
    if not has_a_flight(run):
        return {}
    names = [name for name in (*PLAN_FILES, *OF_A_PLAN) if run.file(name).exists()]
    names += [folder.path.name for folder in run_folders_inside(run)]
    return {name: f"{_next_older(run)}/{name}" for name in names}


def moves_of_an_older_flight(run: RunFolder) -> dict[str, str]:
    """New names for a flight, its verdict and the flights that resumed it; the plan stays."""
    names = [name for name in AFTER_FLIGHT_FILES if run.file(name).exists()]
    names += [folder.path.name for folder in run_folders_inside(run) if _RESUMED.fullmatch(folder.path.name)]
    return {name: f"{_next_older(run)}/{name}" for name in names}


def stale_files(run: RunFolder, kept: Iterable[str]) -> list[str]:
    """The files of an older plan that was not flown, here and in the run folders inside, but for those that are written anew."""
    kept = set(kept)
    return [name for name in _known(run, PurePosixPath()) if name not in kept]


def remove_empty_folders(run: RunFolder) -> None:
    """Remove run folders inside one of which no file is left."""
    for folder in run_folders_inside(run):
        remove_empty_folders(folder)
        with contextlib.suppress(OSError):
            folder.path.rmdir()


def _known(run: RunFolder, where: PurePosixPath) -> Iterator[str]:
    yield from (str(where / name) for name in (*PLAN_FILES, *OF_A_PLAN) if run.file(name).exists())
    for folder in run_folders_inside(run):
        yield from _known(folder, where / folder.path.name)


def _next_older(run: RunFolder) -> str:
    number = 1
    while run.file(f"older-{number}").exists():
        number += 1
    return f"older-{number}"
