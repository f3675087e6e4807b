"""The run folder: its files by name, what becomes of an older plan or flight, and writing without losing anything."""

import contextlib
import json
import math
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from mission_io.model.plain_text import escaped_json
from uavcover.errors import InputError, OutputError
from uavcover.run.file_group import change_together, is_unsettled, settle, write_file, writing

SCHEMA_VERSION = 1


class RunFolder:
    """A folder with everything about one run; see docs/reference/files.md.

    Attributes:
        path: where it is.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def __str__(self) -> str:
        return str(self.path)

    def file(self, name: str) -> Path:
        """Path of one of its files."""
        return self.path / name

    def sorties(self) -> list["RunFolder"]:
        """Its folders ``sortie-1``, ``sortie-2``, ..., each a run folder of its own; empty when it is one flight."""
        self.settle()
        found: list[RunFolder] = []
        while (folder := RunFolder(self.path / f"sortie-{len(found) + 1}")).file("plan.json").is_file():
            found.append(folder)
        return found

    def flight(self, sortie: int | None) -> "RunFolder":
        """The folder of one flight: this one, or that of a sortie.

        Raises:
            InputError: it has sorties and none was named, or not this one.
        """
        sorties = self.sorties()
        if not sorties and sortie is None:
            return self
        if not sorties:
            raise InputError(f"{self.path}: this run is a single flight without sorties; omit --sortie")
        if sortie is None or not 1 <= sortie <= len(sorties):
            named = "" if sortie is None else f", not sortie {sortie}"
            raise InputError(
                f"{self.path}: the run has {len(sorties)} sorties{named}: add --sortie N, from 1 to {len(sorties)}"
            )
        return sorties[sortie - 1]

    def existing(self, name: str, *, made_by: str) -> Path:
        """Path of a file that must be there. Raises InputError: it is not; says which command makes it."""
        self.settle()
        path = self.file(name)
        if not self.path.is_dir():
            raise InputError(f"{self.path}: no such run folder; create it with: uavcover plan")
        if not path.is_file():
            raise InputError(f"{self.path}: the run folder has no {name}; create it with: {made_by}")
        return path

    @contextlib.contextmanager
    def reserved(self, names: Iterable[str], *, force: bool) -> Iterator[None]:
        """Make the folder, keep other processes of uavcover out of it, and see that the files can be written.

        A folder that was made here and is still empty after an error is removed again.

        Raises:
            OutputError: a file already exists and ``force`` is not set, the folder cannot be made or written to, or another
                process has reserved it.
        """
        made = not self.path.exists()
        with writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        try:
            with self._locked():
                settle(self.path)
                there = [name for name in names if self.file(name).exists()]
                if there and not force:
                    raise OutputError(
                        f"{self.path}: this folder already contains {', '.join(there)}; use --force to overwrite, or "
                        "choose another folder"
                    )
                with writing(self.path), tempfile.TemporaryFile(dir=self.path):
                    pass  # a folder that cannot be written to is better known before an hour of planning than after
                yield
        except BaseException:
            if made:
                with contextlib.suppress(OSError):
                    self.path.rmdir()
            raise

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        try:
            import fcntl
        except ImportError:  # Windows: two planners in one folder are not noticed there
            yield
            return
        with writing(self.path):
            handle = os.open(self.path, os.O_RDONLY)
        try:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise OutputError(
                    f"{self.path}: another uavcover process is using this folder; wait until it ends, or use another folder"
                ) from None
            except OSError:
                pass  # a file system without locks
            yield
        finally:
            os.close(handle)

    def write_text(self, name: str, text: str) -> Path:
        """Write a file whole or not at all.

        Raises:
            OutputError: it cannot be written; the file that was there before is untouched.
        """
        self.write_together({name: text})
        return self.file(name)

    def write_json(self, name: str, document: dict[str, Any]) -> Path:
        """Write a JSON file whole or not at all; with exact numbers, NaN as null."""
        return self.write_text(name, json_text(document))

    def write_together(
        self, files: Mapping[str, str | bytes], *, stale: Iterable[str] = (), moved: Mapping[str, str] | None = None
    ) -> None:
        """Write several files that belong together, and take away those that belonged to what was there before.

        Args:
            files: their contents by their names.
            stale: files that are removed.
            moved: files and folders that get another name.

        Raises:
            OutputError: one cannot be written; then everything is as it was.
        """
        contents = {name: text.encode() if isinstance(text, str) else text for name, text in files.items()}
        change_together(self.path, contents, removed=stale, moved=moved)

    def remove(self, names: Iterable[str]) -> None:
        """Remove files, where they exist. Raises OutputError: one cannot be removed; then all are there."""
        change_together(self.path, {}, removed=names)

    def settle(self) -> None:
        """Finish the writes of a process that was killed, in this folder or its parent run folder.

        Raises:
            OutputError: it cannot be finished, or another process is writing at this moment.
        """
        for folder in (self.path.resolve().parent, self.path):
            if is_unsettled(folder):
                with RunFolder(folder)._locked():
                    settle(folder)

    def read_json(self, name: str, *, made_by: str) -> dict[str, Any]:
        """Read a JSON file of the folder. Raises InputError: it is missing, or not JSON."""
        path = self.existing(name, made_by=made_by)
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(
                f"{path}: the file cannot be read as JSON ({error}); create it again with: {made_by}"
            ) from error
        if not isinstance(document, dict):
            raise InputError(f"{path}: the file is not a JSON object; create it again with: {made_by}")
        return document


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises:
        OutputError: it cannot be written; the file that was there before is untouched.
    """
    write_file(path, text.encode())


def json_text(document: dict[str, Any]) -> str:
    """JSON as text and programs: two spaces, with exact numbers, NaN and infinity as null, no control character raw."""
    return escaped_json(json.dumps(_without_nan(document), indent=2, ensure_ascii=False, allow_nan=False)) + "\n"


def json_line(document: dict[str, Any]) -> str:
    """The same on one line, without its end."""
    return escaped_json(json.dumps(_without_nan(document), ensure_ascii=False, allow_nan=False))


def _without_nan(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return value


PARTS = "parts"
"""The folder with the routes of parts, while a large area is being planned."""

PLAN_FILES = ("scenario.toml", "run.json", "pareto.csv", "pareto_routes.csv", "plan.json")
MISSION_FILES = ("mission.waypoints", "mission.plan", "fence.waypoints", "rally.waypoints", "mission.kml")
UPLOAD_FILE = "upload.json"
FLIGHT_FILES = ("track.csv", "flight.rrd", "flight.tlog")
REPORT_FILE = "report.html"
VERDICT_FILES = (REPORT_FILE, "gaps.geojson", "gap_mission.waypoints", "coverage.tif", "verification.json")
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
    """The flights and verdicts of a run: its files, and the folders inside that were flown.

    The report of a plan alone is neither.
    """
    found = [name for name in AFTER_FLIGHT_FILES if run.file(name).exists()]
    found += [folder.path.name for folder in run_folders_inside(run) if has_a_flight(folder)]
    return [] if found == [REPORT_FILE] else found


def moves_of_an_older_plan(run: RunFolder) -> dict[str, str]:
    """New names, in a folder ``older-N``, for everything of a plan that was flown; empty when it was not."""
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
    """The files of an older unflown plan, here and in the run folders inside, without those to be rewritten."""
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
