"""The folder of a benchmark, its runs, figures and tables, on small budgets."""

import csv
import pickle
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from pymoo.indicators.hv import HV
from pymoo.indicators.igd import IGD

from uavcover.errors import InputError, OutputError
from uavcover.extras.benchmarks.mmf.problems import PROBLEMS, reference_sets
from uavcover.extras.benchmarks.mmf.runs import (
    METRICS,
    Budget,
    MmfFolder,
    RunId,
    figure,
    indicators,
    make_runs,
    measured,
    missing_runs,
    summary_csv,
)
from uavcover.extras.benchmarks.mmf.tables import (
    FIGURES,
    comparisons_csv,
    contestants,
    draw,
    median_run,
    published,
    short,
    tables_markdown,
    write_results,
)

SMALL = Budget(population=12, iterations=4, archive=8)


def filled(path: Path, functions: tuple[str, ...], algorithms: tuple[str, ...], runs: int) -> MmfFolder:
    folder = MmfFolder(path)
    wanted = missing_runs(folder, functions=functions, algorithms=algorithms, runs=runs)
    assert len(list(make_runs(folder, wanted, SMALL, processes=2))) == len(wanted)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> MmfFolder:
    algorithms = ("imodbo", "modbo", "modbo+lhs", "mowoa", "random", "uniform")
    return filled(tmp_path_factory.mktemp("mmf"), ("MMF1", "MMF14_a"), algorithms, 3)


class TestFolder:
    def test_numbers_come_back_to_the_last_bit(self, tmp_path: Path) -> None:
        folder, run = MmfFolder(tmp_path), RunId(7, "MMF14", "imodbo")
        rng = np.random.default_rng(0)
        x, objectives = rng.random((5, 3)), rng.random((5, 3))
        folder.write(run, x, objectives)
        back = folder.read(run)
        assert np.array_equal(back[0], x)
        assert np.array_equal(back[1], objectives)
        assert folder.file(run) == tmp_path / "sets/MMF14/imodbo/7.csv"
        assert folder.file(run).read_text().startswith("x1,x2,x3,f1,f2,f3\n")
        assert folder.runs() == [run]

    @pytest.mark.parametrize(
        "text", ["", "x1,x2,f1,f2\n", "x1,x2,f1,f2\n1,2,3,inf\n", "x1,x2,f1,f2\n1,2,3\n", "x1,f1\n1,2\n"]
    )
    def test_a_damaged_file_is_named(self, tmp_path: Path, text: str) -> None:
        folder, run = MmfFolder(tmp_path), RunId(1, "MMF1", "imodbo")
        folder.file(run).parent.mkdir(parents=True)
        folder.file(run).write_text(text)
        with pytest.raises(InputError, match=r"1\.csv: cannot read .*; delete it"):
            folder.read(run)

    def test_files_of_others_are_no_runs(self, tmp_path: Path) -> None:
        folder = filled(tmp_path, ("MMF1",), ("random",), 1)
        (tmp_path / "sets/MMF1/random/notes.csv").write_text("mine")
        (tmp_path / "sets/MMF1/mine").mkdir()
        assert folder.runs() == [RunId(1, "MMF1", "random")]

    def test_another_budget_is_refused(self, tmp_path: Path) -> None:
        folder = MmfFolder(tmp_path / "new")
        with folder.reserved(SMALL):
            pass
        with folder.reserved(SMALL):
            pass
        with pytest.raises(InputError, match="population 12, iterations 4, archive 8, not population 200"):
            folder.reserved(Budget()).__enter__()

    def test_a_folder_of_something_else_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "summary.csv").write_text("mine")
        with pytest.raises(OutputError, match=r"has files, but no settings\.json"):
            MmfFolder(tmp_path).reserved(SMALL).__enter__()
        assert (tmp_path / "summary.csv").read_text() == "mine"

    def test_settings_that_cannot_be_read(self, tmp_path: Path) -> None:
        (tmp_path / "settings.json").write_text("[3]")
        with pytest.raises(InputError, match=r"settings\.json: cannot read"):
            MmfFolder(tmp_path).reserved(SMALL).__enter__()


class TestRuns:
    def test_only_what_is_missing_is_made_and_first_runs_first(self, tmp_path: Path) -> None:
        folder = filled(tmp_path, ("MMF1",), ("random",), 1)
        before = folder.file(RunId(1, "MMF1", "random")).stat().st_mtime_ns
        missing = missing_runs(folder, functions=("MMF1", "MMF4"), algorithms=("random",), runs=2)
        assert [str(run) for run in missing] == ["MMF4/random/1", "MMF1/random/2", "MMF4/random/2"]
        list(make_runs(folder, missing, SMALL, processes=1))
        assert folder.file(RunId(1, "MMF1", "random")).stat().st_mtime_ns == before

    def test_number_of_processes_changes_nothing(self, tmp_path: Path) -> None:
        wanted = [RunId(n, "MMF2", "imodbo") for n in (1, 2, 3)]
        folders = [MmfFolder(tmp_path / name) for name in ("one", "two")]
        for processes, folder in enumerate(folders, start=1):
            list(make_runs(folder, wanted, SMALL, processes=processes))
        for run in wanted:
            assert folders[0].file(run).read_bytes() == folders[1].file(run).read_bytes()

    def test_workers_elsewhere_change_nothing(self, tmp_path: Path, monkeypatch) -> None:
        class Elsewhere:
            def completed(self, function, shared, tasks):
                # What is sent is pickled; a task that is lost is done again; the last one is done first.
                for task in reversed(tasks):
                    sent = pickle.loads(pickle.dumps((function, shared, task)))
                    results = [sent[0](*sent[1:]) for _ in range(2)]
                    yield task, pickle.loads(pickle.dumps(results[-1]))

        monkeypatch.setattr("uavcover.extras.benchmarks.runs.workers_of", lambda _: nullcontext(Elsewhere()))
        wanted = [RunId(n, "MMF2", "imodbo") for n in (1, 2)]
        here, there = MmfFolder(tmp_path / "here"), MmfFolder(tmp_path / "there")
        list(make_runs(here, wanted, SMALL, processes=1))
        assert list(make_runs(there, wanted, SMALL, processes=None, scheduler="tcp://there:1")) == wanted[::-1]
        for run in wanted:
            assert here.file(run).read_bytes() == there.file(run).read_bytes()

    def test_processes_are_not_for_a_scheduler(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="--processes cannot be combined with --scheduler"):
            list(make_runs(MmfFolder(tmp_path), [], SMALL, processes=2, scheduler="local:2"))


class TestSummary:
    def test_indicators_as_pymoo(self) -> None:
        rng = np.random.default_rng(5)
        for function in ("MMF1", "MMF14"):
            problem, reference = PROBLEMS[function], reference_sets(function)
            x = rng.uniform(problem.lower, problem.upper, (40, problem.n_variables))
            reported = indicators(function, x, problem.evaluate(x))
            assert reported["IGD"] == pytest.approx(IGD(reference.pareto_front)(problem.evaluate(x)))
            assert reported["IGDx"] == pytest.approx(IGD(reference.pareto_set)(x))
            assert reported["HV"] == pytest.approx(HV(ref_point=problem.hypervolume_reference)(problem.evaluate(x)))
            assert reported["PSP"] == pytest.approx(reported["CR"] / reported["IGDx"])

    def test_the_reference_itself_has_infinite_psp(self) -> None:
        reference = reference_sets("MMF4")
        reported = indicators("MMF4", reference.pareto_set, PROBLEMS["MMF4"].evaluate(reference.pareto_set))
        assert reported["PSP"] == np.inf

    def test_summary_holds_every_metric_of_every_run(self, tmp_path: Path) -> None:
        folder = filled(tmp_path, ("MMF1", "MMF15"), ("random", "uniform"), 3)
        rows = list(csv.DictReader(summary_csv(measured(folder)).splitlines()))
        assert [row["metric"] for row in rows] == list(METRICS) * 4
        assert {row["runs"] for row in rows} == {"3"}
        by_hand = [indicators("MMF15", *folder.read(RunId(n, "MMF15", "uniform")))["PSP"] for n in (1, 2, 3)]
        row = next(r for r in rows if (r["function"], r["algorithm"], r["metric"]) == ("MMF15", "uniform", "PSP"))
        assert float(row["mean"]) == np.mean(by_hand)
        assert float(row["std"]) == np.std(by_hand, ddof=1)
        assert float(row["median"]) == np.median(by_hand)

    def test_one_run_has_no_deviation(self) -> None:
        assert np.isnan(figure(np.array([2.0])).std)


class TestTables:
    def test_everything_is_written(self, folder: MmfFolder) -> None:
        names = [path.name for path in write_results(folder, SMALL)]
        assert names == ["summary.csv", "runs.csv", "comparisons.csv", "tables.md", "figure3.png", "figure6.png"]
        for name in names[-2:]:
            assert (folder.path / name).read_bytes().startswith(b"\x89PNG")
        header, *rows = csv.reader((folder.path / "runs.csv").read_text().splitlines())
        assert header == ["function", "algorithm", "metric", "1", "2", "3"]
        assert len(rows) == 2 * 6 * len(METRICS)

    def test_tables_have_the_papers_figures_beside_ours(self, folder: MmfFolder) -> None:
        text = tables_markdown(measured(folder), SMALL, version="0")
        lines = text.splitlines()
        table4 = lines[lines.index("## Table 4: PSP, more is better") :]
        header = [cell.strip() for cell in table4[2].split("|")]
        paper = [cell.strip() for cell in table4[5].split("|")]
        assert header[3:9] == ["imodbo", "modbo", "mowoa", "random", "uniform", "ceiling"]
        assert paper[2:7] == ["paper", "18.5 ± 7.7e-01", "18.9 ± 9.1e-01", "7.85 ± 1.1e+00", ""]
        assert "## imodbo against the others: win/tie/loss" in lines
        assert any(line.startswith("| function | modbo | modbo+lhs | imodbo |") for line in lines)

    def test_variants_and_the_floor_are_no_rivals(self, folder: MmfFolder) -> None:
        rows = list(csv.DictReader(comparisons_csv(measured(folder)).splitlines()))
        assert {row["rival"] for row in rows} == {"modbo", "mowoa", "random"}
        assert {row["algorithm"] for row in rows} == {"imodbo"}
        assert len(rows) == len(METRICS) * 2 * 3

    def test_ablation_variants_are_not_contestants(self, folder: MmfFolder) -> None:
        assert contestants(measured(folder)) == ["imodbo", "modbo", "mowoa", "random", "uniform"]

    def test_the_run_in_the_middle_is_drawn(self, folder: MmfFolder) -> None:
        samples = measured(folder)
        values = samples["MMF1", "imodbo"]["IGDx"]
        chosen = median_run(folder, samples, "MMF1", "imodbo")
        assert values[chosen.number - 1] == np.median(values)
        assert draw(FIGURES[0], folder, samples).name == "figure3.png"

    def test_a_single_algorithm_on_a_single_function(self, tmp_path: Path) -> None:
        text = tables_markdown(measured(filled(tmp_path, ("MMF2",), ("random",), 1)), SMALL, version="0")
        assert "Friedman" not in text
        assert "win/tie/loss" not in text

    def test_numbers_for_people(self) -> None:
        assert [short(value) for value in (0.0, 0.001234567, 18.512345, float("nan"), float("inf"))] == [
            "0",
            "1.235e-03",
            "18.51",
            "-",
            "inf",
        ]


class TestPublished:
    def test_a_figure_of_each_table(self) -> None:
        figures = published()
        assert figures["IGD", "MMF1", "nsga2"].mean == 2.82e-3
        assert figures["PSP", "MMF15_l", "imodbo"].mean == 8.10
        assert figures["PSP", "MMF16_l3", "modbo"].std == 0.352
        assert figures["PSP", "MMF10", "ceiling"].mean == 11150

    def test_complete(self) -> None:
        figures = published()
        for metric, algorithms in (("IGD", 7), ("PSP", 8)):
            assert sum(key[0] == metric for key in figures) == 24 * algorithms
        assert {key[1] for key in figures} == set(PROBLEMS)
