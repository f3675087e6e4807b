"""Probability that photos find the object, by cell and over an area."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uavcover.kernels.arrays import BoolArray, FloatArray
from uavcover.kernels.detection import Looks
from uavcover.model.detection import DetectionCurve, Independent

PERCENTILES = (5, 25, 50, 75, 95)
_FAR_FINER = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Probability that the photos find a target, in each of n cells, if it is there.

    Attributes:
        curve: of one look.
        best_look: (n,) by the best photo alone.
        by_sides: (n,) by the best photo from each side, each an independent chance.
        by_pictures: (n,) by every photo, each an independent chance.
    """

    curve: DetectionCurve
    best_look: FloatArray
    by_sides: FloatArray
    by_pictures: FloatArray

    @property
    def pod(self) -> FloatArray:
        """(n,) with the looks that the curve takes as independent."""
        by: dict[Independent, FloatArray] = {
            "none": self.best_look,
            "sides": self.by_sides,
            "pictures": self.by_pictures,
        }
        return by[self.curve.independent]


def detection_of(curve: DetectionCurve, looks: Looks) -> Detection:
    """Joint probability of looks: 1 - product of (1 - p) over the independent ones (Koopman, Search and Screening, 1946)."""
    return Detection(
        curve,
        best_look=looks.best.max(axis=1),
        by_sides=1.0 - np.prod(1.0 - looks.best, axis=1),
        by_pictures=1.0 - looks.missed,
    )


def detection_document(
    detection: Detection, drawn: BoolArray, weight_m2: FloatArray, asked: float | None
) -> dict[str, Any]:
    """The entry of ``photos.json``, over the cells of the area as drawn, including those not visible from anywhere.

    Args:
        detection: of each cell.
        drawn: (n,) which cells.
        weight_m2: (n,) their sizes.
        asked: least mean probability.
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
        "pod_every_picture": mean(detection.by_pictures),
        "pod_percentiles": {str(share): value for share, value in _percentiles(pod, weight).items()},
        "asked": asked,
        "area_below_m2": None if asked is None else float(weight[pod < asked].sum()),
        "holds": None if asked is None else reached >= asked,
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
            "provide your own (--detection FILE.toml) before relying on the probability"
        ]
    first_cm, last_cm = 100.0 * table.sample_m[[0, -1]]
    median_cm = 100.0 * float(np.median(known))
    if _FAR_FINER * median_cm < first_cm:
        return [
            f"the curve {name} begins at {first_cm:g} cm per pixel, but photos have {median_cm:.2g} cm: finer photos "
            "use this value; check that its ground_sample_m are in metres"
        ]
    if median_cm > last_cm:
        return [
            f"the curve {name} ends at {last_cm:.3g} cm per pixel, but photos have {median_cm:.2g} cm: coarser ones "
            "find nothing; check that its ground_sample_m are in metres"
        ]
    return []


def _percentiles(values: FloatArray, weight: FloatArray) -> dict[int, float]:
    """Values that these percentages of the weight do not exceed."""
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weight[order]) / weight.sum()
    places = np.minimum(np.searchsorted(reached, np.array(PERCENTILES) / 100.0), values.size - 1)
    return {share: float(values[order][place]) for share, place in zip(PERCENTILES, places, strict=True)}
