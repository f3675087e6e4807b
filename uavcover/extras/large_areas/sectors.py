"""Sectors: parts of an area between two rays from home, and their flights, one for each layer.

Every flight to a distant layer passes over nearer ground twice. Here it sees something on both ways: it goes out in a strip along
one side of the sector, sees its layer in lines across, the nearest one first, and comes home in a strip along the other side,
which begins at the far end of its layer. Farther layers have the outer strips, and nearer ones see what is between them. Lines
across meet the sides at right angles or nearly so, where lines along a ray would leave gaps or overlap in proportion to the
distance from home. Where the sector is no wider than all its strips, flights see it from straight ways to home.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np
import shapely
from shapely.affinity import affine_transform

from uavcover.kernels.arrays import FloatArray
from uavcover.scenario.vehicle_areas import Piece, polygons_of

_NEAREST = 0.6
"""A flight begins and ends to see so near to home, in widths of a strip: what is nearer is seen on the way."""
_GRID_M = 1e-4
"""Corners of pieces lie on so fine a grid: between those anywhere rounding makes slivers, and these break what follows."""
_ROUNDED = 0.3
"""Share of a line across: above this remainder one more is flown."""


@dataclass(frozen=True, slots=True)
class Swath:
    """Strip that a flight covers beside it.

    Attributes:
        width_m: of the ground that one line sees.
        spacing_m: between lines across.
        inset_m: how far lines stop before the border of what they see.
    """

    width_m: float
    spacing_m: float
    inset_m: float


class Sector:
    """A sector and its layers, the first of them farthest from home.

    Attributes:
        piece: of the area, east and north metres.

    Args:
        area: that is divided.
        home_en: (east, north) of home.
        from_rad: one side, counter-clockwise from east.
        to_rad: the other side, less than pi farther.
        layers: how many.
        swath: what a flight sees.
        turned: whether flights go out along the other side.
    """

    def __init__(
        self,
        area: Piece,
        home_en: tuple[float, float],
        from_rad: float,
        to_rad: float,
        layers: int,
        swath: Swath,
        *,
        turned: bool = False,
    ) -> None:
        middle = 0.5 * (from_rad + to_rad)
        along, across = (math.cos(middle), math.sin(middle)), (-math.sin(middle), math.cos(middle))
        if turned:
            across = (-across[0], -across[1])
        # The sector's own frame: x away from home, y from the side of the ways out to that of the ways back.
        self._home, self._axes = np.array(home_en), np.array([along, across])
        shift = -self._axes @ self._home
        own = _on_grid(affine_transform(area, [*along, *across, *shift]))
        west, south, east, north = own.bounds
        self._far_m = 4.0 * (math.hypot(max(abs(west), abs(east)), max(abs(south), abs(north))) + swath.width_m)
        self._half_rad, self._layers, self._swath = 0.5 * (to_rad - from_rad), layers, swath
        ends = self._far_m * np.array([math.cos(self._half_rad), math.sin(self._half_rad)])
        tip, far = 2.0 * self._far_m, ends[1]
        self._own = _common(
            own, shapely.Polygon([(0.0, 0.0), (ends[0], -far), (tip, -far), (tip, far), (ends[0], far)])
        )
        self._strips_from_m = layers * swath.width_m / math.sin(self._half_rad)
        self.piece = self._on_map(self._own)

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing of the area in it."""
        return bool(self._own.is_empty)

    def bounds_m(self, shares: Sequence[float] | FloatArray) -> FloatArray:
        """(layers + 1,) distances from home along the axis, the smallest first, between layers with given shares of the ground.

        Args:
            shares: (layers,) of the ground, the layer farthest from home first.
        """
        nearest, _, farthest, _ = self._own.bounds
        distances = np.linspace(nearest, farthest, 65)
        below = np.array([0.0, *(self._own.intersection(self._band(nearest - 1.0, far)).area for far in distances[1:])])
        wanted = below[-1] * np.cumsum(list(shares)[::-1]) / sum(shares)
        return np.array([nearest - 1.0, *np.interp(wanted[:-1], below, distances), farthest + 1.0])

    def pieces(self, bounds_m: FloatArray) -> list[Piece]:
        """Part of the area of each layer's flight: the layer and its strips; together the sector, none twice."""
        inside = self._band(-self._far_m, self._strips_from_m)
        near, left = _common(self._own, inside), _rest(self._own, inside)
        found: list[Piece] = []
        for layer in range(1, self._layers + 1):
            own = left
            if layer < self._layers:
                inner = bounds_m[self._layers - layer]
                sides = [self._side(sign, layer) for sign in (-1.0, 1.0)]
                beyond: Piece = self._band(inner, self._far_m)
                own = _common(left, reduce(_joined, sides, beyond))
            left = _rest(left, own)
            wedges = [_common(near, self._wedge(number)) for number in (layer - 1, 2 * self._layers - layer)]
            found.append(self._on_map(reduce(_joined, wedges, own)))
        return found

    def lines(self, layer: int, bounds_m: FloatArray, *, more: int, other_end: bool) -> FloatArray:
        """(n, 2) corners on the map of the flight that sees a layer.

        Args:
            layer: from 1, the one farthest from home.
            bounds_m: of the layers.
            more: number of lines across beyond those that fit.
            other_end: whether the first line across is begun at the side of the way back.
        """
        inner, outer = bounds_m[self._layers - layer], bounds_m[self._layers - layer + 1]
        across = self._lines_across(layer, inner, outer, more)
        there = self._spoke(-1.0, layer, self._strips_from_m, inner)
        back = self._spoke(1.0, layer, self._strips_from_m, outer)[::-1]
        if len(back):
            way = back[-1] - back[0]
            inset_m = min(self._swath.inset_m, 0.5 * float(np.hypot(*way)))
            back[0] += inset_m * way / max(float(np.hypot(*way)), 1e-9)
        ordered = [line[:: 1 if (k % 2 == 0) == other_end else -1] for k, line in enumerate(across)]
        corners = np.vstack([there, *ordered, back])
        if len(corners) == 0:
            return corners
        whole = np.vstack([self._near_home(corners[0]), corners, self._near_home(corners[-1])])
        return np.asarray(whole @ self._axes + self._home)

    def _lines_across(self, layer: int, inner_m: float, outer_m: float, more: int) -> list[FloatArray]:
        """(2, 2) or (1, 2) each, from the side of the return to that of the outbound path. The nearest first."""
        ground = _common(self._own, self._band(max(inner_m, self._strips_from_m), outer_m))
        ground = _rest(ground, self._side(1.0, layer))
        if layer > 1:
            ground = _rest(ground, self._side(-1.0, layer - 1))
        if ground.is_empty:
            return []
        nearest, _, farthest, _ = ground.bounds
        count = max(1, math.ceil((farthest - nearest) / self._swath.spacing_m - _ROUNDED)) + more
        inset_m, found = self._swath.inset_m, []
        for x in nearest + (farthest - nearest) * (np.arange(count) + 0.5) / count:
            crossing = ground.intersection(shapely.LineString([(x, -self._far_m), (x, self._far_m)]))
            if crossing.is_empty:
                continue
            _, low, _, high = crossing.bounds
            ends = [high - inset_m, low + inset_m] if high - low > 2.0 * inset_m else [0.5 * (low + high)]
            found.append(np.array([(x, y) for y in ends]))
        return found

    def _spoke(self, sign: float, strip: int, near_m: float, far_m: float) -> FloatArray:
        """(2, 2) or (0, 2): near and far end of the middle of a strip, from 1 at the side, between two distances."""
        if far_m <= near_m:
            return np.empty((0, 2))
        ray, inward = self._ray(sign)
        begin = (strip - 0.5) * self._swath.width_m * inward
        inside = shapely.LineString([begin, begin + self._far_m * ray]).intersection(self._own)
        line = inside.intersection(self._band(near_m, far_m))
        if line.is_empty:
            return np.empty((0, 2))
        ends = shapely.get_coordinates(line)
        return ends[[int(np.argmin(ends[:, 0])), int(np.argmax(ends[:, 0]))]]

    def _near_home(self, corner: FloatArray) -> FloatArray:
        """Passage of a straight path between home and a corner near home inside the area; nothing without one."""
        away_m = float(np.hypot(*corner))
        place = corner * min(0.5, _NEAREST * self._swath.width_m / max(away_m, 1e-9))
        return place[None] if self._own.intersects(shapely.Point(place)) else np.empty((0, 2))

    def _ray(self, sign: float) -> tuple[FloatArray, FloatArray]:
        """The direction of a side, and that from it into the sector."""
        c, s = math.cos(self._half_rad), math.sin(self._half_rad)
        return np.array([c, sign * s]), np.array([s, -sign * c])

    def _side(self, sign: float, strips: int) -> shapely.Polygon:
        """The first strips at a side, and all beyond it."""
        ray, inward = self._ray(sign)
        line = strips * self._swath.width_m * inward + self._far_m * np.outer([-1.0, 1.0], ray)
        return shapely.Polygon([*line, *(line[::-1] - self._far_m * inward)])

    def _band(self, near_m: float, far_m: float) -> shapely.Polygon:
        """All between two distances from home along the axis."""
        return shapely.box(near_m, -self._far_m, far_m, self._far_m)

    def _wedge(self, number: int) -> shapely.Polygon:
        """One of 2 * layers equal wedges at home, from the side of the ways out."""
        width = math.tan(self._half_rad) * np.linspace(-1.0, 1.0, 2 * self._layers + 1)
        return shapely.Polygon([(0.0, 0.0), *((self._far_m, self._far_m * y) for y in width[number : number + 2])])

    def _on_map(self, own: Piece) -> Piece:
        (ax, ay), (bx, by) = self._axes
        return _on_grid(affine_transform(own, [ax, bx, ay, by, *self._home]))


def _on_grid(piece: shapely.Geometry) -> Piece:
    return polygons_of(shapely.set_precision(piece, _GRID_M))


def _common(one: Piece, other: Piece) -> Piece:
    return polygons_of(shapely.intersection(one, other, grid_size=_GRID_M))


def _rest(one: Piece, other: Piece) -> Piece:
    return polygons_of(shapely.difference(one, other, grid_size=_GRID_M))


def _joined(one: Piece, other: Piece) -> Piece:
    return polygons_of(shapely.union(one, other, grid_size=_GRID_M))


def rays_rad(
    area: Piece, home_en: tuple[float, float], begin_rad: float, extent_rad: float
) -> tuple[FloatArray, FloatArray]:
    """(k,) directions from home, and how much of the area is between the first of them and each."""
    home = np.array(home_en)
    west, south, east, north = area.bounds
    far_m = 4.0 * (math.hypot(east - west, north - south) + float(shapely.distance(area, shapely.Point(home))))
    angles = begin_rad + np.linspace(0.0, extent_rad, max(8, round(360 * extent_rad / (2.0 * math.pi))) + 1)
    ends = home + far_m * np.column_stack([np.cos(angles), np.sin(angles)])
    between = [area.intersection(shapely.Polygon([home, *pair])).area for pair in pairwise(ends)]
    return angles, np.concatenate([[0.0], np.cumsum(between)])
