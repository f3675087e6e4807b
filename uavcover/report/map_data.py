"""Data for the map and the 3D view of a report, as JSON in local metres, east before north."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import shapely

from uavcover.errors import UavcoverError
from uavcover.kernels.arrays import FloatArray
from uavcover.missions.failsafes import IN_PLACE
from uavcover.missions.mission_compiler import compile_mission
from uavcover.missions.return_advice import flight_states
from uavcover.model.route import Route
from uavcover.model.verdict import Gap
from uavcover.report.cell_layers import REASON_WORDS, Bounds, cell_layers, cells_bounds_m, data_uri
from uavcover.report.content import FIGURES, Flight, ReportContent
from uavcover.report.plots import flight_style
from uavcover.scenario.airspace.flyable import zone_lines_m
from uavcover.scenario.airspace.zones import Zone
from uavcover.scenario.obstacles import Prism, rings_m
from uavcover.scenario.site import Site, area_as_drawn
from uavcover.terrain.frames import LocalFrame
from uavcover.terrain.ground import Ground, relief_grid
from uavcover.verification.verify import Verdict


def map_data(content: ReportContent) -> dict[str, Any]:
    """All drawing data, rounded to visible precision."""
    site = content.site
    bounds = bounds_m(site)
    verdict = content.verdict
    return {
        "bounds": rounded(np.array(bounds)),
        "relief": relief_image(site.ground, bounds),
        "geodetic": geodetic_fit(site.frame, bounds),
        "area": [rounded(ring) for ring in rings_m(site.area)],
        "drawn": [rounded(ring) for ring in rings_m(area_as_drawn(site))] if site.scenario.area.margin_m > 0.0 else [],
        "fence": [rounded(ring) for ring in rings_m(site.fence)],
        "obstacles": [_obstacle(site, prism) for prism in site.prisms],
        "noFly": [
            zone_data(zone) | {"lines": [rounded(line) for line in zone_lines_m(site, zone, bounds)]}
            for zone in site.zones
        ],
        "home": None if site.home_m is None else rounded(site.home_m),
        "plan": rounded(content.planned.route.waypoints_m),
        "planHeights": rounded(site.ground.heights_agl_m(content.planned.route.waypoints_m)),
        "sorties": [
            {"name": f"sortie {number + 1}", "style": flight_style(number), "points": rounded(route_m)}
            for number, route_m in enumerate(content.sorties_m)
        ],
        "cellBounds": rounded(np.array(cells_bounds_m(content.coverage))),
        "cells": [asdict(layer) for layer in cell_layers(content)],
        "pictures": _pictures(content),
        "tracks": [_track(flight, number) for number, flight in enumerate(content.flights)],
        "gaps": [] if verdict is None else gap_data(verdict.report.gaps),
        "violations": [] if verdict is None else _violations(verdict, content.flights),
        "unsafeReturns": _unsafe_returns(site, content.sorties_m or (content.planned.route.waypoints_m,)),
        "surface": _surface(site, bounds),
    }


def drawn_every(samples: int) -> int:
    """Every how many samples one is drawn."""
    return max(1, math.ceil(samples / FIGURES.max_samples))


def bounds_m(site: Site) -> Bounds:
    """The displayed bounds: fence and area with a margin."""
    west, south, east, north = shapely.union_all([site.area, site.fence]).bounds
    return west - FIGURES.pad_m, south - FIGURES.pad_m, east + FIGURES.pad_m, north + FIGURES.pad_m


def relief_image(ground: Ground, bounds_m: Bounds) -> str:
    """A relief of a rectangle (west, south, east, north) as a JPEG data URI."""
    grid = relief_grid(ground, bounds_m, nodes=FIGURES.relief_pixels)
    return data_uri(grid.rgb[::-1], "JPEG", quality=FIGURES.jpeg_quality)


def _obstacle(site: Site, prism: Prism) -> dict[str, Any]:
    """Outline and courtyards with the up coordinates of the ground and of the flat top."""
    rings = rings_m(prism.footprint.polygon)
    return {
        "name": prism.footprint.name,
        "height": round(prism.footprint.height_m, 1),
        "rings": [rounded(np.column_stack([ring, site.ground.heights_m(ring)])) for ring in rings],
        "top": rounded(np.array([prism.top_m]))[0],
    }


def zone_data(zone: Zone) -> dict[str, Any]:
    """A no-fly zone for the map."""
    return {
        "name": zone.name,
        "heights": zone.heights_in_words(),
        "rings": [rounded(r) for r in rings_m(zone.outline)],
    }


def _track(flight: Flight, number: int) -> dict[str, Any]:
    every = drawn_every(len(flight.track))
    keep = np.unique(np.append(np.arange(0, len(flight.track), every), len(flight.track) - 1))
    return {
        "name": flight.name,
        "style": flight_style(number),
        "points": rounded(flight.enu_m[keep]),
        "times": rounded(flight.clock_s[keep]),
        "heights": rounded(flight.height_agl_m[keep]),
    }


def _pictures(content: ReportContent) -> dict[str, Any]:
    """Positions of single photos, planned and flown; empty for a sensor that takes none."""
    planned, verdict = content.planned_view, content.verdict
    flown = None if verdict is None or verdict.pictures is None else verdict.observations
    return {
        "planned": [] if planned.pictures is None else rounded(planned.poses.eyes),
        "flown": [] if flown is None else rounded(flown.places_m[flown.known]),
        "unknown": 0 if flown is None else int((~flown.known).sum()),
    }


def gap_data(gaps: Iterable[Gap]) -> list[dict[str, Any]]:
    """Gaps as the script takes them."""
    return [
        {
            "east": gap.east_m,
            "north": gap.north_m,
            "area": round(gap.area_m2),
            "cells": gap.cells,
            "reason": REASON_WORDS[gap.reason],
            "coverable": gap.coverable,
        }
        for gap in gaps
    ]


def _violations(verdict: Verdict, flights: Sequence[Flight]) -> list[dict[str, Any]]:
    starts_s = [float(flight.track.time_s[0]) for flight in flights]
    return [
        {
            "east": v.east_m,
            "north": v.north_m,
            "kind": v.kind,
            "from": round(v.start_s - starts_s[v.track], 1),
            "to": round(v.end_s - starts_s[v.track], 1),
            "worst": f"{v.worst:.1f} {v.unit}",
            "limit": f"{v.limit:g} {v.unit}",
        }
        for v in verdict.report.violations
    ]


def _unsafe_returns(site: Site, routes_m: Sequence[FloatArray]) -> list[dict[str, Any]]:
    """Parts of the flights from where the autopilot's own return is not safe; none where there is no mission."""
    found = []
    for route_m in routes_m:
        try:
            compiled = compile_mission(site, Route(route_m), autopilot=site.scenario.vehicle.autopilot)
        except UavcoverError:
            continue  # the report says elsewhere that there is no mission
        advice = compiled.return_advice
        states = flight_states(site, compiled.path_m, begin_s=compiled.own_returns.begin_s)
        away = [one for one in advice.unsafe if one.destination != IN_PLACE]
        for one, words in zip(away, advice.sentences, strict=True):
            inside = (states.times_s >= one.begin_s) & (states.times_s <= one.end_s)
            points = states.places_m[inside, :2]
            drawn = rounded(points[:: drawn_every(len(points))])
            east, north = round(one.place_m[0], 1), round(one.place_m[1], 1)
            found.append({"points": drawn, "east": east, "north": north, "words": words})
    return found


def _surface(site: Site, bounds: Bounds) -> dict[str, Any]:
    """Heights at the nodes of a grid, rows from the north, in tenths of a metre; null without elevation."""
    west, south, east, north = bounds
    step = max(east - west, north - south) / (FIGURES.surface_nodes - 1)
    columns = max(2, math.ceil((east - west) / step) + 1)
    rows = max(2, math.ceil((north - south) / step) + 1)
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, columns), np.linspace(north, south, rows))
    up = site.ground.heights_m(np.column_stack([grid_e.ravel(), grid_n.ravel()]))
    return {"columns": columns, "rows": rows, "up": rounded(up)}


def geodetic_fit(frame: LocalFrame | None, bounds: Bounds) -> dict[str, list[float]] | None:
    """Coefficients of latitude and longitude in 1, e, n, e e, e n, n n (kilometres), for the pointer's position."""
    if frame is None:
        return None
    west, south, east, north = bounds
    grid_e, grid_n = np.meshgrid(np.linspace(west, east, 9), np.linspace(south, north, 9))
    places = np.column_stack([grid_e.ravel(), grid_n.ravel(), np.zeros(grid_e.size)])
    lat, lon, _ = frame.geodetic_from_enu(places)
    e, n = places[:, 0] / 1000.0, places[:, 1] / 1000.0
    basis = np.column_stack([np.ones(e.size), e, n, e * e, e * n, n * n])
    return {
        name: np.linalg.lstsq(basis, values, rcond=None)[0].tolist() for name, values in (("lat", lat), ("lon", lon))
    }


def rounded(values: FloatArray) -> Any:
    """Nested lists of numbers, NaN as null: to a tenth, and in a scenario of a few metres to a ten-thousandth."""
    finite = values[np.isfinite(values)]
    digits = 1 if finite.size and np.abs(finite).max() > 50.0 else 4
    return _listed(np.round(values, digits))


def _listed(values: FloatArray) -> Any:
    if values.ndim > 1:
        return [_listed(row) for row in values]
    return [value if math.isfinite(value) else None for value in values.tolist()]
