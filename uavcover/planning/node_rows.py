"""The boustrophedon of a sensor that looks from waypoints: rows of nodes, flown back and forth."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from uavcover.coverage.sensors import reach_at_height_m
from uavcover.model.route import Route
from uavcover.planning.terrain_following import finite_heights, lay_over_terrain
from uavcover.planning.waypoint_encoding import allowed_band_m
from uavcover.site import Site


@dataclass(frozen=True, slots=True)
class NodeRows:
    """A regular lattice of nodes over the box around the area, in rows from south to north.

    Attributes:
        rows: how many.
        columns: nodes of a row.
        stagger: by how much of the distance between nodes every other row is shifted: 0, or 0.5 for a triangular lattice.
        height_share: of the allowed height band at each node, 0..1.
    """

    rows: int
    columns: int
    stagger: float
    height_share: float


def fly_rows(site: Site, layout: NodeRows) -> Route:
    """The route over a lattice; nodes outside the fence are left out."""
    west, south, east, north = site.area.bounds
    dx, dy = (east - west) / layout.columns, (north - south) / layout.rows
    places = []
    for row in range(layout.rows):
        shift = layout.stagger * (0.5 if row % 2 else -0.5)
        x = west + dx * (np.arange(layout.columns) + 0.5 + shift)
        y = np.full(layout.columns, south + dy * (row + 0.5))
        places.append(np.column_stack([x, y])[:: -1 if row % 2 else 1])
    nodes = np.vstack(places)
    low, high = allowed_band_m(site, nodes)
    points = finite_heights(np.column_stack([nodes, low + layout.height_share * (high - low)]))
    if site.scenario.limits.applies_to == "legs" and len(points) > 1:
        points = lay_over_terrain(site, points[:, :2], site.ground.heights_agl_m(points), tolerance_m=0.0)
    return Route(points)


def plain_rows(site: Site) -> NodeRows:
    """Squares that the sensor sees whole from their middle, side by side, from the middle of the height band."""
    limits = site.scenario.limits
    height = 0.5 * (limits.min_height_agl_m + limits.max_height_agl_m)
    side = math.sqrt(2.0) * max(reach_at_height_m(site.scenario.sensor, height), site.scenario.area.cell_size_m)
    west, south, east, north = site.area.bounds
    rows, columns = (max(1, math.ceil(width / side - 1e-9)) for width in (north - south, east - west))
    return NodeRows(rows, columns, 0.0, 0.5)


def scanned_rows(site: Site, *, most_nodes: int) -> Iterator[NodeRows]:
    """Every lattice of at most so many nodes, rectangular and triangular, at five heights, rows not much longer than high."""
    west, south, east, north = site.area.bounds
    aspect = (east - west) / (north - south)
    for rows in range(1, most_nodes + 1):
        for columns in range(1, most_nodes // rows + 1):
            if 0.5 <= columns / (rows * aspect) <= 2.0:
                for stagger in (0.0, 0.5):
                    for height_share in (0.0, 0.25, 0.5, 0.75, 1.0):
                        yield NodeRows(rows, columns, stagger, height_share)
