"""Division of an area into parts of equal work, each with a short flight from home.

Straight cuts divide the area: a piece for n parts is cut into two pieces for n / 2 parts each, in proportion to the work. Cuts in
twelve directions and cuts through home are compared by cost: the length of the cut, because lines turn or overlap along it, and
the transit to both sides. Around home, cuts become rays, so every part begins near home. Far from home, or without one, parts
become compact.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from uavcover.kernels.arrays import FloatArray
from uavcover.planner.baselines.boustrophedon import best_height_agl_m
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import Piece, polygons_of

_DIRECTIONS = 12
_BISECTIONS = 14
_CUT_COST = 1.0
"""Metres of flight for a metre of cut: half a swath that is observed twice along it, or two turns a swath across it."""
_WEDGES = 4
"""This number of wedges around home is tried where a piece lies all around it."""


@dataclass(frozen=True, slots=True)
class FlightWork:
    """Flight work of a part."""

    swath_m: float  # width of ground that one line observes
    home_en: tuple[float, float] | None = None  # (east, north) of the take-off position, None without one

    def transit_m(self, piece: Piece) -> float:
        """Length of the transit between home and a piece, up to where the piece is as wide as a swath. 0 without a home."""
        if self.home_en is None:
            return 0.0
        room = piece.buffer(-0.5 * self.swath_m)
        target = piece if room.is_empty else room
        away_m = float(shapely.distance(target, shapely.Point(self.home_en)))
        return 2.0 * max(0.0, away_m - 0.5 * self.swath_m)

    def of(self, piece: Piece, parts: int) -> float:
        """Metres of flight to cover a piece in ``parts`` flights."""
        return float(piece.area) / self.swath_m + parts * self.transit_m(piece)


def flight_work(site: Site) -> FlightWork:
    """Flight work over a site, for its division."""
    scenario = site.scenario
    reach_m = scenario.sensor.half_width_m(best_height_agl_m(site))
    return FlightWork(
        swath_m=2.0 * max(reach_m, scenario.area.cell_size_m),
        home_en=None if site.home_m is None else (float(site.home_m[0]), float(site.home_m[1])),
    )


def divide(area: Piece, count: int, work: FlightWork, fractions: Sequence[float] | None = None) -> list[Piece]:
    """Divide an area into parts of equal work, or of work in given proportions.

    Args:
        area: east, north metres; may have holes and several polygons.
        count: number of parts, at least 1.
        work: cost of flights.
        fractions: (count,) of the work, in any unit, above 0; default: equal ones.

    Returns:
        (count,) parts that cover the area without overlap, in the order of the cuts.
    """
    if count == 1:
        return [area]
    first = count // 2
    amounts = [1.0] * count if fractions is None else list(fractions)
    wanted = sum(amounts[:first]), sum(amounts[first:])
    best: tuple[float, Piece, Piece] | None = None
    for one, other, cut_m in _cuts(area, first, count - first, work, wanted):
        if one.is_empty or other.is_empty:
            continue
        cost = _CUT_COST * cut_m + first * work.transit_m(one) + (count - first) * work.transit_m(other)
        if best is None or cost < best[0] - 1e-6:
            best = cost, one, other
    if best is None:
        return [area]
    return divide(best[1], first, work, amounts[:first]) + divide(best[2], count - first, work, amounts[first:])


def _cuts(
    piece: Piece, first: int, second: int, work: FlightWork, wanted: tuple[float, float]
) -> Iterator[tuple[Piece, Piece, float]]:
    """Both sides of each candidate cut, and its length inside the piece."""
    west, south, east, north = piece.bounds
    middle = np.array([0.5 * (west + east), 0.5 * (south + north)])
    reach_m = math.hypot(east - west, north - south) + 1.0
    if work.home_en is not None:
        home = np.array(work.home_en)
        far_m = reach_m + float(np.hypot(*(middle - home)))
        for begin in range(_WEDGES):
            # Between two rays from home; the first one lies, the second one turns until the work is shared.
            angle = _begin_rad(piece, home) + begin * 2.0 * math.pi / _WEDGES

            def wedge(fraction: float, angle: float = angle) -> shapely.Geometry:
                return _wedge(home, angle, fraction * 2.0 * math.pi, far_m)

            yield _balanced(piece, first, second, work, wanted, wedge)
            if not piece.contains(shapely.Point(home)):
                break
    for k in range(_DIRECTIONS):
        angle = k * math.pi / _DIRECTIONS
        along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])

        def half(fraction: float, along: FloatArray = along, across: FloatArray = across) -> shapely.Polygon:
            low = middle - reach_m * along - reach_m * across
            return shapely.Polygon(
                [low, low + 2.0 * reach_m * along, *(
                    low + end * 2.0 * reach_m * along + fraction * 2.0 * reach_m * across for end in (1.0, 0.0)
                )]
            )  # fmt: skip

        yield _balanced(piece, first, second, work, wanted, half)


def _begin_rad(piece: Piece, home: FloatArray) -> float:
    """First direction of a ray around home: in the widest gap between corners, or at the first corner."""
    corners = shapely.get_coordinates(piece) - home
    corners = corners[np.hypot(*corners.T) > 1e-6]
    angles = np.sort(np.arctan2(corners[:, 1], corners[:, 0]))
    gaps = np.diff(np.append(angles, angles[0] + 2.0 * math.pi))
    return float(angles[(int(np.argmax(gaps)) + 1) % len(angles)]) - 1e-9


def _wedge(home: FloatArray, begin_rad: float, turn_rad: float, far_m: float) -> shapely.Geometry:
    """All within ``far_m`` of home between two rays, counter-clockwise."""
    angles = begin_rad + np.linspace(0.0, turn_rad, max(2, math.ceil(turn_rad / 0.5) + 1))
    # Chords of half a radian stay beyond far_m when their ends are a little farther away.
    rim = home + 1.1 * far_m * np.column_stack([np.cos(angles), np.sin(angles)])
    # Nearly a full turn touches itself.
    return shapely.make_valid(shapely.Polygon([home, *rim]))


def _balanced(
    piece: Piece,
    first: int,
    second: int,
    work: FlightWork,
    wanted: tuple[float, float],
    side: Callable[[float], shapely.Geometry],
) -> tuple[Piece, Piece, float]:
    """The cut that divides the work in proportion."""
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        fraction = 0.5 * (low + high)
        one = polygons_of(piece.intersection(side(fraction)))
        other = polygons_of(piece.difference(side(fraction)))
        if one.is_empty or (
            not other.is_empty and work.of(one, first) / wanted[0] < work.of(other, second) / wanted[1]
        ):
            low = fraction
        else:
            high = fraction
    cut_m = 0.5 * (one.length + other.length - piece.length)
    return one, other, cut_m
