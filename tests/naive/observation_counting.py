"""What every look makes of every cell, by its definition: angles as angles, lists of passes, no bounding boxes."""

import math

from tests.naive.coverage import _angle_deg, ground_sample_m, in_line_of_sight
from uavcover.kernels.sight import CONE, DISC, FRUSTUM, NOT_IN_RANGE, OBSERVED, OCCLUDED, TOO_COARSE, TOO_OBLIQUE


def angles_deg(eye, axis, centre, normal):
    """Off the axis of the camera, and against the normal of the ground."""
    to_cell = [c - e for e, c in zip(eye, centre, strict=True)]
    to_eye = [-x for x in to_cell]
    return _angle_deg(to_cell, axis), _angle_deg(to_eye, normal)


def in_photo(sight, eye, axis, top, centre):
    """By the angles to both sides of the camera's axis, in the plane of its top and in that of its right."""
    right = (
        axis[1] * top[2] - axis[2] * top[1],
        axis[2] * top[0] - axis[0] * top[2],
        axis[0] * top[1] - axis[1] * top[0],
    )
    to_cell = [c - e for e, c in zip(eye, centre, strict=True)]
    depth, across, along = (sum(x * y for x, y in zip(to_cell, each, strict=True)) for each in (axis, right, top))
    half_across, half_along = math.atan(sight.tan_half_fov), math.atan(sight.tan_half_along)
    return abs(math.atan2(across, depth)) <= half_across and abs(math.atan2(along, depth)) <= half_along


def outcome(surface, sight, eye, axis, top, centre, normal):
    if sight.kind == DISC:
        if math.dist(eye[:2], centre[:2]) > sight.reach_m:
            return NOT_IN_RANGE
    elif math.dist(eye, centre) > sight.reach_m:
        return NOT_IN_RANGE
    if sight.kind in (CONE, FRUSTUM):
        off_axis, incidence = angles_deg(eye, axis, centre, normal)
        if sight.kind == CONE and off_axis > math.degrees(math.atan(sight.tan_half_fov)):
            return NOT_IN_RANGE
        if sight.kind == FRUSTUM and not in_photo(sight, eye, axis, top, centre):
            return NOT_IN_RANGE
        if incidence > math.degrees(math.acos(sight.cos_max_incidence)):
            return TOO_OBLIQUE
        if (
            sight.sample_focal_m < math.inf
            and ground_sample_m(1.0, math.dist(eye, centre), off_axis, incidence) > sight.sample_focal_m
        ):
            return TOO_COARSE
    return OBSERVED if in_line_of_sight(surface, sight, eye, centre) else OCCLUDED


def counts(surface, sight, camera, cells, eyes, axes, tops, times):
    """A dictionary for each cell."""
    found = []
    for centre, normal in zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True):
        outcomes = [
            outcome(surface, sight, eye, axis, top, centre, normal)
            for eye, axis, top in zip(eyes.tolist(), axes.tolist(), tops.tolist(), strict=True)
        ]
        observed_by = [k for k, result in enumerate(outcomes) if result == OBSERVED]
        passes = 0
        for position, k in enumerate(observed_by):
            if position == 0 or times[k] - times[observed_by[position - 1]] > camera.pass_gap_s:
                passes += 1
        samples = []
        for k in observed_by:
            if sight.kind in (CONE, FRUSTUM):
                off_axis, incidence = angles_deg(eyes[k].tolist(), axes[k].tolist(), centre, normal)
                samples.append(ground_sample_m(camera.focal_px, math.dist(eyes[k], centre), off_axis, incidence))
        found.append(
            {
                "outcome": max(outcomes, default=NOT_IN_RANGE),
                "first": observed_by[0] if observed_by else -1,
                "passes": passes,
                "nearest": min((math.dist(eyes[k], centre) for k in observed_by), default=math.inf),
                "incidence": min(
                    (angles_deg(eyes[k].tolist(), axes[k].tolist(), centre, normal)[1] for k in observed_by),
                    default=180.0,
                ),
                "sample": min(samples, default=math.inf),
            }
        )
    return found
