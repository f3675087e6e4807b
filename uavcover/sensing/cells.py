"""The cell grid of the area."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from uavcover.errors import ScenarioError, TerrainError
from uavcover.kernels.arrays import FloatArray
from uavcover.kernels.cells import NO_RISE, Cells
from uavcover.kernels.horizon import rises
from uavcover.kernels.obstacles import horizons
from uavcover.kernels.sight import RAY, widest_tangent
from uavcover.kernels.skyline import NO_SKYLINES, skylines
from uavcover.model.area import RasterTerrain, SineCosineTerrain
from uavcover.scenario.site import Site, once
from uavcover.sensing.sensors import sight_for_cells
from uavcover.terrain.ground import Ground

MOST_POSITIONS = 160_000
"""This number is enough for any ground."""

_PROBED = 10_000

MAX_CELLS = 16_000_000
_MOST_RISES = 1_300_000
"""With more cells rays are traced without :func:`uavcover.kernels.horizon.rises`, which takes most of the memory of a cell."""

_SCATTERED = 0.5 * (math.sqrt(5.0) - 1.0), math.sqrt(2.0) - 1.0
_SAMPLED = math.sqrt(3.0) - 1.0, math.sqrt(7.0) - 2.0
_OTHER = math.sqrt(11.0) - 3.0, math.sqrt(13.0) - 3.0
"""Shifts from row to row and from column to column, in cells.

The steps differ, because equal ones would align many positions at 45 degrees. The evaluation, the search and the final test
sample different positions.
"""


@dataclass(frozen=True, eq=False)
class CellGrid:
    """The cells of an area.

    Attributes:
        cells: lattice, centres and normals.
        weight_m2: (n,) area of the ground in each cell: side^2 sqrt(1 + zx^2 + zy^2), slopes at the centre (LIMITS, Eq. 1); of
            the roof of an obstacle.
        hidden_m2: area of the ground that the surface model hides; it belongs to no cell and counts as unobserved.
    """

    cells: Cells
    weight_m2: NDArray[np.float64]
    hidden_m2: float = 0.0

    @property
    def middles_m(self) -> FloatArray:
        """(n, 2) east and north of the middles of the cells' squares on the map, for any representative point."""
        cells = self.cells
        row, column = np.nonzero(cells.lattice >= 0)
        out = np.empty((self.count, 2))
        out[cells.lattice[row, column]] = np.column_stack([
            cells.east0_m + column * cells.size_m, cells.north0_m + row * cells.size_m
        ])  # fmt: skip
        return out

    @property
    def size_m(self) -> float:
        """Side of a cell."""
        return self.cells.size_m

    @property
    def count(self) -> int:
        """Number of cells."""
        return int(self.weight_m2.size)

    def fraction(self, observed: NDArray[np.bool_]) -> float:
        """Fraction of the ground area in the cells marked in ``observed`` (n,), 0..1 (Eq. 1)."""
        return float(self.weight_m2[observed].sum() / self.area_m2)

    @property
    def area_m2(self) -> float:
        """Ground of the whole area, including hidden ground."""
        return float(self.weight_m2.sum()) + self.hidden_m2

    @property
    def hidden_fraction(self) -> float:
        """Fraction of the ground that trees and roofs of the surface model hide, 0..1."""
        return self.hidden_m2 / self.area_m2


def lattice_shape(site: Site, cell_size_m: float) -> tuple[int, int]:
    """Rows and columns of the lattice of an area's cells."""
    west, south, east, north = site.area.bounds
    rows, columns = (max(1, math.ceil(side_m / cell_size_m - 1e-9)) for side_m in (north - south, east - west))
    return rows, columns


def make_cells(site: Site, cell_size_m: float, *, rows: range | None = None) -> CellGrid:
    """Divide the area of a site into square cells. A cell belongs to the area if its centre does.

    Args:
        site: the scenario on its ground.
        cell_size_m: side of a cell.
        rows: consecutive rows of the lattice; None: all. Each cell is the same as among all.

    Raises:
        ScenarioError: no cell, or too many.
        TerrainError: the area extends beyond the elevation data, or into a part without data.
    """
    return _cut(site, cell_size_m, rows=rows)


def cut_for(site: Site) -> Callable[..., CellGrid]:
    """Cells of the evaluation grid. The paper's surface has no pixels, and its cells are their centres."""
    if site.targets_m is not None:
        return make_targets
    return make_cells if isinstance(site.scenario.terrain, SineCosineTerrain) else make_sampled_cells


def make_sampled_cells(site: Site, cell_size_m: float, *, rows: range | None = None) -> CellGrid:
    """Divide the area in the same way, but represent each cell by another point inside it.

    Elevation files are lattices, too. If cells are as large as pixels, all centres have the same position in their pixels, such
    as the foot or the top of a wall. On terraces, this changed the coverage by two points.
    """
    return _cut(site, cell_size_m, steps=_SAMPLED, rows=rows)


def make_targets(site: Site, _cell_size_m: float, *, rows: range | None = None) -> CellGrid:  # noqa: ARG001
    """A cell of weight 1 for each target, in the nearest free square of a lattice with four times that number."""
    targets = np.empty((0, 2)) if site.targets_m is None else site.targets_m
    corner = targets.min(axis=0)
    sides = np.maximum(np.ptp(targets, axis=0), 1e-3)
    size_m = float(max(math.sqrt(sides.prod() / (4.0 * len(targets))), sides.max() / (4.0 * len(targets))))
    columns, rows_ = (math.ceil(side / size_m) + 1 for side in sides)
    squares = corner + size_m * np.stack(np.meshgrid(np.arange(columns), np.arange(rows_)), axis=-1)
    free, lattice = np.zeros((rows_, columns)), np.full((rows_, columns), -1, dtype=np.int32)
    scatter2 = 0.0
    for number, target in enumerate(targets):
        apart2 = ((squares - target) ** 2).sum(axis=-1) + free
        at = np.unravel_index(int(np.argmin(apart2)), free.shape)
        lattice[at], free[at], scatter2 = number, np.inf, max(scatter2, float(apart2[at]))
    centre = np.column_stack([targets, site.ground.heights_m(targets)])
    if not np.isfinite(centre).all():
        raise TerrainError("targets: some targets have no elevation; use elevation data that covers all of them")
    normal = np.tile([0.0, 0.0, 1.0], (len(targets), 1))
    arrays = lattice, centre, normal, np.zeros(len(targets)), np.ones(len(targets))
    for array in arrays:
        array.flags.writeable = False
    cells = Cells(float(corner[0]), float(corner[1]), size_m, *arrays[:4], math.sqrt(scatter2))
    return CellGrid(cells, arrays[4])


def make_other_cells(site: Site, cell_size_m: float) -> CellGrid:
    """As :func:`make_sampled_cells`, with other positions, and for a few routes: see :func:`with_rises`."""
    return _cut(site, cell_size_m, steps=_OTHER, rising=False)


def make_refined_cells(site: Site, cell_size_m: float) -> CellGrid:
    """Divide the area into cells of half the size of the evaluation grid.

    In each larger cell, one of the four has the same point, so a route that observes all small cells observes all large ones.
    """
    steps = (0.0, 0.0) if cut_for(site) is make_cells else _SAMPLED
    return _cut(site, cell_size_m, steps=steps, spread=_spread_of_halves)


def make_scattered_cells(site: Site, cell_size_m: float) -> CellGrid:
    """Divide the area in the same way, but represent each cell by a point that shifts between rows and columns.

    An unobserved strip between two columns of cell centres, up to one cell wide, would not be noticed, and a search would exploit
    it. Here, each row and column is shifted along itself by an irrational fraction of a cell more than the previous one, so that
    a line in any direction passes points at all distances.
    """
    return _cut(site, cell_size_m, steps=_SCATTERED)


def _cut(
    site: Site,
    cell_size_m: float,
    *,
    steps: tuple[float, float] | None = None,
    rows: range | None = None,
    spread: Callable[[int, float], FloatArray] | None = None,
    rising: bool = True,
) -> CellGrid:
    """The cells, with positions shifted by up to half a cell each way, in these steps. None: they are the centres.

    ``spread`` makes the positions from the steps; by default they are independent of other cells' positions. ``rising``: as
    :func:`with_rises`.
    """
    west, south, east, north = site.area.bounds
    all_rows, columns = lattice_shape(site, cell_size_m)
    wanted = range(all_rows) if rows is None else rows
    if len(wanted) * columns > MAX_CELLS:
        raise ScenarioError(
            f"area.cell_size_m: {cell_size_m:g} m divides {east - west:.0f} x {north - south:.0f} m into "
            f"{all_rows * columns:,} cells, but the limit is {MAX_CELLS:,}; use larger cells (in metres, not degrees)"
        )
    east0_m, north0_m = float(west + 0.5 * cell_size_m), float(south + (wanted.start + 0.5) * cell_size_m)
    e = west + (np.arange(columns) + 0.5) * cell_size_m
    n = south + (np.arange(wanted.start, wanted.stop) + 0.5) * cell_size_m
    grid_e, grid_n = np.meshgrid(e, n)
    if steps is not None:
        spread = spread or _spread
        grid_e += cell_size_m * spread(all_rows, steps[0])[wanted.start : wanted.stop, None]
        grid_n += cell_size_m * spread(columns, steps[1])
    inside = np.asarray(shapely.contains_xy(site.area, grid_e, grid_n))
    if rows is None and not inside.any():
        raise ScenarioError(f"area.cell_size_m: no {cell_size_m:g} m cell is centred in the area; use smaller cells")
    inside, hidden_m2 = _without_hidden(site, grid_e, grid_n, inside, cell_size_m, rows)
    if rows is None and not inside.any():
        raise ScenarioError(
            f"terrain.surface_file: all ground in the area lies more than surface_hides_m = {_hides_m(site):g} m "
            "below the surface and cannot be observed from the air; for the tree tops, use the surface model as "
            "terrain.file"
        )
    index = np.full(inside.shape, -1, dtype=np.int32)
    index[inside] = np.arange(int(inside.sum()), dtype=np.int32)
    positions = np.column_stack([grid_e[inside], grid_n[inside]])
    del grid_e, grid_n
    up = site.ground.heights_m(positions)
    slopes = site.ground.gradients(positions)
    if not (np.isfinite(up).all() and np.isfinite(slopes).all()):
        raise TerrainError(_missing(site, site.ground, positions, ~np.isfinite(up), rows))
    # The ground under an obstacle cannot be observed: there the cell is part of its flat roof.
    roof = site.ground.roofs_m(positions)
    up = np.maximum(up, roof)
    slopes[np.isfinite(roof)] = 0.0
    steepness = np.sqrt(1.0 + (slopes**2).sum(axis=1))
    centre = np.column_stack([positions, up])
    normal = np.column_stack([-slopes, np.ones(len(positions))]) / steepness[:, None]
    weight = cell_size_m**2 * steepness
    scatter_m = 0.0 if steps is None else cell_size_m * math.sqrt(0.5)
    obstacles, reach_m = site.ground.surface.obstacles, site.scenario.sensor.reach_m + scatter_m
    horizon = horizons(obstacles, index, centre, east0_m, north0_m, float(cell_size_m), reach_m)
    sight, skyline = sight_for_cells(site.scenario.sensor), NO_SKYLINES
    if sight.line_of_sight == RAY:
        skyline = skylines(obstacles, centre, horizon, reach_m=reach_m, flattest=1.0 / widest_tangent(sight))
    # Only a search traces enough rays for close bounds to pay off.
    rise = _rises(site, centre, scatter_m, closely=steps == _SCATTERED) if rising else NO_RISE
    for array in (index, centre, normal, horizon, weight, rise):
        array.flags.writeable = False
    cells = Cells(east0_m, north0_m, float(cell_size_m), index, centre, normal, horizon, scatter_m, rise, skyline)
    return CellGrid(cells, weight, hidden_m2)


def with_rises(site: Site, grid: CellGrid) -> CellGrid:
    """The same cells, with bounds on the rise of the ground around each, which decide most rays.

    Finding them takes as long as evaluating 6 to 75 routes without them (72 kinds of scripts/bench/kinds.py).
    """
    if len(grid.cells.rise):
        return grid
    rise = _rises(site, grid.cells.centre_m, grid.cells.scatter_m, closely=False)
    rise.flags.writeable = False
    return replace(grid, cells=grid.cells._replace(rise=rise))


def _without_hidden(
    site: Site,
    grid_e: FloatArray,
    grid_n: FloatArray,
    inside: NDArray[np.bool_],
    cell_size_m: float,
    rows: range | None,
) -> tuple[NDArray[np.bool_], float]:
    """Lattice points that are cells with ground visible from above, and the area of the hidden ground.

    The ground of a cell is hidden if the surface model is more than ``terrain.surface_hides_m`` above it. Otherwise both are
    treated as one, and the cell is observed on the surface. Below an obstacle, the cell is on its roof.
    """
    terrain = site.scenario.terrain
    if site.ground_model is None or not isinstance(terrain, RasterTerrain):
        return inside, 0.0
    positions = np.column_stack([grid_e[inside], grid_n[inside]])
    bare, top = site.bare_ground.heights_m(positions), site.ground.heights_m(positions)
    for model, known in ((site.bare_ground, np.isfinite(bare)), (site.ground, np.isfinite(top))):
        if not known.all():
            raise TerrainError(_missing(site, model, positions, ~known, rows))
    hidden = (top - bare > terrain.surface_hides_m) & ~np.isfinite(site.ground.roofs_m(positions))
    left = inside.copy()
    left[inside] = ~hidden
    slopes = np.nan_to_num(site.bare_ground.gradients(positions[hidden]))
    return left, float(cell_size_m**2 * np.sqrt(1.0 + (slopes**2).sum(axis=1)).sum())


def _hides_m(site: Site) -> float:
    terrain = site.scenario.terrain
    return terrain.surface_hides_m if isinstance(terrain, RasterTerrain) else math.inf


def _rises(site: Site, centre: FloatArray, scatter_m: float, *, closely: bool) -> NDArray[np.float32]:
    """Cells at which rays of the sensor may be less steep than the ground somewhere."""
    sight, surface = sight_for_cells(site.scenario.sensor), site.ground.surface
    if len(centre) > _MOST_RISES or sight.line_of_sight != RAY or surface.steepest * widest_tangent(sight) <= 1.0:
        return NO_RISE
    reach_m, flattest = site.scenario.sensor.reach_m + scatter_m, 1.0 / widest_tangent(sight)
    return rises(surface, centre, reach_m=reach_m, flattest=flattest, closely=closely)


def _spread(count: int, step: float) -> NDArray[np.float64]:
    """(count,) numbers in -0.5..0.5, each ``step`` after the previous one modulo 1; evenly spread for an irrational step."""
    fractions: NDArray[np.float64] = (np.arange(count, dtype=np.float64) + 0.5) * step
    return np.asarray(fractions % 1.0 - 0.5, dtype=np.float64)


def _spread_of_halves(count: int, step: float) -> NDArray[np.float64]:
    """(count,) the same in halves of cells, so that one half of each cell has the cell's own point."""
    wholes = _spread(count // 2 + 1, step)
    return np.repeat((2.0 * wholes + 1.0) % 1.0 - 0.5, 2)[:count]


def _missing(
    site: Site, model: Ground, positions: NDArray[np.float64], missing: NDArray[np.bool_], rows: range | None
) -> str:
    first = positions[missing][:1]
    where = f"{first[0, 0]:.0f} m east, {first[0, 1]:.0f} m north of the origin"
    if site.frame is not None:
        lon, lat = site.frame.lon_lat_from_en(first)[0]
        where = f"latitude {lat:.5f}, longitude {lon:.5f}"
    # For some rows, the others are unknown.
    much = (
        f"{100.0 * missing.mean():.1f} % of its cells" if rows is None else f"{missing.sum():,} of its cells at least"
    )
    return (
        f"area: there is no elevation data in {much}, first at {where} ({model.source}); the area extends beyond the "
        "data, or the data has a gap there"
    )


@once
def judged_cell_size_m(site: Site) -> float:
    """Side of the cells of the evaluation grid: ``area.cell_size_m``, or less to get ``area.fewest_places``.

    A cell counts by one position, so the coverage of an area with few cells is a small sample. With 8,500 cells, its standard
    deviation is 0.05 points, and a search finds routes that profit from these positions. If the ground of a few cells weighs as
    much as that of many, as on cliffs, it is half a point. So an area with few cells is evaluated on smaller ones.

    The criterion is the number of positions of equal weight that are as good a sample: (sum of w)^2 / (sum of w^2). The paper's
    cells are their centres, and do not change.
    """
    area = site.scenario.area
    if isinstance(site.scenario.terrain, SineCosineTerrain):
        return area.cell_size_m
    return cell_size_for(site, fewest=area.fewest_places, most=MOST_POSITIONS, largest_m=area.cell_size_m)


def is_judged_on_smaller_cells(site: Site) -> bool:
    """Whether the cells of the evaluation grid are smaller than ``area.cell_size_m``."""
    return judged_cell_size_m(site) < site.scenario.area.cell_size_m


def cell_size_for(site: Site, *, fewest: int, most: int, largest_m: float) -> float:
    """Side of cells that sample the ground as well as ``fewest`` equal cells, if ``most`` suffice.

    Args:
        site: the scenario on its ground.
        fewest: number of cells of equal weight.
        most: largest number of cells.
        largest_m: largest side.
    """
    area_m2 = site.area.area
    cells = area_m2 / largest_m**2
    if fewest == 0 or cells >= most:
        return largest_m
    wanted = min(fewest / evenness(site), most)
    return largest_m if cells >= wanted else math.sqrt(area_m2 / wanted)


@once
def evenness(site: Site) -> float:
    """Fraction 0..1 of a site's cells that, with equal weight, would be as good a sample."""
    size_m = max(site.scenario.area.cell_size_m, math.sqrt(site.area.area / _PROBED))
    weight = _cut(site, size_m, steps=_SAMPLED, rising=False).weight_m2
    return float(weight.sum() ** 2 / (weight**2).sum() / weight.size)
