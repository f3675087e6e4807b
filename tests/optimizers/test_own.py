"""Optimizers that are not ours: found by name, refused with one clear line, and guarded while they run."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from uavcover.errors import OptimizerError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS
from uavcover.extras.benchmarks.mmf.runs import Budget, MmfFolder, RunId, contender_names, make_runs, solve
from uavcover.optimizers import (
    ALGORITHMS,
    IMODBO,
    AskTellOptimizer,
    ParetoSet,
    RandomSearch,
    make_optimizer,
    optimizer_class,
    optimizer_name,
)

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "optimizers.md"
EXAMPLE = next(
    code
    for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    if "class MySearch" in code
)
SETTINGS = {"n_objectives": 2, "n_constraints": 1, "population_size": 20, "max_iterations": 6, "seed": 3}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A current folder that Python has not looked in before, with the modules of a test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(sys.modules[name].__file__):
            del sys.modules[name]


def objectives_of(x):
    return np.column_stack([(x**2).sum(axis=1), ((x - 1) ** 2).sum(axis=1)])


def minimised(algorithm, **changes):
    optimizer = make_optimizer(algorithm, [-2, -2], [2, 2], **SETTINGS | changes)
    while not optimizer.should_stop:
        x = optimizer.ask()
        optimizer.tell(objectives_of(x), 0.1 - x[:, :1])
    return optimizer


PYMOO = [
    "AGEMOEA", "AGEMOEA2", "CMOPSO", "CTAEA", "GDE3", "MOPSO_CD", "NSDE", "NSDER", "NSGA2", "NSGA3", "OmniOptimizer",
    "ParallelMOEAD", "RVEA", "SMSEMOA", "SPEA2", "UNSGA3",
]  # fmt: skip
REFUSED = {
    "MOEAD": "one candidate at a time",
    "RNSGA2": "requires ref_points; write a subclass",
    "RNSGA3": "requires ref_points, pop_per_ref_point; write a subclass",
    "DNSGA2": "DNSGA2 only works for unconstrained problems",
}


class Scripted:
    """Takes part as well as it can; a test replaces one method by a bad one."""

    def __init__(self, lower, upper, *, population_size, seed, **_):
        self.lower, self.upper, self.n = lower, upper, population_size
        self.rng = np.random.default_rng(seed)

    def ask(self):
        return self.rng.uniform(self.lower, self.upper, (self.n, len(self.lower)))

    def tell(self, objectives, violations):
        self.reported = objectives, violations


class TestNames:
    def test_ours_are_found_as_they_are(self):
        for name, algorithm in ALGORITHMS.items():
            assert optimizer_class(name) is algorithm
            assert optimizer_name(name) == name
        assert isinstance(make_optimizer("imodbo", [0], [1], **SETTINGS), IMODBO)

    def test_a_class_of_an_installed_module(self):
        assert optimizer_class("uavcover.optimizers.imodbo:IMODBO") is IMODBO
        assert optimizer_class(IMODBO) is IMODBO
        assert optimizer_name(IMODBO) == "uavcover.optimizers.imodbo:IMODBO"

    def test_a_file_in_the_current_folder_and_what_it_imports_there(self, folder):
        (folder / "step_width_of_test.py").write_text("WIDTH = 0.1\n")
        (folder / "search_of_test.py").write_text("from step_width_of_test import WIDTH\n" + EXAMPLE)
        assert optimizer_class("search_of_test:MySearch").__name__ == "MySearch"

    def test_a_nested_class(self, folder):
        (folder / "nested_of_test.py").write_text(
            "class Outer:\n" + "".join(f"    {line}\n" for line in EXAMPLE.splitlines())
        )
        assert optimizer_class("nested_of_test:Outer.MySearch").__qualname__ == "Outer.MySearch"

    @pytest.mark.parametrize(
        "name", ["", ":", "a:", ":B", "a:b:c", "a b:C", "a/b.py:C", ".a:C", "a.:C", "a:1", "a:B()", "../a:B"]
    )
    def test_what_is_no_name_says_what_to_write(self, name):
        with pytest.raises(OptimizerError, match=r"use imodbo, |write module:Class"):
            optimizer_class(name)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("X = 1\n", "has no MySearch, nor another class"),
            (EXAMPLE.replace("MySearch", "Other"), "has no MySearch; choose one of Other"),
            ("import not_there_at_all\n", "importing 'bad_of_test' fails: No module named 'not_there_at_all'"),
            ("1 / 0\n", r"fails: ZeroDivisionError: bad_of_test.py, line 1: division by zero"),
            ("def (:\n", "fails: SyntaxError"),
            ("raise SystemExit(3)\n", "fails: SystemExit"),
            ("def MySearch(*a, **k): ...\n", "is not a class"),
            ("MySearch = 5\n", "5 is not a class"),
            ("class MySearch: ...\n", r"class MySearch has no ask\(\) and no tell\(\); implement them"),
            ("class MySearch:\n def ask(self): ...\n", r"class MySearch has no tell\(\)"),
            ("class MySearch:\n ask = 1\n def tell(self): ...\n", r"class MySearch has no ask\(\)"),
            ("from uavcover.optimizers import AskTellOptimizer\nclass MySearch(AskTellOptimizer): ...\n",
             r"class MySearch is abstract; implement _move\(\)"),
            (EXAMPLE.replace(", **settings", ""), r"MySearch\(...\) does not accept its arguments .*n_objectives"),
            (EXAMPLE.replace("lower, upper, *, ", "*, lower, upper, "), "does not accept its arguments"),
        ],
    )  # fmt: skip
    def test_what_cannot_be_used_is_one_line_that_names_it(self, folder, text, message):
        (folder / "bad_of_test.py").write_text(text)
        with pytest.raises(OptimizerError, match=message) as refused:
            optimizer_class("bad_of_test:MySearch")
        assert "bad_of_test:MySearch" in str(refused.value)
        assert "\n" not in str(refused.value)

    @pytest.mark.usefixtures("folder")
    def test_a_module_that_is_not_there(self):
        for name, missing in (("nowhere_of_test:A", "nowhere_of_test"), ("nowhere_of_test.b:A", "nowhere_of_test")):
            with pytest.raises(OptimizerError, match=f"cannot find the module '{missing}'"):
                optimizer_class(name)


class TestRuns:
    def test_the_example_of_the_page_gets_better(self):
        space = {}
        exec(compile(EXAMPLE, str(PAGE), "exec"), space)
        found = minimised(space["MySearch"], max_iterations=40).pareto_set()
        assert found.feasible
        assert (found.x[:, 0] >= 0.1).all()
        assert objectives_of(found.x).sum(axis=1).min() < 1.02  # the best sum is 1

    def test_a_guarded_optimizer_finds_what_it_finds_alone(self):
        class Mine(RandomSearch):
            """Not in our table, so it is guarded."""

        alone = RandomSearch([-2, -2], [2, 2], **SETTINGS)
        while not alone.should_stop:
            x = alone.ask()
            alone.tell(objectives_of(x), 0.1 - x[:, :1])
        guarded = minimised(Mine)
        assert np.array_equal(guarded.pareto_set().x, alone.pareto_set().x)
        assert (guarded.iteration, guarded.evaluations) == (6, 120)
        assert minimised(Scripted).pareto_set().feasible

    def test_asking_again_returns_the_same(self):
        optimizer = make_optimizer(Scripted, [0, 0], [1, 1], **SETTINGS)
        assert optimizer.ask() is optimizer.ask()
        with pytest.raises(OptimizerError, match="no candidates evaluated yet"):
            optimizer.pareto_set()

    @pytest.mark.parametrize(("rows", "evaluations"), [(20, 120), (7, 119), (1, 120), (19, 114)])
    def test_the_budget_holds_whatever_the_rounds(self, rows, evaluations):
        class Few(Scripted):
            def ask(self):
                return super().ask()[:rows]

        assert minimised(Few).evaluations == evaluations

    @pytest.mark.parametrize("stop", [True, lambda _: True])
    def test_an_optimizer_may_end_early_but_not_before_the_first_round(self, stop):
        assert minimised(type("Early", (Scripted,), {"should_stop": stop})).iteration == 1

    @pytest.mark.parametrize(
        ("method", "bad", "message"),
        [
            ("ask", lambda _: np.full((20, 2), 3.0), r"ask\(\): entry \(0, 0\) is 3, outside \[-2, 2\]"),
            ("ask", lambda _: np.full((20, 2), np.nan), r"ask\(\): entry \(0, 0\) is nan"),
            ("ask", lambda _: np.zeros((21, 2)), r"ask\(\): the shape is \(21, 2\)"),
            ("ask", lambda _: np.zeros((20, 3)), r"ask\(\): the shape is \(20, 3\)"),
            ("ask", lambda _: np.zeros((0, 2)), r"ask\(\): the shape is \(0, 2\)"),
            ("ask", lambda _: np.zeros(2), r"ask\(\): the shape is \(2,\)"),
            ("ask", lambda _: None, r"ask\(\): (not an array|entry)"),
            ("ask", lambda _: "x", r"ask\(\): this is not an array"),
            ("ask", lambda _: 1 / 0, r"ask fails: ZeroDivisionError: division by zero \(test_own.py, line \d+\)"),
            ("tell", lambda _, __: None, "tell fails: TypeError"),
            ("tell", lambda _, objectives, __: objectives.no_such, "tell fails: AttributeError"),
            ("__init__", lambda _, lower, *__, **___: lower.no_such, "__init__ fails: AttributeError"),
            ("pareto_set", lambda _: 5, r"pareto_set\(\): no x"),
            ("pareto_set", lambda _: ParetoSet(*(np.zeros((0, k)) for k in (2, 2, 1)), feasible=True), r"\.x: shape"),
            ("pareto_set", lambda _: ParetoSet(*(np.full((1, k), 9.0) for k in (2, 2, 1)), feasible=True), "a row is outside"),
            ("pareto_set", lambda _: ParetoSet(*(np.zeros((1, k)) for k in (2, 3, 1)), feasible=True), r"\.objectives: shape"),
            ("should_stop", property(lambda _: 1 / 0), "should_stop fails: ZeroDivisionError"),
        ],
    )  # fmt: skip
    def test_what_breaks_a_rule_is_one_line_that_names_class_and_method(self, method, bad, message):
        with pytest.raises(OptimizerError, match=message) as refused:
            minimised(type("Broken", (Scripted,), {method: bad})).pareto_set()
        assert "Broken" in str(refused.value)
        assert "\n" not in str(refused.value)

    @pytest.mark.parametrize("values", [np.zeros((20, 3)), np.zeros((19, 2)), np.full((20, 2), np.inf)])
    def test_what_is_told_is_checked_too(self, values):
        optimizer = make_optimizer(Scripted, [0, 0], [1, 1], **SETTINGS)
        with pytest.raises(OptimizerError, match="no candidates are open"):
            optimizer.tell(values)
        optimizer.ask()
        with pytest.raises(OptimizerError, match="tell: objectives"):
            optimizer.tell(values, np.zeros((20, 1)))
        with pytest.raises(OptimizerError, match="tell: violations"):
            optimizer.tell(np.zeros((20, 2)))


class TestPymoo:
    @pytest.mark.no_cover
    def test_every_algorithm_by_name_works_or_says_why_not(self):
        with pytest.raises(OptimizerError, match="unknown to pymoo") as refused:
            optimizer_class("pymoo:Nothing")
        names = str(refused.value).rpartition("choose one of ")[2].split(", ")
        assert set(names) >= set(PYMOO) | set(REFUSED)
        for name in PYMOO:
            assert len(minimised(f"pymoo:{name}", max_iterations=3).pareto_set()), name
        for name, why in REFUSED.items():
            with pytest.raises(OptimizerError, match=why) as refused:
                minimised(f"pymoo:{name}", max_iterations=3)
            assert "\n" not in str(refused.value)

    def test_upper_and_lower_case_are_the_same_and_the_full_path_too(self):
        first, *others = (
            minimised(name).pareto_set().x
            for name in ("pymoo:NSGA3", "pymoo:nsga3", "pymoo.algorithms.moo.nsga3:NSGA3")
        )
        assert all(np.array_equal(first, other) for other in others)

    def test_an_algorithm_of_one_objective_says_so(self):
        with pytest.raises(OptimizerError, match="GA minimises at most 1"):
            minimised("pymoo.algorithms.soo.nonconvex.ga:GA")

    def test_a_subclass_of_our_adapter_is_a_class_as_any_other(self):
        from uavcover.optimizers.pymoo.adapters import PymooOptimizer, pymoo_algorithm

        class Sms(PymooOptimizer):
            def _build(self):
                return pymoo_algorithm("SMSEMOA")(pop_size=self._population_size)

        assert issubclass(optimizer_class(Sms), AskTellOptimizer)
        assert len(minimised(Sms).pareto_set())


class TestBenchmark:
    def test_own_classes_come_after_ours_and_before_the_floor(self, folder):
        (folder / "mine_of_test.py").write_text(EXAMPLE)
        names = contender_names(["imodbo", "mine_of_test:MySearch", "pymoo:NSGA3"])
        assert names[-3:] == ["mine_of_test:MySearch", "pymoo:NSGA3", "uniform"]
        assert names[:-3] == contender_names()[:-1]
        with pytest.raises(OptimizerError, match="cannot find the module"):
            contender_names(["gone_of_test:A"])

    @pytest.mark.parametrize("name", ["mine_of_test:MySearch", "pymoo:RVEA"])
    def test_a_run_is_kept_and_found_again(self, folder, name):
        (folder / "mine_of_test.py").write_text(EXAMPLE)
        results, budget, run = MmfFolder(folder / "mmf"), Budget(20, 5, 30), RunId(1, "MMF2", name)
        assert list(make_runs(results, [run], budget, processes=1)) == [run]
        assert results.runs() == [run]
        assert ":" not in str(results.file(run).relative_to(folder))
        x, objectives = solve(PROBLEMS["MMF2"], name, seed=1, budget=budget)
        again_x, again_objectives = results.read(run)
        assert np.array_equal(x, again_x)
        assert np.array_equal(objectives, again_objectives)
