"""Genes of a swath layout, counted from a known good one."""

import math

import numpy as np
from numpy.typing import NDArray

from uavcover.model.route import Route
from uavcover.planning.swaths import SwathLayout, fly_layout
from uavcover.site import Site

FloatArray = NDArray[np.float64]

SPARE_LINES = 2
_WIDEST_GAP = 1.6
_FIXED = 5


class SwathEncoding:
    """Genes -1..1, all zero for the layout that the encoding is centred on.

    The dung beetle's moves are drawn to the origin of the genes (Eq. 9 and 12 to 16 multiply positions; measured in
    docs/optimizers.md), so the origin is a good layout: the tuned boustrophedon. In order: direction (a quarter turn
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
