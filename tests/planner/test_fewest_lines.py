"""The guided scan of the tuned boustrophedon: as good as all spacings, and much less work."""

import itertools
import math

import pytest

from tests.planner.sites import flat, hills, make_site
from uavcover.model.sensor import FrameCamera
from uavcover.planner.baselines.boustrophedon import (
    best_height_agl_m,
    boustrophedons,
    evaluated,
    fewest_lines,
    fly_layout,
    is_same_direction,
    long_side_angle_rad,
    regular_layout,
    taken,
)
from uavcover.planner.terrain_following import PLAIN_TOLERANCE_M
from uavcover.sensing.site_maps import planning_map

WIDE = ((0.0, 0.0), (900.0, 100.0), (800.0, 700.0), (100.0, 600.0))


@pytest.mark.parametrize(("ups", "required"), [(flat, 0.95), (hills, 0.95), (hills, 0.99)])
def test_no_spacing_of_the_whole_scan_is_better_and_a_quarter_of_it_finds_that(ups, required: float) -> None:
    site = make_site(ups, ring=WIDE, cell_m=20.0)
    coverage = planning_map(site)
    goal = required * coverage.fraction(coverage.coverable)

    def cost(each) -> float:
        return float(each.objectives[2]) if each.violation <= 0.0 and -each.objectives[0] >= goal else float("inf")

    whole, guided = boustrophedons(coverage), list(fewest_lines(coverage, goal))
    assert min(map(cost, guided)) <= min(map(cost, whole))
    assert len(guided) < 0.4 * len(whole)
    assert min(map(cost, guided[: len(whole) // 4])) <= 1.01 * min(map(cost, whole))


def test_the_first_way_is_searched_to_the_fewest_lines_that_reach_the_goal() -> None:
    site = make_site(hills, ring=WIDE, cell_m=20.0)
    coverage = planning_map(site)
    goal = 0.995 * coverage.fraction(coverage.coverable)
    angle, height = long_side_angle_rad(site.area), best_height_agl_m(site)

    def reaches(lines: int) -> bool:
        layout = regular_layout(
            angle_rad=angle, lines=lines, height_agl_m=height, inset=0.5, tolerance_m=PLAIN_TOLERANCE_M
        )
        return -evaluated(coverage, "", [fly_layout(site, layout)], None)[0].objectives[0] >= goal

    fewest = next(lines for lines in itertools.count(1) if reaches(lines))
    first = [e for e in fewest_lines(coverage, goal) if e.layout is not None and e.layout.angle_rad == angle]
    same = [e.layout.heights_agl_m.size for e in first if e.layout.inset == 0.5 and e.layout.heights_agl_m[0] == height]
    assert fewest in same
    assert fewest - 1 in same


def test_what_is_not_taken_is_left_for_later() -> None:
    site = make_site(flat, cell_m=20.0)
    coverage = planning_map(site)
    tuned, stops = fewest_lines(coverage, 0.95), iter([False, False, True])
    early = boustrophedons(coverage, should_stop=lambda: next(stops), tuned=tuned)
    assert [each.name for each in early] == ["boustrophedon", "boustrophedon-tuned", "boustrophedon-return"]
    late = taken(tuned, lambda: False)
    whole = list(fewest_lines(coverage, 0.95))
    assert len(early) - 1 + len(late) == len(whole)
    assert late[-1].objectives == pytest.approx(whole[-1].objectives)


def test_lines_along_an_edge_are_tried_besides_turns_of_the_long_side() -> None:
    # A wedge: the long side of the box around it is one edge, the other slanted one is no turn of it by 30 degrees.
    site = make_site(flat, ring=((0.0, 0.0), (900.0, 0.0), (900.0, 100.0), (100.0, 400.0)), cell_m=20.0)
    coverage = planning_map(site)
    edge = math.atan2(-300.0, 800.0)
    for found in (boustrophedons(coverage), list(fewest_lines(coverage, 0.95))):
        angles = [each.layout.angle_rad for each in found if each.layout is not None]
        assert any(is_same_direction(angle, edge) for angle in angles)


@pytest.mark.parametrize(("heading_deg", "across"), [(0.0, True), (90.0, False)])
def test_lines_of_photos_with_a_fixed_heading_run_along_their_heading(heading_deg: float, across: bool) -> None:
    sensor = FrameCamera(
        kind="frame-camera", fov_across_deg=80.0, fov_along_deg=40.0, range_m=300.0, mount="stabilised",
        heading_deg=heading_deg, trigger_distance_m=20.0,
    )  # fmt: skip
    site = make_site(flat, ring=((0.0, 0.0), (600.0, 0.0), (600.0, 600.0), (0.0, 600.0)), sensor=sensor, cell_m=20.0)
    coverage = planning_map(site)
    found = [each for each in fewest_lines(coverage, 0.98) if each.layout is not None and -each.objectives[0] >= 0.98]
    best = min(found, key=lambda each: float(each.objectives[2])).layout
    assert best is not None
    assert is_same_direction(best.angle_rad, math.pi / 2.0) is across
    height_m = best_height_agl_m(site)
    assert len(best.heights_agl_m) <= math.ceil(600.0 / (2.0 * height_m * math.tan(math.radians(40.0)))) + 1
