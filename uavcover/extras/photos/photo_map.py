"""What the page of a verdict on pictures draws."""

import math
from typing import Any

import numpy as np
import shapely

from uavcover.extras.photos.photo_verdict import PhotoVerdict, footprints_m
from uavcover.report.cell_layers import (
    CellLayer,
    cells_bounds_m,
    coverage_layer,
    gap_layer,
    label,
    picture_layers,
    ramp_layer,
)
from uavcover.report.map_data import PAD_M, gap_data, geodetic_fit, layer_data, relief_image, rings_of, rounded
from uavcover.scenario.site import area_as_drawn
from uavcover.sensing.pictures import PictureCounts

MAX_FOOTPRINTS = 400
_NEAR_M = 500.0


def photo_map_data(verdict: PhotoVerdict) -> dict[str, Any]:
    """The drawing data of a verdict on pictures: the area, cells, where pictures were taken, footprints of some, and gaps."""
    site = verdict.site
    west, south, east, north = site.area.bounds
    eyes = verdict.placed.eyes_m
    near = eyes[shapely.dwithin(shapely.points(eyes[:, :2]), site.area, _NEAR_M)]
    if len(near):
        west, south = min(west, near[:, 0].min()), min(south, near[:, 1].min())
        east, north = max(east, near[:, 0].max()), max(north, near[:, 1].max())
    bounds = (float(west) - PAD_M, float(south) - PAD_M, float(east) + PAD_M, float(north) + PAD_M)
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
    """Every how many pictures a footprint is drawn."""
    return max(1, math.ceil(len(verdict.placed.pictures) / MAX_FOOTPRINTS))


def photo_layers(verdict: PhotoVerdict) -> list[CellLayer]:
    """The cell layers of a verdict on pictures; layers without any known value are omitted."""
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
