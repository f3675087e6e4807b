"""The report of a verdict on photos, as ``judge-photos --report`` writes it: one HTML file that needs no network."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from uavcover.errors import OutputError
from uavcover.extras.photos.photo_verdict import PhotoVerdict, footprints_m
from uavcover.report.cell_layers import (
    REASON_WORDS,
    CellLayer,
    cells_bounds_m,
    coverage_layer,
    gap_layer,
    label,
    picture_layers,
    ramp_layer,
)
from uavcover.report.map_data import gap_data, geodetic_fit, layer_data, relief_image, rings_of, rounded
from uavcover.report.page import map_script, rendered_page
from uavcover.report.tuning import FIGURES
from uavcover.run.folder import write_text
from uavcover.run.user import User, percent
from uavcover.scenario.site import area_as_drawn
from uavcover.sensing.pictures import PictureCounts, overlap_rule

_MAX_ROWS = 30
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
            "reason_words": REASON_WORDS,
            "drawn_every": footprints_drawn_every(verdict),
            "left_out": list(document["left_out"].items()),
            "max_rows": _MAX_ROWS,
        },
    )


def _requirements(verdict: PhotoVerdict) -> list[dict[str, Any]]:
    document = verdict.document
    rows = [
        {
            "name": "Sure coverage of visible ground",
            "asked": f"at least {percent(document['required'])}",
            "found": f"{percent(document['surely'])}; possibly {percent(document['possibly'])}",
            "holds": _HOLDS[document["coverage_holds"]],
        }
    ]
    if document["pictures_asked"] is not None:
        rule = overlap_rule(verdict.site.scenario.sensor)
        rows.append(
            {
                "name": f"Area in at least {document['pictures_asked']} photos"
                + ("" if rule is None else f" ({rule})"),
                "asked": f"at least {percent(document['overlap_required'])}",
                "found": percent(document["overlap_fraction"]),
                "holds": "yes" if document["overlap_holds"] else "NO",
            }
        )
    searched = document["detection"]
    if searched is not None:
        rows.append(
            {
                "name": f"Probability of detection, mean of the area ({searched['title']})",
                "asked": "" if searched["asked"] is None else f"at least {percent(searched['asked'])}",
                "found": f"{percent(searched['pod'])}; best photo alone {percent(searched['pod_best_look'])}, all photos "
                f"independent {percent(searched['pod_every_picture'])}",
                "holds": {None: "not required", True: "yes", False: "NO"}[searched["holds"]],
            }
        )
    return rows


def save_photo_report(verdict: PhotoVerdict, path: Path, user: User, *, force: bool) -> None:
    """Write the report.

    Raises:
        OutputError: it is there already and ``force`` was not said, or cannot be written.
    """
    refuse_to_replace(path, force=force)
    with user.progress("reporting"):
        text = render_photo_report(verdict)
    write_text(path, text)
    user.say(f"written: {path} ({len(text.encode()) / 1e6:.1f} MB)")


def refuse_to_replace(path: Path, *, force: bool) -> None:
    """See before photos are judged that their report can be written.

    Raises:
        OutputError: it is there already and ``force`` was not said.
    """
    if path.exists() and not force:
        raise OutputError(f"{path}: this file would be overwritten; use --force, or another name")


MAX_FOOTPRINTS = 400
_NEAR_M = 500.0


def photo_map_data(verdict: PhotoVerdict) -> dict[str, Any]:
    """The drawing data of a verdict on pictures: the area, cells, where photos were taken, footprints of some, and gaps."""
    site = verdict.site
    west, south, east, north = site.area.bounds
    eyes = verdict.placed.eyes_m
    near = eyes[shapely.dwithin(shapely.points(eyes[:, :2]), site.area, _NEAR_M)]
    if len(near):
        west, south = min(west, near[:, 0].min()), min(south, near[:, 1].min())
        east, north = max(east, near[:, 0].max()), max(north, near[:, 1].max())
    bounds = (
        float(west) - FIGURES.pad_m,
        float(south) - FIGURES.pad_m,
        float(east) + FIGURES.pad_m,
        float(north) + FIGURES.pad_m,
    )
    return {
        "bounds": rounded(np.array(bounds)),
        "relief": relief_image(site.ground, bounds),
        "geodetic": geodetic_fit(site.frame, bounds),
        "area": [rounded(ring) for ring in rings_of(site.area)],
        "drawn": [rounded(ring) for ring in rings_of(area_as_drawn(site))] if site.scenario.area.margin_m > 0.0 else [],
        "fence": [], "obstacles": [], "noFly": [], "home": None, "plan": [], "planHeights": [], "sorties": [], "tracks": [],
        "violations": [], "unsafeReturns": [], "background": None,
        "cellBounds": rounded(np.array(cells_bounds_m(verdict.coverage))),
        "cells": [layer_data(layer) for layer in photo_layers(verdict)],
        "pictures": {"planned": [], "flown": rounded(eyes), "unknown": 0},
        "footprints": [
            {"name": verdict.placed.pictures[number].name, "ring": rounded(edge[:, :2])}
            for number, edge in footprints_m(verdict, every=footprints_drawn_every(verdict))
        ],
        "gaps": gap_data([region.gap for region in verdict.gaps]),
    }  # fmt: skip


def footprints_drawn_every(verdict: PhotoVerdict) -> int:
    """Every how many photos a footprint is drawn."""
    return max(1, math.ceil(len(verdict.placed.pictures) / MAX_FOOTPRINTS))


def photo_layers(verdict: PhotoVerdict) -> list[CellLayer]:
    """The cell layers of a verdict on photos; layers without any known value are omitted."""
    coverage, flown = verdict.coverage, verdict.shown.coverage
    counts = PictureCounts(
        verdict.shown.pictures, flown.ground_sample_m, len(verdict.placed.pictures), verdict.shown.looks
    )
    per_point, sample = picture_layers(coverage, counts, "flown", verdict.asked)
    directions = np.where(verdict.shown.directions > 0, verdict.shown.directions.astype(float), np.nan)
    layers = [
        per_point, sample, coverage_layer(coverage, flown), gap_layer(coverage, verdict.asked_coverage),
        ramp_layer(coverage, "directions", "Directions of the cameras", directions, "viridis", label("{:.0f}")),
        ramp_layer(coverage, "incidence", "Incidence angle", flown.incidence_deg, "magma_r", label("{:.0f}°")),
    ]  # fmt: skip
    if verdict.shown.detection is not None:
        pod = 100.0 * verdict.shown.detection.pod
        layers.append(ramp_layer(coverage, "pod", "Probability of detection", pod, "viridis", label("{:.0f} %")))
    return [layer for layer in layers if layer is not None]
