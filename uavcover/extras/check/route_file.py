"""Routes of drone apps and map programs as missions: GPX, KML lines, DJI's WPML, Litchi's CSV."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from mission_io.errors import FormatError
from mission_io.formats import gpx, kml, litchi, wpml_reader
from mission_io.formats.point_route import PointRoute
from mission_io.formats.text import text_from_bytes
from uavcover.errors import InputError
from uavcover.scenario.areas.kmz import entry_of, kml_of

ROUTE_SUFFIXES: Final = (".gpx", ".kml", ".kmz", ".wpml")
MOST_BYTES: Final = 64 * 1024 * 1024
_READERS: Final[Mapping[str, Callable[[str], PointRoute]]] = MappingProxyType(
    {".gpx": gpx.read_route, ".kml": kml.read_route, ".wpml": wpml_reader.read_route}
)


def read_route_file(path: Path) -> PointRoute | None:
    """Read a route file; None for any other file, by its name and, with ``.csv``, its header.

    Raises:
        InputError: it cannot be opened, or is too large.
        FormatError: it is not what its name says, with file and place.
    """
    suffix = path.suffix.lower()
    if suffix not in (*ROUTE_SUFFIXES, ".csv"):
        return None
    try:
        if path.stat().st_size > MOST_BYTES:
            raise InputError(f"{path}: the file is larger than {MOST_BYTES:,} bytes; save only the route")
        if suffix == ".kmz":
            return _read_kmz(path)
        text = text_from_bytes(path.read_bytes()).text
        if suffix == ".csv":
            return litchi.read_route(text) if litchi.is_litchi(text) else None
        return _READERS[suffix](text)
    except FormatError as error:
        where = f"{path}: {error.where}" if error.where else str(path)
        raise FormatError(error.what, where=where, advice=error.advice) from error
    except OSError as error:
        raise InputError(f"{path}: the file cannot be read ({error.strerror or type(error).__name__})") from error


def _read_kmz(path: Path) -> PointRoute:
    """A flight of DJI's, or a KMZ with a line."""
    flight = entry_of(path, wpml_reader.DOCUMENT)
    if flight is None and entry_of(path, wpml_reader.TEMPLATE) is not None:
        raise FormatError(
            f"the file contains DJI's template ({wpml_reader.TEMPLATE}) but no {wpml_reader.DOCUMENT}, which the aircraft flies",
            advice="export the flight from DJI Pilot 2 or FlightHub, or use its area with new",
        )  # fmt: skip
    if flight is not None:
        return wpml_reader.read_route(text_from_bytes(flight).text)
    return kml.read_route(text_from_bytes(kml_of(path)).text)
