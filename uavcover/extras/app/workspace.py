"""The folder that the page works in: what is in it, and no way out of it."""

import re
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from uavcover.errors import InputError
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import FLYING, settled_ending

OWN_FOLDER = ".uavcover"
"""Jobs, and nothing of the user's; hidden from the listing."""
ELEVATION = frozenset({".tif", ".tiff", ".vrt", ".hgt", ".asc", ".dt2", ".dt1"})
AREAS = frozenset(
    {".kml", ".kmz", ".geojson", ".json", ".gpkg", ".shp", ".gpx", ".poly", ".wkt", ".csv", ".plan", ".zip", ".fgb"}
)
TRACKS = frozenset({".bin", ".tlog", ".ulg", ".rrd", ".gpx", ".csv"})
PHOTOS = "photos"
"""Folder inside a run folder that its photos are kept in."""
_FIRST = ("plan.json", "photos.json")
_MOST_LISTED = 2000
_MOST_DEEP = 3
_NAME = re.compile(r"[^\x00-\x1f\x7f<>:\"|?*\\/]{1,120}")


class Workspace:
    """A folder, and paths inside it.

    Attributes:
        root: the folder; symbolic links in its own path are resolved.
        busy: names of the run folders that commands work on now; such a command may not have made its folder yet.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self.busy: Callable[[], Collection[str]] = tuple

    def free_run(self, stem: str) -> Path:
        """A run folder that is not there yet, and that no command is about to make."""
        return free_name(self.root, stem, taken=self.busy())

    def path(self, name: str) -> Path:
        """A path inside the folder, by its name relative to it.

        Raises:
            InputError: it is outside, or leads outside through a symbolic link, or belongs to the page's own files.
        """
        parts = Path(name).parts
        bad = (
            not parts
            or Path(name).is_absolute()
            or ".." in parts
            or any(_NAME.fullmatch(part) is None for part in parts)
        )
        found = self.root.joinpath(*parts)
        if bad or not found.resolve().is_relative_to(self.root):
            raise InputError(f"{name!r} is not a path inside {self.root}; use a file or folder in it")
        if any(part.startswith((".", "-")) for part in parts):
            raise InputError(f"{name!r}: names that begin with a dot or a dash are not served; rename it")
        return found

    def name(self, path: Path) -> str:
        """The name of a path inside the folder, relative to it."""
        return path.resolve().relative_to(self.root).as_posix()

    def listing(self) -> dict[str, list[dict[str, Any]]]:
        """Scenarios, run folders, areas and elevation data, each by name."""
        found: dict[str, list[dict[str, Any]]] = {
            "scenarios": [],
            "runs": [],
            "areas": [],
            "elevation": [],
            "backgrounds": [],
            "photos": [],
        }
        runs: set[Path] = set()
        for path in self._files():
            suffix, entry = path.suffix.lower(), {"name": self.name(path)}
            if path.name == "plan.json":
                runs.add(path.parent)
                if not any(parent in runs for parent in path.parent.parents):
                    found["runs"].append({"name": self.name(path.parent), **_state_of(path.parent)})
            elif path.name == "photos.json" and not any(parent in runs for parent in path.parents):
                runs.add(path.parent)
                found["photos"].append({"name": self.name(path.parent)})
            elif any(parent in runs for parent in path.parents):
                continue
            elif suffix == ".toml" and _is_scenario(path):
                found["scenarios"].append(entry)
            elif suffix in ELEVATION:
                found["elevation"].append(entry)
                found["backgrounds"].append(entry)
            elif suffix == ".mbtiles":
                found["backgrounds"].append(entry)
            elif suffix in AREAS:
                found["areas"].append(entry)
        return found

    def _files(self) -> Iterator[Path]:
        """Files of the folder, a run's plan before what else is in it; hidden ones and what is deep inside are left out."""
        left = _MOST_LISTED
        folders = [(self.root, 0)]
        while folders and left > 0:
            folder, depth = folders.pop(0)
            try:
                inside = sorted(folder.iterdir(), key=lambda path: (path.name not in _FIRST, path.name))
            except OSError:
                continue
            for path in inside:
                if path.name.startswith(".") or not path.resolve().is_relative_to(self.root):
                    continue
                of_a_run = path.name == PHOTOS and (folder / "plan.json").is_file()
                if path.is_dir() and depth < _MOST_DEEP and not of_a_run:
                    folders.append((path, depth + 1))
                elif path.is_file():
                    left -= 1
                    yield path


def free_name(folder: Path, stem: str, suffix: str = "", *, taken: Collection[str] = ()) -> Path:
    """A path that is not there yet: ``stem``, ``stem-2``, ``stem-3``, ..."""
    path, number = folder / f"{stem}{suffix}", 1
    while path.exists() or path.name in taken:
        number += 1
        path = folder / f"{stem}-{number}{suffix}"
    return path


def _is_scenario(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return b"[area]" in file.read(1 << 18)
    except OSError:
        return False


def _state_of(folder: Path) -> dict[str, Any]:
    """State of a run folder, for the list."""
    run, sorties = RunFolder(folder), len(list(folder.glob("sortie-*/plan.json")))
    flights = [run, *(RunFolder(folder / f"sortie-{number}") for number in range(1, sorties + 1))]
    flown = [each for each in flights if each.file("track.csv").is_file()]
    return {
        "sorties": sorties,
        "uploaded": any(each.file("upload.json").is_file() for each in flights),
        "flown": bool(flown),
        "verified": run.file("verification.json").is_file(),
        "gaps": run.file("gaps/plan.json").is_file(),
        "flying": any(settled_ending(each) == FLYING for each in flown),
    }
