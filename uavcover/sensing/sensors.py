"""Observations of a scenario's sensor: their distance, and views that contain its own or lie inside it."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uavcover.errors import InputError, ScenarioError
from uavcover.kernels.sight import CONE, FRUSTUM, SPHERE, Sight, horizontal_reach
from uavcover.model.scenario import Scenario
from uavcover.model.sensor import FrameCamera, Sensor
from uavcover.model.sensor_base import FlatPicture

_LEVEL = 1e-9
"""Cosine of the pitch of a camera that looks straight down."""
_DIRECTIONS = 12
_RADII = (0.35, 0.7, 0.95)
_BAND_SHARES = (0.5, 0.0, 1.0)
_AHEAD = (0.5, 0.05, 0.95)
_ACROSS = (0.0, -0.9, 0.9)
LONGEST_SPACING_M = 10.0
"""Spacing of observations along the path without a spacing in the scenario."""


def turns_with_legs(sight: Sight) -> bool:
    """Whether a sensor's view depends on the direction of the leg."""
    return sight.kind == FRUSTUM and math.isnan(sight.heading_e)


def whatever_heading(sight: Sight) -> Sight:
    """A sensor whose view contains this one's for every heading, used as a bound; itself if heading has no effect."""
    if not turns_with_legs(sight):
        return sight
    reach = horizontal_reach(sight)
    if reach >= sight.reach_m:
        return sight._replace(kind=SPHERE)
    return sight._replace(
        kind=CONE, tan_half_fov=reach / math.sqrt(sight.reach_m**2 - reach**2), sample_focal_m=math.inf
    )


def narrowed(sight: Sight, *, margin_m: float, reach_m: float) -> Sight:
    """The sensor with its range on the map reduced by ``margin_m``.

    For a camera, at the height where it reaches ``reach_m``.

    A photo loses the same angle at its bottom and its top as at its sides: the ground there is as near, or farther away.
    """
    share = max(0.1, 1.0 - margin_m / max(reach_m, 1e-9))
    if sight.kind == FRUSTUM:
        along = max(0.1 * sight.tan_half_along, sight.tan_half_along - (1.0 - share) * sight.tan_half_fov)
        return sight._replace(tan_half_fov=sight.tan_half_fov * share, tan_half_along=along)
    if sight.kind == CONE:
        return sight._replace(tan_half_fov=sight.tan_half_fov * share)
    return sight._replace(reach_m=sight.reach_m * share)


def keeping_inside(sight: Sight, margin_m: float, height_agl_m: float) -> Sight:
    """The sensor with its range, and the sides of a camera's view from a height, narrowed by a margin; at most to a half."""
    reach = max(sight.reach_m - margin_m, 0.5 * sight.reach_m)
    if sight.kind not in {CONE, FRUSTUM}:
        return sight._replace(reach_m=reach)
    less = margin_m / height_agl_m
    return sight._replace(
        reach_m=reach,
        tan_half_fov=max(sight.tan_half_fov - less, 0.5 * sight.tan_half_fov),
        tan_half_along=max(sight.tan_half_along - less, 0.5 * sight.tan_half_along),
    )


def inside_every_heading(sight: Sight) -> list[Sight]:
    """View of a frame camera straight down at any heading; of other sensors nothing."""
    if sight.kind != FRUSTUM or sight.cos_pitch > _LEVEL:
        return []
    return [sight._replace(kind=CONE, tan_half_fov=min(sight.tan_half_fov, sight.tan_half_along))]


def is_ball_or_cone(sight: Sight) -> bool:
    """Whether :mod:`uavcover.kernels.swaths` can measure the strip that a sensor sees along a line."""
    return sight.kind in {CONE, SPHERE}


_NO_FLOOR = 0.01
"""A band whose lowest footprint is at most this share of its middle one has no floor: that of a flight without a plan."""


def sample_spacing_m(scenario: Scenario) -> float:
    """Distance between two observations along the path: the stated one, or one that suits the sensor's footprint.

    Between two circles of a swath a strip of its edge is not seen. Spaced by a third of the radius, they lose 1.4 % of its width
    at the worst place and 0.5 % on average.

    Raises:
        ScenarioError: the stated distance is larger than the radius, which loses 13 % and more.
    """
    sensor = scenario.sensor
    low, high = scenario.limits.min_height_agl_m, scenario.limits.max_height_agl_m
    # A camera sees least from the lowest height of the band, a sphere from the highest, which it need not reach.
    reaches = [_half_footprint_m(sensor, height) for height in (low, 0.5 * (low + high))]
    seeing = [reach for reach in reaches if reach > _NO_FLOOR * max(reaches)]
    stated = sensor.sample_spacing_m
    if not seeing:
        return LONGEST_SPACING_M if stated is None else stated
    reach_m = min(seeing)
    if stated is None:
        return min(LONGEST_SPACING_M, reach_m / 3.0)
    if stated > reach_m and sensor.looks_along_path and trigger_distance_m(scenario) is None:
        raise ScenarioError(
            f"sensor.sample_spacing_m: {stated:g} m between observations leaves gaps, because the sensor observes only "
            f"{reach_m:.3g} m to each side; remove this key, or use at most {math.floor(100.0 * reach_m) / 100.0:g}"
        )
    return stated


def _half_footprint_m(sensor: Sensor, height_agl_m: float) -> float:
    """Half the swath width on flat ground, or half a photo's length along the path if that is shorter."""
    reach_m, picture = sensor.half_width_m(height_agl_m), sensor.flat_picture(height_agl_m)
    return reach_m if picture is None else min(reach_m, 0.5 * picture.length_m)


def trigger_distance_m(scenario: Scenario) -> float | None:
    """Distance between two photos; none when the scenario does not take photos by distance.

    Raises:
        ScenarioError: the photo shows nothing from the lowest height of the band, where it shows least.
    """
    return scenario.sensor.photo_spacing_m(scenario.limits.min_height_agl_m)


def looks_singly(scenario: Scenario) -> bool:
    """Whether the sensor looks from single places: from waypoints, or triggered by distance."""
    return not scenario.sensor.looks_along_path or trigger_distance_m(scenario) is not None


def frame_camera(sensor: Sensor, *, source: str) -> FrameCamera:
    """The sensor, which takes rectangular photos.

    Raises:
        InputError: it does not.
    """
    if isinstance(sensor, FrameCamera):
        return sensor
    raise InputError(f"{source}: the sensor is a {sensor.kind}; photos require a frame-camera")


@dataclass(frozen=True, slots=True)
class TrialPlace:
    """A position relative to a cell, with the heading of a level vehicle there.

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
    """The positions tried for every cell, the most promising first.

    Directly above and 36 positions around, each at three heights of the band. For a frame camera instead the positions from
    which flat ground at the cell would lie at the centre, near the corners and near the edges of the photo, for twelve
    headings or the one that the scenario sets.
    """
    limits, sensor = scenario.limits, scenario.sensor
    low, high = limits.min_height_agl_m, limits.max_height_agl_m
    pictures = [(share, sensor.flat_picture(low + share * (high - low))) for share in _BAND_SHARES]
    if sensor.turns_with_vehicle or sensor.heading_deg is not None:
        yield from _by_picture(sensor.heading_deg, pictures)
        return
    reach = max(sensor.half_width_m(low + share * (high - low)) for share in _BAND_SHARES)
    offsets = [(0.0, 0.0)] + [(reach * r * math.cos(a), reach * r * math.sin(a)) for r in _RADII for a in _angles_rad()]
    for (east, north), share in itertools.product(offsets, _BAND_SHARES):
        yield TrialPlace(east, north, share, 0.0, 1.0)


def _by_picture(stated: float | None, pictures: Sequence[tuple[float, FlatPicture | None]]) -> Iterator[TrialPlace]:
    headings = _angles_rad() if stated is None else [math.radians(90.0 - stated)]
    for ahead, across, (share, picture) in itertools.product(_AHEAD, _ACROSS, pictures):
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
