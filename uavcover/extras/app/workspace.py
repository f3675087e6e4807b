"""The folder of the page: its content, and protection against paths outside it."""

import math
import re
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from pyproj import Transformer

from uavcover.errors import InputError
from uavcover.run.folder import RunFolder
from uavcover.run.provenance import FLYING, settled_ending

# Positions as people type them: decimal degrees, degrees and minutes and seconds, UTM, MGRS.

_DECIMAL = re.compile(r"([-+]?\d{1,3}(?:\.\d+)?)\s*°?\s*([NSns])?\s*[,; ]\s*([-+]?\d{1,3}(?:\.\d+)?)\s*°?\s*([EWew])?")
_SEXAGESIMAL = re.compile(
    r"(\d{1,3})\s*[°d ]\s*(\d{1,2}(?:\.\d+)?)\s*(?:['′m ]\s*(?:(\d{1,2}(?:\.\d+)?)\s*(?:\"|″|''|s)?)?)?\s*([NSEWnsew])"
)
_UTM = re.compile(
    r"(\d{1,2})\s*([C-HJ-NP-Xc-hj-np-x])\s+(\d{5,7}(?:\.\d+)?)\s*(?:m?\s*E)?[,\s]+(\d{1,8}(?:\.\d+)?)\s*(?:m?\s*N)?",
    re.IGNORECASE,
)
_MGRS = re.compile(r"(\d{1,2})\s*([C-HJ-NP-X])\s*([A-HJ-NP-Z])([A-HJ-NP-V])\s*(\d{0,5})\s*(\d{0,5})", re.IGNORECASE)
_BANDS = "CDEFGHJKLMNPQRSTUVWX"
_ROWS = "ABCDEFGHJKLMNPQRSTUV"
_COLUMNS = ("ABCDEFGH", "JKLMNPQR", "STUVWXYZ")
FORMS = "47.37, 8.54 or 47°22'12\"N 8°32'24\"E or 32T 465300 5246800 or 32T MT 65300 46800"


def position_of(text: str) -> tuple[float, float]:
    """Latitude and longitude in degrees of a typed position, WGS 84.

    Raises:
        InputError: it is no position; names the forms.
    """
    words = text.strip()
    for read in (_decimal, _sexagesimal, _mgrs, _utm):
        found = read(words)
        if found is not None:
            lat, lon = found
            if not (math.isfinite(lat) and math.isfinite(lon) and abs(lat) <= 90.0 and abs(lon) <= 180.0):
                raise InputError(
                    f"{words[:60]!r} is not a position on Earth; latitude is between -90 and 90, longitude between -180 and 180"
                )
            return lat, lon
    raise InputError(f"{words[:60]!r} is not a position; enter, for example, {FORMS}")


def _decimal(text: str) -> tuple[float, float] | None:
    found = _DECIMAL.fullmatch(text)
    if found is None:
        return None
    lat = float(found[1]) * (-1.0 if (found[2] or "N") in "Ss" else 1.0)
    return lat, float(found[3]) * (-1.0 if (found[4] or "E") in "Ww" else 1.0)


def _sexagesimal(text: str) -> tuple[float, float] | None:
    found = list(_SEXAGESIMAL.finditer(text))
    if len(found) != 2 or _SEXAGESIMAL.sub("", text).strip(" ,;"):
        return None
    values: dict[bool, float] = {}
    for part in found:
        minutes, seconds = float(part[2]), float(part[3] or 0.0)
        if minutes >= 60.0 or seconds >= 60.0:
            return None
        side = part[4].upper()
        values[side in "NS"] = (float(part[1]) + minutes / 60.0 + seconds / 3600.0) * (-1.0 if side in "SW" else 1.0)
    return (values[True], values[False]) if len(values) == 2 else None


def _utm(text: str) -> tuple[float, float] | None:
    found = _UTM.fullmatch(text)
    if found is None or not 1 <= int(found[1]) <= 60:
        return None
    return _from_utm(int(found[1]), found[2].upper(), float(found[3]), float(found[4]))


def _mgrs(text: str) -> tuple[float, float] | None:
    """The middle of the square that an MGRS reference names (its south-west corner where it has five digits each)."""
    found = _MGRS.fullmatch(text)
    if found is None or not 1 <= int(found[1]) <= 60:
        return None
    digits = found[5] + found[6]
    if len(digits) % 2:
        return None
    zone, band, half = int(found[1]), found[2].upper(), len(digits) // 2
    column = _COLUMNS[(zone - 1) % 3].find(found[3].upper())
    if column < 0:
        return None
    size = 10.0 ** (5 - half)
    middle = 0.0 if half == 5 else 0.5 * size
    easting = 100_000.0 * (column + 1) + (int(digits[:half] or 0) * size) + middle
    row = (_ROWS.index(found[4].upper()) - (5 if zone % 2 == 0 else 0)) % 20
    northing = 100_000.0 * row + (int(digits[half:] or 0) * size) + middle
    # Letters of rows repeat every 2000 km: the one inside the latitude band is meant.
    south_deg = -80.0 + 8.0 * _BANDS.index(band)
    for repeat in range(6):
        lat, lon = _from_utm(zone, band, easting, northing + 2_000_000.0 * repeat)
        if south_deg - 1.0 <= lat <= south_deg + (12.0 if band == "X" else 8.0) + 1.0:
            return lat, lon
    return None


def _from_utm(zone: int, band: str, easting: float, northing: float) -> tuple[float, float]:
    code = (32600 if band >= "N" else 32700) + zone
    lon, lat = Transformer.from_crs(code, 4326, always_xy=True).transform(easting, northing)
    return float(lat), float(lon)


OWN_FOLDER = ".uavcover"
"""Jobs, and nothing of the user's; hidden from the listing."""
ELEVATION = frozenset({".tif", ".tiff", ".vrt", ".hgt", ".asc", ".dt2", ".dt1"})
AREAS = frozenset(
    {".kml", ".kmz", ".geojson", ".json", ".gpkg", ".shp", ".gpx", ".poly", ".wkt", ".csv", ".plan", ".zip", ".fgb"}
)
PHOTOS = "photos"
"""Folder inside a run folder that its photos are kept in."""
_FIRST = ("plan.json", "photos.json")
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
        """A run folder that does not exist yet, and that no command is about to create."""
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
            raise InputError(f"{name!r} is outside {self.root}; use a file or folder inside it")
        if any(part.startswith((".", "-")) for part in parts):
            raise InputError(f"{name!r}: the server ignores names that begin with a dot or a dash; rename the file")
        return found

    def name(self, path: Path) -> str:
        """The name of a path inside the folder, relative to it."""
        return path.resolve().relative_to(self.root).as_posix()

    def listing(self) -> dict[str, list[dict[str, Any]]]:
        """Scenarios, run folders, areas and elevation data, each by name."""
        kinds = ("scenarios", "runs", "areas", "elevation", "backgrounds", "photos")
        found: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
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
        """Files of the folder, a run's plan before what else is in it; hidden ones and what is deep inside are omitted."""
        left = 2000
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
                if path.is_dir() and depth < 3 and not of_a_run:
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
