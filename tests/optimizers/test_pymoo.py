"""pymoo both ways: its algorithms behind our ask and tell, and ours in its minimize."""

import subprocess
import sys

import numpy as np
import pytest
from pymoo.algorithms.moo.nsga3 import NSGA3
from pymoo.algorithms.moo.sms import SMSEMOA
from pymoo.core.problem import Problem
from pymoo.optimize import minimize
from pymoo.problems import get_problem

from tests.optimizers.problems import minimise, outside_the_corner, two_spheres
from tests.optimizers.test_convergence import solve
from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.indicators import hypervolume, inverted_generational_distance
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.optimizers import ALGORITHMS, ImodboNiching
from uavcover.optimizers.pymoo.adapters import PymooOptimizer, spread_weights
from uavcover.optimizers.pymoo.algorithm import UavcoverAlgorithm

OCTANT = spread_weights(200, 3) / np.linalg.norm(spread_weights(200, 3), axis=1, keepdims=True)


class TestTheirsInOurs:
    # limits beside the worst of seeds 0-3
    @pytest.mark.parametrize(("name", "limit"), [("nsga2", 0.4), ("moead", 1.1)])  # 0.31, 0.86
    def test_zdt1(self, name, limit):
        problem = get_problem("zdt1")
        result = solve(name, problem, population_size=40, max_iterations=60)
        assert inverted_generational_distance(problem.pareto_front(), result.objectives) < limit

    @pytest.mark.parametrize(("name", "limit"), [("nsga2", 0.14), ("moead", 0.26)])  # 0.113, 0.216
    def test_dtlz2(self, name, limit):
        result = solve(name, get_problem("dtlz2"), population_size=60, max_iterations=40)
        assert inverted_generational_distance(OCTANT, result.objectives) < limit

    @pytest.mark.parametrize(("name", "limit"), [("nsga2", 0.98), ("moead", 0.97)])  # 0.9899, 0.9816
    def test_bnh_is_constrained(self, name, limit):
        problem, reference = get_problem("bnh"), np.array([150.0, 55.0])
        result = solve(name, problem, population_size=50, max_iterations=40)
        assert result.feasible
        assert (result.violations <= 0).all()
        assert hypervolume(result.objectives, reference) > limit * hypervolume(problem.pareto_front(), reference)

    @pytest.mark.parametrize(
        "theirs", [lambda n: NSGA3(spread_weights(n, 2), pop_size=n), lambda n: SMSEMOA(pop_size=n)]
    )
    def test_any_other_algorithm_by_a_subclass(self, theirs):
        class Other(PymooOptimizer):
            def _build(self):
                return theirs(self._population_size)

        def build():
            return Other([0.0, 0.0], [2.0, 2.0], n_objectives=2, population_size=16, max_iterations=12, seed=3)

        whole, part = build(), build()
        for _ in range(5):
            part.tell(two_spheres(part.ask()))
        part.ask()
        resumed = Other.from_state(part.state_dict())
        assert np.array_equal(minimise(whole, two_spheres).x, minimise(resumed, two_spheres).x)

    def test_what_cannot_be_pickled_runs_but_is_not_saved(self):
        class Unsaved(PymooOptimizer):
            def _build(self):
                return SMSEMOA(pop_size=self._population_size, callback=lambda _: None)

        optimizer = Unsaved([0.0], [1.0], n_objectives=2, population_size=8, max_iterations=3, seed=0)
        optimizer.tell(two_spheres(optimizer.ask()))
        with pytest.raises(OptimizerError, match="state: SMSEMOA of pymoo cannot be pickled"):
            optimizer.state_dict()
        assert minimise(optimizer, two_spheres).feasible

    def test_too_many_candidates_are_refused(self):
        class Greedy(PymooOptimizer):
            def _build(self):
                return SMSEMOA(pop_size=self._population_size, n_offsprings=2 * self._population_size)

        optimizer = Greedy([0.0], [1.0], n_objectives=2, population_size=4, max_iterations=3, seed=0)
        optimizer.tell(two_spheres(optimizer.ask()))
        with pytest.raises(OptimizerError, match="SMSEMOA proposed 8 candidates for a population of 4"):
            optimizer.ask()

    @pytest.mark.parametrize("name", ["nsga2", "moead"])
    def test_a_box_of_one_point_is_filled_up(self, name):
        optimizer = ALGORITHMS[name]([1.0], [1.0], n_objectives=2, population_size=4, max_iterations=3, seed=0)
        result = minimise(optimizer, two_spheres)
        assert result.x.tolist() == [[1.0]]

    def test_a_child_replaces_at_most_its_share_of_neighbours(self):
        optimizer = ALGORITHMS["moead"](
            [0.0, 0.0], [2.0, 2.0], n_objectives=2, population_size=100, max_iterations=9, seed=3
        )
        optimizer.tell(two_spheres(optimizer.ask()))
        replaced = 0
        while not optimizer.should_stop:
            optimizer.tell(two_spheres(optimizer.ask()))
            alive = [id(individual) for individual in optimizer._algorithm.pop]
            counts = [alive.count(id(child)) for child in optimizer._algorithm.off]
            assert max(counts) == 1  # n_r = 0.01 of 100
            replaced += sum(counts)
        assert replaced > 50

    def test_moead_prefers_less_violation(self):
        optimizer = ALGORITHMS["moead"](
            [-1.0, -1.0], [2.0, 2.0], n_objectives=2, n_constraints=2, population_size=30, max_iterations=20, seed=3
        )
        minimise(optimizer, two_spheres, outside_the_corner)
        assert (optimizer._algorithm.pop.get("total_violation") == 0).mean() > 0.9

    def test_pymoo_is_imported_only_when_needed(self):
        code = (
            "import sys, uavcover.optimizers as o; "
            "assert not any(name.split('.')[0] == 'pymoo' for name in sys.modules); "
            "sys.modules['pymoo'] = None; "
            "o.ALGORITHMS['nsga2']([0], [1], n_objectives=2, seed=1).ask()"
        )
        ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert "OptimizerError: NSGA2 requires pymoo (" in ran.stderr


class TestWeights:
    @pytest.mark.parametrize(("n", "m"), [(1, 1), (5, 1), (2, 2), (200, 2), (2, 3), (91, 3), (200, 3), (56, 4)])
    def test_are_different_points_of_the_simplex(self, n, m):
        weights = spread_weights(n, m)
        assert weights.shape == (n, m)
        assert np.allclose(weights.sum(axis=1), 1)
        assert (weights >= 0).all()
        assert m == 1 or len(np.unique(weights, axis=0)) == n

    def test_are_spread(self):
        weights = spread_weights(200, 3)
        assert {tuple(corner) for corner in np.eye(3)} <= {tuple(row) for row in weights.tolist()}
        gaps = np.linalg.norm(weights[:, None] - weights[None], axis=2) + np.eye(200) * 9
        assert gaps.min() > 0.5 * np.sqrt(2) / 18.5  # a regular lattice of 200 would have 18.5 divisions


class TestOursInTheirs:
    @pytest.mark.parametrize(
        ("name", "reference"), [("zdt1", [1.1, 6.0]), ("dtlz2", [2.5, 2.5, 2.5]), ("bnh", [150.0, 55.0])]
    )
    def test_same_seed_same_result_as_ask_and_tell(self, name, reference):
        problem = get_problem(name)

        def run(seed):
            return minimize(problem, UavcoverAlgorithm("imodbo", population_size=30), ("n_gen", 40), seed=seed)

        one, two, other = run(1), run(1), run(2)
        own = solve("imodbo", problem, population_size=30, max_iterations=40, seed=1)
        assert np.array_equal(one.X, own.x)
        assert np.array_equal(one.F, own.objectives)
        assert np.array_equal(one.X, two.X)
        assert not np.array_equal(one.X, other.X)
        assert one.algorithm.evaluator.n_eval == 1200
        assert (one.CV <= 0).all()
        assert hypervolume(one.F, reference) > 0

    def test_every_algorithm_runs(self):
        for name, algorithm in ALGORITHMS.items():
            if issubclass(algorithm, PymooOptimizer):
                continue
            problem = get_problem("sphere") if algorithm.most_objectives == 1 else get_problem("bnh")
            result = minimize(problem, UavcoverAlgorithm(name, population_size=12), ("n_gen", 4), seed=1)
            assert np.isfinite(result.F).all(), name

    def test_a_choice_from_a_pool_is_made_once_at_the_end(self, monkeypatch):
        asked = []
        choose = ImodboNiching.pareto_set
        monkeypatch.setattr(ImodboNiching, "pareto_set", lambda self: asked.append(self.iteration) or choose(self))
        problem, algorithm = get_problem("zdt1"), UavcoverAlgorithm("imodbo-niching", population_size=20)
        result = minimize(problem, algorithm, ("n_gen", 30), seed=1)
        own = solve("imodbo-niching", problem, population_size=20, max_iterations=30, seed=1)
        assert np.array_equal(result.X, own.x)
        assert np.array_equal(result.F, own.objectives)
        assert asked == [30, 30]

    def test_whether_local_sets_are_wanted_is_read_from_the_problem(self):
        class WithLocalSets(Problem):
            local_sets_wanted = True

            def __init__(self):
                mmf = PROBLEMS["MMF11_l"]
                super().__init__(n_var=2, n_obj=2, xl=mmf.lower, xu=mmf.upper)

            def _evaluate(self, x, out, *_, **__):
                out["F"] = PROBLEMS["MMF11_l"].evaluate(x)

        algorithm = UavcoverAlgorithm("imodbo-niching", population_size=40)
        found = minimize(WithLocalSets(), algorithm, ("n_gen", 100), seed=1).X
        assert np.count_nonzero(np.abs(found[:, 1] - 0.745) < 0.03) >= 6

    def test_a_run_that_is_ended_early_returns_the_chosen_set(self):
        algorithm = UavcoverAlgorithm("imodbo-niching", population_size=20, max_iterations=50)
        result = minimize(get_problem("zdt1"), algorithm, ("n_gen", 10), seed=1)
        assert np.array_equal(result.X, result.algorithm.optimizer.pareto_set().x)

    def test_equality_constraints_keep_their_sign(self):
        class OffTheLine(Problem):
            def __init__(self):
                super().__init__(n_var=2, n_obj=2, n_eq_constr=1, xl=[0.0, 0.5], xu=[0.25, 1.0])

            def _evaluate(self, x, out, *_, **__):
                out["F"] = two_spheres(x)
                out["H"] = x[:, :1] - x[:, 1:]

        algorithm = UavcoverAlgorithm("modbo", population_size=20, return_least_infeasible=True)
        result = minimize(OffTheLine(), algorithm, ("n_gen", 40), seed=1)
        np.testing.assert_allclose(result.H, result.X[:, :1] - result.X[:, 1:])
        np.testing.assert_allclose(result.CV, 0.25 - 1e-4)

    def test_one_objective_gives_one_solution(self):
        result = minimize(get_problem("sphere"), UavcoverAlgorithm("dbo", population_size=20), ("n_gen", 60), seed=1)
        assert result.X.shape == (10,)
        assert result.F[0] < 0.01

    def test_without_a_seed_runs_differ_and_can_be_repeated(self):
        one, two = (minimize(get_problem("bnh"), UavcoverAlgorithm("modbo"), ("n_eval", 200)) for _ in range(2))
        assert not np.array_equal(one.X, two.X)
        again = minimize(get_problem("bnh"), UavcoverAlgorithm("modbo"), ("n_eval", 200), seed=one.algorithm.seed)
        assert np.array_equal(one.X, again.X)

    def test_equality_constraints_keep_pymoos_tolerance(self):
        class OnALine(Problem):
            def __init__(self):
                super().__init__(n_var=2, n_obj=2, n_ieq_constr=1, n_eq_constr=1, xl=0.0, xu=1.0)

            def _evaluate(self, x, out, *_, **__):
                out["F"] = two_spheres(x)
                out["G"] = 0.25 - x[:, :1]
                out["H"] = x[:, :1] - x[:, 1:]

        result = minimize(OnALine(), UavcoverAlgorithm("modbo", population_size=40), ("n_gen", 60), seed=1)
        assert (np.abs(result.H) <= 1e-4).all()
        assert (result.G <= 0).all()
        assert (result.CV == 0).all()

    def test_nothing_feasible_is_reported_as_pymoo_does(self):
        class Impossible(Problem):
            def __init__(self):
                super().__init__(n_var=1, n_obj=2, n_ieq_constr=1, xl=0.0, xu=1.0)

            def _evaluate(self, x, out, *_, **__):
                out["F"], out["G"] = two_spheres(x), 1.0 + x

        assert minimize(Impossible(), UavcoverAlgorithm("modbo"), ("n_gen", 5), seed=1).X is None
        least = minimize(Impossible(), UavcoverAlgorithm("modbo", return_least_infeasible=True), ("n_gen", 5), seed=1)
        assert least.X.ravel() == pytest.approx([0.0])

    def test_rounds_come_from_max_iterations_or_from_the_termination(self):
        problem = get_problem("bnh")
        assert minimize(problem, UavcoverAlgorithm("modbo", max_iterations=7), seed=1).algorithm.evaluator.n_eval == 350
        both = minimize(problem, UavcoverAlgorithm("modbo", max_iterations=7), ("n_gen", 20), seed=1)
        assert both.algorithm.evaluator.n_eval == 350  # more rounds than it planned for are not made
        with pytest.raises(OptimizerError, match="use max_iterations"):
            minimize(problem, UavcoverAlgorithm("modbo"), ("time", "00:00:01"), seed=1)

    def test_an_unknown_name_is_refused(self):
        with pytest.raises(OptimizerError, match="'simplex' is unknown; choose one of dbo, "):
            UavcoverAlgorithm("simplex")
        with pytest.raises(OptimizerError, match="'nsga2' is pymoo's own algorithm; use it directly"):
            UavcoverAlgorithm("nsga2")

    def test_bad_values_are_refused(self):
        class Broken(Problem):
            def __init__(self):
                super().__init__(n_var=1, n_obj=2, xl=0.0, xu=1.0)

            def _evaluate(self, x, out, *_, **__):
                out["F"] = np.hstack([x, x * np.nan])

        with pytest.raises(OptimizerError, match="objectives: entry"):
            minimize(Broken(), UavcoverAlgorithm("modbo"), ("n_gen", 5), seed=1)

    def test_history_can_be_kept(self):
        result = minimize(
            get_problem("bnh"), UavcoverAlgorithm("imodbo"), ("n_gen", 4), seed=1, save_history=True, verbose=False
        )
        sizes = [len(entry.opt) for entry in result.history]
        assert len(sizes) == 4
        assert sizes[-1] == len(result.X)
