"""Figures of a route whose parts of the area are flown by different vehicles: they count together."""

from collections.abc import Iterable, Sequence

import numpy as np

from uavcover.missions.objectives import judge_member
from uavcover.model.route import Route, RouteMember, RouteMetrics
from uavcover.scenario.site import Site
from uavcover.scenario.vehicle_areas import groups_of
from uavcover.scenario.vehicle_site import vehicle_sites
from uavcover.sensing.site_maps import fleet_map, map_for


def judge_route(site: Site, route: Route, origin: str, *, margin_m: float) -> RouteMember:
    """A route on the cells of the whole area, as :func:`uavcover.missions.objectives.judge_member`.

    Where vehicles have parts of the area, each part of the route has the figures of the first vehicle that sees that part. What
    any of them sees is seen; counts, lengths, times and costs are those of all together.
    """
    whole = fleet_map(site)
    groups = groups_of(site.scenario)
    if not groups:
        return judge_member(whole, route, origin, margin_m=margin_m)
    sites = vehicle_sites(site)
    maps = [map_for(site, sites[group[0] - 1]) for group in groups]
    members = [judge_member(own, part, origin, margin_m=margin_m) for own, part in zip(maps, route.parts, strict=True)]
    seen = np.logical_or.reduce(
        [own.seen(part.waypoints_m) for own, part in zip(maps, route.parts, strict=True)], axis=0
    )
    metrics = _together(
        [member.metrics for member in members], share=whole.share(seen), of_coverable=whole.share_of_coverable(seen)
    )
    return RouteMember(route, metrics, sum(member.violation for member in members), origin)


def _together(parts: Sequence[RouteMetrics], *, share: float, of_coverable: float) -> RouteMetrics:
    return RouteMetrics(
        coverage_fraction=share,
        coverage_of_coverable=of_coverable,
        waypoint_count=sum(part.waypoint_count for part in parts),
        path_length_m=sum(part.path_length_m for part in parts),
        flight_time_s=sum(part.flight_time_s for part in parts),
        min_height_agl_m=min(part.min_height_agl_m for part in parts),
        max_height_agl_m=max(part.max_height_agl_m for part in parts),
        cost=sum(part.cost for part in parts),
        mission_time_s=_sum(part.mission_time_s for part in parts),
        mission_energy_hover_s=_sum(part.mission_energy_hover_s for part in parts),
    )


def _sum(values: Iterable[float | None]) -> float | None:
    """The sum; none where one is not known."""
    known = list(values)
    return None if None in known else sum(value for value in known if value is not None)
