"""Evaluate placed photos on an area: their number, sides, resolution and certainty, and reasons for gaps."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavcover.extras.photos.placing import LocatedPhotos
from uavcover.kernels import observation_counting as kernels
from uavcover.kernels.arrays import BoolArray, FloatArray, IntArray
from uavcover.kernels.coverage import Looks
from uavcover.kernels.observation_counting import Camera, ObservationCounts, SensorPoses
from uavcover.kernels.sight import OBSERVED, TOO_COARSE, LocalSlopes, Sight, local_slopes
from uavcover.new.catalog import DetectionCurve, Independent
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.sensing.photos import look_distance_m, looks_of
from uavcover.sensing.sensors import add_observations
from uavcover.verification.flown_coverage import FlownCoverage

# Probability that photos find the object, by cell and over an area.

PERCENTILES = (5, 25, 50, 75, 95)
_FAR_FINER = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Probability that the photos find a target in each of n cells."""

    curve: DetectionCurve  # of one look
    best_look: FloatArray  # (n,) by the best photo alone
    by_sides: FloatArray  # (n,) by the best photo from each side, each an independent chance
    by_photos: FloatArray  # (n,) by every photo, each an independent chance

    @property
    def pod(self) -> FloatArray:
        """(n,) with the looks that the curve takes as independent."""
        by: dict[Independent, FloatArray] = {
            "none": self.best_look,
            "sides": self.by_sides,
            "pictures": self.by_photos,
        }
        return by[self.curve.independent]


def detection_of(curve: DetectionCurve, looks: Looks) -> Detection:
    """Joint probability of looks: 1 - product of (1 - p) over the independent ones (Koopman, Search and Screening, 1946)."""
    return Detection(
        curve,
        best_look=looks.best.max(axis=1),
        by_sides=1.0 - np.prod(1.0 - looks.best, axis=1),
        by_photos=1.0 - looks.missed,
    )


def detection_document(
    detection: Detection, drawn: BoolArray, weight_m2: FloatArray, required: float | None
) -> dict[str, Any]:
    """The entry of ``photos.json``, over the cells of the area as drawn, including those not visible from anywhere.

    Args:
        detection: of each cell.
        drawn: (n,) which cells.
        weight_m2: (n,) their sizes.
        required: least mean probability.
    """
    weight = weight_m2[drawn]

    def mean(pod: FloatArray) -> float:
        return float((pod[drawn] * weight).sum() / weight.sum())

    pod = detection.pod[drawn]
    reached = mean(detection.pod)
    return {
        "curve": detection.curve.name,
        "title": detection.curve.title,
        "source": detection.curve.source,
        "independent": detection.curve.independent,
        "pod": reached,
        "pod_best_look": mean(detection.best_look),
        "pod_every_picture": mean(detection.by_photos),
        "pod_percentiles": {str(fraction): value for fraction, value in _percentiles(pod, weight).items()},
        "asked": required,
        "area_below_m2": None if required is None else float(weight[pod < required].sum()),
        "holds": None if required is None else reached >= required,
    }


def detection_doubts(detection: Detection, sample_m: FloatArray) -> list[str]:
    """Questions to the user about a curve that is for other photos.

    Args:
        detection: with the curve.
        sample_m: (n,) best ground sample distances, NaN where a cell is not shown.
    """
    known = sample_m[np.isfinite(sample_m)]
    table, name = detection.curve.table, detection.curve.name
    if not known.size:
        return []
    if detection.curve.is_example:
        return [
            f"the curve {name} is a rule of thumb that was not measured with this camera, observer and ground; "
            "provide your own curve (--detection FILE.toml) before you rely on the probability"
        ]
    first_cm, last_cm = 100.0 * table.sample_m[[0, -1]]
    median_cm = 100.0 * float(np.median(known))
    if _FAR_FINER * median_cm < first_cm:
        return [
            f"the curve {name} begins at {first_cm:g} cm per pixel, but photos have {median_cm:.2g} cm: finer photos "
            "use the curve's first value; check that ground_sample_m is in metres"
        ]
    if median_cm > last_cm:
        return [
            f"the curve {name} ends at {last_cm:.3g} cm per pixel, but photos have {median_cm:.2g} cm: coarser "
            "photos detect nothing; check that ground_sample_m is in metres"
        ]
    return []


def _percentiles(values: FloatArray, weight: FloatArray) -> dict[int, float]:
    """Values that these percentages of the weight do not exceed."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weight[order]) / weight.sum()
    positions = np.minimum(np.searchsorted(reached, np.array(PERCENTILES) / 100.0), values.size - 1)
    return {fraction: float(values[order][position]) for fraction, position in zip(PERCENTILES, positions, strict=True)}


DIRECTIONS = ("down", "north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_DOWN_WITHIN_DEG = 20.0
"""A camera within this of the vertical looks down, others towards one of eight points of the compass."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownCells:
    """Photos of each of the n cells of a map.

    The whole photo counts, hidden ground does not.

    How coarse a photo is does not matter for how many there are, as :mod:`uavcover.sensing.photos` counts them.
    """

    # (n,) how many looks show it, measurements taken as exact, however coarse; photos from one place are one look
    photos: NDArray[np.int32]
    looks: int  # how many looks the photos are
    directions: NDArray[np.int32]  # (n,) into how many of ``DIRECTIONS`` their cameras looked
    # (n,) each: seen by a photo as finely as the sensor has to, surely, possibly, how closely, and the best outcome of
    # any photo
    coverage: FlownCoverage
    # how probably they find what is searched for, by the photos that are as fine as the sensor has to be; None where there is no
    # search
    detection: Detection | None = None

    def enough(self, needed: int) -> BoolArray:
        """(n,) cells that are observed, and in the required number of photos."""
        return self.coverage.observed & (self.photos >= needed)


def shown_cells(coverage: CoverageMap, placed: LocatedPhotos, curve: DetectionCurve | None = None) -> ShownCells:
    """Count photos by cell, and with a curve how probably they find what is searched for.

    A cell is surely seen when some photo shows it wherever within its errors the camera was and however within them it looked.
    How finely it is shown, and what looks find, is taken as measured.
    """
    slopes = local_slopes(coverage.site.ground.surface)
    steepest = float(slopes.steepest[np.isfinite(slopes.steepest)].max(initial=0.0))
    count = coverage.grid.count
    finely: ObservationCounts = kernels.no_observations(count, searched=curve is not None)
    anyhow: ObservationCounts = kernels.no_observations(count)
    however_coarse = coverage.sight._replace(sample_focal_m=np.inf)
    by_direction = np.zeros(count, dtype=np.int32)
    errors = np.column_stack([placed.horizontal_m, placed.vertical_m, placed.turn_deg])
    direction = looking_towards(placed.axes)
    taken = 0
    exact = Camera(
        focal_px=coverage.site.scenario.sensor.focal_px,
        pass_gap_s=-1.0,  # every photo counts
        offset_m=0.0,
        horizontal_m=0.0,
        lift_m=0.0,
        turn_rad=0.0,
    )
    searching = exact if curve is None else exact._replace(detection=curve.table)
    for towards in np.unique(direction):
        before = anyhow.passes.copy()
        for row in np.unique(errors[direction == towards], axis=0):
            chosen = (direction == towards) & (errors == row).all(axis=1)
            horizontal, vertical = float(row[0]), float(row[1]) + coverage.site.vertical_uncertainty_m
            uncertain = exact._replace(
                offset_m=float(np.hypot(horizontal, vertical)),
                horizontal_m=horizontal,
                lift_m=vertical + horizontal * steepest,
                turn_rad=float(np.radians(row[2])),
            )
            numbers = taken + np.arange(int(chosen.sum()), dtype=float)
            taken += numbers.size
            poses = _poses(placed, chosen, numbers)
            _add(coverage, slopes, coverage.sight, searching, poses, finely)
            _add(coverage, slopes, however_coarse, uncertain, poses, anyhow)
        by_direction += anyhow.passes > before
    detection = None if curve is None else detection_of(curve, finely.looks)
    closer_m = look_distance_m(coverage.site.scenario, placed.horizontal_m)
    looks = looks_of(placed.eyes_m, placed.axes, closer_m, [photo.capture_id for photo in placed.photos])
    number, photos = int(looks.max(initial=-1)) + 1, anyhow.passes
    if number < len(looks):
        by_look: ObservationCounts = kernels.no_observations(count)
        order = np.argsort(looks, kind="stable")
        _add(
            coverage, slopes, however_coarse, exact._replace(pass_gap_s=0.0),
            _poses(placed, order, looks[order].astype(float)), by_look,
        )  # fmt: skip
        photos = by_look.passes
    return ShownCells(photos, number, by_direction, _coverage(finely, anyhow), detection)


def looking_towards(axes: FloatArray) -> IntArray:
    """(n,) numbers in ``DIRECTIONS`` of (n, 3) viewing directions.

    >>> looking_towards(np.array([[0.0, 0.0, -1.0], [0.0, 0.7, -0.7], [-0.7, 0.0, -0.7]])).tolist()
    [0, 1, 7]
    """
    octant = np.round(np.degrees(np.arctan2(axes[:, 0], axes[:, 1])) / 45.0).astype(np.int64) % 8
    down = -axes[:, 2] >= np.cos(np.radians(_DOWN_WITHIN_DEG))
    return np.where(down, 0, 1 + octant)


def _poses(placed: LocatedPhotos, chosen: BoolArray | IntArray, numbers: FloatArray) -> SensorPoses:
    return SensorPoses(
        np.ascontiguousarray(placed.eyes_m[chosen]), np.ascontiguousarray(placed.axes[chosen]),
        np.ascontiguousarray(placed.tops[chosen]), numbers,
    )  # fmt: skip


def _add(
    coverage: CoverageMap,
    slopes: LocalSlopes,
    sight: Sight,
    camera: Camera,
    poses: SensorPoses,
    counts: ObservationCounts,
) -> None:
    add_observations(coverage.site, slopes, sight, camera, coverage.grid.cells, poses, counts)


def _coverage(counts: ObservationCounts, anyhow: ObservationCounts) -> FlownCoverage:
    observed = counts.passes > 0
    none = np.full(observed.size, np.nan)
    return FlownCoverage(
        observed=observed,
        certain_cells=observed & (anyhow.sure > 0),
        possible_cells=observed | ((anyhow.possible > 0) & (counts.outcome != TOO_COARSE)),
        possible_by_attitude=np.zeros(observed.size, dtype=bool),
        first_observed_s=none,
        passes=counts.passes,
        nearest_m=np.where(np.isfinite(counts.nearest_m), counts.nearest_m, np.nan),
        ground_sample_m=np.where(np.isfinite(counts.ground_sample_m), counts.ground_sample_m, np.nan),
        incidence_deg=np.where(observed, np.degrees(np.arccos(np.clip(counts.cos_incidence, -1.0, 1.0))), np.nan),
        outcome=np.where(observed, OBSERVED, counts.outcome).astype(np.uint8),
    )
