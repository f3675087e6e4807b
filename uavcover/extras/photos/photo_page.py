"""The report of a verdict on photos, as ``judge-photos --report`` writes it: one HTML file that opens offline."""

import math
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.errors import InputError, OutputError
from uavcover.extras.photos.photo_verdict import PhotoVerdict, footprint_polygons, footprints_m, frame_of
from uavcover.report.content import FIGURES
from uavcover.report.map_data import (
    REASON_TEXTS,
    CellLayer,
    cells_bounds_m,
    coverage_layer,
    gap_data,
    gap_layer,
    geodetic_fit,
    label,
    photo_count_layers,
    ramp_layer,
    relief_image,
    rounded,
)
from uavcover.report.page import map_script, rendered_page
from uavcover.run.folder import write_text
from uavcover.run.user import User, percent
from uavcover.scenario.obstacles import rings_m
from uavcover.scenario.site import area_as_drawn
from uavcover.sensing.photos import PhotoCounts, overlap_rule
from uavcover.verification.gaps import gaps_geojson

# A verdict on photos as a GeoPackage, by pyogrio, which is the extra ``gis``.

LAYERS = ("footprints", "pictures", "gaps")


def check_geopackage(path: Path, *, force: bool) -> None:
    """Check before the photos are judged that the file can be written.

    Raises:
        InputError: pyogrio is not installed, or the name has another ending.
        OutputError: the file already exists and ``force`` is not set.
    """
    if path.suffix.lower() != ".gpkg":
        raise InputError(f"--gpkg: {path}: the name of a GeoPackage must end in .gpkg")
    try:
        import pyogrio  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"--gpkg: {path}: GeoPackages require the extra gis (pip install 'uavcover[gis]'); footprints.geojson, "
            "gaps.geojson and pictures.csv contain the same data"
        ) from error
    if path.exists() and not force:
        raise OutputError(f"{path} already exists; use --force to overwrite it, or choose another name")


def write_geopackage(verdict: PhotoVerdict, path: Path, user: User, *, force: bool) -> None:
    """Write footprints, places of photos and gaps as layers in longitude and latitude (EPSG:4326), whole or not at all.

    Raises:
        InputError: pyogrio is not installed.
        OutputError: the file already exists and ``force`` is not set, or it cannot be written.
    """
    check_geopackage(path, force=force)
    import pyogrio
    import pyogrio.errors

    if not path.parent.is_dir():
        raise OutputError(f"{path}: cannot write the file: no such folder")
    handle, name = tempfile.mkstemp(suffix=".gpkg", prefix=f".{path.stem}-", dir=path.parent)
    os.close(handle)
    part = Path(name)
    part.unlink()
    try:
        for layer, kind, (shapes, fields) in (
            ("footprints", "Polygon", _footprints(verdict)),
            ("pictures", "Point Z", _photos(verdict)),
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
    user.say(f"wrote {path} ({', '.join(LAYERS)})")


Layer = tuple[Sequence[shapely.Geometry], Mapping[str, NDArray[Any]]]


def _footprints(verdict: PhotoVerdict) -> Layer:
    found = list(footprint_polygons(verdict))
    names = [verdict.placed.photos[number].name for number, _ in found]
    return [shape for _, shape in found], {"name": np.array(names, dtype=object)}


def _photos(verdict: PhotoVerdict) -> Layer:
    placed = verdict.placed
    lat, lon, alt = frame_of(verdict.site).geodetic_from_enu(placed.eyes_m)
    heights_m = verdict.site.ground.heights_agl_m(placed.eyes_m)
    return [shapely.Point(*position) for position in np.column_stack([lon, lat, alt])], {
        "name": np.array([photo.name for photo in placed.photos], dtype=object),
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
    kinds = {"reason": object, "area_m2": float, "cells": np.int64, "coverable": bool}
    return [shapely.geometry.shape(feature["geometry"]) for feature in features], {
        name: np.array([feature["properties"][name] for feature in features], dtype=kind)
        for name, kind in kinds.items()
    }


_HOLDS = {"yes": "yes", "no": "NO", "not proved": "not proved"}


def render_photo_report(verdict: PhotoVerdict) -> str:
    """The page; names of files are escaped."""
    document = verdict.document
    return rendered_page(
        Path(__file__).parent / "photos.html",
        own_script=map_script(),
        data=photo_map_data(verdict),
        facts={
            "site": verdict.site,
            "scenario": verdict.site.scenario,
            "document": document,
            "rows": _requirements(verdict),
            "gaps": [region.gap for region in verdict.gaps],
            "reason_words": REASON_TEXTS,
            "drawn_every": footprints_drawn_every(verdict),
            "left_out": list(document["left_out"].items()),
            "max_rows": 30,
        },
    )


def _requirements(verdict: PhotoVerdict) -> list[dict[str, Any]]:
    document = verdict.document
    required, found = f"at least {percent(document['required'])}", percent(document["surely"])
    found += f"; possibly {percent(document['possibly'])}"
    rows = [("Certain coverage of visible ground", required, found, _HOLDS[document["coverage_holds"]])]
    if document["pictures_asked"] is not None:
        rule = overlap_rule(verdict.site.scenario.sensor)
        name = f"Area in at least {document['pictures_asked']} photos" + ("" if rule is None else f" ({rule})")
        required, found = f"at least {percent(document['overlap_required'])}", percent(document["overlap_fraction"])
        rows.append((name, required, found, "yes" if document["overlap_holds"] else "NO"))
    searched = document["detection"]
    if searched is not None:
        name = f"Probability of detection, mean over the area ({searched['title']})"
        required = "" if searched["asked"] is None else f"at least {percent(searched['asked'])}"
        found = (
            f"{percent(searched['pod'])}; with only the best photo {percent(searched['pod_best_look'])}, with "
            "all photos as independent "
        )
        found += f"independent {percent(searched['pod_every_picture'])}"
        rows.append((name, required, found, {None: "not required", True: "yes", False: "NO"}[searched["holds"]]))
    return [dict(zip(("name", "asked", "found", "holds"), row, strict=True)) for row in rows]


def save_photo_report(verdict: PhotoVerdict, path: Path, user: User, *, force: bool) -> None:
    """Write the report. Raises OutputError: it already exists and ``force`` is not set, or cannot be written."""
    refuse_to_replace(path, force=force)
    with user.progress("reporting"):
        text = render_photo_report(verdict)
    write_text(path, text)
    user.say(f"wrote {path} ({len(text.encode()) / 1e6:.1f} MB)")


def refuse_to_replace(path: Path, *, force: bool) -> None:
    """Check before the photos are judged that their report can be written.

    Raises:
        OutputError: it already exists and ``force`` is not set.
    """
    if path.exists() and not force:
        raise OutputError(f"{path} already exists; use --force to overwrite it, or choose another name")


MAX_FOOTPRINTS = 400
_NEAR_M = 500.0


def photo_map_data(verdict: PhotoVerdict) -> dict[str, Any]:
    """The drawing data of a verdict on photos: the area, cells, where photos were taken, footprints of some, and gaps."""
    site = verdict.site
    west, south, east, north = site.area.bounds
    eyes = verdict.placed.eyes_m
    near = eyes[shapely.dwithin(shapely.points(eyes[:, :2]), site.area, _NEAR_M)]
    if len(near):
        west, south = min(west, near[:, 0].min()), min(south, near[:, 1].min())
        east, north = max(east, near[:, 0].max()), max(north, near[:, 1].max())
    pad_m = FIGURES.pad_m
    bounds = (float(west) - pad_m, float(south) - pad_m, float(east) + pad_m, float(north) + pad_m)
    return {
        "bounds": rounded(np.array(bounds)),
        "relief": relief_image(site.ground, bounds),
        "geodetic": geodetic_fit(site.frame, bounds),
        "area": [rounded(ring) for ring in rings_m(site.area)],
        "drawn": [rounded(ring) for ring in rings_m(area_as_drawn(site))] if site.scenario.area.margin_m > 0.0 else [],
        "fence": [], "obstacles": [], "noFly": [], "home": None, "plan": [], "planHeights": [], "sorties": [], "tracks": [],
        "violations": [], "unsafeReturns": [], "background": None,
        "cellBounds": rounded(np.array(cells_bounds_m(verdict.coverage))),
        "cells": [asdict(layer) for layer in photo_layers(verdict)],
        "pictures": {"planned": [], "flown": rounded(eyes), "unknown": 0},
        "footprints": [
            {"name": verdict.placed.photos[number].name, "ring": rounded(edge[:, :2])}
            for number, edge in footprints_m(verdict, every=footprints_drawn_every(verdict))
        ],
        "gaps": gap_data([region.gap for region in verdict.gaps]),
    }  # fmt: skip


def footprints_drawn_every(verdict: PhotoVerdict) -> int:
    """Interval of the photos whose footprints are drawn."""
    return max(1, math.ceil(len(verdict.placed.photos) / MAX_FOOTPRINTS))


def photo_layers(verdict: PhotoVerdict) -> list[CellLayer]:
    """The cell layers of a verdict on photos; layers without any known value are omitted."""
    coverage, flown = verdict.coverage, verdict.shown.coverage
    counts = PhotoCounts(verdict.shown.photos, flown.ground_sample_m, len(verdict.placed.photos), verdict.shown.looks)
    per_point, sample = photo_count_layers(coverage, counts, "flown", verdict.required)
    directions = np.where(verdict.shown.directions > 0, verdict.shown.directions.astype(float), np.nan)
    layers = [
        per_point, sample, coverage_layer(coverage, flown), gap_layer(coverage, verdict.coverage_as_required),
        ramp_layer(coverage, "directions", "Directions of the cameras", directions, "viridis", label("{:.0f}")),
        ramp_layer(coverage, "incidence", "Incidence angle", flown.incidence_deg, "magma_r", label("{:.0f}°")),
    ]  # fmt: skip
    if verdict.shown.detection is not None:
        pod = 100.0 * verdict.shown.detection.pod
        layers.append(ramp_layer(coverage, "pod", "Probability of detection", pod, "viridis", label("{:.0f} %")))
    return [layer for layer in layers if layer is not None]
