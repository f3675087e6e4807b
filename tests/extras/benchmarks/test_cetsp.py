"""Close-enough TSP instances, on one made up in the formats of both repositories."""

import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import Cli
from uavcover.extras.benchmarks.cetsp import Instance, read_instances, site_of, tour_length
from uavcover.kernels import annealing
from uavcover.model.route import Route
from uavcover.planner.search.route_problem import route_problem, state_of
from uavcover.sensing.site_maps import judging_map, planning_map

CENTRES = [(10.0, 0.0), (10.0, 8.0), (0.0, 10.0), (0.1, 9.9)]


def written(folder: Path, disks: list[dict[str, object]], name: str = "four") -> Path:
    (folder / "solutions" / "benchmark").mkdir(parents=True, exist_ok=True)
    document = {name: {"disks": disks, "carrabs2020_upper_bound": 31.0}}
    (folder / "benchmark.json.gz").write_bytes(gzip.compress(json.dumps(document).encode()))
    return folder


def disks(radii: list[float]) -> list[dict[str, object]]:
    depot = {"x": 0.0, "y": 0.0, "r": 0.0, "meta": "depot"}
    return [depot, *({"x": x, "y": y, "r": r} for (x, y), r in zip(CENTRES, radii, strict=True))]


@pytest.fixture
def data(tmp_path: Path) -> Path:
    folder = written(tmp_path / "data", disks([2.0] * 4))
    tour = "value : 32\n0,1,2,3,\n0 0 0\n1 8 0\n2 8 8\n3 0 8\n"
    (folder / "solutions" / "benchmark" / "four.txt").write_text(tour)
    return folder


def test_an_instance_is_read_with_its_best_known_length(data: Path) -> None:
    instance = read_instances(data)["four"]
    assert instance.centres.tolist() == [list(centre) for centre in CENTRES]
    assert (instance.radius, instance.best_known, instance.home.tolist()) == (2.0, 31.0, [0.0, 0.0])
    assert tour_length(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])) == pytest.approx(12.0)
    assert instance.unobserved(np.array([[8.0, 0.0], [9.0, 8.0]])) == 2


def test_the_radius_of_an_overlap_ratio_is_that_share_of_the_longer_side(data: Path) -> None:
    written(data, disks([7.0] * 4), "four(0.3)")
    (data / "solutions" / "benchmark" / "four.txt").rename(data / "solutions" / "benchmark" / "four_or30.txt")
    assert read_instances(data)["four_or30"].radius == pytest.approx(0.3 * 10.0)


def test_other_radii_and_other_discs_are_left_out(data: Path) -> None:
    written(data, disks([2.0, 2.0, 2.0, 3.0]))
    assert read_instances(data) == {}
    written(data, disks([1.0] * 4))
    assert read_instances(data) == {}, "the tour does not reach discs of half the radius"


def test_each_target_is_one_cell_where_it_is(data: Path, tmp_path: Path) -> None:
    instance = read_instances(data)["four"]
    site = site_of(instance, tmp_path)
    cells = judging_map(site).grid.cells
    assert planning_map(site) is judging_map(site)
    assert site.home_m is not None
    moved = (cells.centre_m[:, :2] - site.home_m[:2]) * instance.radius / 50.0
    assert moved == pytest.approx(np.array(CENTRES), abs=1e-9)
    rows, columns = np.nonzero(cells.lattice >= 0)
    assert sorted(cells.lattice[rows, columns].tolist()) == [0, 1, 2, 3]
    there = np.column_stack([cells.east0_m + columns * cells.size_m, cells.north0_m + rows * cells.size_m])
    apart = np.hypot(*(there - cells.centre_m[cells.lattice[rows, columns], :2]).T)
    assert apart.max() == pytest.approx(cells.scatter_m)


def test_targets_beside_each_other_have_room(tmp_path: Path) -> None:
    """One place sees a hundred of them, each in a square of its own, far from where it is."""
    close = np.random.default_rng(1).normal(0.0, 1e-3, (100, 2))
    centres = np.vstack([np.full(2, 5.0) + close, [[30.0, 0.0], [0.0, 30.0]]])
    site = site_of(Instance("close", np.zeros(2), centres, 0.5, 1.0), tmp_path)
    coverage = judging_map(site)
    problem = route_problem(coverage, margin_m=0.0, reach_m=1.0)
    route = Route(np.array([[*coverage.grid.cells.centre_m[:100, :2].mean(axis=0), 50.0]]))
    assert len(annealing.snapshot(state_of(problem, route, capacity=1))) == 1


def test_the_command_plans_a_short_tour_keeps_it_and_goes_on(cli: Cli, data: Path, tmp_path: Path) -> None:
    arguments = ("bench", "cetsp", data, "--budget", 3, "--processes", 1, "-o", tmp_path / "out", "--json")
    first, second = cli(*arguments), cli(*arguments)
    assert (first.code, first.document["made"]) == (0, 1)
    assert (second.code, second.document["made"]) == (0, 0)
    name, discs, length, _, _, unobserved, *_ = (tmp_path / "out" / "cetsp.csv").read_text().splitlines()[1].split(",")
    assert (name, discs, unobserved) == ("four", "4", "0")
    # Not shorter than there and back to the far corner's disc, nor longer than a tour of the centres.
    assert 2.0 * (math.hypot(10.0, 8.0) - 2.0) < float(length) < 18.0 + math.hypot(10.0, 2.0) + 10.0


def test_bad_usage_is_one_line(cli: Cli, data: Path, tmp_path: Path) -> None:
    arguments = ("-o", tmp_path / "out", "--processes", 1)
    assert (
        "none: benchmark.json.gz (d-krupke/close-enough-tsp) not found"
        in cli("bench", "cetsp", tmp_path / "none", *arguments).error
    )
    assert "--names: unknown: 'five'" in cli("bench", "cetsp", data, "--names", "five", *arguments).error
    (data / "solutions" / "benchmark" / "four.txt").write_text("value : 32\n0,1\n0 a b\n")
    assert "four.txt: cannot read" in cli("bench", "cetsp", data, *arguments).error
    (data / "benchmark.json.gz").write_bytes(b"{}")
    assert "benchmark.json.gz: cannot read" in cli("bench", "cetsp", data, *arguments).error
    (data / "benchmark.json.gz").write_bytes(gzip.compress(b'{"four": {"disks": []}}'))
    assert "benchmark.json.gz: cannot read" in cli("bench", "cetsp", data, *arguments).error
