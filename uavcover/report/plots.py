"""Drawings of a run: the charts of its report, and figures as files (the paper's Figures 7 to 11)."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from uavcover.errors import OutputError
from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import MissionSize, Route
from uavcover.planner.pareto_file import ParetoRow, trade_off_axis
from uavcover.report.charts import Chart, Key, Plot
from uavcover.report.content import FIGURES, Flight, ReportContent, bounds_m
from uavcover.scenario.obstacles import rings_m
from uavcover.terrain.ground import relief_grid
from uavcover.verification.verify import Verdict


def height_along_route(content: ReportContent) -> Chart:
    """Height above ground along the planned route, with the band."""
    along_m, points = _along(content.planned.route)
    height = content.site.ground.heights_agl_m(points)
    limits = content.site.scenario.limits
    km = along_m / 1000.0
    top = max(_largest(height), limits.max_height_agl_m) * 1.08
    plot = Plot((0.0, float(km[-1])), (0.0, top))
    ends = km[[0, -1]]
    plot.between("band", ends, _both(limits.min_height_agl_m), _both(limits.max_height_agl_m), name="height band")
    plot.line("planned", km, height, name="planned")
    for number, flight in enumerate(content.flights):
        on_route, km = flown_along(content, flight)
        if np.isfinite(km).any():
            plot.line(flight_style(number), km, flight.height_agl_m[on_route], name=_key(content, number))
    return plot.finished(
        "along", "Height above ground along the route", x_label="distance along the planned route, km", y_label="m"
    )


def elevation_profile(content: ReportContent) -> Chart:
    """Ground, band, planned and flown heights above sea level along the planned route."""
    along_m, points = _along(content.planned.route)
    ground = content.site.ground.heights_m(points[:, :2])
    # Sea level in the local frame changes by millimetres over an area, so each position has its own offset.
    sea = content.site.alts_amsl_m(points) - points[:, 2]
    limits = content.site.scenario.limits
    km, surface, route = along_m / 1000.0, ground + sea, points[:, 2] + sea
    low = min(-_largest(-surface), float(route.min()))
    high = max(_largest(surface) + limits.max_height_agl_m, float(route.max()))
    floor = low - 0.06 * (high - low)
    plot = Plot((0.0, float(km[-1])), (floor, high + 0.04 * (high - low)))
    plot.between("band", km, surface + limits.min_height_agl_m, surface + limits.max_height_agl_m, name="height band")
    plot.between("ground", km, np.full(km.size, floor), surface, name="ground")
    plot.line("planned", km, route, name="planned")
    for number, flight in enumerate(content.flights):
        on_route, flown_km = flown_along(content, flight)
        if np.isfinite(flown_km).any():
            flown = content.site.alts_amsl_m(flight.enu_m[on_route])
            plot.line(flight_style(number), flown_km, flown, name=_key(content, number))
    unit = "height above sea level, m" if content.site.frame is not None else "height, m"
    return plot.finished("profile", "Profile", x_label="distance along the planned route, km", y_label=unit)


def height_over_time(content: ReportContent, verdict: Verdict) -> Chart:
    """Height above ground over all flights, one after the other, with the band where it applies."""
    limits, flights = content.site.scenario.limits, content.flights
    known = np.concatenate([flight.height_agl_m for flight in flights])
    top = max(_largest(known), limits.max_height_agl_m) * 1.08
    plot = Plot((0.0, float(flights[-1].clock_s[-1]) / 60.0), (min(0.0, -_largest(-known)), top))
    for number, flight in enumerate(flights):
        on_route = np.flatnonzero(flight.track.current_waypoint >= 1)
        ends = flight.clock_s[on_route[[0, -1]] if on_route.size else [0, -1]] / 60.0
        name = "height band" if number == 0 else ""
        plot.between("band", ends, _both(limits.min_height_agl_m), _both(limits.max_height_agl_m), name=name)
    for number, flight in enumerate(flights):
        plot.line(flight_style(number), flight.clock_s / 60.0, flight.height_agl_m, name=_key(content, number))
    for violation in verdict.report.violations:
        flight = flights[violation.track]
        height = float(np.interp(violation.worst_s, flight.track.time_s, np.nan_to_num(flight.height_agl_m)))
        minute = float(np.interp(violation.worst_s, flight.track.time_s, flight.clock_s)) / 60.0
        words = f"{violation.kind} at {violation.worst_s:.1f} s"
        if len(flights) > 1:
            words += f" of {flight.name}"
        plot.mark("violation", minute, height, radius=5.0, title=words)
    keys = [Key("violation", "violation", is_mark=True)] if verdict.report.violations else []
    which = "" if len(flights) == 1 else f", {len(flights)} consecutive flights"
    return plot.finished(
        "height", f"Height above ground in flight{which}", x_label="flight time, minutes", y_label="m", mark_keys=keys
    )


def coverage_over_time(content: ReportContent, verdict: Verdict) -> Chart:
    """Coverage of the area over all flights, one after the other."""
    moments, flights = verdict.report.coverage_by_time, content.flights
    start_s = float(flights[0].track.time_s[0])
    times = np.array([moment.time_s - start_s for moment in moments])
    observed = np.array([100.0 * moment.coverage_fraction for moment in moments])
    end = max(float(flights[-1].clock_s[-1]), float(times[-1]) if times.size else 0.0, 1.0)
    # Nothing is seen before the first observation, and nothing new after the last.
    before = [0.0, float(times[0])] if times.size else [0.0]
    times = np.concatenate([before, times, [end]])
    observed = np.concatenate([np.zeros(len(before)), observed, [100.0 * verdict.report.coverage_fraction]])
    required = 100.0 * content.site.scenario.requirements.min_coverage_of_coverable
    planned = 100.0 * content.planned.coverage_fraction
    plot = Plot((0.0, end / 60.0), (0.0, 102.0))
    plot.between("seen", times / 60.0, np.zeros(times.size), observed)
    plot.line("level", np.array([0.0, end / 60.0]), _both(planned), name="planned, of the area")
    plot.line("limit", np.array([0.0, end / 60.0]), _both(required), name="required, of visible ground")
    for number, flight in enumerate(flights):
        ends = flight.clock_s[[0, -1]]
        inside = times[(times > ends[0]) & (times < ends[1])]
        own = np.concatenate([ends[:1], inside, ends[1:]])
        name = "observed, of the area" + ("" if len(flights) == 1 else f", {flight.name}")
        plot.line(flight_style(number), own / 60.0, np.interp(own, times, observed), name=name)
    return plot.finished("coverage", "Coverage over time", x_label="flight time, minutes", y_label="%")


def pareto_front(content: ReportContent) -> tuple[Chart, ...]:
    """Coverage against mission time or length of the Pareto set and the baselines; empty without a Pareto set.

    The first chart shows the surroundings of the chosen route, where one chooses; the second everything, where that is more.
    """
    if not content.members:
        return ()
    near, whole = _trade_off(content, choice_floor(content)), _trade_off(content, -math.inf)
    return (near,) if len(near.wide.marks) == len(whole.wide.marks) else (near, whole)


def choice_floor(content: ReportContent) -> float:
    """Least coverage 0..1 of the visible ground that matters for the choice, because the last points are expensive."""
    chosen = content.planned.coverage_of_coverable
    return chosen - max(4.0 * (1.0 - chosen), 0.05)


def _trade_off(content: ReportContent, floor: float) -> Chart:
    """The trade-off between routes with at least a fraction 0..1 of coverage."""
    baselines = [b for b in content.plan.get("baselines", []) if isinstance(b, dict)]
    axis = trade_off_axis(content.members, baselines, content.plan.get("objective"))
    shown_baselines = [
        (baseline, cost)
        for baseline, cost in zip(baselines, axis.baselines, strict=True)
        if baseline["coverage_of_coverable"] >= floor
    ]
    shown_members = [
        (m, cost) for m, cost in zip(content.members, axis.members, strict=True) if m.coverage_of_coverable >= floor
    ]
    fraction = np.array(
        [float(b["coverage_of_coverable"]) for b, _ in shown_baselines]
        + [m.coverage_of_coverable for m, _ in shown_members]
    )
    reference = (
        None if axis.is_time or math.isfinite(floor) else content.plan.get("bounds", {}).get("length_reference_m")
    )
    costs = np.array([
        *(cost for _, cost in (*shown_members, *shown_baselines)), *([] if reference is None else [reference / 1000.0])
    ])  # fmt: skip
    if not costs.size:
        costs, fraction = np.array([0.0, 1.0]), np.array([max(floor, 0.0)])
    pad = 0.03 * float(np.ptp(costs))
    low = 100.0 * float(fraction.min())
    span = max(100.0 - low, 1.0)
    plot = Plot(
        (float(costs.min()) - pad, float(costs.max()) + pad),
        (low - 0.05 * span, min(100.0, 100.0 * float(fraction.max())) + 0.05 * span),
    )
    keys = [Key("member", "Pareto set", is_mark=True)]
    if reference is not None:
        plot.line("reference", _both(reference / 1000.0), np.array(plot.y_range), name="area / swath width (estimate)")
    for baseline, cost in shown_baselines:
        plot.mark(
            "baseline", cost, 100.0 * baseline["coverage_of_coverable"], radius=3.5,
            title=_words(baseline["name"], baseline["coverage_of_coverable"], baseline["path_length_m"],
                         baseline.get("mission_time_s"), baseline.get("mission_energy_hover_s"), baseline["waypoint_count"]),
        )  # fmt: skip
    # The chosen one lies over the others.
    for member, cost in sorted(shown_members, key=lambda shown: shown[0].chosen):
        name = f"index:{member.index}, {member.made_by}"
        plot.mark(
            "chosen" if member.chosen else "member", cost, 100.0 * member.coverage_of_coverable,
            radius=7.0 if member.chosen else 3.5,
            title=_words(
                name, member.coverage_of_coverable, member.path_length_m, member.mission_time_s,
                member.mission_energy_hover_s, member.waypoint_count,
            ) + _size(member.mission),
        )  # fmt: skip
    keys += [Key("chosen", "selected", is_mark=True)] if any(m.chosen for m, _ in shown_members) else []
    keys += [Key("baseline", "baselines", is_mark=True)] if shown_baselines else []
    here = math.isfinite(floor)
    return plot.finished(
        "pareto" if here else "pareto-whole", "Coverage and cost of the routes" if here else "Coverage and cost of all routes",
        x_label=axis.label, y_label="% of visible ground", mark_keys=keys,
    )  # fmt: skip


def _words(
    name: str, fraction: float, length_m: float, mission_s: float | None, hover_s: float | None, waypoints: int
) -> str:
    time = "" if mission_s is None else f", {mission_s:.0f} s"
    energy = "" if hover_s is None else f", energy of {hover_s:.0f} s of hovering"
    return f"{name}: {100.0 * fraction:.2f} %, {length_m:.0f} m{time}{energy}, {waypoints} waypoints"


def _size(mission: MissionSize | None) -> str:
    """Sorties, vehicles and when they are done, where that says more than the time of the mission."""
    if mission is None or mission.sorties == 1:
        return ""
    vehicles = f" of {mission.vehicles} vehicles" if mission.vehicles > 1 else ""
    return f", {mission.sorties} sorties{vehicles}, completed after {mission.makespan_s:.0f} s"


def _largest(values: FloatArray) -> float:
    """The largest known value, 0 without one."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else 0.0


def _both(value: float) -> FloatArray:
    return np.full(2, float(value))


def _along(route: Route) -> tuple[FloatArray, FloatArray]:
    """Distances (k,) along a route and the (k, 3) positions there, waypoints included."""
    waypoints_m = route.waypoints_m
    if len(waypoints_m) < 2:
        points = np.repeat(waypoints_m, 2, axis=0) if len(waypoints_m) else np.full((2, 3), np.nan)
        return np.array([0.0, 1.0]), points
    at_m = _along_m(waypoints_m, route.begins)
    along = np.unique(np.append(np.linspace(0.0, at_m[-1], FIGURES.along_steps), at_m))
    return along, np.column_stack([np.interp(along, at_m, waypoints_m[:, axis]) for axis in range(3)])


def flight_style(number: int) -> str:
    """The style class of a flight; after the last colour they repeat with dashes (``report.css``)."""
    return f"flight-{number % (2 * FIGURES.flight_colors)}"


def _key(content: ReportContent, number: int) -> str:
    return "flown" if len(content.flights) == 1 else content.flights[number].name


def flown_along(content: ReportContent, flight: Flight) -> tuple[NDArray[np.int64], FloatArray]:
    """Numbers (n,) of a flight's samples on its route, and their distance (n,) along the whole plan in kilometres.

    A sample heading for waypoint k is projected onto the leg from k - 1 to k.
    """
    waypoints = flight.planned_m
    target = flight.track.current_waypoint
    on = np.flatnonzero((target >= 1) & (target < len(waypoints)))
    to = target[on]
    start, leg = waypoints[to - 1], waypoints[to] - waypoints[to - 1]
    length = np.linalg.norm(leg, axis=1)
    fraction = ((flight.enu_m[on] - start) * leg).sum(axis=1) / np.where(length > 0.0, length**2, 1.0)
    at_m = _positions_along_m(content.planned.route, waypoints)
    return on, (at_m[to - 1] + np.clip(fraction, 0.0, 1.0) * length) / 1000.0


def _positions_along_m(whole: Route, part_m: FloatArray) -> FloatArray:
    """Distance along the whole route of each waypoint of a part; all NaN when it is not a part.

    A sortie, or a flight that resumes another one, flies consecutive waypoints of the whole plan; the latter may begin at a
    position on the leg to the first of them.
    """
    index_of = {position: index for index, position in reversed(list(enumerate(_to_the_mm(whole.waypoints_m))))}
    found = [(number, index_of[position]) for number, position in enumerate(_to_the_mm(part_m)) if position in index_of]
    if not found:
        return np.full(len(part_m), np.nan)
    # A position that the route passes twice may match the wrong pass; most positions are passed once.
    offsets = [index - number for number, index in found]
    number, index = found[offsets.index(max(offsets, key=offsets.count))]
    along_part_m, along_whole_m = _along_m(part_m), _along_m(whole.waypoints_m, whole.begins)
    return np.asarray(along_part_m + (along_whole_m[index] - along_part_m[number]))


def _along_m(waypoints_m: FloatArray, begins: Sequence[int] = ()) -> FloatArray:
    """(n,) distance along a route to each of its waypoints; where the route of another part begins, none is flown."""
    legs_m = np.linalg.norm(np.diff(waypoints_m, axis=0), axis=1)
    legs_m[[begin - 1 for begin in begins]] = 0.0
    return np.append(0.0, np.cumsum(legs_m))


def _to_the_mm(positions_m: FloatArray) -> list[tuple[float, ...]]:
    return [tuple(position) for position in np.round(positions_m, 3).tolist()]


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
    observed = [100.0 * m.coverage_of_coverable for m in members]
    points = axes.scatter(
        axis.members, observed, c=[m.waypoint_count for m in members], cmap="viridis", s=26, label="Pareto set"
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
        for number, point in enumerate(waypoints):
            axes.annotate(str(number), point[:2], xytext=(3, 3), textcoords="offset points", fontsize=6, color="white")
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
