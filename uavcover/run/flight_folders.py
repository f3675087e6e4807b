"""Where the flights of a run are kept: its own, those of its sorties, and those that resumed them."""

import hashlib
from pathlib import Path

from uavcover.errors import InputError
from uavcover.run.folder import RunFolder

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
    """Where the flight that goes on with the latest one is kept."""
    return RunFolder(run.file(f"{_FOLDER}-{len(flights_of(run))}"))


def continues(folder: RunFolder, before: RunFolder) -> bool:
    """Whether a flight continues the present state of the one before it."""
    try:
        link = folder.read_json("run.json", made_by="uavcover fly --resume").get(LINK)
    except InputError:
        return False
    return isinstance(link, dict) and link.get("track_sha256") == track_sha256(before.file(TRACK))


def track_sha256(path: Path) -> str:
    """SHA-256 of a track, by which the flight that goes on with it names it."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
