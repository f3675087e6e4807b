"""The route that closes the gaps: viewpoints in a short order, laid over the terrain, and pruned by what it sees on its way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uavcover.coverage.coverage_map import CoverageMap
from uavcover.errors import InfeasibleError
from uavcover.gap_planning.missing import MissingCells
from uavcover.gap_planning.viewpoints import cover, grid_places, inside_fence, places_around
from uavcover.kernels.sight import CONE, FRUSTUM, Sight
from uavcover.kernels.tour import order_between_ends
from uavcover.leg_checks import measure_violations
from uavcover.model.route import Route
from uavcover.planning.terrain_following import lay_over_terrain
from uavcover.site import Site

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_TOLERANCE_M = 10.0
_ROUNDS = 4
"""How often viewpoints are added for what the laid route still does not see."""
_PULLS = (1.0, 0.5, 0.2)
"""A corner is tried this far on the way to the middle of its neighbours, ..."""
_STEPS_M = (25.0, 8.0)
_DIRECTIONS = 8
"""... and this far away in each of so many directions."""
_LEAST_GAIN_M = 0.5
"""A move that saves less is not worth its evaluation."""
_MARGIN = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class ClosingRoute:
    """A route for the gaps.

    Attributes:
        route: the waypoints.
        wanted_m2: ground area that was to be seen.
        seen_m2: what the route sees of it.
    """

    route: Route
    wanted_m2: float
    seen_m2: float


def plan_closing_route(
    coverage: CoverageMap, missing: BoolArray, *, start_m: FloatArray, end_m: FloatArray, needed_m2: float | None = None
) -> ClosingRoute:
    """A short route from a start to an end that sees the missing cells.

    The sensor is taken a little narrower than it is, by the vehicle's acceptance radius, so that what is planned is also seen
    when waypoints are rounded; where that leaves cells out, the sensor as it is gets its say.

    Args:
        coverage: on the cells that results are judged on.
        missing: (cells,) what is to be seen; cells that no allowed place sees are left out of it by the caller.
        start_m: (3,) ENU, where the vehicle comes from: home, or where it is.
        end_m: (3,) ENU, where it goes to afterwards.
        needed_m2: ground area of the missing cells that is enough, the costliest parts left out; default: all that can be seen.

    Raises:
        InfeasibleError: nothing is missing, or no allowed route sees any of it.
    """
    if not missing.any():
        raise InfeasibleError("there are no gaps to close: everything that can be seen was seen")
    site = coverage.site
    builder = _Builder(site, MissingCells.of(coverage, missing), start_m, end_m)
    builder.add_viewpoints()
    if needed_m2 is not None:
        builder.drop_costly(needed_m2)
    builder.shorten()
    return builder.result()


class _Builder:
    """A route as corners on the map with wanted heights, and what it sees."""

    def __init__(self, site: Site, missing: MissingCells, start_m: FloatArray, end_m: FloatArray) -> None:
        self.site, self.missing = site, missing
        self.start_m, self.end_m = start_m, end_m
        self.corners = np.empty((0, 3))
        self.sight = missing.coverage.sight
        self.narrow = _narrower(site, self.sight)
        self.views = np.zeros((2, len(missing.weight_m2)), dtype=bool)

    @property
    def seen(self) -> BoolArray:
        """(m,) what is seen by the sensor as it is."""
        return np.asarray(self.views[1])

    def add_viewpoints(self) -> None:
        """Corners until the laid route sees all that can be seen, the narrow sensor first."""
        wanted = np.ones(len(self.missing.weight_m2), dtype=bool)
        grid = grid_places(self.site, self.missing)
        self._take(np.vstack([self.corners, cover(self.site, self.missing, grid, self.narrow, wanted)]))
        for _ in range(_ROUNDS):
            if self.seen.all():
                return
            around = places_around(self.site, self._some_unseen())
            more = cover(self.site, self.missing, around, self.sight, ~self.seen)
            if len(more) == 0:
                return
            before = self.seen.sum()
            self._take(np.vstack([self.corners, more]))
            if self.seen.sum() <= before:
                return

    def drop_costly(self, needed_m2: float) -> None:
        """Leave out the corners that save the most way for the ground they show, while enough is seen."""
        while len(self.corners) > 1:
            now_m2 = self._area_m2(self.seen)
            best, best_score = None, 0.0
            for k, saved in enumerate(self._savings()):
                if saved <= 0.0:
                    continue
                # Another order lays other legs over the terrain: what is judged is what will be flown.
                fewer = self._ordered(np.delete(self.corners, k, axis=0))
                views = self._views_with(fewer)
                left_m2 = self._area_m2(views[1])
                if left_m2 < needed_m2:
                    continue
                score = saved / max(now_m2 - left_m2, self.missing.coverage.grid.cells.size_m**2)
                if score > best_score:
                    best, best_score = (fewer, views), score
            if best is None:
                return
            self.corners, self.views = best

    def shorten(self) -> None:
        """Leave out and pull in corners while nothing is lost that is seen now, by the narrow sensor and as it is."""
        keep = self.views
        improved = True
        while improved:
            improved = False
            for k in np.argsort(-self._savings(), kind="stable"):
                if k < len(self.corners) and len(self.corners) > 1:
                    improved |= self._try(np.delete(self.corners, k, axis=0), keep)
            for k in range(len(self.corners)):
                for move in self._moves(k):
                    corners = self.corners.copy()
                    corners[k, :2] += move
                    if inside_fence(self.site, corners[k : k + 1, :2])[0] and self._try(corners, keep):
                        improved = True
                        break

    def result(self) -> ClosingRoute:
        """The route, laid over the terrain.

        Raises:
            InfeasibleError: it sees nothing.
        """
        if not self.seen.any():
            raise InfeasibleError("no allowed place sees any of the gaps; they stay open")
        return ClosingRoute(
            Route(self._laid(self.corners)), self._area_m2(np.ones_like(self.seen)), self._area_m2(self.seen)
        )

    def _moves(self, k: int) -> FloatArray:
        """(j, 2) moves of a corner that may make the way shorter."""
        around = self._with_ends()[[k, k + 2], :2]
        pulls = np.multiply.outer(_PULLS, around.mean(axis=0) - self.corners[k, :2])
        angles = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
        steps = np.multiply.outer(_STEPS_M, np.column_stack([np.cos(angles), np.sin(angles)]))
        return np.vstack([pulls, steps.reshape(-1, 2)])

    def _try(self, corners: FloatArray, keep: BoolArray) -> bool:
        """Take other corners if they make the way shorter, lose nothing of ``keep`` and break no limit anew.

        Fewer corners only need not to make it longer.
        """
        corners = self._ordered(corners)
        gain_m = self._length_m(self.corners) - self._length_m(corners)
        if not gain_m > (-_MARGIN if len(corners) < len(self.corners) else _LEAST_GAIN_M):
            return False
        views = self._views_with(corners)
        if (keep & ~views).any() or self._violation(corners) > self._violation(self.corners) + _MARGIN:
            return False
        self.corners, self.views = corners, views
        return True

    def _take(self, corners: FloatArray) -> None:
        self.corners = self._ordered(corners)
        self.views = self._views_with(self.corners)

    def _ordered(self, corners: FloatArray) -> FloatArray:
        """The corners in a short order between start and end."""
        places = np.vstack([self.start_m[:2], corners[:, :2], self.end_m[:2]])
        distance = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        return corners[order_between_ends(np.ascontiguousarray(distance))[1:-1] - 1]

    def _with_ends(self) -> FloatArray:
        return np.vstack([[*self.start_m[:2], 0.0], self.corners, [*self.end_m[:2], 0.0]])

    def _savings(self) -> FloatArray:
        """(n,) way that is saved when a corner is left out."""
        places = self._with_ends()[:, :2]
        legs = np.hypot(*np.diff(places, axis=0).T)
        return np.asarray(legs[:-1] + legs[1:] - np.hypot(*(places[2:] - places[:-2]).T))

    def _length_m(self, corners: FloatArray) -> float:
        places = np.vstack([self.start_m[:2], corners[:, :2], self.end_m[:2]])
        return float(np.hypot(*np.diff(places, axis=0).T).sum())

    def _laid(self, corners: FloatArray) -> FloatArray:
        if len(corners) == 1:
            up = self.site.ground.ups_m(corners[:, :2], corners[:, 2])
            return np.column_stack([corners[:, :2], up])
        return lay_over_terrain(self.site, corners[:, :2], corners[:, 2], tolerance_m=_TOLERANCE_M)

    def _views_with(self, corners: FloatArray) -> BoolArray:
        """(2, m) what the laid route sees: with the narrow sensor, and with the sensor as it is."""
        laid = self._laid(corners)
        return np.stack([self.missing.seen_on(laid, sight) for sight in (self.narrow, self.sight)])

    def _violation(self, corners: FloatArray) -> float:
        return measure_violations(self.site, self._laid(corners), margin_m=0.0).total

    def _some_unseen(self) -> FloatArray:
        """Some hundred of the cells that are not seen yet, evenly picked."""
        numbers = np.flatnonzero(~self.seen)
        return self.missing.cells.centre_m[numbers[:: max(1, len(numbers) // 200)]]

    def _area_m2(self, seen: BoolArray) -> float:
        return float(self.missing.weight_m2[seen].sum())


def _narrower(site: Site, sight: Sight) -> Sight:
    """The sensor with its edge drawn in by the vehicle's acceptance radius at the middle of the band."""
    limits, radius = site.scenario.limits, site.scenario.vehicle.acceptance_radius_m
    reach = max(sight.reach_m - radius, 0.5 * sight.reach_m)
    if sight.kind not in {CONE, FRUSTUM}:
        return sight._replace(reach_m=reach)
    less = radius / (0.5 * (limits.min_height_agl_m + limits.max_height_agl_m))
    return sight._replace(
        reach_m=reach,
        tan_half_fov=max(sight.tan_half_fov - less, 0.5 * sight.tan_half_fov),
        tan_half_along=max(sight.tan_half_along - less, 0.5 * sight.tan_half_along),
    )
