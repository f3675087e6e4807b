"""``run.json``: which command read and wrote what in a run folder, with SHA-256, and the status of its flight.

Entries of the list ``provenance`` are only ever added. Each holds the hash of the one before it, so that a changed or missing
entry is detected. The last entry that wrote a file holds for it; a plan begins anew.

A flight is ``flying`` from its first second on, with the process that follows it. When that process ends without another word,
as by ``kill -9`` or a power cut, the flight is ``interrupted``: every command that looks at the run says so, and writes it down.
"""

import contextlib
import dataclasses
import functools
import hashlib
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from uavcover.errors import InputError, OutputError
from uavcover.model.limits import Obstacles
from uavcover.model.track import FlightOutcome
from uavcover.run.folder import FLIGHT_FILES, SCHEMA_VERSION, RunFolder

RUN_FILE = "run.json"
RECORDING = "flight.rrd"
_LIST = "provenance"


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """Record of the files of a folder in ``run.json``."""

    # hashes of what was planned from, by name (``scenario``, ``terrain``, ``obstacles``), null where there was none; None when no
    # plan is recorded
    inputs: Mapping[str, str | None] | None
    # hash of every file that was written since the plan, by its path in the folder; null where it was removed
    files: Mapping[str, str | None]
    version: str | None  # of the uavcover that planned
    faults: tuple[str, ...]  # problems of the record itself


def sha256_of(path: Path) -> str | None:
    """Hash of a file's bytes; None where there is no such file. Raises InputError: it cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InputError(f"{path}: the file cannot be read ({error.strerror})") from error


def sha256_of_content(content: str | bytes) -> str:
    """Hash of a file with this content."""
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def obstacles_sha256(obstacles: Obstacles) -> str | None:
    """Hash of obstacles as read, independent of their file; None without any."""
    if not obstacles.prisms:
        return None
    return sha256_of_content(json.dumps(dataclasses.asdict(obstacles), sort_keys=True))


def version() -> str:
    """Of uavcover."""
    try:
        return metadata.version("uavcover")
    except metadata.PackageNotFoundError:  # run from a source folder that is not installed
        return "not installed"


def with_entry(document: Mapping[str, Any], did: str, *, command: Sequence[str], **more: Any) -> dict[str, Any]:
    """A ``run.json`` with one more entry."""
    entries = _entries(document)
    entry = {
        "did": did,
        "command": list(command),
        "uavcover": version(),
        "at": datetime.now(UTC).isoformat(timespec="seconds"),
        **more,
        "previous_sha256": _sha256_of_entry(entries[-1]) if entries else None,
    }
    return {**document, _LIST: [*entries, entry]}


def planned_at_s(run: RunFolder) -> float | None:
    """Time at which a run was planned, seconds since 1970; None where ``run.json`` has none."""
    times = [entry.get("at") for entry in _entries(run_document(run)) if entry.get("did") == "plan"]
    try:
        return datetime.fromisoformat(str(times[-1])).timestamp() if times else None
    except ValueError:
        return None


def note_files(run: RunFolder, did: str, names: Sequence[str], *, command: Sequence[str], **more: Any) -> None:
    """Add an entry for files that were written, or removed where they no longer exist; it contains ``more``.

    Raises:
        InputError: ``run.json`` or a file cannot be read.
        OutputError: ``run.json`` cannot be written.
    """
    wrote = {name: sha256_of(run.file(name)) for name in names}
    document = run_document(run)
    run.write_json(RUN_FILE, with_entry(document, did, command=command, wrote=wrote, **more))


def run_document(run: RunFolder) -> dict[str, Any]:
    """``run.json``, or the start of a new one. Raises InputError: it cannot be read."""
    if not run.file(RUN_FILE).exists():
        return {"schema_version": SCHEMA_VERSION}
    return run.read_json(RUN_FILE, made_by="uavcover plan")


def read_record(run: RunFolder) -> Record:
    """The record of a folder's files in ``run.json``; empty without one.

    Raises:
        InputError: it is there and cannot be read.
    """
    if not run.file(RUN_FILE).exists():
        return Record(None, {}, None, (f"{RUN_FILE} is missing",))
    document = run.read_json(RUN_FILE, made_by="uavcover plan")
    entries = _entries(document)
    faults = list(_broken_links(entries))
    planned = [k for k, entry in enumerate(entries) if isinstance(entry.get("inputs"), dict)]
    if not planned:
        return Record(None, _files(entries), None, (*faults, f"{RUN_FILE} has no record of a plan"))
    plan = entries[planned[-1]]
    if document.get("inputs") != plan["inputs"]:
        faults.append(f"the inputs in {RUN_FILE} differ from those in its own record")
    inputs = {name: _hash_in(value) for name, value in plan["inputs"].items()}
    return Record(inputs, _files(entries[planned[-1] :]), str(plan.get("uavcover")), tuple(faults))


def _entries(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    entries = document.get(_LIST, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{RUN_FILE}: {_LIST} is not a list of entries; restore the file, or plan again")
    return entries


def _broken_links(entries: Sequence[dict[str, Any]]) -> list[str]:
    before: list[str | None] = [None, *map(_sha256_of_entry, entries[:-1])]
    return [
        f"entry {k} of {RUN_FILE} ({entry.get('did')}) does not follow from the previous entry"
        for k, (entry, expected) in enumerate(zip(entries, before, strict=False), start=1)
        if entry.get("previous_sha256") != expected
    ]


def _sha256_of_entry(entry: Mapping[str, Any]) -> str:
    return sha256_of_content(json.dumps(entry, sort_keys=True, ensure_ascii=False))


def _files(entries: Sequence[dict[str, Any]]) -> dict[str, str | None]:
    files: dict[str, str | None] = {}
    for entry in entries:
        wrote = entry.get("wrote")
        files |= {str(name): _hash_in(value) for name, value in (wrote if isinstance(wrote, dict) else {}).items()}
    return files


def _hash_in(value: Any) -> str | None:
    found = value.get("sha256") if isinstance(value, dict) else value
    return str(found) if found else None


def seal_flight(
    run: RunFolder,
    *,
    samples: int,
    command: Sequence[str],
    outcome: FlightOutcome | None = None,
    **more: Any,
) -> None:
    """Record how a flight ended, and the hashes of what was recorded of it: later changes are noticed.

    Both are one write, so that no run says how its flight ended and has no hash of its track.

    Args:
        run: where it was recorded.
        samples: of the track; without any there is nothing to hash.
        command: the command line.
        outcome: how it ended; None for a flight whose end is not known.
        more: what else belongs to the record of the flight.

    Raises:
        InputError, OutputError: ``run.json`` cannot be read or written.
    """
    document = run_document(run)
    if outcome is not None:
        document = _with_flight(document, outcome.as_json())
    if samples:
        # The recording is written anew after this, from the track, and then has its own entry.
        names = [name for name in FLIGHT_FILES if name != RECORDING and run.file(name).exists()]
        wrote = {name: sha256_of(run.file(name)) for name in names}
        document = with_entry(document, "fly", command=command, wrote=wrote, samples=samples, **more)
    run.write_json(RUN_FILE, document)


def photos_required(run: RunFolder) -> bool:
    """Whether a flight of this folder was flown with ``--require-photos``."""
    return any(entry.get("photos_required") is True for entry in _entries(run_document(run)))


def add_stage(run: RunFolder, name: str, wall_s: float) -> None:
    """Note in ``run.json`` how long a stage took."""
    stages = run.read_json("run.json", made_by="uavcover plan").get("stages")
    note_in_run(run, "stages", {**(stages if isinstance(stages, dict) else {}), name: {"wall_s": wall_s}})


def note_in_run(run: RunFolder, key: str, value: dict[str, Any]) -> None:
    """Put an entry into ``run.json``, in place of an older one under that key."""
    document = run.read_json("run.json", made_by="uavcover plan")
    run.write_json("run.json", {**document, key: value})


FLYING: Final = "flying"
INTERRUPTED: Final = "interrupted"
_KEY, _PROCESS = "flight", "process"
_BOOT = Path("/proc/sys/kernel/random/boot_id")


def forget(run: RunFolder) -> None:
    """No older flight's ending stands there any more; errors as ``note_flying``."""
    _note(run, None)


def note_flying(run: RunFolder) -> None:
    """From here on the run speaks of this flight, and of no older one.

    Raises:
        InputError, OutputError: ``run.json`` cannot be read or written.
    """
    _note(run, {"ending": FLYING, _PROCESS: process_of(os.getpid())})


def note_interrupted(run: RunFolder) -> None:
    """Record that the flight is no longer followed and its end is unknown; errors as ``note_flying``."""
    _note(run, {"ending": INTERRUPTED, "vehicle_now": "unknown: uavcover did not follow the flight to its end"})


def settled_ending(run: RunFolder) -> str | None:
    """End of the run's flight, by its name; ``flying`` while it goes on, None without a flight.

    A flight whose program is gone is ``interrupted``; that is written down where it can be.
    """
    flight = _read(run)
    if flight is None:
        return None
    if flight.get("ending") == FLYING and not is_running(flight.get(_PROCESS)):
        with contextlib.suppress(InputError, OutputError):  # a read-only folder can be read, too
            note_interrupted(run)
        return INTERRUPTED
    ending = flight.get("ending")
    return ending if isinstance(ending, str) else None


def _read(run: RunFolder) -> dict[str, Any] | None:
    try:
        flight = run.read_json("run.json", made_by="uavcover plan").get(_KEY)
    except InputError:
        return None
    return flight if isinstance(flight, dict) else None


def _note(run: RunFolder, flight: dict[str, Any] | None) -> None:
    run.write_json(RUN_FILE, _with_flight(run.read_json(RUN_FILE, made_by="uavcover plan"), flight))


def _with_flight(document: Mapping[str, Any], flight: dict[str, Any] | None) -> dict[str, Any]:
    others = {key: value for key, value in document.items() if key != _KEY}
    return others if flight is None else {**others, _KEY: flight}


def process_of(pid: int) -> dict[str, Any]:
    """A running process, as distinct from a later one with its number."""
    return {"pid": pid, "started": _started(pid), "boot_id": _boot_id()}


def is_running(process: object) -> bool:
    """Whether a process of :func:`process_of` still runs; a newer one with its number does not count."""
    if not isinstance(process, dict) or not isinstance(pid := process.get("pid"), int) or pid <= 0:
        return False
    if process.get("boot_id") != _boot_id():
        return False
    if (started := process.get("started")) is not None:
        return bool(_started(pid) == started)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:  # it belongs to another user
        return True
    return True


def _boot_id() -> str | None:
    """Identifies one start of the machine; None without support by the operating system."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return None


def _started(pid: int) -> int | None:
    """Start time of a process, in ticks; None without the process, or where the system gives none."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
        fields = stat.rpartition(")")[2].split()
        # of the fields behind the program's name in ``/proc/PID/stat``: when it started, in ticks since the machine did
        return None if fields[0] in ("Z", "X") else int(fields[19])
    except (OSError, IndexError, ValueError):
        return None


# Version of this program: a result depends on it beside its inputs.

_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "shapely", "pyproj")


@functools.cache
def program() -> dict[str, str]:
    """Versions of uavcover and of what computes its results, and a hash of its sources, by name.

    Two programs of which all of this is equal give equal results on processors of one kind.
    """
    return {
        "uavcover": version(),
        "uavcover's sources": _sources_sha256()[:16],
        "python": platform.python_version(),
        "processor": platform.machine(),
        **{name: metadata.version(name) for name in _PACKAGES},
    }


def differences(ours: dict[str, str], theirs: dict[str, str]) -> str:
    """The differences of both, as text; empty without any."""
    return ", ".join(
        f"{name} {ours.get(name, 'none')} here and {theirs.get(name, 'none')} there"
        for name in ours | theirs
        if ours.get(name) != theirs.get(name)
    )


def _sources_sha256() -> str:
    root = Path(__file__).resolve().parents[1]
    found = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()
