"""What every look makes of every cell, by its definition: angles as angles, lists of passes, no bounding boxes."""

import math

from tests.naive.coverage import _angle_deg, in_line_of_sight
from uavcover.kernels.coverage import CONE, DISC
from uavcover.kernels.tally import NOT_IN_RANGE, OCCLUDED, SEEN, TOO_OBLIQUE


def angles_deg(eye, axis, centre, normal):
    """Off the axis of the camera, and against the normal of the ground."""
    to_cell = [c - e for e, c in zip(eye, centre, strict=True)]
    to_eye = [-x for x in to_cell]
    return _angle_deg(to_cell, axis), _angle_deg(to_eye, normal)


def outcome(surface, sight, eye, axis, centre, normal):
    if sight.kind == DISC:
        if math.dist(eye[:2], centre[:2]) > sight.reach_m:
            return NOT_IN_RANGE
    elif math.dist(eye, centre) > sight.reach_m:
        return NOT_IN_RANGE
    if sight.kind == CONE:
        off_axis, incidence = angles_deg(eye, axis, centre, normal)
        if off_axis > math.degrees(math.atan(sight.tan_half_fov)):
            return NOT_IN_RANGE
        if incidence > math.degrees(math.acos(sight.cos_max_incidence)):
            return TOO_OBLIQUE
    return SEEN if in_line_of_sight(surface, sight, eye, centre) else OCCLUDED


def tally(surface, sight, camera, cells, eyes, axes, times):
    """A dictionary for each cell."""
    found = []
    for centre, normal in zip(cells.centre_m.tolist(), cells.normal.tolist(), strict=True):
        outcomes = [
            outcome(surface, sight, eye, axis, centre, normal)
            for eye, axis in zip(eyes.tolist(), axes.tolist(), strict=True)
        ]
        seen_by = [k for k, result in enumerate(outcomes) if result == SEEN]
        passes = 0
        for position, k in enumerate(seen_by):
            if position == 0 or times[k] - times[seen_by[position - 1]] > camera.pass_gap_s:
                passes += 1
        samples = []
        for k in seen_by:
            if sight.kind == CONE:
                off_axis, incidence = angles_deg(eyes[k].tolist(), axes[k].tolist(), centre, normal)
                # A pixel's solid angle cos^3 / f^2, spread over ground at that distance and incidence.
                solid = math.cos(math.radians(off_axis)) ** 3 / camera.focal_px**2
                area = math.dist(eyes[k], centre) ** 2 * solid / math.cos(math.radians(incidence))
                samples.append(math.sqrt(area))
        found.append(
            {
                "outcome": max(outcomes, default=NOT_IN_RANGE),
                "first": seen_by[0] if seen_by else -1,
                "passes": passes,
                "nearest": min((math.dist(eyes[k], centre) for k in seen_by), default=math.inf),
                "incidence": min(
                    (angles_deg(eyes[k].tolist(), axes[k].tolist(), centre, normal)[1] for k in seen_by), default=180.0
                ),
                "sample": min(samples, default=math.inf),
            }
        )
    return found
