"""Encodings for the optimizers: the paper's free waypoints with activation genes, and swath layouts.

Free waypoints are for sensors that observe from waypoints. The genes of a swath layout are counted from a known good layout.
"""

import math
from typing import Literal

import numpy as np

from uavcover.errors import InputError
from uavcover.kernels import route as kernels
from uavcover.kernels.arrays import FloatArray, read_only
from uavcover.model.route import Route
from uavcover.planner.baselines.swaths import SwathLayout, fly_layout
from uavcover.planner.terrain_following import finite_heights, lay_over_terrain
from uavcover.scenario.site import Site


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
            raise InputError(f"initial: a route of {len(points)} waypoints exceeds max_waypoints = {capacity}")
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
        order = kernels.nearest_neighbour_order(read_only(points), read_only(self._reference_m))
        if self._order == "improved":
            order = kernels.two_opt(points, order)
        points = points[order]
        if self._site.scenario.limits.applies_to == "legs" and len(points) > 1:
            agl_m = self._site.ground.heights_agl_m(points)
            points = lay_over_terrain(self._site, points[:, :2], agl_m, tolerance_m=0.0)
        return Route(points)


def allowed_band_m(site: Site, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest allowed up coordinate (n,) at (n, 2) places; lowest exceeds highest where nothing is allowed."""
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


SPARE_LINES = 2
_WIDEST_GAP = 1.6
_FIXED = 5


class SwathEncoding:
    """Genes -1..1, all zero for the layout that the encoding is centred on.

    The dung beetle's moves are drawn to the origin of the genes (Eq. 9 and 12 to 16 multiply positions; measured in
    docs/explanation/imodbo.md), so the origin is a good layout: the tuned boustrophedon. In order: direction (a quarter turn
    either way), number of lines (up to two more or fewer), inset, tolerance, start corner; then the width of every gap
    (1 / 1.6 to 1.6 times) and the height of every line (half the band either way, inside the band by what
    the legs may leave it). Genes of lines that a layout does not have are ignored.

    Attributes:
        lower: (d,) lower bounds, all -1; d = 5 + 2 capacity + 1.
        upper: (d,) upper bounds, all 1.
    """

    name = "swaths"

    def __init__(self, site: Site, *, centre: SwathLayout) -> None:
        self._site = site
        self._centre = centre
        self._capacity = len(centre.heights_agl_m) + SPARE_LINES
        limits = site.scenario.limits
        self._low = limits.min_height_agl_m + limits.height_margin_m
        self._high = limits.max_height_agl_m - limits.height_margin_m
        size = _FIXED + 2 * self._capacity + 1
        self.lower = np.full(size, -1.0)
        self.upper = np.full(size, 1.0)

    def layout(self, genes: FloatArray) -> SwathLayout:
        """The layout of a (d,) vector of genes."""
        centre = self._centre
        lines = max(1, len(centre.heights_agl_m) + round(float(genes[1]) * SPARE_LINES))
        gaps = _WIDEST_GAP ** np.asarray(genes[_FIXED : _FIXED + lines + 1], float)
        gaps[[0, -1]] *= 0.5
        heights = np.full(lines, float(np.mean(centre.heights_agl_m)))
        heights += genes[_FIXED + self._capacity + 1 :][:lines] * 0.5 * (self._high - self._low)
        tolerance = centre.tolerance_m * 4.0 ** float(genes[3])
        # A leg that may leave its height both ways needs a tenth of the waypoints of one pressed against the ceiling.
        inner = min(tolerance, 0.25 * (self._high - self._low))
        return SwathLayout(
            angle_rad=centre.angle_rad + float(genes[0]) * 0.5 * math.pi,
            gaps=gaps,
            heights_agl_m=np.clip(heights, self._low + inner, self._high - inner),
            inset=max(0.0, centre.inset + float(genes[2])),
            tolerance_m=tolerance,
            start=(centre.start + round(2.0 * float(genes[4]))) % 4,
        )

    def decode(self, genes: FloatArray) -> Route:
        """The route of a (d,) vector of genes."""
        return fly_layout(self._site, self.layout(genes))

    def near(self, layout: SwathLayout) -> FloatArray:
        """Genes (d,) whose layout is ``layout``, a regular one, as nearly as the genes reach."""
        centre = self._centre
        genes = np.zeros(self.lower.size)
        turn = layout.angle_rad - centre.angle_rad
        quarter_turn = math.remainder(turn, math.pi)
        genes[0] = quarter_turn / (0.5 * math.pi)
        start = layout.start
        if round((turn - quarter_turn) / math.pi) % 2:
            # Half a turn further the same lines are flown from the opposite corner.
            start ^= 2 if len(layout.heights_agl_m) % 2 else 3
        genes[4] = math.remainder(start - centre.start, 4) / 2.0
        genes[1] = (len(layout.heights_agl_m) - len(centre.heights_agl_m)) / SPARE_LINES
        genes[2] = layout.inset - centre.inset
        genes[3] = math.log(layout.tolerance_m / centre.tolerance_m, 4.0)
        rise = float(np.mean(layout.heights_agl_m) - np.mean(centre.heights_agl_m))
        genes[_FIXED + self._capacity + 1 :] = rise / (0.5 * (self._high - self._low))
        return np.clip(genes, -1.0, 1.0)
