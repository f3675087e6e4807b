import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.planner.sites import with_scenario
from tests.terrain_kinds import write_scenario
from uavcover.planner.baselines.boustrophedon import best_height_agl_m, fly_layout, long_side_angle_rad, regular_layout
from uavcover.planner.plan_search import SearchRequest, plan
from uavcover.planner.search import improve
from uavcover.planner.search.goal_search import _can_afford_finest
from uavcover.planner.search.local_search import (
    SearchStart,
    Work,
    counted_as_judged,
    finest_problem,
    fraction_counted,
    search_problem,
)
from uavcover.planner.search.route_problem import RouteProblem, state_of
from uavcover.scenario.site import load_site
from uavcover.sensing.site_maps import finer_map, judging_map, planning_map


@pytest.mark.parametrize("fewest_places", [0, 25_000])
def test_at_waypoints_a_search_sees_what_judges_see_where_these_have_smaller_cells(
    fewest_places: int, tmp_path: Path
) -> None:
    site = load_site(str(write_scenario(tmp_path, "canyon", "sphere")))
    site = with_scenario(site, area=dataclasses.replace(site.scenario.area, fewest_places=fewest_places))
    planning = planning_map(site)
    cells = search_problem(planning, judging_map(site), [], 1.0).numbers.cells
    assert np.array_equal(cells.centre_m, planning.grid.cells.centre_m) is (fewest_places == 0)


@pytest.mark.parametrize(("terrain", "likely"), [("terraces", True), ("flat", False)])
def test_where_hardly_any_ground_is_in_view_all_the_way_likely_pictures_count(
    terrain: str, likely: bool, tmp_path: Path
) -> None:
    """Pictures every 40 m: on cliffs the count of what they show for sure says little about what is judged."""
    site = load_site(str(write_scenario(tmp_path, terrain, "sparse")))
    judging = judging_map(site)
    problem = search_problem(planning_map(site), judging, [], 1.0)
    routes = [
        fly_layout(
            site,
            regular_layout(
                angle_rad=long_side_angle_rad(site.area), lines=lines, height_agl_m=best_height_agl_m(site), inset=0.5,
                tolerance_m=10.0,
            ),
        )
        for lines in (5, 6)
    ]  # fmt: skip
    judged = [judging.fraction_of_coverable(judging.observed(route.waypoints_m)) for route in routes]

    def off(counting: RouteProblem) -> float:
        counted = [float(state_of(counting, route, capacity=len(route)).observed[0]) for route in routes]
        return max(abs(a - b) for a, b in zip(counted, judged, strict=True))

    starts = [SearchStart(route, observed) for route, observed in zip(routes, judged, strict=True)]
    counted_on = counted_as_judged(problem, judging, starts)
    assert (counted_on.numbers.trigger_m < problem.numbers.trigger_m) is likely
    assert off(counted_on) < 0.03
    assert (off(problem) > 0.05) is likely


@pytest.mark.parametrize("terrain", ["terraces", "flat"])
def test_the_finest_cells_count_as_much_as_is_judged(terrain: str, tmp_path: Path) -> None:
    """On terraces, a photo every 40 m counted 20 points less than the evaluation found."""
    site = load_site(str(write_scenario(tmp_path, terrain, "sparse")))
    layout = regular_layout(
        angle_rad=long_side_angle_rad(site.area), lines=6, height_agl_m=best_height_agl_m(site), inset=0.5, tolerance_m=10.0
    )  # fmt: skip
    route, judging, finer = fly_layout(site, layout), judging_map(site), finer_map(site)
    assert finer is not None
    judged = judging.fraction_of_coverable(judging.observed(route.waypoints_m))
    counted = fraction_counted(finest_problem(finer, route, judged), route)
    assert counted == pytest.approx(judged, abs=0.003)


@pytest.mark.parametrize(("terrain", "finest"), [("terraces", True), ("flat", False)])
def test_likely_pictures_are_counted_on_the_finest_cells_before_the_end(
    terrain: str, finest: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their count was 3 points too high over a canyon, and closing the gaps took half of the way again."""
    required = list[bool]()

    def search(work: Work, starts: list[SearchStart], **_: object) -> list[SearchStart]:
        required.append(work.finest is not None)
        return starts

    monkeypatch.setattr(improve, "search_goals", search)
    site = load_site(str(write_scenario(tmp_path, terrain, "sparse")))
    plan(site, SearchRequest(evaluations=60, select="coverage>=0.98", workers=1))
    assert required == [finest]


@pytest.mark.parametrize(("time_factor", "affordable"), [(1.0, True), (3.0, True), (3.2, False)])
def test_the_finest_cells_are_searched_where_there_is_time(time_factor: float, affordable: bool) -> None:
    """With 10 s, 228 proposals on the finest cells of a canyon took the time of the search that reaches the goal."""

    class Pace:
        fraction = 0.5

    work = Work(None, Pace(), [], None, lambda: False, lambda _: None, finest_time_factor=time_factor, proposals=4000)  # type: ignore[arg-type]
    # 4,000 proposals took 0.4 of the work, and 0.315 are left for 1,000 that take ``time_factor`` times as long.
    assert _can_afford_finest(work, (0.1, 0), 0.815) is affordable
