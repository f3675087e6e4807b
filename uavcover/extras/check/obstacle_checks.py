"""Obstacles, along every segment at its full length: beside them or above them there is room, or there is not."""

from collections.abc import Sequence

import numpy as np
import shapely

from uavcover.errors import InputError
from uavcover.extras.check.findings import CheckFinding, joined
from uavcover.extras.check.limits import Surroundings
from uavcover.extras.check.segments import FlownPath
from uavcover.extras.check.tuning import CHECKS
from uavcover.extras.check.world import World
from uavcover.kernels.arrays import FloatArray
from uavcover.model.obstacles import Obstacle, Obstacles
from uavcover.scenario.obstacles import Footprint, Prism, leg_breaches, stand_on
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground


def with_obstacles(
    ground: Ground,
    obstacles: Sequence[Obstacle],
    frame: LocalFrame,
    bounds_m: tuple[float, float, float, float],
    clearance_m: float,
    *,
    foot: Ground | None = None,
) -> tuple[Ground, tuple[Prism, ...]]:
    """Obstacles in degrees on a ground, as far as they stand within west, south, east, north.

    ``foot`` is what they stand on where a surface model lies over it.

    Raises:
        InputError: one is in another frame, or its outline crosses itself.
        TerrainError: the ground under one is unknown.
    """
    if not obstacles:
        return ground, ()
    box = shapely.box(*bounds_m)
    footprints = []
    for number, one in enumerate(obstacles):
        name = one.name or str(number)
        if not one.rings_lon_lat_deg:
            raise InputError(
                f"--obstacles: {name}: is in metres of a scenario's local frame; use longitudes and latitudes"
            )
        rings = [
            frame.enu_from_geodetic(lat, lon, frame.alt_amsl_m)[:, :2]
            for lon, lat in (np.asarray(ring, float).T for ring in one.rings_lon_lat_deg)
        ]
        polygon = shapely.Polygon(rings[0], rings[1:])
        if not polygon.is_valid:
            raise InputError(f"--obstacles: {name}: {shapely.is_valid_reason(polygon)}; draw it again")
        if box.intersects(polygon):
            footprints.append(Footprint(name, polygon, one.height_m))
    if not footprints:
        return ground, ()
    return stand_on(ground, footprints, largest_clearance_m=clearance_m, foot=foot)


def obstacle_findings(path: FlownPath, world: World, around: Surroundings) -> list[CheckFinding]:
    """Segments that come too near to an obstacle, or through it."""
    found = []
    for segment in path.distinct:
        nearest = nearest_obstacle(segment.enu_m, world, around)
        if nearest is None:
            continue
        short_m, name, place = nearest
        clearance_m = around.obstacle_clearance_m
        words = (
            f"through obstacle {name}"
            if short_m >= clearance_m
            else f"{clearance_m - short_m:.1f} m from obstacle {name}"
        )
        found.append(
            CheckFinding(
                kind="obstacle", weight="breaks", items=segment.items, by=short_m,
                unit="m", what=f"{words}; the limit is {clearance_m:g} m",
                do="fly around or over it, or allow less with --obstacle-clearance",
            ).at(world.geodetic(place))
        )  # fmt: skip
    return joined(found, _of_which)


def _of_which(found: CheckFinding) -> object:
    return found.what.split(" obstacle ")[-1]


def nearest_obstacle(points_m: FloatArray, world: World, around: Surroundings) -> tuple[float, str, FloatArray] | None:
    """Largest clearance deficit of lines (n, 3): metres, the obstacle's name, and the position; None where they keep it.

    Rows of NaN are gaps.
    """
    if not around.prisms or len(points_m) < 2:
        return None
    clearance_m = around.obstacle_clearance_m
    known = np.asarray(np.isfinite(points_m).all(axis=1))
    legs = np.flatnonzero(known[:-1] & known[1:])
    if not len(legs):
        return None
    wanted = Obstacles(clearance_beside_m=clearance_m, clearance_above_m=clearance_m)
    pairs = np.stack([points_m[legs], points_m[legs + 1]], axis=1).reshape(-1, 3)
    rows = leg_breaches(world.ground, pairs, wanted)[0::2]
    k = int(np.argmax(rows[:, 1]))
    if rows[k, 0] < 0 or rows[k, 1] <= CHECKS.clearance_tolerance_m:
        return None
    begin, end = points_m[legs[k]], points_m[legs[k] + 1]
    return float(rows[k, 1]), around.prisms[int(rows[k, 0])].footprint.name, begin + rows[k, 2] * (end - begin)
