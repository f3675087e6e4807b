"""Free waypoints with activation genes: the paper's encoding, for sensors that look from waypoints."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uavcover.errors import InputError
from uavcover.kernels import route as kernels
from uavcover.model.route import Route
from uavcover.planning.terrain_following import finite_heights, lay_over_terrain
from uavcover.site import Site

FloatArray = NDArray[np.float64]


class WaypointEncoding:
    """Four genes for each of ``capacity`` nodes: east, north, height, activation.

    - The height gene 0..1 is a share of what is allowed at the place: the height band cut with the sea-level limits. No
      node is ever under the ground (NOTES on section 5.2).
    - A node takes part when its activation gene is above one half; when none is, the one with the largest.
    - Order: the node nearest the reference, then always the nearest (section 2.1); "improved" shortens that by 2-opt.
    - Where the limits apply to legs, the legs are laid over the terrain, which may add waypoints between the nodes.

    Attributes:
        lower: (d,) lower bounds of the genes, d = 4 capacity.
        upper: (d,) upper bounds.
    """

    name = "waypoints"

    def __init__(
        self, site: Site, *, capacity: int, order: Literal["nearest-neighbour", "improved"], reference_m: FloatArray
    ) -> None:
        self._site = site
        self._order = order
        self._reference_m = np.asarray(reference_m, float)
        west, south, east, north = site.area.bounds
        self.lower = np.tile([west, south, 0.0, 0.0], capacity)
        self.upper = np.tile([east, north, 1.0, 1.0], capacity)

    def near(self, route: Route) -> FloatArray:
        """(d,) genes of a route's waypoints; inside the bounds, so a waypoint outside the area is moved to its border.

        Raises:
            InputError: it has more waypoints than there are nodes.
        """
        points = route.waypoints_m
        capacity = self.lower.size // 4
        if len(points) > capacity:
            raise InputError(
                f"initial: a route of {len(points)} waypoints does not fit into max_waypoints = {capacity}"
            )
        genes = self.lower.reshape(-1, 4).copy()
        low, high = allowed_band_m(self._site, points[:, :2])
        room = np.where(high > low, high - low, 1.0)
        genes[: len(points)] = np.column_stack([points[:, :2], (points[:, 2] - low) / room, np.ones(len(points))])
        return np.asarray(np.clip(genes.ravel(), self.lower, self.upper))

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        nodes = np.asarray(genes, float).reshape(-1, 4)
        active = nodes[:, 3] > 0.5
        if not active.any():
            active[np.argmax(nodes[:, 3])] = True
        places = nodes[active, :2]
        low, high = allowed_band_m(self._site, places)
        points = finite_heights(np.column_stack([places, low + nodes[active, 2] * (high - low)]))
        order = kernels.nearest_neighbour_order(points, self._reference_m)
        if self._order == "improved":
            order = kernels.two_opt(points, order)
        points = points[order]
        if self._site.scenario.limits.applies_to == "legs" and len(points) > 1:
            agl_m = self._site.ground.heights_agl_m(points)
            points = lay_over_terrain(self._site, points[:, :2], agl_m, tolerance_m=0.0)
        return Route(points)


def allowed_band_m(site: Site, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest allowed up coordinate (n,) at (n, 2) places; they may cross where nothing is allowed."""
    limits = site.scenario.limits
    low = site.ground.ups_m(places_m, limits.min_height_agl_m + limits.height_margin_m)
    high = site.ground.ups_m(places_m, limits.max_height_agl_m - limits.height_margin_m)
    if limits.min_alt_amsl_m is not None or limits.max_alt_amsl_m is not None:
        ground = site.ground.heights_m(places_m)
        sea = ground - site.alts_amsl_m(np.column_stack([places_m, ground]))
        if limits.min_alt_amsl_m is not None:
            low = np.maximum(low, limits.min_alt_amsl_m + sea)
        if limits.max_alt_amsl_m is not None:
            high = np.minimum(high, limits.max_alt_amsl_m + sea)
    return low, high
