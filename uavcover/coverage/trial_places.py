"""Places around a cell from which it might be seen, tried to find out what can be seen at all."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uavcover.coverage.sensors import flat_picture, reach_at_height_m
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import FrameCamera

_DIRECTIONS = 12
_RADII = (0.35, 0.7, 0.95)
_BAND_SHARES = (0.5, 0.0, 1.0)
_AHEAD = (0.5, 0.05, 0.95)
_ACROSS = (0.0, -0.9, 0.9)


@dataclass(frozen=True, slots=True)
class TrialPlace:
    """A place seen from the cell, and how a level vehicle heads there.

    Attributes:
        east_m: from the cell.
        north_m: from the cell.
        band_share: share 0..1 of the allowed heights above that spot.
        heading_e: east part of the heading.
        heading_n: north part.
    """

    east_m: float
    north_m: float
    band_share: float
    heading_e: float
    heading_n: float


def trial_places(scenario: Scenario) -> Iterator[TrialPlace]:
    """The places that are tried for every cell, the likeliest first.

    Right above and 36 around, each at three heights of the band. For a frame camera instead those from which flat ground at the
    cell would lie in the middle, near the corners and near the middles of the sides of the picture, for twelve headings or the
    one that the scenario says.
    """
    limits, sensor = scenario.limits, scenario.sensor
    low, high = limits.min_height_agl_m, limits.max_height_agl_m
    if isinstance(sensor, FrameCamera):
        yield from _by_picture(sensor, low, high)
        return
    reach = max(reach_at_height_m(sensor, low + share * (high - low)) for share in _BAND_SHARES)
    offsets = [(0.0, 0.0)] + [(reach * r * math.cos(a), reach * r * math.sin(a)) for r in _RADII for a in _angles_rad()]
    for (east, north), share in itertools.product(offsets, _BAND_SHARES):
        yield TrialPlace(east, north, share, 0.0, 1.0)


def _by_picture(sensor: FrameCamera, low_m: float, high_m: float) -> Iterator[TrialPlace]:
    stated = sensor.heading_deg
    headings = _angles_rad() if stated is None else [math.radians(90.0 - stated)]
    for ahead, across, share in itertools.product(_AHEAD, _ACROSS, _BAND_SHARES):
        picture = flat_picture(sensor, low_m + share * (high_m - low_m))
        if picture is None:
            continue
        forward = picture.near_m + ahead * (picture.far_m - picture.near_m)
        for angle in headings:
            he, hn = math.cos(angle), math.sin(angle)
            # The cell is ``forward`` ahead of the place and ``across`` to the right of it.
            right = across * picture.half_width_m
            yield TrialPlace(-forward * he - right * hn, -forward * hn + right * he, share, he, hn)


def _angles_rad() -> list[float]:
    return [float(a) for a in np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)]
