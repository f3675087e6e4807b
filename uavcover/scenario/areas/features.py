"""Features of area files before their polygons are checked: their names, their layers, and the reader of GIS files.

GeoPackage, Shapefile and FlatGeobuf are read by pyogrio, which is the extra ``gis``.
"""

import difflib
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import shapely
from pyproj import CRS
from pyproj.exceptions import CRSError

from mission_io.model.plain_text import counted
from uavcover.errors import InputError
from uavcover.model.area import Rings

WGS84 = CRS.from_epsg(4326)
_MOST_NAMES = 12


@dataclass(frozen=True, slots=True)
class AreaFeature:
    """A feature with one or more polygons."""

    # each its outer ring and its holes, as (x, y) or (longitude, latitude) pairs in the order of the file
    polygons: tuple[Rings, ...]
    name: str = ""  # of the feature; empty without one
    layer: str = ""  # the layer, folder or kind it belongs to; empty where the format has none
    properties: Mapping[str, Any] = field(default_factory=dict)  # other properties in GeoJSON


@dataclass(frozen=True, slots=True)
class AreaDocument:
    """The content of a file."""

    source: str  # names it in errors
    features: tuple[AreaFeature, ...]  # those with polygons, in the order of the file
    crs: CRS | None = WGS84  # their coordinate system; None when the file does not say
    others: str = ""  # its other content, for the error without a polygon: "2 lines"
    rings_may_be_open: bool = False  # whether the format leaves out the last corner, which repeats the first
    unclosed: tuple[str, ...] = ()  # places of rings that should have been closed and were not, found while reading
    notes: tuple[str, ...] = ()  # what was repaired or omitted, one line each


def chosen(document: AreaDocument, layer: str | None, feature: str | None) -> tuple[tuple[str, AreaFeature], ...]:
    """The selected features, each with its name for error messages.

    Args:
        document: the file.
        layer: only this layer; None: the only one.
        feature: only features of this name, or the one of this number, counted from 1; None: all.

    Raises:
        InputError: there is none, or several layers and none was chosen; says what there is.
    """
    everything = document.features
    if not everything:
        there = f" (only {document.others})" if document.others else ""
        raise InputError(
            f"{document.source}: the file contains no polygons{there}; draw the area as a polygon and save the file again"
        )
    layers = list(dict.fromkeys(one.layer for one in everything))
    if layer is not None:
        name = _known(layer, layers, f"{document.source}: the file has no layer {layer!r}")
        everything = tuple(one for one in everything if one.layer == name)
    elif feature is None and len(layers) > 1:
        raise InputError(
            f"{document.source}: the file has polygons in several layers ({_listed(layers)}); choose one with --layer"
        )
    numbered = [(_words(number, one), one) for number, one in enumerate(everything, start=1)]
    if feature is None:
        return tuple(numbered)
    if feature.isdigit() and not any(one.name == feature for one in everything):
        if not 1 <= int(feature) <= len(numbered):
            raise InputError(
                f"{document.source}: the file has no feature {feature}; it has {len(numbered)}, counted from 1"
            )
        return (numbered[int(feature) - 1],)
    name = _known(feature, [one.name for one in everything], f"{document.source}: the file has no feature {feature!r}")
    return tuple(one for one in numbered if one[1].name == name)


def _words(number: int, feature: AreaFeature) -> str:
    return f"feature {number} ({feature.name})" if feature.name else f"feature {number}"


def _known(wanted: str, names: Sequence[str], missing: str) -> str:
    """One of the names, in any case."""
    if wanted in names:
        return wanted
    alike = {name.casefold(): name for name in names if name}
    if wanted.casefold() in alike:
        return alike[wanted.casefold()]
    if not alike:
        raise InputError(f"{missing}, and no feature has a name; omit this option")
    close = difflib.get_close_matches(wanted.casefold(), alike, n=1)
    advice = f"did you mean {alike[close[0]]!r}?" if close else f"the names are: {_listed(list(alike.values()))}"
    raise InputError(f"{missing}; {advice}")


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(name or "(no name)" for name in names[:_MOST_NAMES])
    return shown if len(names) <= _MOST_NAMES else f"{shown} and {len(names) - _MOST_NAMES} more"


# KMZ: a zip with a KML document, opened with limits so that a small file cannot fill memory or disk.

MAX_ENTRIES = 2000
MAX_KML_BYTES = 64 * 1024 * 1024
MAX_RATIO = 200.0
"""Ratio of unpacked to packed size; text packs to about a twentieth, a bomb to a thousandth."""
_ARCHIVES = (".kmz", ".zip", ".7z", ".gz", ".rar", ".tar", ".bz2", ".xz")


def kml_of(path: Path) -> bytes:
    """The KML document of a KMZ file: ``doc.kml``, or the only one there is. Photos and the rest are not unpacked.

    Raises:
        InputError: no zip, a damaged or encrypted one, none or several documents, or one beyond the limits.
    """
    with _opened(path) as archive:
        return _unpacked(path, archive, _document(path, _files(path, archive)))


def entry_of(path: Path, name: str) -> bytes | None:
    """The entry of a KMZ file that has this name; None without one.

    Raises:
        InputError: no zip, a damaged or encrypted one, or an entry beyond the limits.
    """
    with _opened(path) as archive:
        found = [entry for entry in _files(path, archive) if entry.filename == name]
        return _unpacked(path, archive, found[0]) if found else None


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except (zipfile.BadZipFile, NotImplementedError, EOFError, zlib.error) as error:
        raise InputError(
            f"{path}: cannot open the file as KMZ, which is a zip file ({error}); save it again, or save it as KML"
        ) from error


def _files(path: Path, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    entries = archive.infolist()
    if len(entries) > MAX_ENTRIES:
        raise InputError(
            f"{path}: the archive has {len(entries)} entries, but the limit is {MAX_ENTRIES}; save only the drawing, as KML"
        )
    return [one for one in entries if not one.is_dir()]


def _unpacked(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    if entry.flag_bits & 1:
        raise InputError(f"{path}: {entry.filename} is encrypted; save it without a password")
    # The sizes in the directory may lie, so what comes out is counted too.
    ratio = entry.file_size / max(entry.compress_size, 1)
    if entry.file_size > MAX_KML_BYTES or (ratio > MAX_RATIO and entry.file_size > MAX_KML_BYTES // 64):
        raise InputError(
            f"{path}: {entry.filename} unpacks to {entry.file_size:,} bytes, {ratio:.0f} times its packed size; the "
            f"limits are {MAX_KML_BYTES:,} bytes and {MAX_RATIO:g} times; save only the drawing, as KML"
        )
    with archive.open(entry) as stream:
        data = stream.read(MAX_KML_BYTES + 1)
    if len(data) > MAX_KML_BYTES:
        raise InputError(f"{path}: {entry.filename} exceeds {MAX_KML_BYTES:,} bytes; save only the drawing, as KML")
    return data


def _document(path: Path, entries: list[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    documents = [one for one in entries if one.filename.lower().endswith(".kml")]
    main = [one for one in documents if one.filename.lower() == "doc.kml"] or documents
    if len(main) == 1:
        return main[0]
    if documents:
        names = ", ".join(one.filename for one in documents[:5])
        raise InputError(
            f"{path}: the archive has {len(documents)} documents and no doc.kml ({names}); unpack it and use one of them"
        )
    nested = [one.filename for one in entries if one.filename.lower().endswith(_ARCHIVES)]
    if nested:
        raise InputError(f"{path}: the archive contains another archive ({nested[0]}); unpack it first")
    raise InputError(f"{path}: the archive contains no KML document; save the area again with the map program")


GIS_SUFFIXES = (".gpkg", ".shp", ".fgb")
MAX_FEATURES = 100_000
MAX_BYTES = 1_000_000_000
_NAME_FIELDS = ("name", "label", "title", "id")


def read_gis_file(path: Path, layer: str | None) -> AreaDocument:
    """Every polygon of a file, or of the only one in a zip; of one layer, if that is given.

    Raises:
        InputError: pyogrio is not installed, or the file cannot be read.
    """
    opened = _inside_zip(path) if path.suffix.lower() == ".zip" else str(path)
    try:
        import pyogrio
        import pyogrio.errors
    except ImportError as error:
        raise InputError(
            f"{path}: {path.suffix} files require the extra gis (pip install 'uavcover[gis]'); or use GeoJSON or KML"
        ) from error
    try:
        layers = [str(name) for name, kind in pyogrio.list_layers(opened) if kind is not None]
        wanted = [name for name in layers if layer is None or name.casefold() == layer.casefold()] or layers
        found: list[AreaFeature] = []
        systems: list[CRS | None] = []
        others = 0
        for name in wanted:
            if pyogrio.read_info(opened, layer=name)["features"] > MAX_FEATURES:
                raise InputError(f"{path}: layer {name} has over {MAX_FEATURES:,} features; save only the area")
            meta, _, shapes, fields = pyogrio.raw.read(opened, layer=name)
            of_layer, left_out = _features(name, meta, shapes, fields)
            others += left_out
            if of_layer:
                found += of_layer
                systems.append(CRS.from_user_input(meta["crs"]) if meta["crs"] else None)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, OSError, ValueError, RuntimeError) as error:
        raise InputError(
            f"{path}: the file cannot be read ({_first_line(error)}); save it again, or as GeoJSON"
        ) from error
    except CRSError as error:
        raise InputError(f"{path}: unknown coordinate system ({_first_line(error)}); specify it with --crs") from error
    except (shapely.errors.GEOSException, NotImplementedError) as error:
        raise InputError(
            f"{path}: the file contains an unsupported shape ({_first_line(error)}); save it as plain polygons"
        ) from error
    crs = systems[0] if systems else None
    if any(other != crs for other in systems):
        names = ", ".join(dict.fromkeys(one.layer for one in found))
        missing = "" if layer is None else f"the file has no layer {layer!r}, and "
        raise InputError(f"{path}: {missing}the layers ({names}) differ in coordinate system; choose one with --layer")
    return AreaDocument(
        str(path), tuple(found), crs, f"{counted(others, 'feature')} without a polygon" if others else ""
    )


def _inside_zip(path: Path) -> str:
    """Path of a zip's only file of a known format, for GDAL; within the limits of KMZ files."""
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, OSError) as error:
        raise InputError(f"{path}: cannot open the file as a zip archive ({error}); unpack it yourself") from error
    found = [entry.filename for entry in entries if entry.filename.lower().endswith(GIS_SUFFIXES)]
    if len(found) != 1:
        raise InputError(
            f"{path}: the archive must contain one file ({', '.join(GIS_SUFFIXES)}), not {len(found)}; unpack it and use the file"
        )
    size = sum(entry.file_size for entry in entries)
    packed = sum(entry.compress_size for entry in entries)
    if len(entries) > MAX_ENTRIES or size > MAX_BYTES or size > MAX_RATIO * max(packed, 1):
        raise InputError(
            f"{path}: the archive unpacks to {size:,} bytes in {len(entries)} files, which exceeds the limit; unpack "
            "it yourself if you trust it"
        )
    return f"/vsizip/{path.resolve()}/{found[0]}"


def _features(layer: str, meta: dict[str, Any], shapes: Any, fields: Any) -> tuple[list[AreaFeature], int]:
    if shapes is None:
        return [], 0
    columns = {str(field).casefold(): values for field, values in zip(meta["fields"], fields, strict=True)}
    names = next((columns[field] for field in _NAME_FIELDS if field in columns), None)
    found: list[AreaFeature] = []
    left_out = 0
    for number, data in enumerate(shapes):
        polygons = polygons_of_shape(shapely.from_wkb(data)) if data is not None else ()
        if polygons:
            name = names[number] if names is not None else None
            found.append(AreaFeature(polygons, "" if name is None else str(name), layer))
        else:
            left_out += 1
    return found, left_out


def polygons_of_shape(shape: Any) -> tuple[Rings, ...]:
    """The rings of every polygon of a shapely geometry, heights dropped."""
    if shape is None or shape.is_empty:
        return ()
    if isinstance(shape, shapely.Polygon):
        return (tuple(tuple((p[0], p[1]) for p in ring.coords) for ring in (shape.exterior, *shape.interiors)),)
    return tuple(rings for part in getattr(shape, "geoms", ()) for rings in polygons_of_shape(part))


def _first_line(error: Exception) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0]
