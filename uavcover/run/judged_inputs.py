"""Inputs of a verdict: the hash of every judged file, compared with the records in ``run.json``.

Hashes are of bytes, so a scenario written in another way is another scenario, even with the same meaning. A consistently forged
``run.json`` is not detected here, but by the checks of the track.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from uavcover.errors import InputError, ScenarioError, UavcoverError
from uavcover.model.area import RasterTerrain
from uavcover.model.scenario import Scenario
from uavcover.run.documents import TRACK, continues, flown_tracks, plans_of
from uavcover.run.folder import FLIGHT_FILES, MISSION_FILES, SCHEMA_VERSION, RunFolder
from uavcover.run.provenance import Record, obstacles_sha256, read_record, run_document, sha256_of, version
from uavcover.scenario.scenario_file import load_scenario, surface_source, terrain_source
from uavcover.scenario.site import Site, load_site
from uavcover.terrain.terrain_source import TerrainSource

WHATS = ("scenario", "terrain", "surface", "obstacles", "plan", "mission", "track", "version", "record")
"""What can have changed, in the words of ``--accept-changed``; ``record`` is what says how it was: run.json itself."""
EVERYTHING = "all"
_STILL_FLYING = ("flying", "interrupted")


@dataclass(frozen=True, slots=True)
class Change:
    """Something that is not as it was when it was recorded."""

    what: str  # one of ``WHATS``
    file: str  # which file, by its path in the run folder where it is inside
    was: str | None = None  # its hash, or version, as recorded; None where it was not there, or is not recorded
    now: str | None = None  # as it is; None where it is not there
    why: str = ""  # problems other than different hashes

    def __str__(self) -> str:
        if self.why:
            return self.why
        was, now = (None if value is None else value[:12] for value in (self.was, self.now))
        if was is None:
            return f"{self.file} did not exist and is now {now}"
        return f"{self.file} was {was} and is now {'gone' if now is None else now}"


@dataclass(frozen=True, slots=True)
class JudgedInputs:
    """The inputs of a verdict."""

    hashes: dict[str, Any]  # ``inputs`` of ``verification.json``
    changes: tuple[Change, ...]  # differences from the record
    unsealed: tuple[str, ...]  # tracks of the run of which no end is recorded, as of a flight that was killed
    site: Site | None = None  # the scenario on its ground, whose hashes these are; None where it cannot be made


def inspect_inputs(run: RunFolder, logs: Sequence[Path]) -> JudgedInputs:
    """The hashes of everything that a verdict on these logs rests on, and what of it changed.

    Args:
        run: with a scenario.
        logs: the judged tracks; empty before a flight.

    Raises:
        InputError: a file cannot be read, or is missing.
    """
    path = run.existing("scenario.toml", made_by="uavcover plan")
    finding = _Finding(run)
    record = read_record(run)
    finding.add_record(run, record)
    finding.add_files(run, record)
    folders = {log.parent.resolve(): RunFolder(log.parent) for log in logs}
    if any(not folder.file("plan.json").exists() for folder in folders.values()):
        # a log from elsewhere is judged by the plan that it followed: any of these.
        folders |= {folder.path.resolve(): folder for folder in plans_of(run)[1:]}
    for resolved, folder in folders.items():
        if resolved != run.path.resolve() and any(folder.file(name).exists() for name in ("plan.json", "run.json")):
            finding.add_followed(folder, record)
    finding.add_tracks(logs)
    scenario_sha256 = sha256_of(path)
    elevation: dict[str, str | None] = {"terrain": None}
    obstacles, site = None, None
    try:
        scenario = load_scenario(path)
    except ScenarioError:
        if not any(change.what == "scenario" for change in finding.changes):
            raise
    else:
        sources = _elevation_sources(scenario)
        site = _site(scenario)
        elevation |= _elevation_sha256(scenario, site, sources)
        obstacles = obstacles_sha256(scenario.obstacles)
        finding.add_surroundings(record, {what: source.name for what, source in sources.items()}, elevation, obstacles)
    hashes = {
        "version": version(),
        "schema_version": SCHEMA_VERSION,
        "scenario": scenario_sha256,
        **elevation,
        "obstacles": obstacles,
        "plan": sha256_of(run.file("plan.json")),
        "plans_followed": {finding.name(f.file("plan.json")): sha256_of(f.file("plan.json")) for f in folders.values()},
        "track": {finding.name(log): sha256_of(log) for log in logs},
    }
    return JudgedInputs(hashes, tuple(finding.changes), tuple(finding.unsealed), site)


def check_accepted(accepted: Sequence[str]) -> None:
    """Refuse a word that names nothing that can have changed. Raises InputError: it does not."""
    for word in accepted:
        if word not in (*WHATS, EVERYTHING):
            raise InputError(f"--accept-changed: {word!r} is not one of {', '.join((*WHATS, EVERYTHING))}")


def refuse_changes(run: RunFolder, inputs: JudgedInputs, accepted: Sequence[str], *, who_accepts: str = "") -> None:
    """Refuse to judge what changed since it was recorded.

    Args:
        run: the folder.
        inputs: what there is, and what changed.
        accepted: what may have changed.
        who_accepts: the command that takes ``--accept-changed``, where it is not the one that judges now.

    Raises:
        InputError: something changed that is not accepted; one line with all of it.
    """
    check_accepted(accepted)
    if EVERYTHING in accepted:
        return
    refused = [change for change in inputs.changes if change.what not in accepted]
    if refused:
        words = " ".join(f"--accept-changed {what}" for what in WHATS if any(c.what == what for c in refused))
        raise InputError(
            f"{run}: not judged, because inputs have changed since planning or flight: "
            f"{'; '.join(map(str, refused))}. Restore them, or accept the changes, which the verdict then records, "
            f"with: {f'{who_accepts} {words}'.strip()}"
        )


def same_inputs(document: dict[str, Any], inputs: JudgedInputs) -> bool:
    """Whether a ``verification.json`` judged the present files."""
    return bool(document.get("inputs") == inputs.hashes)


def accepted_in(document: dict[str, Any]) -> set[Change]:
    """The accepted changes of a ``verification.json``."""
    entries = document.get("accepted_changes", [])
    return {
        Change(entry["what"], entry["file"], entry["was"], entry["now"], entry["why"])
        for entry in (entries if isinstance(entries, list) else [])
        if isinstance(entry, dict) and {"what", "file", "was", "now", "why"} <= set(entry)
    }


def unsealed_text(name: str) -> str:
    """Message about a track without a recorded end."""
    return f"{name}: run.json does not record the end of the flight, so the file may have been changed"


def _elevation_sources(scenario: Scenario) -> dict[str, TerrainSource]:
    """Ground and surface model of a scenario, as far as it has them."""
    terrain = scenario.terrain
    if not isinstance(terrain, RasterTerrain):
        return {}
    surface = surface_source(terrain)
    return {"terrain": terrain_source(terrain), **({} if surface is None else {"surface": surface})}


def _site(scenario: Scenario) -> Site | None:
    """The scenario on its ground; None where its elevation data cannot be used."""
    try:
        return load_site(scenario)
    except UavcoverError:
        return None


def _elevation_sha256(
    scenario: Scenario, site: Site | None, sources: Mapping[str, TerrainSource]
) -> dict[str, str | None]:
    """Hashes of the heights of a site, or of their files; None where a file is missing."""
    if site is not None:
        both = {"terrain": site.bare_ground.sha256, "surface": site.ground.surface_sha256}
        return {what: both[what] for what in sources}
    found = {what: _files_sha256(source) for what, source in sources.items()}
    if isinstance(terrain := scenario.terrain, RasterTerrain) and "surface" in sources:
        terrain = replace(
            terrain, surface_file=None, surface_vertical_datum=None, surface_crs=None, surface_band=None,
            surface_height_unit=None,
        )  # fmt: skip
        bare = replace(scenario, terrain=terrain)
        found |= _elevation_sha256(bare, _site(bare), {"terrain": sources["terrain"]})
    return found


def _files_sha256(source: TerrainSource) -> str | None:
    try:
        return source.sha256()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{source}: the file cannot be read ({error.strerror})") from error


@dataclass(slots=True)
class _Finding:
    """Collects the changes."""

    run: RunFolder
    changes: list[Change] = field(default_factory=list)
    unsealed: list[str] = field(default_factory=list)

    def name(self, path: Path) -> str:
        """A path inside the run folder, or the name alone: no path of this machine."""
        inside = path.resolve().is_relative_to(self.run.path.resolve())
        return path.resolve().relative_to(self.run.path.resolve()).as_posix() if inside else path.name

    def add_record(self, folder: RunFolder, record: Record) -> None:
        """Check the record, and the version that planned."""
        where = self.name(folder.file("run.json"))
        self.changes += [Change("record", where, why=f"{where}: {fault}") for fault in record.faults]
        if record.version is not None and record.version != version():
            now = version()
            self.changes.append(
                Change("version", where, record.version, now, f"uavcover was {record.version} and is now {now}")
            )

    def add_files(self, folder: RunFolder, record: Record) -> None:
        """The files of a plan."""
        if record.inputs is None:
            return
        for what, names in (
            ("scenario", ["scenario.toml"]), ("plan", ["plan.json"]), ("mission", list(MISSION_FILES)),
        ):  # fmt: skip
            for name in names:
                self.add_if_changed(what, folder.file(name), record.files.get(name))

    def add_followed(self, folder: RunFolder, of_run: Record) -> None:
        """Add the plan beside a log, such as that of a sortie, and require the same scenario."""
        record = read_record(folder)
        self.add_record(folder, record)
        self.add_files(folder, record)
        if record.inputs is not None and of_run.inputs is not None:
            was, now = of_run.inputs.get("scenario"), record.inputs.get("scenario")
            if was != now:
                where = self.name(folder.file("plan.json"))
                self.changes.append(Change("plan", where, was, now, f"{where} was planned for a different scenario"))

    def add_surroundings(
        self, record: Record, names: Mapping[str, str], elevation: Mapping[str, str | None], obstacles: str | None
    ) -> None:
        """Elevation data by its names, and obstacles."""
        if record.inputs is None:
            return
        judged = [(what, names.get(what, what), now) for what, now in elevation.items()]
        for what, file, now in (*judged, ("obstacles", "obstacles of scenario.toml", obstacles)):
            was = record.inputs.get(what)
            if was != now:
                self.changes.append(Change(what, file, was, now))

    def add_tracks(self, logs: Sequence[Path]) -> None:
        """The judged logs; and tracks that were flown and are not judged because they are gone."""
        for log in logs:
            folder = RunFolder(log.parent)
            if not folder.file("run.json").exists() and log.name != TRACK:
                continue
            known = read_record(folder).files
            if known.get(log.name) is not None:
                self.add_if_changed("track", log, known[log.name])
            elif log.name in FLIGHT_FILES and self.is_of_a_run(folder):
                self.add_unsealed(folder, log)
        for folder, name in _flown_of(self.run):
            if not folder.file(name).exists():
                self.add_if_changed("track", folder.file(name), read_record(folder).files.get(name))
        self.add_broken_continuations(logs)

    def is_of_a_run(self, folder: RunFolder) -> bool:
        """Whether a folder is the run or one inside it, or has a plan of its own."""
        inside = folder.path.resolve().is_relative_to(self.run.path.resolve())
        return inside or folder.file("plan.json").exists()

    def add_unsealed(self, folder: RunFolder, log: Path) -> None:
        """A track without a record of its end: of a flight that was killed, unless run.json knows how it ended."""
        flight = run_document(folder).get("flight")
        ending = flight.get("ending") if isinstance(flight, dict) else None
        # The recording is written anew from a sealed track after the flight, and has a hash of its own only then.
        made_again = log.name != TRACK and read_record(folder).files.get(TRACK) is not None
        if ending is None or ending in _STILL_FLYING or made_again:
            self.unsealed.append(self.name(log))
            return
        self.changes.append(
            Change("record", self.name(log), None, sha256_of(log), f"{self.name(log)} has no hash in run.json")
        )

    def add_broken_continuations(self, logs: Sequence[Path]) -> None:
        """Report a flight that continues another track than the present one."""
        for log in logs:
            if log.name != TRACK:
                continue
            for folder, before in _continuations_of(RunFolder(log.parent)):
                if not continues(folder, before):
                    why = f"{self.name(folder.path)} continues a different {self.name(before.file(TRACK))}"
                    self.changes.append(Change("track", self.name(before.file(TRACK)), why=why))

    def add_if_changed(self, what: str, path: Path, was: str | None) -> None:
        """Add a file whose hash differs from the recorded one."""
        now = sha256_of(path)
        change = Change(what, self.name(path), was, now)
        if was != now and change not in self.changes:
            self.changes.append(change)


def _flown_of(run: RunFolder) -> Iterator[tuple[RunFolder, str]]:
    """The tracks that are recorded in a run and in its sorties."""
    for folder in (run, *run.sorties()):
        for name, was in read_record(folder).files.items():
            if was is not None and Path(name).name == TRACK:
                yield folder, name


def _continuations_of(run: RunFolder) -> Iterator[tuple[RunFolder, RunFolder]]:
    """The folders of flights that resumed a run, each with the folder of the flight before it."""
    before = run
    number = 1
    while (folder := RunFolder(run.file(f"resumed-{number}"))).file(TRACK).is_file():
        yield folder, before
        before, number = folder, number + 1


def judged_logs(run: RunFolder, logs: Sequence[Path]) -> list[Path]:
    """The logs that were named, or the run's own tracks. Raises InputError: none was named, and nothing was flown."""
    return list(logs) or flown_tracks(run)


def logs_of_the_verdict(run: RunFolder) -> list[Path]:
    """The logs that the verdict in a run folder judged; empty where it judged the run's own tracks, or without a verdict.

    A log that lies elsewhere is known by its name and its hash alone: it is looked for beside the run and where the command runs.

    Raises:
        InputError: one is not there, or is another one by now; it is to be named.
    """
    if not run.file("verification.json").is_file():
        return []
    judged = run.read_json("verification.json", made_by="uavcover verify").get("inputs")
    tracks = judged.get("track") if isinstance(judged, dict) else None
    if not isinstance(tracks, dict) or not tracks:
        return []
    own = {run.file(name).resolve() for name in tracks}
    if was_flown(run) and own <= {path.resolve() for path in flown_tracks(run)}:
        return []
    return [_log_named(run, name, sha256) for name, sha256 in tracks.items()]


def _log_named(run: RunFolder, name: str, sha256: object) -> Path:
    locations = [run.file(name), run.path.resolve().parent / name, Path(name)]
    found = next((path for path in locations if path.is_file() and sha256_of(path) == sha256), None)
    if found is None:
        raise InputError(
            f"{run}: the verdict refers to {name}, which is missing or has changed; specify the log with --log PATH/{name}"
        )
    return found


def was_flown(run: RunFolder) -> bool:
    """Whether there is a track in a run or in one of its sorties."""
    return any(folder.file(TRACK).is_file() for folder in (run, *run.sorties()))
