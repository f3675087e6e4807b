"""A verdict on photos as a GeoPackage, by pyogrio, which is the extra ``gis``."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.errors import InputError, OutputError
from uavcover.extras.photos.photo_verdict import PhotoVerdict, footprint_polygons, frame_of
from uavcover.run.user import User
from uavcover.verification.gaps import gaps_geojson

LAYERS = ("footprints", "pictures", "gaps")


def check_geopackage(path: Path, *, force: bool) -> None:
    """See before photos are judged that the file can be written.

    Raises:
        InputError: pyogrio is not installed, or the name has another ending.
        OutputError: the file is there already and ``force`` was not said.
    """
    if path.suffix.lower() != ".gpkg":
        raise InputError(f"--gpkg: {path}: the name of a GeoPackage must end in .gpkg")
    try:
        import pyogrio  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"--gpkg: {path}: GeoPackages need the extra gis (pip install 'uavcover[gis]'); footprints.geojson, gaps.geojson and "
            "pictures.csv contain the same data"
        ) from error
    if path.exists() and not force:
        raise OutputError(f"{path}: this file would be overwritten; use --force, or another name")


def write_geopackage(verdict: PhotoVerdict, path: Path, user: User, *, force: bool) -> None:
    """Write footprints, places of photos and gaps as layers in longitude and latitude (EPSG:4326), whole or not at all.

    Raises:
        InputError: pyogrio is not installed.
        OutputError: the file is there already and ``force`` was not said, or it cannot be written.
    """
    check_geopackage(path, force=force)
    import pyogrio
    import pyogrio.errors

    handle, name = (
        tempfile.mkstemp(suffix=".gpkg", prefix=f".{path.stem}-", dir=path.parent) if path.parent.is_dir() else (-1, "")
    )
    if handle < 0:
        raise OutputError(f"{path}: the file cannot be written: no such folder")
    os.close(handle)
    part = Path(name)
    part.unlink()
    try:
        for layer, kind, (shapes, fields) in (
            ("footprints", "Polygon", _footprints(verdict)),
            ("pictures", "Point Z", _pictures(verdict)),
            ("gaps", "MultiPolygon", _gaps(verdict)),
        ):
            pyogrio.raw.write(
                part, shapely.to_wkb(np.array(shapes, dtype=object), output_dimension=3), list(fields.values()), list(fields),
                layer=layer, driver="GPKG", geometry_type=kind, crs="EPSG:4326",
            )  # fmt: skip
        part.replace(path)
    except (pyogrio.errors.DataSourceError, OSError) as error:
        raise OutputError(f"{path}: the file cannot be written: {' '.join(str(error).split())}") from error
    finally:
        part.unlink(missing_ok=True)
    user.say(f"written: {path} ({', '.join(LAYERS)})")


Layer = tuple[Sequence[shapely.Geometry], Mapping[str, NDArray[Any]]]


def _footprints(verdict: PhotoVerdict) -> Layer:
    found = list(footprint_polygons(verdict))
    names = [verdict.placed.pictures[number].name for number, _ in found]
    return [shape for _, shape in found], {"name": np.array(names, dtype=object)}


def _pictures(verdict: PhotoVerdict) -> Layer:
    placed = verdict.placed
    lat, lon, alt = frame_of(verdict.site).geodetic_from_enu(placed.eyes_m)
    heights_m = verdict.site.ground.heights_agl_m(placed.eyes_m)
    return [shapely.Point(*place) for place in np.column_stack([lon, lat, alt])], {
        "name": np.array([picture.name for picture in placed.pictures], dtype=object),
        "alt_amsl_m": alt,
        "height_agl_m": heights_m,
        "tilt_deg": np.degrees(np.arccos(np.clip(-placed.axes[:, 2], -1.0, 1.0))),
        "direction_known": placed.direction_known,
        "horizontal_error_m": placed.horizontal_m,
        "vertical_error_m": placed.vertical_m,
        "blur_px": verdict.blur_px,
    }


def _gaps(verdict: PhotoVerdict) -> Layer:
    features = gaps_geojson(verdict.coverage, verdict.gaps)["features"]
    rows = [feature["properties"] for feature in features]
    return [shapely.geometry.shape(feature["geometry"]) for feature in features], {
        "reason": np.array([properties["reason"] for properties in rows], dtype=object),
        "area_m2": np.array([properties["area_m2"] for properties in rows], dtype=float),
        "cells": np.array([properties["cells"] for properties in rows], dtype=np.int64),
        "coverable": np.array([properties["coverable"] for properties in rows], dtype=bool),
    }
