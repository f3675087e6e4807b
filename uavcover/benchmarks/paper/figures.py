"""The paper's Figures 7 to 11: the terrain, and what both algorithms planned over it, from the side and from above."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uavcover.benchmarks.paper.readings import READINGS, Reading
from uavcover.benchmarks.paper.runs import ALGORITHMS
from uavcover.benchmarks.paper.summary import Scheme
from uavcover.coverage.coverage_map import CoverageMap

FloatArray = NDArray[np.float64]

_FIGURES = {"modbo": (8, 10), "imodbo": (9, 11)}
_SIDE = 10.0
_STEPS = 81


def draw_terrain(path: Path) -> Path:
    """Figure 7: the terrain (Eq. 26); returns the file."""
    plt = _pyplot()
    page = plt.figure(figsize=(5.0, 3.8))
    try:
        axis = page.add_subplot(projection="3d")
        axis.plot_surface(*_surface(READINGS["planar"]), cmap="terrain", linewidth=0.0)
        axis.set(xlabel="x", ylabel="y", zlabel="z", title="As the paper's Figure 7: z = sin(y) cos(x)")
        page.tight_layout()
        page.savefig(path, dpi=80)
    finally:
        plt.close(page)
    return path


def draw_schemes(path: Path, reading: Reading, schemes: dict[str, Scheme]) -> Path:
    """Figures 8 to 11 for a reading: side view and top view of each algorithm's scheme; returns the file.

    The top view has what is seen in green and what is not in red.
    """
    plt = _pyplot()
    page = plt.figure(figsize=(9.0, 7.6))
    try:
        for column, algorithm in enumerate(ALGORITHMS):
            scheme = schemes[algorithm]
            figures = scheme.figures
            side, top = _FIGURES[algorithm]
            told = f"{100 * figures.coverage:.1f} %, {figures.nodes:.0f} nodes, length {figures.length:.1f}"
            axis = page.add_subplot(2, 2, 1 + column, projection="3d")
            _side_view(axis, reading, scheme.route)
            axis.set_title(f"As Figure {side}: {algorithm}, {told}", fontsize=9)
            axis = page.add_subplot(2, 2, 3 + column)
            _top_view(axis, reading, scheme.route)
            axis.set_title(f"As Figure {top}: {algorithm}", fontsize=9)
        page.suptitle(f"{reading.name}: {reading.meaning}", fontsize=10)
        page.tight_layout()
        page.savefig(path, dpi=80)
    finally:
        plt.close(page)
    return path


def _side_view(axis: Any, reading: Reading, route: FloatArray) -> None:
    axis.plot_surface(*_surface(reading), cmap="terrain", linewidth=0.0, alpha=0.45)
    axis.plot(*route.T, ".-", color="tab:red", markersize=4.0, linewidth=1.0)
    axis.view_init(elev=18.0, azim=-60.0)
    axis.set(xlabel="x", ylabel="y", zlabel="z")
    axis.tick_params(labelsize=6)


def _top_view(axis: Any, reading: Reading, route: FloatArray) -> None:
    site = reading.site()
    coverage = CoverageMap(site, cell_size_m=site.scenario.area.cell_size_m)
    lattice = coverage.grid.cells.lattice
    picture = np.where(lattice >= 0, coverage.seen(route)[lattice], np.nan)
    axis.imshow(picture, origin="lower", extent=(0.0, _SIDE, 0.0, _SIDE), cmap="RdYlGn", vmin=-0.3, vmax=1.3, alpha=0.6)
    axis.contour(*_surface(reading), levels=7, colors="0.4", linewidths=0.4)
    axis.plot(*route[:, :2].T, ".-", color="black", markersize=5.0, linewidth=0.9)
    axis.plot(*route[:1, :2].T, "o", color="tab:blue", markersize=7.0, markerfacecolor="none")
    axis.set(xlabel="x", ylabel="y", aspect="equal")
    axis.tick_params(labelsize=6)


def _surface(reading: Reading) -> tuple[FloatArray, FloatArray, FloatArray]:
    axis = np.linspace(0.0, _SIDE, _STEPS)
    x, y = np.meshgrid(axis, axis)
    z = reading.site().ground.heights_m(np.column_stack([x.ravel(), y.ravel()])).reshape(x.shape)
    return x, y, z


def _pyplot() -> Any:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot
