"""The bound on path length by prices: every proof step attacked with the real sensor, and the bound with exact optima."""

import functools
import heapq
import itertools
import math

import numpy as np
import pytest

from tests.planning.sites import flat, hills, make_site
from uavcover.kernels.ground_prices import HEADINGS, credit, direction_bin, largest_rate, rates_in_tiles
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, SphereSensor
from uavcover.planning.bounds import least_path_length_m
from uavcover.planning.ground_prices import coverable_weight_m2, lattice_step_m, places_over, price_ground
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations, sees_each

LOW = {"min_height_agl_m": 10.0, "max_height_agl_m": 30.0}
TILE = 8
SENSORS = {
    "cone": NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0),
    "short cone": NadirCamera(kind="nadir-camera", fov_deg=90.0, range_m=28.0),
    "sphere": SphereSensor(kind="sphere", range_m=32.0, sensing="along-path"),
    "disc": DiscSensor(kind="disc", radius_m=22.0, sensing="along-path"),
    "frame": FrameCamera(kind="frame-camera", fov_across_deg=60.0, fov_along_deg=40.0, range_m=100.0, pitch_deg=-75.0),
}


def bumps(seed):
    rng = np.random.default_rng(seed)
    waves = rng.uniform([20.0, 20.0, 0.0, 2.0], [80.0, 80.0, 6.0, 9.0], (4, 4))
    return lambda e, n: sum(h * np.sin(e / a + p) * np.cos(n / b - p) for a, b, p, h in waves)


@functools.cache
def covered(kind, seed):
    """A small site with a sensor; each made once."""
    ring = ((0.0, 0.0), (150.0, 0.0), (150.0, 90.0), (60.0, 120.0), (0.0, 90.0))
    site = make_site(bumps(seed) if seed else flat, ring=ring, sensor=SENSORS[kind], limits=LOW, cell_m=6.0)
    return CoverageMap(site, cell_size_m=6.0)


@functools.cache
def priced(kind, seed):
    """Likewise, with its prices."""
    coverage = covered(kind, seed)
    return coverage, price_ground(coverage, 0.95, step_m=3.0)


def random_path(coverage, rng, waypoints):
    """A polyline inside the fence and the height band: straight, winding, to and fro."""
    places = [rng.uniform([-60.0, -60.0], [210.0, 180.0])]
    heading = rng.uniform(0.0, 2.0 * math.pi)
    turn = rng.choice([0.0, 0.3, 1.5, math.pi])
    for _ in range(waypoints - 1):
        heading += rng.normal(0.0, 1.0) * turn
        places.append(places[-1] + rng.uniform(1.0, 40.0) * np.array([math.cos(heading), math.sin(heading)]))
    east_north = np.clip(np.array(places), -60.0, 210.0)
    # Close samples, each at a height of the band: higher and lower at will.
    dense = np.vstack([np.linspace(a, b, 12) for a, b in itertools.pairwise(east_north)])
    agl = np.clip(np.interp(np.arange(len(dense)), [0, len(dense)], rng.uniform(10.0, 30.0, 2)), 10.0, 30.0)
    if rng.random() < 0.5:
        agl[:] = 30.0
    return np.column_stack([dense, coverage.site.ground.heights_m(dense) + agl])


@pytest.mark.parametrize(
    ("kind", "seed"), [*((kind, 3) for kind in SENSORS), pytest.param("cone", 0, marks=pytest.mark.slow)]
)
@pytest.mark.no_cover
def test_no_path_gains_more_than_its_length_and_one_look(kind, seed):
    coverage, ground = priced(kind, seed)
    rng = np.random.default_rng(seed)
    gained = 0.0
    for _ in range(60):
        path = random_path(coverage, rng, int(rng.integers(2, 12)))
        length_m = float(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum())
        worth_m = float(ground.prices_m[coverage.seen(path)].sum())
        assert worth_m <= ground.first_look_m + length_m
        gained = max(gained, worth_m)
    assert gained > 0.5 * ground.first_look_m


@pytest.mark.parametrize("kind", SENSORS)
@pytest.mark.parametrize("seed", [0, 5])
def test_a_cell_that_is_seen_has_all_of_its_credit(kind, seed):
    coverage = covered(kind, seed)
    places = places_over(coverage, 3.0)
    rng = np.random.default_rng(seed)
    numbers = rng.integers(0, coverage.grid.count, 3000)
    eyes = coverage.grid.cells.centre_m[numbers, :2] + rng.uniform(-40.0, 40.0, (3000, 2))
    up = coverage.site.ground.heights_m(eyes) + rng.uniform(10.0, 30.0, 3000)
    turned = rng.uniform(0.0, 360.0, 3000)
    looks = LevelObservations.by_yaw(np.column_stack([eyes, up]), turned)
    seen = np.flatnonzero(sees_each(coverage, looks, numbers, coverage.sight))
    assert len(seen) > 100
    for k in seen:
        row, column = int((eyes[k, 1] - places.north0) // 3.0), int((eyes[k, 0] - places.east0) // 3.0)
        centre = coverage.grid.cells.centre_m[numbers[k]]
        assert places.allowed[row, column]
        for i in (0, 1):
            for j in (0, 1):
                assert credit(places, row + i, column + j, *centre, 6.0) == 1.0


def certified(coverage, prices_m, step_m=3.0):
    places = places_over(coverage, step_m)
    shape = tuple((count - 2) // TILE + 1 for count in places.tops.shape)
    rates, worst = np.zeros(shape), np.zeros((*shape, 4), dtype=np.int64)
    rates_in_tiles(places, coverage.grid.cells, prices_m, TILE, 1, rates, worst)
    return places, rates, worst


@pytest.mark.parametrize("kind", ["cone", "disc"])
def test_the_prices_pass_the_proof_and_dearer_ones_are_refuted(kind):
    coverage, ground = priced(kind, 3)
    _, rates, _ = certified(coverage, ground.prices_m)
    assert 0.5 < rates.max() <= 1.0
    tight = ground.prices_m / rates.max()
    assert certified(coverage, tight * 0.9999)[1].max() <= 1.0
    assert certified(coverage, tight * 1.02)[1].max() > 1.019
    # Dearer only around one place, where it is tight: refuted there.
    places, rates, worst = certified(coverage, tight)
    row, column, _, _ = worst[np.unravel_index(rates.argmax(), rates.shape)]
    place = np.array([places.east0 + column * places.step, places.north0 + row * places.step])
    near = np.hypot(*(coverage.grid.cells.centre_m[:, :2] - place).T) < 2.0 * places.reach
    assert certified(coverage, np.where(near, 1.02 * tight, tight))[1].max() > 1.01


@pytest.mark.parametrize("seed", range(3))
def test_a_naive_twin_finds_no_larger_rate(seed):
    coverage = covered("cone", 3)
    rng = np.random.default_rng(seed)
    prices_m = rng.uniform(0.0, 1.0, coverage.grid.count)
    places, rates, _ = certified(coverage, prices_m)
    found = np.zeros_like(rates)
    centres = coverage.grid.cells.centre_m
    for _ in range(40):
        i, j = (int(rng.integers(0, count - 1)) for count in places.tops.shape)
        # Credits at the corners, and their gradients in both triangles.
        sw, se, nw, ne = (
            np.array([credit(places, i + a, j + b, *centre, 6.0) for centre in centres])
            for a, b in ((0, 0), (0, 1), (1, 0), (1, 1))
        )
        for ge, gn in ((se - sw, ne - se), (ne - nw, nw - sw)):
            for angle in rng.uniform(0.0, 2.0 * math.pi, 20):
                along = np.maximum(0.0, ge * math.cos(angle) + gn * math.sin(angle))
                tile = (i // TILE, j // TILE)
                found[tile] = max(found[tile], float(prices_m @ along) / places.step)
    assert (found <= rates + 1e-9).all()
    assert found.max() > 0.5 * rates.max()


@pytest.mark.parametrize("seed", range(5))
def test_rates_between_the_headings_are_bounded_closely(seed):
    rng = np.random.default_rng(seed)
    vectors = rng.normal(0.0, 1.0, (int(rng.integers(1, 60)), 2)) * rng.choice([1.0, 100.0])
    sums = np.zeros((HEADINGS, 2))
    for vector in vectors:
        sector = direction_bin(*vector)
        angle = math.atan2(vector[1], vector[0]) % (2.0 * math.pi)
        assert sector == int(angle / (2.0 * math.pi) * HEADINGS) % HEADINGS
        sums[sector] += vector
    angles = np.linspace(0.0, 2.0 * math.pi, 20_001)
    exact = np.maximum(0.0, vectors @ np.stack([np.cos(angles), np.sin(angles)])).sum(axis=0).max()
    bound, _ = largest_rate(sums)
    assert exact * (1.0 - 1e-6) <= bound <= exact / math.cos(math.pi / HEADINGS) * (1.0 + 1e-9)


def lawnmower(width_m, height_m, lanes, up_m):
    """Lanes from south to north and back, over the whole width."""
    spacing = width_m / lanes
    rows = []
    for k in range(lanes):
        ends = [0.0, height_m] if k % 2 == 0 else [height_m, 0.0]
        rows += [[(k + 0.5) * spacing, north, up_m] for north in ends]
    return np.array(rows)


def test_a_strip_needs_its_length_less_one_look():
    """The line along a strip narrower than the view is the optimum. Prices prove a third of it: seen from beside, the strip
    would be worth more than a move if they were higher."""
    ring = ((0.0, 0.0), (40.0, 0.0), (40.0, 900.0), (0.0, 900.0))
    sensor = DiscSensor(kind="disc", radius_m=30.0, sensing="along-path")
    coverage = CoverageMap(make_site(ring=ring, sensor=sensor, limits=LOW, cell_m=5.0), cell_size_m=5.0)
    ground = price_ground(coverage, 1.0, step_m=2.5)
    bound_m = ground.least_length_m(coverable_weight_m2(coverage), 1.0)
    line = np.array([[20.0, 22.0, 20.0], [20.0, 878.0, 20.0]])
    assert coverage.seen(line).all()
    assert 0.3 * 856.0 < bound_m <= 856.0


@pytest.mark.parametrize("lanes", [5])
def test_lines_that_see_enough_are_not_shorter(lanes):
    coverage = CoverageMap(make_site(hills, limits=LOW, cell_m=5.0), cell_size_m=5.0)
    path = lawnmower(300.0, 200.0, lanes, 0.0)
    dense = np.vstack([np.linspace(a, b, 60) for a, b in itertools.pairwise(path)])
    dense[:, 2] = coverage.site.ground.heights_m(dense[:, :2]) + 30.0
    share = coverage.share_of_coverable(coverage.seen(dense))
    ground = price_ground(coverage, share, step_m=2.5)
    bound_m = ground.least_length_m(coverable_weight_m2(coverage), share - 1e-9)
    assert 0.0 < bound_m <= float(np.linalg.norm(np.diff(dense[:, :2], axis=0), axis=1).sum())


def shortest_on_graph(reaches, targets, nodes, neighbours, share):
    """Shortest path over a graph from whose nodes a share of the targets is seen: Dijkstra over (node, set of targets)."""
    sees = [
        sum(1 << t for t, place in enumerate(targets) if math.hypot(*(place - node)) <= reaches[t]) for node in nodes
    ]
    queue = [(0.0, k, mask) for k, mask in enumerate(sees)]
    heapq.heapify(queue)
    best = {}
    while queue:
        length, k, mask = heapq.heappop(queue)
        if mask.bit_count() >= share * len(targets) - 1e-9:
            return length
        if best.get((k, mask), math.inf) <= length:
            continue
        best[k, mask] = length
        for other, leg in neighbours[k]:
            further = length + leg
            if further < best.get((other, mask | sees[other]), math.inf):
                heapq.heappush(queue, (further, other, mask | sees[other]))
    raise AssertionError("the graph sees too little")


@pytest.mark.parametrize("seed", range(5))
def test_no_bound_exceeds_the_optimum_of_a_small_problem(seed):
    """Every optimum on a graph of places is that of a path, so the bound is at most as long; so is any plan found."""
    rng = np.random.default_rng(seed)
    columns, rows = int(rng.integers(8, 12)), 1
    side, radius = 20.0, float(rng.uniform(20.0, 24.0))
    share = float(rng.choice([0.7, 0.9, 1.0]))
    ring = ((0.0, 0.0), (columns * side, 0.0), (columns * side, rows * side), (0.0, rows * side))
    sensor = DiscSensor(kind="disc", radius_m=radius, sensing="along-path")
    coverage = CoverageMap(make_site(ring=ring, sensor=sensor, limits=LOW, cell_m=side), cell_size_m=side)
    assert coverage.coverable.all()
    targets = coverage.grid.cells.centre_m[:, :2]
    step = 10.0
    axes = [np.arange(0.0, count * side + 0.1, step) for count in (columns, rows)]
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    legs = [
        [(b, float(d)) for b, d in enumerate(np.hypot(*(nodes - node).T)) if 0.0 < d < 1.5 * step] for node in nodes
    ]
    optimum_m = shortest_on_graph([radius] * len(targets), targets, nodes, legs, share)
    ground = price_ground(coverage, share, step_m=5.0)
    assert ground.least_length_m(coverable_weight_m2(coverage), share - 1e-9) <= optimum_m + 1e-6
    assert least_path_length_m(coverage, share) <= optimum_m + 1e-6


def test_what_may_stay_unseen_is_what_saves_most():
    _, ground = priced("cone", 3)
    weight = np.full(len(ground.prices_m), 2.0)
    whole = ground.least_length_m(weight, 1.0)
    assert whole == pytest.approx(max(0.0, ground.prices_m.sum() - ground.first_look_m))
    dearest = np.sort(ground.prices_m)[::-1]
    count = len(dearest)
    left = ground.prices_m.sum() - dearest[:2].sum() - 0.5 * dearest[2]
    assert ground.least_length_m(weight, 1.0 - 2.5 / count) == pytest.approx(max(0.0, left - ground.first_look_m))
    assert ground.least_length_m(weight, 0.0) == 0.0


def test_the_lattice_is_as_fine_as_the_time_allows():
    coverage = covered("cone", 3)
    steps = [lattice_step_m(coverage, time_s) for time_s in (0.0, 0.01, 10.0, 1e6)]
    assert steps[0] is None
    assert steps[1] is None
    assert steps[3] == 6.0 / 8.0
    assert steps[2] >= steps[3]


def test_where_limits_apply_to_waypoints_alone_the_legs_may_be_at_any_height():
    limits = {**LOW, "applies_to": "waypoints"}
    coverage = CoverageMap(make_site(hills, limits=limits, cell_m=20.0), cell_size_m=20.0)
    places = places_over(coverage, 10.0)
    assert places.allowed.all()
    assert np.isposinf(places.tops).all()
