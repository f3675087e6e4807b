"""The paper's simulation: readings, tables and figures, on small budgets."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from uavcover.errors import InputError, OutputError
from uavcover.extras.benchmarks.paper import (
    READINGS,
    TABLE_5,
    Figures,
    PaperResult,
    Scheme,
    by_nodes,
    by_weights,
    make_runs,
    misfit,
    paper_runs,
    read_results,
    row,
    tables_markdown,
    write_results,
)
from uavcover.extras.benchmarks.runs import KeptRuns
from uavcover.sensing.coverage_map import CoverageMap

SMALL = {"population": 20, "iterations": 3}


def made(path: Path, readings: tuple[str, ...], runs: int, processes: int) -> KeptRuns:
    folder = KeptRuns(path, SMALL)
    wanted = paper_runs(readings, runs)
    assert list(make_runs(folder, wanted, population=20, iterations=3, processes=processes)) or not wanted
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> KeptRuns:
    return made(tmp_path_factory.mktemp("paper"), ("planar", "R2-midpoint"), 2, 1)


@pytest.fixture(scope="module")
def files(folder: KeptRuns) -> list[str]:
    return [path.name for path in write_results(folder)]


def result(*front: tuple[float, float, float]) -> PaperResult:
    schemes = (Scheme(Figures(*values), np.full((1, 3), k)) for k, values in enumerate(front))
    return PaperResult(tuple(schemes), 0, 1.0)


class TestReadings:
    def test_the_midpoint_sees_what_the_ray_does_not(self) -> None:
        positions = np.random.default_rng(4).uniform([0, 0, 0.2], [10, 10, 1.0], (40, 3))
        fractions = {}
        for name, reading in READINGS.items():
            coverage = CoverageMap(reading.site(), cell_size_m=0.5)
            fractions[name] = coverage.fraction(coverage.observed(positions))
        assert fractions["R2-midpoint"] > fractions["R2-ray"] > fractions["r1-ray"]
        assert fractions["r1-midpoint"] >= fractions["r1-ray"]
        assert fractions["planar"] > fractions["r1-midpoint"]

    def test_planar_is_a_distance_in_the_plane(self) -> None:
        position = np.array([[3.1, 4.2, 0.9]])
        coverage = CoverageMap(READINGS["planar"].site(), cell_size_m=0.5)
        centres = coverage.grid.cells.centre_m[:, :2]
        assert np.array_equal(coverage.observed(position), np.hypot(*(centres - position[0, :2]).T) <= 1.0)


class TestChoices:
    def test_weights_by_hand(self) -> None:
        # Scaled: (1, 0, 0), (0.25, 0.5, 0.4), (0, 1, 1): sums 0.6, 0.33, 0.4.
        one = result((0.4, 20, 30.0), (0.7, 30, 50.0), (0.8, 40, 80.0))
        assert by_weights([one]).figures == Figures(0.7, 30, 50.0)
        assert by_weights([one, result((0.8, 20, 30.0))]).figures == Figures(0.8, 20, 30.0)

    def test_nodes_as_many_as_the_paper(self) -> None:
        one = result((0.4, 20, 30.0), (0.7, 39, 50.0), (0.75, 44, 60.0), (0.8, 45, 80.0))
        assert by_nodes([one]).figures == Figures(0.75, 44, 60.0)
        assert by_nodes([result((0.4, 20, 30.0), (0.6, 35, 40.0))]).figures.nodes == 35

    def test_rows_are_sample_statistics(self) -> None:
        mean, std = row([result((0.5, 30, 60.0)), result((0.7, 40, 50.0))], "weights")
        assert dataclasses.astuple(mean) == pytest.approx((0.6, 35.0, 55.0))
        assert std.nodes == pytest.approx(math.sqrt(50.0))
        assert math.isnan(row([result((0.5, 30, 60.0))], "weights")[1].coverage)

    def test_misfit_is_zero_on_the_papers_own_rows(self) -> None:
        assert misfit(TABLE_5) == 0.0
        worse = dataclasses.replace(TABLE_5["modbo"][0], nodes=1.6 * TABLE_5["modbo"][0].nodes)
        assert misfit({**TABLE_5, "modbo": (worse, worse)}) == pytest.approx(math.sqrt(0.36 / 6.0))


class TestRuns:
    def test_number_of_processes_changes_nothing(self, folder: KeptRuns, tmp_path: Path) -> None:
        other = made(tmp_path, ("planar",), 1, 2)
        for key in other.done():
            ours, theirs = folder.read(key), other.read(key)
            assert ours["members"] == theirs["members"]
            assert ours["chosen"] == theirs["chosen"]

    def test_the_planners_own_choice_is_the_weighted_one(self, folder: KeptRuns) -> None:
        for found in read_results(folder).values():
            for one in found:
                assert by_weights([one]).figures == one.front[one.chosen].figures

    def test_first_runs_first(self) -> None:
        keys = [str(run) for run in paper_runs(("planar", "R2-ray"), 2)]
        assert keys[:4] == ["planar/modbo/1", "planar/imodbo/1", "R2-ray/modbo/1", "R2-ray/imodbo/1"]
        assert len(keys) == 8


class TestResults:
    def test_files(self, folder: KeptRuns, files: list[str]) -> None:
        names = files
        assert names[:2] == ["runs.csv", "tables.md"]
        assert {"figure7.png", "figures8-11-planar.png", "route-planar-imodbo-weights.csv"} <= set(names)
        assert "figures8-11-R2-ray.png" not in names
        for name in names:
            assert (folder.path / name).stat().st_size > 50
        rows = list(csv.DictReader((folder.path / "runs.csv").read_text().splitlines()))
        assert len(rows) == 2 * 2 * 2 * 2

    @pytest.mark.usefixtures("files")
    def test_a_kept_route_has_the_coverage_that_is_told(self, folder: KeptRuns) -> None:
        lines = (folder.path / "route-planar-imodbo-weights.csv").read_text().splitlines()[1:]
        route = np.array([line.split(",") for line in lines], dtype=float)
        coverage = CoverageMap(READINGS["planar"].site(), cell_size_m=0.5)
        figures = by_weights(read_results(folder)["planar", "imodbo"]).figures
        assert coverage.fraction(coverage.observed(route)) == figures.coverage
        assert len(route) == figures.nodes
        # Section 2.1: begin at the node nearest the origin.
        assert np.linalg.norm(route, axis=1).argmin() == 0

    def test_tables_have_the_papers_rows_first(self, folder: KeptRuns) -> None:
        text = tables_markdown(read_results(folder), population=20, iterations=3, version="0")
        assert "| paper | modbo | 72.84 ± 1.49 | 72.17 ± 2.37 | 41.8 ± 2.2 |" in text
        assert "| paper | imodbo | 87.2 | 70.74 | 40 |" in text
        assert "imodbo less modbo (paper +14.0)" in text


class TestKeptRuns:
    def test_other_settings_are_refused(self, tmp_path: Path) -> None:
        for _ in range(2):
            with KeptRuns(tmp_path / "new", SMALL).reserved():
                pass
        with pytest.raises(InputError, match="use population 20, iterations 3, not population 50;"):
            KeptRuns(tmp_path / "new", {"population": 50}).reserved().__enter__()

    def test_a_folder_of_something_else_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "thesis.tex").write_text("mine")
        with pytest.raises(OutputError, match=r"no settings\.json of a benchmark"):
            KeptRuns(tmp_path, SMALL).reserved().__enter__()

    def test_keys_in_order_and_damage_named(self, tmp_path: Path) -> None:
        folder = KeptRuns(tmp_path, SMALL)
        for key in ("b/10", "b/9", "a/1"):
            folder.write(key, {"x": 0.1})
        assert folder.done() == ["a/1", "b/9", "b/10"]
        assert folder.read("b/9") == {"x": 0.1}
        folder.file("b/9").write_text("[1]")
        with pytest.raises(InputError, match=r"9\.json: cannot read .*; delete it"):
            folder.read("b/9")
