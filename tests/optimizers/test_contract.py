"""What every algorithm must keep to, whatever it does inside."""

import copy

import numpy as np
import pytest

from tests.optimizers.problems import minimise, outside_the_corner, two_spheres
from uavcover.errors import OptimizerError
from uavcover.optimizers import ALGORITHMS
from uavcover.optimizers.pymoo.adapters import PymooOptimizer

LOWER, UPPER = np.array([-1.0, -1.0, 0.5]), np.array([2.0, 2.0, 0.5])


@pytest.fixture(params=sorted(ALGORITHMS))
def algorithm(request):
    return ALGORITHMS[request.param]


def width(algorithm):
    return algorithm.most_objectives or 2


def objectives_of(algorithm):
    return lambda x: two_spheres(x)[:, : width(algorithm)]


def build(algorithm, **overrides):
    arguments = {"n_objectives": width(algorithm), "population_size": 12, "max_iterations": 8, "seed": 1} | overrides
    return algorithm(LOWER, UPPER, **arguments)


def tell(optimizer):
    optimizer.tell(objectives_of(optimizer)(optimizer.ask()))


def same(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    return one == other


def test_candidates_are_read_only_rows_inside_the_bounds(algorithm):
    optimizer = build(algorithm)
    while not optimizer.should_stop:
        x = optimizer.ask()
        assert (x.shape, x.dtype) == ((12, 3), np.float64)
        assert ((x >= LOWER) & (x <= UPPER)).all()
        assert not x.flags.writeable
        assert optimizer.ask() is x  # asking again changes nothing
        optimizer.tell(objectives_of(algorithm)(x))
    assert (optimizer.iteration, optimizer.evaluations) == (8, 96)
    with pytest.raises(OptimizerError, match="all 8 iterations are done"):
        optimizer.ask()


def test_pareto_set_is_read_only_and_holds_what_was_evaluated(algorithm):
    result = minimise(build(algorithm, archive_size=5), objectives_of(algorithm))
    assert 1 <= len(result) <= 5
    assert result.feasible
    assert result.violations.shape == (len(result), 0)
    np.testing.assert_array_equal(objectives_of(algorithm)(result.x), result.objectives)
    assert not any(array.flags.writeable for array in (result.x, result.objectives, result.violations))


def test_same_seed_same_result_and_other_seed_other_result(algorithm):
    one, two, other = (minimise(build(algorithm, seed=seed), objectives_of(algorithm)) for seed in (7, 7, 8))
    assert np.array_equal(one.x, two.x)
    assert not np.array_equal(one.x, other.x)


def test_a_seed_sequence_is_a_seed_and_is_not_changed(algorithm):
    sequence = np.random.SeedSequence(3)
    one, two = (build(algorithm, seed=sequence).ask() for _ in range(2))
    assert np.array_equal(one, two)
    assert sequence.n_children_spawned == 0


@pytest.mark.parametrize("rounds", [0, 1, 4])
@pytest.mark.parametrize("asked", [False, True])
def test_a_resumed_run_equals_an_uninterrupted_one(algorithm, rounds, asked):
    whole = build(algorithm, initial=[[0.0, 0.0, 0.5]])
    for _ in range(rounds):
        tell(whole)
    if asked:
        whole.ask()
    saved = whole.state_dict()
    kept = copy.deepcopy(saved)
    resumed = algorithm.from_state(saved)
    assert same(resumed.state_dict(), saved)
    expected, result = (minimise(optimizer, objectives_of(algorithm)) for optimizer in (whole, resumed))
    assert np.array_equal(expected.x, result.x)
    assert np.array_equal(expected.objectives, result.objectives)
    assert same(saved, kept)  # a state is a copy, not a window


def test_a_state_of_another_algorithm_is_refused(algorithm):
    state = build(algorithm).state_dict() | {"algorithm": "Simplex"}
    with pytest.raises(OptimizerError, match="saved by 'Simplex'"):
        algorithm.from_state(state)


NONE = np.ones((12, 1))


@pytest.mark.parametrize(
    ("objectives", "violations", "message"),
    [
        (lambda m: np.ones((11, m)), NONE, r"objectives have shape \(11, {m}\); use \(12, {m}\)"),
        (lambda _: np.ones((12, 3)), NONE, r"objectives have shape \(12, 3\)"),
        (lambda _: np.ones(12), NONE, r"objectives have shape \(12,\)"),
        (lambda m: np.where(np.eye(12, m) > 0, np.nan, 1.0), NONE, r"objectives: entry \(0, 0\) is nan"),
        (lambda m: np.where(np.eye(12, m, -1) > 0, -np.inf, 1.0), NONE, r"objectives: entry \(1, 0\) is -inf"),
        (lambda _: [[1.0, 2.0], [3.0]], NONE, "objectives: this is not an array of numbers"),
        (lambda m: np.ones((12, m)), None, "violations are missing"),
        (lambda m: np.ones((12, m)), np.ones((12, 2)), r"violations have shape \(12, 2\)"),
        (lambda m: np.ones((12, m)), NONE * np.nan, r"violations: entry \(0, 0\) is nan"),
    ],
)
def test_a_bad_tell_is_refused_and_changes_nothing(algorithm, objectives, violations, message):
    optimizer, m = build(algorithm, n_constraints=1), width(algorithm)
    optimizer.tell(objectives_of(algorithm)(optimizer.ask()), np.zeros((12, 1)))
    x = optimizer.ask()
    before = optimizer.state_dict()
    with pytest.raises(OptimizerError, match=message.format(m=m)):
        optimizer.tell(objectives(m), violations)
    assert same(optimizer.state_dict(), before)
    optimizer.tell(objectives_of(algorithm)(x), np.zeros((12, 1)))  # the same candidates can be told again
    assert optimizer.iteration == 2


def test_tell_before_ask_and_result_before_tell_are_refused(algorithm):
    optimizer = build(algorithm)
    with pytest.raises(OptimizerError, match="no candidates evaluated"):
        optimizer.pareto_set()
    with pytest.raises(OptimizerError, match="no candidates are open"):
        optimizer.tell(np.ones((12, width(algorithm))))
    tell(optimizer)
    with pytest.raises(OptimizerError, match="no candidates are open"):
        optimizer.tell(np.ones((12, width(algorithm))))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"n_objectives": 0}, "n_objectives is 0"),
        ({"n_constraints": -1}, "n_constraints is -1"),
        ({"population_size": 0}, "population_size is 0"),
        ({"population_size": 10.0}, "population_size is 10.0"),
        ({"max_iterations": 0}, "max_iterations is 0"),
        ({"archive_size": 0}, "archive_size is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": True}, "seed is True"),
        ({"initial": [[0.0, 0.0]]}, r"initial: the shape is \(1, 2\)"),
        ({"initial": np.full((13, 3), 0.5)}, r"initial: the shape is \(13, 3\)"),
        ({"initial": [[0.0, 0.0, 0.6]]}, "outside the bounds"),
        ({"initial": [[0.0, np.nan, 0.5]]}, r"initial: entry \(0, 1\) is nan"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(algorithm, overrides, message):
    with pytest.raises(OptimizerError, match=message):
        build(algorithm, **overrides)


@pytest.mark.parametrize("name", ["imodbo", "modbo", "dbo"])
def test_a_population_smaller_than_the_four_groups_is_refused(name):
    with pytest.raises(OptimizerError, match="population_size is 3; use a whole number >= 4"):
        build(ALGORITHMS[name], population_size=3)


def test_the_smallest_population_works(algorithm):
    smallest = algorithm.smallest_population
    with pytest.raises(OptimizerError, match=f"use a whole number >= {smallest}"):
        build(algorithm, population_size=smallest - 1)
    minimise(build(algorithm, population_size=smallest), objectives_of(algorithm))


def test_known_starts_take_the_place_of_the_first_samples(algorithm):
    starts = np.array([[0.0, 0.0, 0.5], [1.0, 1.0, 0.5]])
    x, without = build(algorithm, initial=starts).ask(), build(algorithm).ask()
    assert np.array_equal(x[:2], starts)
    assert np.array_equal(x[2:], without[2:])


def test_arguments_are_never_changed(algorithm):
    lower, upper, starts = LOWER.copy(), UPPER.copy(), np.array([[0.0, 0.0, 0.5]])
    optimizer = algorithm(
        lower,
        upper,
        n_objectives=width(algorithm),
        n_constraints=2,
        population_size=12,
        max_iterations=5,
        seed=1,
        initial=starts,
    )
    while not optimizer.should_stop:
        x = optimizer.ask()
        values = objectives_of(algorithm)(x), outside_the_corner(x)
        copies = [value.copy() for value in values]
        optimizer.tell(*values)
        assert all(np.array_equal(value, then) for value, then in zip(values, copies, strict=True))
        expected = optimizer.pareto_set().objectives.copy()
        values[0][:] = np.nan  # what the caller does to its arrays later is its own affair
        assert np.array_equal(optimizer.pareto_set().objectives, expected)
    assert np.array_equal(lower, LOWER)
    assert np.array_equal(upper, UPPER)
    assert starts.tolist() == [[0.0, 0.0, 0.5]]


def test_positive_scaling_of_objectives_changes_nothing(algorithm):
    # Powers of two are exact in floating point, so the runs must be identical. MOEA/D weighs the objectives as they are, so
    # for it only a common factor means nothing.
    factors = np.array([1024.0, 1024.0 if algorithm is ALGORITHMS["moead"] else 0.25])[: width(algorithm)]
    plain = minimise(build(algorithm), objectives_of(algorithm))
    scaled = minimise(build(algorithm), lambda x: objectives_of(algorithm)(x) * factors)
    assert np.array_equal(plain.x, scaled.x)


def test_constraints_are_kept_once_a_feasible_point_is_known(algorithm):
    optimizer = build(algorithm, n_constraints=2, max_iterations=30)
    result = minimise(optimizer, objectives_of(algorithm), outside_the_corner)
    assert result.feasible
    assert (result.violations <= 0).all()
    assert (result.x[:, :2] >= 0.25).all()


def test_without_a_feasible_point_the_least_violating_is_returned(algorithm):
    optimizer = build(algorithm, n_constraints=1)
    observed = []
    while not optimizer.should_stop:
        x = optimizer.ask()
        violations = 1.0 + x[:, :1] ** 2
        observed += violations.ravel().tolist()
        optimizer.tell(objectives_of(algorithm)(x), violations)
    result = optimizer.pareto_set()
    assert not result.feasible
    assert (result.violations == min(observed)).all()


@pytest.mark.no_cover
def test_memory_does_not_grow(algorithm):
    def size(value):
        return sum(map(size, value.values())) if isinstance(value, dict) else getattr(value, "nbytes", 0)

    optimizer = build(algorithm, max_iterations=200)
    sizes = []
    while not optimizer.should_stop:
        tell(optimizer)
        if optimizer.iteration % 10 == 0:
            sizes.append(size(optimizer.state_dict()))
    archive = 12 * (3 + width(algorithm)) * 8
    # only the archive changes, up to its capacity; a pickle, too, by what repeats itself in it
    slack = archive + (sizes[0] // 4 if issubclass(algorithm, PymooOptimizer) else 0)
    assert max(sizes) - min(sizes) <= slack


@pytest.mark.parametrize("m", [1, 3, 4])
def test_other_numbers_of_objectives(algorithm, m):
    if algorithm.most_objectives is not None and m > algorithm.most_objectives:
        with pytest.raises(OptimizerError, match=f"n_objectives is {m}, but {algorithm.__name__} minimises at most 1"):
            build(algorithm, n_objectives=m)
        return
    centres = np.linspace(-1, 1, m)
    result = minimise(
        build(algorithm, n_objectives=m), lambda x: ((x[:, None, :] - centres[None, :, None]) ** 2).sum(axis=2)
    )
    assert result.objectives.shape[1] == m
