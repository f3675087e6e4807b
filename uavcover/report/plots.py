"""The charts of a report."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from uavcover.kernels.arrays import FloatArray
from uavcover.model.route import MissionSize, Route
from uavcover.planner.pareto_file import trade_off_axis
from uavcover.report.charts import Chart, Key, Plot
from uavcover.report.content import FIGURES, Flight, ReportContent
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
    seen = np.array([100.0 * moment.coverage_fraction for moment in moments])
    end = max(float(flights[-1].clock_s[-1]), float(times[-1]) if times.size else 0.0, 1.0)
    # Nothing is seen before the first observation, and nothing new after the last.
    before = [0.0, float(times[0])] if times.size else [0.0]
    times = np.concatenate([before, times, [end]])
    seen = np.concatenate([np.zeros(len(before)), seen, [100.0 * verdict.report.coverage_fraction]])
    asked = 100.0 * content.site.scenario.requirements.min_coverage_of_coverable
    planned = 100.0 * content.planned.coverage_fraction
    plot = Plot((0.0, end / 60.0), (0.0, 102.0))
    plot.between("seen", times / 60.0, np.zeros(times.size), seen)
    plot.line("level", np.array([0.0, end / 60.0]), _both(planned), name="planned, of the area")
    plot.line("limit", np.array([0.0, end / 60.0]), _both(asked), name="required, of visible ground")
    for number, flight in enumerate(flights):
        ends = flight.clock_s[[0, -1]]
        inside = times[(times > ends[0]) & (times < ends[1])]
        own = np.concatenate([ends[:1], inside, ends[1:]])
        name = "observed, of the area" + ("" if len(flights) == 1 else f", {flight.name}")
        plot.line(flight_style(number), own / 60.0, np.interp(own, times, seen), name=name)
    return plot.finished("coverage", "Coverage over time", x_label="flight time, minutes", y_label="%")


def pareto_front(content: ReportContent) -> tuple[Chart, ...]:
    """Coverage against mission time or length of the Pareto set and the baselines; none without a Pareto set.

    The first chart shows the surroundings of the chosen route, where one chooses; the second everything, where that is more.
    """
    if not content.members:
        return ()
    near, whole = _trade_off(content, choice_floor(content)), _trade_off(content, -math.inf)
    return (near,) if len(near.wide.marks) == len(whole.wide.marks) else (near, whole)


def choice_floor(content: ReportContent) -> float:
    """Least share 0..1 of what can be seen that matters where one chooses: the last points are what costs."""
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
    share = np.array(
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
        costs, share = np.array([0.0, 1.0]), np.array([max(floor, 0.0)])
    pad = 0.03 * float(np.ptp(costs))
    low = 100.0 * float(share.min())
    span = max(100.0 - low, 1.0)
    plot = Plot(
        (float(costs.min()) - pad, float(costs.max()) + pad),
        (low - 0.05 * span, min(100.0, 100.0 * float(share.max())) + 0.05 * span),
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
    name: str, share: float, length_m: float, mission_s: float | None, hover_s: float | None, waypoints: int
) -> str:
    time = "" if mission_s is None else f", {mission_s:.0f} s"
    energy = "" if hover_s is None else f", energy of {hover_s:.0f} s of hovering"
    return f"{name}: {100.0 * share:.2f} %, {length_m:.0f} m{time}{energy}, {waypoints} waypoints"


def _size(mission: MissionSize | None) -> str:
    """Sorties, vehicles and when they are done, where that says more than the time of the mission."""
    if mission is None or mission.sorties == 1:
        return ""
    vehicles = f" of {mission.vehicles} vehicles" if mission.vehicles > 1 else ""
    return f", {mission.sorties} sorties{vehicles}, completed after {mission.makespan_s:.0f} s"


def _largest(values: FloatArray) -> float:
    """The largest known value, 0 when there is none."""
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
    share = ((flight.enu_m[on] - start) * leg).sum(axis=1) / np.where(length > 0.0, length**2, 1.0)
    at_m = _places_along_m(content.planned.route, waypoints)
    return on, (at_m[to - 1] + np.clip(share, 0.0, 1.0) * length) / 1000.0


def _places_along_m(whole: Route, part_m: FloatArray) -> FloatArray:
    """Distance along the whole route of each waypoint of a part; all NaN when it is not a part.

    A sortie, or a flight that resumes another one, flies consecutive waypoints of the whole plan; the latter may begin at a
    position on the leg to the first of them.
    """
    index_of = {place: index for index, place in reversed(list(enumerate(_to_the_mm(whole.waypoints_m))))}
    found = [(number, index_of[place]) for number, place in enumerate(_to_the_mm(part_m)) if place in index_of]
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


def _to_the_mm(places_m: FloatArray) -> list[tuple[float, ...]]:
    return [tuple(place) for place in np.round(places_m, 3).tolist()]
