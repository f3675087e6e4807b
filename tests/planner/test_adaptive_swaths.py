"""Lines that bend: which are laid out, in which order, by how many threads."""

import dataclasses
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.planner.sites import SQUARE, hills, make_site
from uavcover.model.route import Route
from uavcover.planner.baselines.adaptive_swaths import adaptive_swaths, bend_lines, fly_bent, simple_lines, tight_lines
from uavcover.planner.baselines.boustrophedon import (
    SwathLayout,
    begun_near_home,
    best_height_agl_m,
    regular_layout,
    width_across_m,
)
from uavcover.scenario.site import Site

STRIP = ((0.0, 0.0), (400.0, 0.0), (400.0, 30.0), (0.0, 30.0))


def equal(one: list[Route], other: list[Route]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a.waypoints_m, b.waypoints_m) for a, b in zip(one, other, strict=True)
    )


@pytest.mark.parametrize("make", [adaptive_swaths, simple_lines])
def test_threads_change_nothing_and_a_stop_leaves_the_first(make: Callable[..., list[Route]]) -> None:
    site = make_site(hills)
    routes = make(site, 0.3)
    with ThreadPoolExecutor(2) as executor:
        assert equal(make(site, 0.3, executor=executor), routes)
        required = iter([False, False])
        some = make(site, 0.3, executor=executor, should_stop=lambda: next(required, True))
    first = make(site, 0.3, should_stop=lambda: True)
    assert 0 < len(first) < len(some) < len(routes)
    assert equal(first, routes[: len(first)])


def test_tight_lines_are_the_first_of_the_simple_ones() -> None:
    site = make_site(hills)
    tight, simple = tight_lines(site, 0.3), simple_lines(site, 0.3)
    assert len(tight) == 8  # two numbers of lines, two tolerances, two insets
    assert equal(tight, simple[:8])


@pytest.mark.parametrize("ring", [SQUARE, STRIP])
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.5 * math.pi])
def test_the_number_of_lines_that_just_fits_comes_first(ring: tuple[tuple[float, float], ...], angle: float) -> None:
    site = make_site(hills, ring=ring)
    layout = begun_near_home(site, fitting(site, angle))
    bent = bend_lines(site, layout)
    expected = [fly_bent(site, dataclasses.replace(layout, inset=inset), bent) for inset in (0.8, 0.9, 0.96, 1.0)]
    assert equal(adaptive_swaths(site, angle, should_stop=lambda: True), expected)


def fitting(site: Site, angle: float) -> SwathLayout:
    limits = site.scenario.limits
    tolerance_m = 0.0025 * (limits.max_height_agl_m - limits.min_height_agl_m - 2.0 * limits.height_margin_m)
    height_m = best_height_agl_m(site, tolerance_m=tolerance_m)
    swath_m = 2.0 * site.scenario.sensor.half_width_m(height_m)
    return regular_layout(
        angle_rad=angle, lines=max(1, int(width_across_m(site, angle) / swath_m)), height_agl_m=height_m, inset=0.0,
        tolerance_m=tolerance_m,
    )  # fmt: skip
