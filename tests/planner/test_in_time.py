"""A search that is ended from outside, and the time of a whole command."""

import contextlib
import dataclasses
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site
from tests.terrain_kinds import KINDS, SENSORS, TRUE_TO_SCALE, write_kind
from uavcover.cli.console import Interrupts
from uavcover.errors import InfeasibleError, StageOver
from uavcover.model.limits import NoFly
from uavcover.planner.budget import CommandTime
from uavcover.planner.plan_search import SearchRequest, plan, plan_and_site
from uavcover.planner.search.optimizer_search import SearchProgress
from uavcover.planner.selection_rule import with_sizes

EFFORT = {"evaluations": 40, "workers": 1, "algorithm": "memetic", "select": "coverage>=0.9"}


def test_a_command_has_its_budget_from_its_begin():
    moments = iter([12.0, 12.0, 30.0])
    limit = CommandTime(begun_s=10.0, budget_s=5.0, now=lambda: next(moments))
    assert [limit.left_s(), limit.left_s(fraction=2.0), limit.left_s()] == [3.0, 8.0, 0.0]
    assert CommandTime(begun_s=0.0).left_s() == float("inf")
    assert CommandTime(begun_s=0.0, should_stop=lambda: True).left_s() == 0.0


class EndsAt:
    """Ends the search at the n-th time that it reports, once it has a route."""

    count = 0

    def __init__(self, reports: int) -> None:
        self.left = reports

    def any(self) -> bool:
        return False

    def report(self, progress: SearchProgress) -> None:
        self.evaluations = progress.evaluations
        self.left -= 1
        if self.left <= 0 and self.ready():
            raise StageOver

    @contextlib.contextmanager
    def no_longer_than(self, _seconds, ready) -> Iterator[None]:
        self.ready = ready
        yield


@pytest.mark.parametrize("reports", [1, 3])
def test_a_search_that_is_ended_gives_its_incumbent(reports):
    site, stops = make_site(hills), EndsAt(reports)
    request = SearchRequest(**EFFORT)
    result, _ = plan_and_site(site, request, should_stop=stops.any, on_progress=stops.report, kept=None, stops=stops)
    assert result.chosen.violation <= 0.0
    assert {member.origin for member in result.members} & {"memetic", "boustrophedon", "boustrophedon-tuned"}
    assert result.evaluations == stops.evaluations
    assert not result.interrupted


def test_a_search_that_is_ended_late_keeps_its_best_route():
    """A search for other coverages and for few waypoints follows the one for the required coverage."""
    site, request = make_site(hills), SearchRequest(**EFFORT | {"evaluations": 400})
    reports: list[SearchProgress] = []
    whole, _ = plan_and_site(site, request, should_stop=lambda: False, on_progress=reports.append, kept=None)
    stops = EndsAt(len(reports))
    ended, _ = plan_and_site(site, request, should_stop=stops.any, on_progress=stops.report, kept=None, stops=stops)
    assert stops.left == 0
    assert ended.rule_met
    assert ended.chosen.metrics.cost <= 1.01 * whole.chosen.metrics.cost


def interrupted_library() -> None:
    """A call that is interrupted by the alarm and raises an error of its own."""
    with contextlib.suppress(StageOver):
        signal.raise_signal(signal.SIGALRM)
    raise RuntimeError("no compiled object")


def test_an_error_after_the_end_of_a_stage_is_its_end():
    """numba made a RuntimeError of the interruption of a compilation."""
    with Interrupts("stop") as stops, pytest.raises(StageOver), stops.no_longer_than(60.0, lambda: True):
        interrupted_library()
    with Interrupts("stop") as stops, pytest.raises(RuntimeError), stops.no_longer_than(60.0, lambda: False):
        interrupted_library()


def test_a_kernel_that_is_being_loaded_is_not_interrupted():
    """The judgement after the search failed in a kernel that was half loaded."""
    loading = {"__name__": "numba.core.caching", "signal": signal}
    exec("def load():\n    signal.raise_signal(signal.SIGALRM)\n    return 'loaded'", loading)
    with Interrupts("stop") as stops:
        with stops.no_longer_than(60.0, lambda: True):
            assert loading["load"]() == "loaded"
        with pytest.raises(StageOver), stops.no_longer_than(60.0, lambda: True):
            signal.raise_signal(signal.SIGALRM)


def test_a_stage_ends_only_when_it_is_ready_and_not_outside_of_it():
    with Interrupts("stop") as stops:
        with stops.no_longer_than(60.0, lambda: False):
            signal.raise_signal(signal.SIGALRM)
        signal.raise_signal(signal.SIGTERM)
        assert stops.any()
        # No alarm is set where nothing would take it.
        assert signal.setitimer(signal.ITIMER_REAL, 0.0) == (0.0, 0.0)


def test_without_time_only_the_chosen_route_has_a_size():
    site = make_site(hills)
    result = plan(site, SearchRequest(**EFFORT))
    bare = dataclasses.replace(
        result, members=tuple(dataclasses.replace(m, mission=None) for m in result.members), chosen=result.members[0]
    )
    bare = dataclasses.replace(bare, chosen=bare.members[0])
    over = CommandTime(begun_s=0.0, budget_s=1.0, now=lambda: 2.0)
    assert [m.mission is not None for m in with_sizes(site, bare, limit=over).members].count(True) == 1
    assert all(m.mission is not None for m in with_sizes(site, bare).members)


def _zones(count: int, corners: int, radius_m: float) -> str:
    """Zones in rows, as tables of a scenario."""
    from pyproj import Transformer

    to_earth, rng, text = Transformer.from_crs(TRUE_TO_SCALE, 4326, always_xy=True), np.random.default_rng(45), ""
    side = int(np.ceil(np.sqrt(count)))
    angles = 2.0 * np.pi * np.arange(corners) / corners
    for k in range(count):
        middle = (np.array([k % side, k // side]) + 0.5) / side * 440.0 - 220.0
        ring = middle + radius_m * rng.uniform(0.7, 1.0, (corners, 1)) * np.column_stack(
            [np.cos(angles), np.sin(angles)]
        )
        positions = np.column_stack(to_earth.transform(*ring.T)).tolist()
        text += f"\n[[no_fly]]\npolygon_lon_lat_deg = {positions}\nmargin_m = 2.0\n"
    return text


def _boxes(count: int) -> tuple[tuple[shapely.Polygon, float], ...]:
    rng, side = np.random.default_rng(46), int(np.ceil(np.sqrt(count)))
    at = [(np.array([k % side, k // side]) + 0.5) / side * 440.0 - 220.0 for k in range(count)]
    return tuple((shapely.box(e - 2.0, n - 2.0, e + 2.0, n + 2.0), float(rng.uniform(5, 40))) for e, n in at)


CASES = {
    "zones": lambda kind: (kind, _zones(120, 4, 6.0)),
    "many corners": lambda kind: (kind, _zones(300, 16, 5.0)),
    "one zone": lambda kind: (kind, _zones(1, 2000, 90.0)),
    "obstacles": lambda kind: (dataclasses.replace(kind, prisms=_boxes(1000)), ""),
    "terraces": lambda _: (KINDS["terraces"], ""),
    "canyon": lambda _: (KINDS["canyon"], ""),
}
BUDGET_S = 10.0


@pytest.mark.parametrize("case", CASES)
def test_a_command_keeps_its_budget_of_processor_time(case, tmp_path):
    """The budget is the clock's, which on a busy machine gives less processor time: never more than the rule allows."""
    kind, more = CASES[case](KINDS["flat"])
    scenario = write_kind(
        tmp_path, kind, name=case, required=0.98, sensor=SENSORS["nadir"], vehicle='autopilot = "px4"', more=more
    )
    command = [sys.executable, "-m", "uavcover", "plan", scenario, "-o", tmp_path / "run", "--workers", "1"]
    # The budget rule holds for kernels that are compiled already.
    subprocess.run([*command, "--evaluations", "60"], capture_output=True, timeout=600, check=False)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [*command, "--force", "--budget", f"{BUDGET_S}s"], capture_output=True, text=True, timeout=600, check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode in (0, 1), done.stderr
    assert (tmp_path / "run" / "plan.json").exists()
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert used_s <= 1.05 * BUDGET_S + 1.0


def test_a_flat_site_with_a_zone_is_planned_within_no_time_at_all():
    """A budget that is over before the search begins still gives a route."""
    zone = NoFly(polygon_east_north_m=((100, 50), (140, 50), (140, 90), (100, 90)), margin_m=2.0)
    result = plan(make_site(flat, no_fly=(zone,)), SearchRequest(budget_s=1e-3, workers=1, algorithm="memetic"))
    assert result.chosen.violation <= 0.0


def test_a_refusal_within_a_budget_says_that_more_time_may_help():
    limits = {"max_height_agl_m": 50.0, "max_climb_angle_deg": 15.0, "height_margin_m": 1.0}
    # Higher by 100 m at every second node of the ground: no leg keeps the height band.
    site = make_site(lambda east, north: 100.0 * ((east + north) // 10.0 % 2.0), limits=limits)
    with pytest.raises(InfeasibleError, match=r"max_climb_angle_deg.*, or use a larger --budget$"):
        plan(site, SearchRequest(budget_s=1e-3, workers=1, algorithm="memetic"))
