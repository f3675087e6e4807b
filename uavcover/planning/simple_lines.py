"""Lines of few waypoints: flown lower, legs may leave their height by more, and the terrain needs fewer of them.

A leg that leaves the best height by 2 m follows every hill; one that may leave a lower height by 20 m crosses a valley in one
go, and sees a strip that is a seventh narrower. What that costs in length it saves several times over in mission items.
"""

import math

from uavcover.coverage.sensors import reach_at_height_m
from uavcover.model.route import Route
from uavcover.planning.balanced_lines import can_be_balanced, fly_balanced
from uavcover.planning.baselines import best_height_agl_m
from uavcover.planning.swaths import fly_layout, regular_layout, width_across_m
from uavcover.site import Site

BENT = (1 / 16, 1 / 8, 3 / 16)
STRAIGHT = (3 / 16, 1 / 4, 3 / 8, 1 / 2)
"""How far legs may leave their height, as shares of the band: of lines that bend, and of straight ones."""

_BEND = 0.8
"""How far bent lines may be laid straight on the map, as a share of how far they may leave their height."""

_LINES = {True: (1.0, 1.08), False: (1.0, 1.08, 1.2)}
"""Numbers of lines that bend, or that do not, as shares of the width of the area over that of a swath of flat ground."""

_INSET = 0.5


def simple_lines(site: Site, angle_rad: float) -> list[Route]:
    """Routes of lines in a direction, from many waypoints to few, with several numbers of lines each."""
    limits = site.scenario.limits
    band_m = limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m
    kinds = [(share, True) for share in BENT if can_be_balanced(site)] + [(share, False) for share in STRAIGHT]
    routes = []
    for share, bent in kinds:
        tolerance_m = share * band_m
        height_m = best_height_agl_m(site, tolerance_m=tolerance_m)
        swath_m = 2.0 * max(reach_at_height_m(site.scenario.sensor, height_m), site.scenario.area.cell_size_m)
        wanted = width_across_m(site, angle_rad) / swath_m
        for lines in sorted({math.ceil(more * wanted) for more in _LINES[bent]}):
            layout = regular_layout(
                angle_rad=angle_rad, lines=lines, height_agl_m=height_m, inset=_INSET, tolerance_m=tolerance_m
            )
            routes.append(
                fly_balanced(site, layout, straight_m=_BEND * tolerance_m) if bent else fly_layout(site, layout)
            )
    return routes
