"""The contract of all algorithms with local sets wanted, and the parts of this one."""

import numpy as np
import pytest

from tests.naive import niching as naive
from tests.optimizers.test_contract import *  # noqa: F403 -- its tests run here with the fixture below
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.kernels.niching import dominated_near, last_apart, niche_survivors, spread_out, two_space_medoids
from uavcover.optimizers.ask_tell import Solutions
from uavcover.optimizers.imodbo_niching import ImodboNiching, NichePool, neighbours, representatives, smoothed


class _WithLocalSets(ImodboNiching):
    def __init__(self, *arguments, **named):
        super().__init__(*arguments, **{"local_sets_wanted": True} | named)


@pytest.fixture
def algorithm():  # in place of the contract suite's own
    return _WithLocalSets


NEVER = np.array([np.inf, np.inf])


def run(name, *, seed=1, rounds=60, **overrides):
    problem = PROBLEMS[name]
    arguments = {"population_size": 40, "archive_size": 30, "local_sets_wanted": problem.local_sets_wanted} | overrides
    optimizer = ImodboNiching(
        problem.lower, problem.upper, n_objectives=problem.n_objectives, max_iterations=rounds, seed=seed, **arguments
    )
    while not optimizer.should_stop:
        optimizer.tell(problem.evaluate(optimizer.ask()))
    return optimizer.pareto_set()


@pytest.mark.parametrize(
    ("radius", "slack", "expected"),
    [
        # Row 0 dominates rows 1 and 2; row 1 is 0.1 away from it and row 2 is 0.5 away.
        (0.2, NEVER, [True, False, True]),
        (0.05, NEVER, [True, True, True]),
        (0.6, NEVER, [True, False, False]),
        (0.05, np.array([0.15, 0.15]), [True, True, False]),  # row 1 is 0.1 worse, row 2 is 0.2 worse
        (0.05, np.array([0.05, 0.05]), [True, False, False]),
    ],
)
def test_a_dominated_point_stays_when_its_dominator_is_far_and_little_better(radius, slack, expected):
    x = np.array([[0.0, 0.0], [0.1, 0.0], [0.5, 0.0]])
    objectives = np.array([[1.0, 1.0], [1.1, 1.1], [1.2, 1.2]])
    assert niche_survivors(x, objectives, 0, radius, slack, 0.0).tolist() == expected
    assert niche_survivors(x[::-1].copy(), objectives[::-1].copy(), 0, radius, slack, 0.0).tolist() == expected[::-1]


def test_of_equals_that_are_too_close_the_later_stays_and_of_repetitions_the_earlier():
    x = np.array([[0.0], [0.01], [0.5], [0.5]])
    objectives = np.array([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0], [1.0, 0.0]])
    assert niche_survivors(x, objectives, 0, 0.0, NEVER, 0.02).tolist() == [False, True, True, False]


def test_thinning_does_not_run_along_a_chain():
    assert last_apart(np.arange(7.0)[:, None], 1.0).tolist() == [True, False, True, False, True, False, True]


def test_rows_before_the_start_do_not_meet_each_other():
    x = np.array([[0.0], [0.01], [0.02]])
    objectives = np.array([[0.0, 0.0], [1.0, 1.0], [-1.0, 2.0]])
    assert niche_survivors(x, objectives, 2, 0.1, NEVER, 0.0).tolist() == [True, True, True]


def test_farthest_points_by_hand():
    points = np.array([[0.0], [0.4], [0.5], [1.0], [1.0]])
    assert spread_out(points, np.array([0]), 3).tolist() == [0, 3, 2]
    assert spread_out(points, np.array([0]), 5).tolist() == [0, 3, 2, 1]  # the fifth repeats the fourth


def test_medoids_by_hand():
    # Two groups of three; from a bad start each group's middle is found. With the first one fixed it stays.
    x = np.array([[0.0], [0.1], [0.2], [5.0], [5.1], [5.2]])
    even, none = np.ones(6), np.zeros(6)
    assert sorted(two_space_medoids(x, x, even, none, np.array([0, 2]), 0, 9).tolist()) == [1, 4]
    assert two_space_medoids(x, x, even, none, np.array([0, 2]), 1, 9).tolist() == [0, 4]
    # The same with the groups in the second space.
    assert sorted(two_space_medoids(np.zeros((6, 1)), x, none, even, np.array([0, 2]), 0, 9).tolist()) == [1, 4]


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.no_cover
def test_kernels_equal_their_naive_twins(seed):
    rng = np.random.default_rng(seed)
    n, d, m = int(rng.integers(6, 25)), int(rng.integers(1, 4)), int(rng.integers(1, 4))
    x, objectives = rng.integers(0, 5, (n, d)) / 4, rng.integers(0, 4, (n, m)).astype(float)
    radius, spacing, slack = rng.choice([0.0, 0.3, 0.8]), rng.choice([0.0, 0.3]), rng.choice([0.5, 1.5, np.inf], m)
    start = int(rng.integers(0, n))
    assert niche_survivors(x, objectives, start, radius, slack, spacing).tolist() == naive.niche_survivors(
        x, objectives, start, radius, slack, spacing
    )
    assert last_apart(x, spacing).tolist() == naive.last_apart(x, spacing)
    half = n // 2
    parts = x[:half], objectives[:half], x[half:], objectives[half:]
    assert dominated_near(*parts, radius).tolist() == naive.dominated_near(*parts, radius)
    x, f = rng.random((n, d)), rng.random((n, m))  # no ties
    assert spread_out(x, np.array([1, 3]), 5).tolist() == naive.spread_out(x, [1, 3], 5)
    weights = rng.random((2, n))
    first = spread_out(x, np.array([1, 3]), 5)
    medoids = two_space_medoids(x, f, *weights, first, 2, 3)
    assert medoids.tolist() == naive.two_space_medoids(x, f, *weights, first.tolist(), 2, 3)
    assert medoids[:2].tolist() == [1, 3]


@pytest.mark.parametrize("d", [1, 2, 3, 5])
@pytest.mark.parametrize("radius", [0.0, 0.1, 0.25, 2.0])
def test_shadows_cross_the_cells_of_the_grid(d, radius):
    rng = np.random.default_rng(d)
    x, other_x = (rng.integers(-20, 21, (n, d)) / 20 for n in (60, 90))  # many pairs exactly a radius apart
    objectives, others = rng.random((60, 2)), rng.random((90, 2))
    expected = naive.dominated_near(x, objectives, other_x, others, radius)
    assert dominated_near(x, objectives, other_x, others, radius).tolist() == expected
    assert dominated_near(x, objectives, other_x[:0], others[:0], radius).tolist() == [False] * 60
    assert radius < 1.0 or any(expected)


def test_representatives_of_an_even_line_are_even_and_hold_its_ends():
    t = np.linspace(0.0, 1.0, 401)[:, None]
    rows = representatives(
        t,
        np.hstack([t, 1 - t]),
        11,
        shortlist=401,
        front_weights=(1.0,),
        front_allowance=1.0,
        crowd_radius=0.35,
        passes=5,
    )
    assert {rows[0], rows[-1]} == {0, 400}
    assert np.diff(t[rows, 0]) == pytest.approx(0.1, abs=0.04)


def test_the_least_front_weight_that_covers_the_front_is_taken():
    t = np.linspace(0.0, 1.0, 301)
    unit, objectives = np.column_stack([t, np.zeros(301)]), np.column_stack([t**8, 1 - t**8])  # the front: near t = 1

    def chosen(weights, allowance):
        return representatives(
            unit,
            objectives,
            12,
            shortlist=301,
            front_weights=weights,
            front_allowance=allowance,
            crowd_radius=0.35,
            passes=5,
        ).tolist()

    weak, strong = chosen((0.01,), np.inf), chosen((50.0,), np.inf)
    assert np.mean(t[weak]) < np.mean(t[strong]) - 0.1
    assert chosen((0.01, 50.0), np.inf) == weak
    assert chosen((0.01, 50.0), 1.0) == strong
    assert chosen((0.01, 50.0), 0.0) == strong  # out of reach: the last weight


def test_a_thick_band_counts_no_more_than_a_thin_one():
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 1.0, 400)
    thin, thick = np.column_stack([t[::4], np.zeros(100)]), np.column_stack([np.repeat(t, 4), np.full(1600, 1.0)])
    thick[:, 1] += rng.uniform(-0.005, 0.005, 1600)
    unit = np.vstack([thin, thick])
    objectives = np.column_stack([unit[:, 0], 1 - unit[:, 0]])
    rows = representatives(
        unit, objectives, 20, shortlist=1700, front_weights=(0.01,), front_allowance=1.0, crowd_radius=0.35, passes=5
    )
    assert 8 <= np.count_nonzero(rows < 100) <= 12  # 5 if every row counts the same


class TestSmoothed:
    def test_points_of_a_parabola_stay_where_they_are(self):
        t = np.linspace(-0.5, 0.5, 7)
        curve = np.column_stack([t, 0.3 * t**2])
        near = np.array([np.roll(curve, -i, axis=0) for i in range(7)])
        np.testing.assert_allclose(smoothed(near, 1), curve, atol=1e-12)

    def test_what_scatters_around_a_tilted_plane_comes_closer_to_it(self):
        rng = np.random.default_rng(4)
        plane = rng.random((300, 2)) @ np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -0.25]])
        normal = np.cross([1.0, 0.0, 0.5], [0.0, 1.0, -0.25])
        normal /= np.linalg.norm(normal)
        scattered = plane + 0.01 * rng.standard_normal((300, 1)) * normal
        moved = smoothed(scattered[neighbours(scattered, np.arange(300), 23)], 2)
        before, after = np.abs(scattered @ normal).mean(), np.abs(moved @ normal).mean()
        assert (
            after < 0.65 * before
        )  # 6 coefficients through 24 points: sqrt(6 / 24) of the noise is left, more at the rim
        assert np.abs((moved - scattered) - ((moved - scattered) @ normal)[:, None] * normal).max() < 0.01

    @pytest.mark.parametrize(("d", "dimension"), [(1, 1), (2, 2), (2, 5), (1, 0)])
    def test_a_surface_that_fills_the_space_moves_nothing(self, d, dimension):
        near = np.random.default_rng(0).random((3, 5, d))
        np.testing.assert_allclose(smoothed(near, dimension), near[:, 0], atol=1e-12)

    @pytest.mark.parametrize("k", [1, 2, 6])
    def test_repetitions_stay(self, k):
        same = np.full((2, k, 3), 0.25)
        np.testing.assert_allclose(smoothed(same, 2), 0.25)


def test_representatives_share_equivalent_sets_fairly():
    t = np.linspace(0.0, 1.0, 200)
    unit = np.vstack([np.column_stack([t, np.zeros(200)]), np.column_stack([t, np.ones(200)])])
    objectives = np.tile(np.column_stack([t, 1 - t]), (2, 1))
    rows = representatives(
        unit, objectives, 20, shortlist=400, front_weights=(1.0,), front_allowance=1.0, crowd_radius=0.35, passes=5
    )
    assert 9 <= np.count_nonzero(rows < 200) <= 11


@pytest.mark.parametrize("n", [1, 2, 5])
def test_few_rows_are_all_returned(n):
    same = np.zeros((n, 2))
    assert representatives(
        same, same, 5, shortlist=10, front_weights=(1.0,), front_allowance=1.0, crowd_radius=0.35, passes=1
    ).tolist() == list(range(n))


def test_repetitions_and_flat_objectives_do_not_disturb_the_choice():
    unit = np.repeat(np.linspace(0, 1, 4), 3)[:, None]
    rows = representatives(
        unit, np.zeros((12, 2)), 6, shortlist=12, front_weights=(1.0,), front_allowance=1.0, crowd_radius=0.35, passes=2
    )
    assert sorted(set(unit[rows, 0])) == sorted(set(unit[:, 0]))


def test_neighbours_begin_with_the_row_itself():
    unit = np.array([[0.0], [0.1], [0.3], [1.0]])
    assert neighbours(unit, np.array([2]), 2).tolist() == [[2, 1, 0]]
    assert neighbours(unit[:1], np.array([0, 0]), 8).tolist() == [[0], [0]]


def test_the_pool_keeps_to_its_capacity_and_to_the_least_violation():
    x = np.linspace(0.0, 1.0, 50)[:, None]
    violations = np.where(x < 0.5, 1.0, -1.0)
    reported = Solutions(x, np.hstack([x, 1 - x]), violations)
    pool = NichePool(Solutions.none(1, 2, 1), np.empty((0, 1)), np.ones(1), 0.1, 12).with_evaluated(reported, x, np.inf)
    assert 6 <= len(pool) <= 12
    assert (pool.solutions.x >= 0.5).all()
    assert pool.spacing > 0


def test_all_four_equivalent_branches_are_found():
    x = run("MMF4").x  # x2 = sin(pi |x1|) and the same + 1, left and right of 0
    z = np.where(x[:, 1] <= 1, x[:, 1], x[:, 1] - 1)
    assert np.abs(z - np.sin(np.pi * np.abs(x[:, 0]))).max() < 0.15
    branches = 2 * (x[:, 0] > 0) + (x[:, 1] > 1)
    assert (np.bincount(branches, minlength=4) >= 4).all()


def test_local_sets_are_returned_if_they_are_wanted_and_only_then():
    both, best = run("MMF11_l", rounds=120).x[:, 1], run("MMF11", rounds=120).x[:, 1]
    assert np.count_nonzero(np.abs(both - 0.745) < 0.03) >= 6
    assert np.count_nonzero(np.abs(both - 0.249) < 0.03) >= 6
    assert (np.abs(best - 0.249) < 0.05).all()


@pytest.mark.parametrize("name", ["MMF1", "MMF15_l"])
def test_a_run_resumed_while_scouting_or_later_equals_an_uninterrupted_one(name):
    problem = PROBLEMS[name]
    optimizer = ImodboNiching(
        problem.lower,
        problem.upper,
        n_objectives=problem.n_objectives,
        population_size=20,
        max_iterations=40,
        seed=3,
        local_sets_wanted=problem.local_sets_wanted,
    )
    resumed = []
    for rounds in range(40):
        if rounds in (2, 20, 37):
            resumed.append(ImodboNiching.from_state(optimizer.state_dict()))
        x = optimizer.ask()
        for other in resumed:
            assert np.array_equal(other.ask(), x)
            other.tell(problem.evaluate(x))
        optimizer.tell(problem.evaluate(x))
    for other in resumed:
        assert np.array_equal(other.pareto_set().x, optimizer.pareto_set().x)


def test_reading_the_result_on_the_way_changes_nothing():
    problem = PROBLEMS["MMF1"]
    one, other = (
        ImodboNiching(problem.lower, problem.upper, n_objectives=2, population_size=20, max_iterations=20, seed=1)
        for _ in range(2)
    )
    while not one.should_stop:
        one.tell(problem.evaluate(one.ask()))
        other.tell(problem.evaluate(other.ask()))
        assert one.pareto_set() is one.pareto_set()
    assert np.array_equal(one.pareto_set().x, other.pareto_set().x)


def test_the_state_has_the_same_size_from_the_first_round_on():
    problem = PROBLEMS["MMF15_l"]
    optimizer = ImodboNiching(
        problem.lower,
        problem.upper,
        n_objectives=3,
        population_size=20,
        max_iterations=40,
        seed=1,
        local_sets_wanted=True,
    )
    sizes = set()
    while not optimizer.should_stop:
        optimizer.tell(problem.evaluate(optimizer.ask()))
        sizes.add(sum(values.nbytes for values in optimizer.state_dict()["memory"].values()))
    assert len(sizes) == 1
