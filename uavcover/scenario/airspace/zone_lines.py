"""Lines of no-fly zones in space, for displays."""

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.site import Site


def zone_lines_m(site: Site, zone: Zone, bounds_m: tuple[float, float, float, float]) -> list[FloatArray]:
    """(m, 3) lines of a no-fly zone inside the displayed bounds: rings at floor and ceiling, and vertical lines at its corners.

    Without a floor it begins at the ground; without a ceiling it is drawn up to the highest height of transits.

    Args:
        site: for ground and heights.
        zone: to draw.
        bounds_m: west, south, east, north of what is displayed.
    """
    west, south, east, north = bounds_m
    shown = zone.outline.intersection(shapely.box(west, south, east, north))
    entry, lines = zone.entry, []
    for part in shapely.get_parts(shown):
        for ring in _rings_m(part) if isinstance(part, shapely.Polygon) else ():
            places = np.asarray(
                # lines follow the ground in pieces: this number along the longer side of the display
                shapely.LineString(ring).segmentize(max(east - west, north - south) / 60).coords
            )
            ground = site.ground.heights_m(places)
            known = np.isfinite(ground)
            places, ground = places[known], ground[known]
            if len(places) < 2:
                continue
            low = _zone_end_m(site, ground, entry.floor_agl_m, entry.floor_amsl_m, np.minimum, 0.0)
            top_agl_m = site.scenario.transit_ceiling_agl_m
            high = _zone_end_m(site, ground, entry.ceiling_agl_m, entry.ceiling_amsl_m, np.maximum, top_agl_m)
            low, high = np.maximum(low, ground), np.maximum(high, ground)
            lines += [np.column_stack([places, low]), np.column_stack([places, high])]
            corners = np.flatnonzero((places[:, None] == ring[:, :2]).all(axis=2).any(axis=1))
            lines += [np.array([[*places[k], low[k]], [*places[k], high[k]]]) for k in corners]
    return lines


def _zone_end_m(
    site: Site, ground_m: FloatArray, agl_m: float | None, amsl_m: float | None, of_two: np.ufunc, default_agl_m: float
) -> FloatArray:
    """(n,) up coordinate of a floor or a ceiling above ground at these heights."""
    ends = [] if agl_m is None else [ground_m + agl_m]
    if amsl_m is not None:
        ends.append(np.full(len(ground_m), amsl_m - site.alt_amsl_offset_m))
    return np.asarray(of_two.reduce(np.array(ends or [ground_m + default_agl_m])))


def _rings_m(polygon: shapely.Polygon) -> list[FloatArray]:
    """(n, 2) positions of the outline and of the holes."""
    return [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
