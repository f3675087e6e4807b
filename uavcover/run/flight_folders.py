"""Where the flights of a run are kept: its own, those of its sorties, and those that resumed them."""

import hashlib
from pathlib import Path

from uavcover.errors import InputError
from uavcover.model.scenario import Scenario
from uavcover.run.documents import PlannedDocument, read_plan_document
from uavcover.run.folder import RunFolder
from uavcover.run.user import to_paste
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.scenario.vehicles import vehicle_sites

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
        InputError: nothing tells which vehicle flew it.
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
    # Only who flew and from where is the sortie's; limits and ground are those of the whole run.
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
