"""Figures as files: the trade-off, and ground and routes from the side and from above (the paper's Figures 7 to 11)."""

from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from uavcover.errors import OutputError
from uavcover.kernels.arrays import FloatArray
from uavcover.planner.pareto_file import ParetoRow, trade_off_axis
from uavcover.report.content import FIGURES, ReportContent
from uavcover.report.map_data import bounds_m
from uavcover.scenario.obstacles import rings_m
from uavcover.terrain.ground import relief_grid

FIGURE_NAMES = ("side-view.png", "top-view.png")

_OBSTACLE = "#8e6fc1"
_NO_FLY = "#e0245e"
_PLANNED, _CHOSEN, _BASELINE = "#1f3f8f", "#d55e00", "#6b7075"
_PLANNED_LINE, _PLANNED_WIDTH, _FLOWN_WIDTH = "#a9c4ff", 4.5, 1.1
"""The planned line is broad and pale, under the flown line: both are visible where they agree."""
_FLOWN = ("#d55e00", "#b0208f", "#00786c", "#6a3fc4", "#806000", "#0f7fc0", "#38801c", "#c93a6e")


def save_figures(content: ReportContent, folder: Path) -> list[Path]:
    """Draw the ground with planned and flown route into FIGURE_NAMES of a folder, which is created if missing.

    Raises:
        OutputError: a figure cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot create the folder ({error.strerror or error})") from error
    drawn = [(_side_view(content), FIGURE_NAMES[0]), (_top_view(content), FIGURE_NAMES[1])]
    return [_save(figure, folder / name) for figure, name in drawn]


def save_pareto_plot(members: tuple[ParetoRow, ...], plan: dict[str, object], path: Path) -> Path:
    """Draw coverage against mission time or length, waypoint count as colour, with the selected member and the baselines.

    Args:
        members: the Pareto set.
        plan: ``plan.json``, for the baselines; empty for none.
        path: the file; its suffix sets the format: .png, .svg or .pdf.

    Raises:
        OutputError: an unknown suffix, or the file cannot be written.
    """
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    axes: Axes = figure.add_subplot()
    listed = plan.get("baselines", [])
    baselines = [b for b in listed if isinstance(b, dict)] if isinstance(listed, list) else []
    axis = trade_off_axis(members, baselines, plan.get("objective"))
    seen = [100.0 * m.coverage_of_coverable for m in members]
    points = axes.scatter(
        axis.members, seen, c=[m.waypoint_count for m in members], cmap="viridis", s=26, label="Pareto set"
    )
    figure.colorbar(points, ax=axes, label="waypoints")
    if baselines:
        axes.scatter(
            axis.baselines, [100.0 * b["coverage_of_coverable"] for b in baselines],
            facecolors="none", edgecolors=_BASELINE, s=54, label="baselines",
        )  # fmt: skip
    for member, cost in zip(members, axis.members, strict=True):
        if member.chosen:
            axes.scatter(
                [cost], [100.0 * member.coverage_of_coverable], marker="*", s=260,
                color=_CHOSEN, edgecolors="white", zorder=3, label=f"selected (index:{member.index})",
            )  # fmt: skip
    axes.set(xlabel=axis.label, ylabel="coverage, % of visible ground", title=str(plan.get("name", "")))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    return _save(figure, path)


def _side_view(content: ReportContent) -> Figure:
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    axes: Axes3D = figure.add_subplot(projection="3d", computed_zorder=False)
    grid = relief_grid(content.site.ground, bounds_m(content.site), nodes=FIGURES.side_nodes)
    axes.plot_surface(
        grid.east_m, grid.north_m, grid.up_m, facecolors=grid.rgb / 255.0, rcount=FIGURES.side_nodes, ccount=FIGURES.side_nodes,
        shade=False, linewidth=0.0, antialiased=False, zorder=1,
    )  # fmt: skip
    for name, color, width, route in _routes(content):
        axes.plot(*route.T, color=color, linewidth=width, label=name, zorder=2)
    waypoints = content.planned.route.waypoints_m
    axes.scatter(*waypoints.T, color=_PLANNED, s=9, depthshade=False, zorder=3)
    known = grid.up_m[np.isfinite(grid.up_m)]
    rise = float(np.ptp(known)) if known.size else 1.0
    width, depth = float(np.ptp(grid.east_m)), float(np.ptp(grid.north_m))
    axes.set_box_aspect((width, depth, max(rise, 0.25 * max(width, depth))))
    axes.view_init(elev=28.0, azim=-115.0)
    axes.set(xlabel="east, m", ylabel="north, m", zlabel="up, m", title=content.site.scenario.name)
    axes.legend(loc="upper left")
    return figure


def _top_view(content: ReportContent) -> Figure:
    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    axes: Axes = figure.add_subplot()
    grid = relief_grid(content.site.ground, bounds_m(content.site), nodes=FIGURES.top_nodes)
    west, south, east, north = bounds_m(content.site)
    axes.imshow(grid.rgb, extent=(west, east, south, north), origin="lower", interpolation="bilinear")
    if np.isfinite(grid.up_m).any():
        lines = axes.contour(grid.east_m, grid.north_m, grid.up_m, levels=12, colors="black", linewidths=0.4, alpha=0.6)
        axes.clabel(lines, fontsize=6, fmt="%g")
    for ring in rings_m(content.site.area):
        axes.plot(*ring.T, color="white", linewidth=1.2)
    axes.plot(*np.asarray(content.site.fence.exterior.coords).T[:2], color="white", linewidth=1.0, linestyle="--")
    for zone in content.site.zones:
        for part in shapely.get_parts(zone.outline):
            axes.fill(
                *np.asarray(part.exterior.coords).T[:2], facecolor=_NO_FLY, edgecolor=_NO_FLY, alpha=0.35, linewidth=1.2
            )
    for prism in content.site.prisms:
        axes.fill(
            *np.asarray(prism.footprint.polygon.exterior.coords).T[:2],
            facecolor=_OBSTACLE,
            edgecolor="black",
            linewidth=0.5,
        )
    for name, color, width, route in _routes(content):
        axes.plot(route[:, 0], route[:, 1], color=color, linewidth=width, label=name)
    waypoints = content.planned.route.waypoints_m
    axes.scatter(waypoints[:, 0], waypoints[:, 1], color=_PLANNED, s=12, zorder=3)
    if len(waypoints) <= FIGURES.max_numbers:
        for number, place in enumerate(waypoints):
            axes.annotate(str(number), place[:2], xytext=(3, 3), textcoords="offset points", fontsize=6, color="white")
    axes.set(xlabel="east, m", ylabel="north, m", title=content.site.scenario.name, aspect="equal")
    axes.legend(loc="upper right")
    return figure


def _routes(content: ReportContent) -> list[tuple[str, str, float, FloatArray]]:
    # A label that begins with an underscore is not in the legend again.
    routes = [
        ("_planned" if number else "planned", _PLANNED_LINE, _PLANNED_WIDTH, part.waypoints_m)
        for number, part in enumerate(content.planned.route.parts)
    ]
    alone = len(content.flights) == 1
    return routes + [
        ("flown" if alone else f"flown: {flight.name}", _FLOWN[number % len(_FLOWN)], _FLOWN_WIDTH, flight.enu_m)
        for number, flight in enumerate(content.flights)
    ]


def _save(figure: Figure, path: Path) -> Path:
    FigureCanvasAgg(figure)
    try:
        # No date and no version, so that equal runs give equal figures.
        no_date = {"Date": None} if path.suffix == ".svg" else {"CreationDate": None} if path.suffix == ".pdf" else {}
        figure.savefig(path, dpi=FIGURES.dpi, metadata=no_date)
    except ValueError as error:
        raise OutputError(f"{path}: {error}; use .png, .svg or .pdf") from error
    except OSError as error:
        raise OutputError(f"{path}: the file cannot be written ({error.strerror or error})") from error
    return path
