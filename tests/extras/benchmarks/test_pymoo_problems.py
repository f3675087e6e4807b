"""The MMF problems in pymoo, and what is said when pymoo is not there."""

import pickle
import subprocess
import sys

import numpy as np
import pytest
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.optimize import minimize

from uavcover.errors import InputError
from uavcover.extras.benchmarks.indicators import inverted_generational_distance
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, reference_sets
from uavcover.extras.benchmarks.mmf.pymoo_problems import pymoo_problem
from uavcover.optimizers.pymoo.algorithm import UavcoverAlgorithm


@pytest.mark.parametrize("name", PROBLEMS)
def test_is_the_same_problem(name):
    theirs, ours = pymoo_problem(name), PROBLEMS[name]
    assert (theirs.name(), theirs.n_var, theirs.n_obj) == (name, ours.n_variables, ours.n_objectives)
    assert (theirs.n_constr, theirs.local_sets_wanted) == (0, ours.local_sets_wanted)
    assert np.array_equal(theirs.xl, ours.lower)
    assert np.array_equal(theirs.xu, ours.upper)
    x = np.random.default_rng(3).uniform(ours.lower, ours.upper, (50, ours.n_variables))
    assert np.array_equal(theirs.evaluate(x), ours.evaluate(x))
    assert np.array_equal(theirs.evaluate(x[0]), ours.evaluate(x[:1])[0])


@pytest.mark.parametrize("name", PROBLEMS)
def test_has_the_reference_sets(name):
    problem, reference = pymoo_problem(name), reference_sets(name)
    assert np.array_equal(problem.pareto_set(), reference.pareto_set)
    front = problem.pareto_front()
    assert np.array_equal(np.unique(front, axis=0), np.unique(reference.pareto_front, axis=0))
    assert len(front) == len(reference.pareto_front)


def test_bounds_are_copies():
    problem = pymoo_problem("MMF1")
    problem.xl[:] = -7.0
    assert pymoo_problem("MMF1").xl.tolist() == [1.0, -1.0]


@pytest.mark.parametrize("name", ["MMF1", "MMF16_l3"])
def test_can_be_sent_to_another_process(name):
    problem = pymoo_problem(name)
    x = np.full((2, problem.n_var), 1.0)
    assert np.array_equal(pickle.loads(pickle.dumps(problem)).evaluate(x), problem.evaluate(x))


@pytest.mark.parametrize(
    ("name", "limit"),
    [("MMF1", 0.0060), ("MMF14", 0.17)],  # worst of seeds 0-4: 0.0050, 0.143; 100 uniform points: 0.040, 0.27
)
def test_pymoos_nsga2_gets_close(name, limit):
    problem = pymoo_problem(name)
    result = minimize(problem, NSGA2(pop_size=100), ("n_gen", 60), seed=1)
    assert np.array_equal(PROBLEMS[name].evaluate(result.X), result.F)
    assert inverted_generational_distance(problem.pareto_front(), result.F) < limit


def test_ours_in_pymoo_reads_whether_local_sets_are_wanted():
    # the local set of MMF11_l is x2 = 0.745
    def at_the_local_set(name):
        found = minimize(
            pymoo_problem(name), UavcoverAlgorithm("imodbo-niching", population_size=40), ("n_gen", 100), seed=1
        )
        return np.count_nonzero(np.abs(found.X[:, 1] - 0.745) < 0.03)

    assert at_the_local_set("MMF11") == 0
    assert at_the_local_set("MMF11_l") >= 6


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(InputError, match=r"unknown problem 'MMF3'; choose from MMF1, MMF2, MMF4"):
        pymoo_problem("MMF3")


@pytest.mark.parametrize(
    ("statement", "who"),
    [
        ("import uavcover.extras.benchmarks.mmf.pymoo_problems", "uavcover.extras.benchmarks.mmf.pymoo_problems"),
        ("import uavcover.optimizers.pymoo.algorithm", "uavcover.optimizers.pymoo.algorithm"),
        ("ALGORITHMS['nsga2']([0], [1], n_objectives=2, seed=1).ask()", "NSGA2"),
        ("ALGORITHMS['moead']([0], [1], n_objectives=2, seed=1).ask()", "MOEAD"),
    ],
)
def test_without_pymoo_one_line_says_what_to_install(statement, who):
    code = f"import sys; sys.modules['pymoo'] = None; from uavcover.optimizers import ALGORITHMS; {statement}"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    last = ran.stderr.splitlines()[-1]
    assert last.startswith(f"uavcover.errors.OptimizerError: {who} requires pymoo (")
    assert last.endswith("pip install pymoo")
