"""Quality indicators of a set of objective vectors: hypervolume and inverted generational distance."""

import numpy as np
import numpy.typing as npt

from uavcover.errors import OptimizerError
from uavcover.kernels.arrays import FloatArray
from uavcover.optimizers.ask_tell import finite_array


def hypervolume(objectives: npt.ArrayLike, reference: npt.ArrayLike) -> float:
    """The volume that a set dominates, up to the reference point; more is better.

    Exact. A sweep for 2 objectives, O(n log n); for 3 a sweep over slices of the third, O(n^2 log n), which is enough
    for fronts of hundreds of points.

    Args:
        objectives: ``(n, m)``, minimised, m = 2 or 3; rows not below the reference everywhere count for nothing.
        reference: ``(m,)``.

    Raises:
        OptimizerError: Wrong shapes, values that are not finite, or a number of objectives other than 2 and 3.

    >>> hypervolume([[1.0, 2.0], [2.0, 1.0]], [3.0, 3.0])
    3.0
    """
    points, corner = finite_array(objectives, "objectives"), finite_array(reference, "reference")
    if points.ndim != 2 or corner.shape != points.shape[1:] or len(corner) not in (2, 3):
        raise OptimizerError(f"hypervolume: shapes {points.shape} and {corner.shape}; use (n, m) and (m,), m = 2 or 3")
    inside = points[(points < corner).all(axis=1)]
    return _area(inside, corner) if len(corner) == 2 else _volume(inside, corner)


def _area(points: FloatArray, corner: FloatArray) -> float:
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    # each point adds the strip between the lowest second objective so far and its own
    floor = np.minimum.accumulate(np.concatenate([corner[1:], ordered[:, 1]]))
    return float(((corner[0] - ordered[:, 0]) * (floor[:-1] - floor[1:])).sum())


def _volume(points: FloatArray, corner: FloatArray) -> float:
    ordered = points[np.argsort(points[:, 2], kind="stable")]
    thickness = np.diff(np.concatenate([ordered[:, 2], corner[2:]]))
    slices = (_area(ordered[: i + 1, :2], corner[:2]) * h for i, h in enumerate(thickness) if h > 0)
    return float(sum(slices))


def inverted_generational_distance(reference_front: npt.ArrayLike, objectives: npt.ArrayLike) -> float:
    """Mean distance from the points of the true front to the nearest of the set (Eq. 24); less is better.

    Args:
        reference_front: ``(r, m)`` points spread over the true front.
        objectives: ``(n, m)`` the set, n >= 1.

    Raises:
        OptimizerError: Wrong shapes, an empty array, or values that are not finite.

    >>> inverted_generational_distance([[0.0, 1.0], [1.0, 0.0]], [[0.0, 1.0], [1.0, 0.5]])
    0.25
    """
    from scipy.spatial import KDTree  # a third of a second to load, and the planner's own search needs none

    front, points = finite_array(reference_front, "reference_front"), finite_array(objectives, "objectives")
    if front.ndim != 2 or points.ndim != 2 or front.shape[1] != points.shape[1] or not (front.size and points.size):
        raise OptimizerError(f"generational distance: shapes {front.shape} and {points.shape}; use (r, m), (n, m)")
    distances, _ = KDTree(points).query(front)  # Eq. 24: d(v, A) of every v
    return float(np.mean(distances))
