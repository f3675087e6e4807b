import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.terrain_kinds import SENSORS, Kind, flat, write_kind
from uavcover.missions.leg_checks import measure_violations
from uavcover.planner.baselines.boustrophedon import width_across_m
from uavcover.planner.baselines.cut_lines import cut_lines, cut_pieces, needs_cuts, ordered_route
from uavcover.scenario.airspace.flyable import flyable_area
from uavcover.scenario.site import Site, load_site

COMB = shapely.union_all([shapely.box(0, 0, 500, 100), *(shapely.box(x, 0, x + 70, 420) for x in (0, 140, 280, 430))])
HOLED = shapely.box(-200, -200, 200, 200).difference(
    shapely.union_all([shapely.Point(-60, 40).buffer(70, 8), shapely.box(60, -120, 150, -30)])
)
SHAPES = {
    "comb": COMB,
    "holes": HOLED,
    "two": shapely.MultiPolygon([shapely.box(0, 0, 150, 300), shapely.box(260, 40, 420, 330)]),
}


def site_of(folder: Path, area: shapely.Geometry, *, zones: bool = False) -> Site:
    more = ""
    if zones:
        more = "".join(
            f'[[no_fly]]\nname = "zone {k}"\nmargin_m = 1.0\n'
            f"polygon_east_north_m = {np.round(shapely.get_coordinates(ring), 3).tolist()}\n"
            for k, ring in enumerate(area.interiors)
        )
    return load_site(
        str(write_kind(folder, Kind(flat, area), name="shape", required=1.0, sensor=SENSORS["nadir"], more=more))
    )


@pytest.mark.parametrize("degrees", [0.0, 33.0, 90.0, 130.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_pieces_see_the_whole_area_on_flat_ground(shape: str, degrees: float, tmp_path: Path) -> None:
    site = site_of(tmp_path, SHAPES[shape])
    reach_m, angle = 30.0, math.radians(degrees)
    lines = math.ceil(width_across_m(site, angle) / (2.0 * reach_m))
    pieces = cut_pieces(site, angle, lines=lines, reach_m=reach_m, height_agl_m=60.0, goal=1.0)
    observed = shapely.union_all(shapely.buffer(shapely.linestrings(pieces.ends_m), reach_m, quad_segs=32))
    assert shapely.difference(site.area, observed).area < 1e-3 * site.area.area


@pytest.mark.parametrize("shape", SHAPES)
def test_cut_lines_fly_less_over_other_ground_than_whole_lines(shape: str, tmp_path: Path) -> None:
    site = site_of(tmp_path, SHAPES[shape])
    pieces = cut_pieces(site, 0.0, lines=9, reach_m=30.0, height_agl_m=60.0, goal=1.0)
    lines = shapely.linestrings(pieces.ends_m)
    beside = sum(shapely.difference(line, site.area.buffer(1.0)).length for line in lines)
    assert beside < 0.25 * sum(line.length for line in lines)


def test_a_convex_area_without_zones_needs_no_cuts(tmp_path: Path) -> None:
    assert not needs_cuts(site_of(tmp_path, shapely.box(-200, -100, 200, 100)))
    assert needs_cuts(site_of(tmp_path, HOLED))


def test_routes_keep_out_of_zones(tmp_path: Path) -> None:
    site = site_of(tmp_path, HOLED, zones=True)
    routes = list(itertools.islice(cut_lines(site, 0.98), 5))
    assert len(routes) == 5
    for route in routes:
        assert measure_violations(site, route.waypoints_m, margin_m=0.0).total == 0.0
        assert flyable_area(site).polygon.buffer(0.01).covers(shapely.LineString(route.waypoints_m[:, :2]))


def slow_length_m(ends_m: np.ndarray) -> float:
    """The least length of flying pieces in any order and any direction, one after the other."""
    lengths = []
    for order in itertools.permutations(range(len(ends_m))):
        for turned in itertools.product((1, -1), repeat=len(ends_m)):
            points = np.vstack([ends_m[k][::step] for k, step in zip(order, turned, strict=True)])
            lengths.append(float(np.hypot(*np.diff(points, axis=0).T).sum()))
    return min(lengths)


@pytest.mark.parametrize("seed", range(6))
def test_the_order_is_the_best_of_all_orders(seed: int, tmp_path: Path) -> None:
    """Of length alone, so that turns cost nothing."""
    site = site_of(tmp_path, shapely.box(-400, -400, 400, 400))
    planner = dataclasses.replace(site.scenario.planner, objective="length")
    site = dataclasses.replace(site, scenario=dataclasses.replace(site.scenario, planner=planner))
    rng = np.random.default_rng(seed)
    begins = np.mean(site.area.bounds) + rng.uniform(-380, 300, (5, 1, 2))
    ends_m = np.concatenate([begins, begins + rng.uniform(20, 80, (5, 1, 2))], axis=1)
    pieces = dataclasses.replace(
        cut_pieces(site, 0.0, lines=3, reach_m=60.0, height_agl_m=60.0, goal=0.0), ends_m=ends_m
    )
    path_m = np.hypot(*np.diff(ordered_route(site, pieces).waypoints_m[:, :2], axis=0).T).sum()
    assert path_m == pytest.approx(slow_length_m(ends_m), rel=1e-6)
