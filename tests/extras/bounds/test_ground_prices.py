"""The bound on path length by prices: every proof step attacked with the real sensor, and the bound with exact optima."""

import functools
import heapq
import itertools
import math

import numpy as np
import pytest

from tests.naive.ground_prices import gain, height
from tests.planner.sites import flat, hills, make_site
from uavcover.extras.bounds import bounds
from uavcover.extras.bounds.bound_heights import margin_cells, over_tiles, relief_over
from uavcover.extras.bounds.bounds import (
    PricedGround,
    coverable_weight_m2,
    lattice_parts,
    least_path_length_m,
    price_ground,
)
from uavcover.extras.bounds.programs import PriceProgram
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, SphereSensor
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations, observes_each

LOW = {"min_height_agl_m": 10.0, "max_height_agl_m": 30.0}
SENSORS = {
    "cone": NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0),
    "short cone": NadirCamera(kind="nadir-camera", fov_deg=90.0, range_m=28.0),
    "cone and reach": NadirCamera(kind="nadir-camera", fov_deg=90.0, range_m=40.0),
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
    return coverage, price_ground(coverage, 0.95, parts=2)


def random_path(coverage, rng, waypoints):
    """A polyline inside the fence and the height band: straight, winding, to and fro."""
    positions = [rng.uniform([-60.0, -60.0], [210.0, 180.0])]
    heading = rng.uniform(0.0, 2.0 * math.pi)
    turn = rng.choice([0.0, 0.3, 1.5, math.pi])
    for _ in range(waypoints - 1):
        heading += rng.normal(0.0, 1.0) * turn
        positions.append(positions[-1] + rng.uniform(1.0, 40.0) * np.array([math.cos(heading), math.sin(heading)]))
    east_north = np.clip(np.array(positions), -60.0, 210.0)
    # Close samples, each at a height of the band: higher and lower at will.
    dense = np.vstack([np.linspace(a, b, 12) for a, b in itertools.pairwise(east_north)])
    agl = np.clip(np.interp(np.arange(len(dense)), [0, len(dense)], rng.uniform(10.0, 30.0, 2)), 10.0, 30.0)
    if rng.random() < 0.5:
        agl[:] = 30.0
    return np.column_stack([dense, coverage.site.ground.heights_m(dense) + agl])


@pytest.mark.parametrize(
    ("kind", "seed"), [*((kind, 3) for kind in SENSORS), pytest.param("cone", 0, marks=pytest.mark.long)]
)
@pytest.mark.no_cover
def test_no_path_gains_more_than_its_length_and_one_look(kind, seed):
    """Cells are worth their price where all of their corners and middles of sides are seen, by the sensor itself."""
    coverage, ground = priced(kind, seed)
    rng = np.random.default_rng(seed)
    cells = coverage.grid.cells
    priced_cells = np.flatnonzero(coverable_weight_m2(coverage))
    # In the order of the prices: by rows of the lattice.
    order = cells.lattice[cells.lattice >= 0]
    order = order[np.isin(order, priced_cells)]
    gained = 0.0
    for _ in range(40):
        path = random_path(coverage, rng, int(rng.integers(2, 12)))
        length_m = float(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum())
        whole = wholly_observed(coverage, path, order)
        worth_m = float(ground.prices_m[whole].sum())
        assert worth_m <= ground.first_look_m + length_m
        gained = max(gained, worth_m)
    # Little of what a frame camera sees is the same for all headings.
    assert gained > (0.05 if kind == "frame" else 0.5) * ground.first_look_m


def wholly_observed(coverage, path, numbers):
    """Of cells, those of which nine places are seen: with a sensor that looks far enough, by distance and angle alone."""
    site, sensor, cells = coverage.site, coverage.site.scenario.sensor, coverage.grid.cells
    whole = np.ones(len(numbers), dtype=bool)
    rows, columns = np.nonzero(cells.lattice >= 0)
    at = {int(number): (i, j) for number, i, j in zip(cells.lattice[rows, columns], rows, columns, strict=True)}
    corners = np.array([at[int(number)] for number in numbers])
    for di in (-0.5, 0.0, 0.5):
        for dj in (-0.5, 0.0, 0.5):
            e = cells.east0_m + (corners[:, 1] + dj) * cells.size_m
            n = cells.north0_m + (corners[:, 0] + di) * cells.size_m
            position = np.column_stack([e, n])
            up = site.ground.heights_m(position)
            flat_m = np.hypot(e[:, None] - path[:, 0], n[:, None] - path[:, 1])
            above_m = path[:, 2] - up[:, None]
            if sensor.kind == "disc":
                observed = flat_m <= sensor.radius_m
            elif sensor.kind == "sphere":
                observed = np.hypot(flat_m, above_m) <= sensor.range_m
            elif sensor.kind == "nadir-camera":
                wide = math.tan(math.radians(0.5 * sensor.fov_deg))
                observed = (flat_m <= wide * above_m) & (np.hypot(flat_m, above_m) <= sensor.range_m)
            else:
                observed = flat_m <= 0.2 * above_m  # well inside the picture of the frame camera, whatever its heading
            whole &= observed.any(axis=1)
    return whole


@pytest.mark.parametrize("kind", SENSORS)
@pytest.mark.parametrize("seed", [0, 5])
def test_what_a_sensor_sees_is_in_view_in_the_relief(kind, seed):
    coverage = covered(kind, seed)
    relief = relief_over(coverage, 2)
    rng = np.random.default_rng(seed)
    cells = coverage.grid.cells
    numbers = rng.integers(0, coverage.grid.count, 3000)
    eyes = cells.centre_m[numbers, :2] + rng.uniform(-40.0, 40.0, (3000, 2))
    up = coverage.site.ground.heights_m(eyes) + rng.uniform(10.0, 30.0, 3000)
    turned = rng.uniform(0.0, 360.0, 3000)
    looks = LevelObservations.by_yaw(np.column_stack([eyes, up]), turned)
    observed = np.flatnonzero(observes_each(coverage, looks, numbers, coverage.sight))
    assert len(observed) > 100
    corner = np.array([cells.east0_m, cells.north0_m]) - (margin_cells(coverage) + 0.5) * cells.size_m
    eye, target = (eyes[observed] - corner).T, (cells.centre_m[numbers[observed], :2] - corner).T
    assert relief.allowed[(eye[1] // relief.side).astype(int), (eye[0] // relief.side).astype(int)].all()
    far = np.hypot(*(eye - target))
    assert (far <= relief.reach).all()
    if relief.tangent > 0.0:
        fall = height(relief.top_m, relief.side, *eye) - height(relief.ground_m, relief.side, *target)
        assert (far <= relief.tangent * fall).all()
        # Ground and places between the nodes: on the right side of what the relief has, and not far from it.
        over = height(relief.top_m, relief.side, *eye) - coverage.site.ground.heights_m(eyes[observed]) - 30.0
        under = coverage.site.ground.heights_m(cells.centre_m[numbers[observed], :2]) - height(
            relief.ground_m, relief.side, *target
        )
        assert (over >= 0.0).all()
        assert (under >= 0.0).all()
        assert over.max() < 2.0


def test_numbers_over_tiles_are_nowhere_below_those_of_squares():
    squares = np.random.default_rng(4).uniform(0.0, 1.0, (11, 18)) ** 8
    nodes = over_tiles(squares, tile=4)
    assert nodes.shape == (12, 19)
    # Linear in the triangles of a square, they are nowhere below its smallest corner.
    corners = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[:-1, 1:], nodes[1:, 1:]])
    assert (corners.min(axis=0) >= squares).all()
    assert nodes.max() == squares.max()
    assert np.abs(np.diff(nodes, axis=0)).max() <= squares.max() / 4.0 + 1e-12
    # A square matters to its own tile and to those around it.
    single = np.zeros((20, 20))
    single[9, 9] = 1.0
    far = np.ones((21, 21), dtype=bool)
    far[4:17, 4:17] = False
    assert (over_tiles(single, tile=4)[far] == 0.0).all()


@functools.cache
def proved(kind, seed):
    """Prices that no program made, what is proved about them, and what the proof leaves of them, as functions of the place."""
    coverage = covered(kind, 3)
    relief = relief_over(coverage, 2)
    program = PriceProgram(coverage, coverable_weight_m2(coverage), relief, 1.0)
    rng = np.random.default_rng(seed)
    program.per_m2 = rng.uniform(0.5, 1.0, program.per_m2.shape) / 40.0
    rates, largest = bounds._rates(relief, program, 1, (0, 0))
    nodes, side = program.at_nodes(), relief.side

    def price_m2(e, n):
        j, i = np.floor(e / side).astype(int), np.floor(n / side).astype(int)
        x, y = e / side - j, n / side - i
        south, north = (
            nodes[i, j] + x * (nodes[i, j + 1] - nodes[i, j]),
            nodes[i + 1, j] * (1.0 - x) + nodes[i + 1, j + 1] * x,
        )
        return np.where(program.priced[i, j], south + y * (north - south), 0.0)

    def left_m2(e, n):
        divisor = largest[np.floor(n / side).astype(int) // 2, np.floor(e / side).astype(int) // 2]
        return np.divide(price_m2(e, n), divisor, out=np.zeros_like(divisor), where=divisor > 0.0)

    return relief, rates, price_m2, left_m2


@pytest.mark.parametrize("kind", ["cone", "short cone", "cone and reach", "disc"])
@pytest.mark.parametrize("seed", range(2))
def test_a_naive_twin_finds_no_larger_rate(kind, seed):
    relief, rates, price_m2, left_m2 = proved(kind, seed)
    rng = np.random.default_rng(seed)
    squares = np.argwhere(rates > 0.3 * rates.max())
    nearest, most = 0.0, 0.0
    for i, j in squares[rng.integers(0, len(squares), 120)]:
        # Anywhere in the square, corners included.
        e, n = (np.array([j, i]) + np.clip(rng.uniform(-0.2, 1.2, 2), 1e-3, 1.0 - 1e-3)) * relief.side
        heading = rng.uniform(0.0, 2.0 * math.pi)
        found = gain(relief, price_m2, (e, n), heading)
        assert found <= rates[i, j] * 1.002
        nearest = max(nearest, found / rates[i, j])
        left = gain(relief, left_m2, (e, n), heading)
        assert left <= 1.002
        most = max(most, left)
    # Where either of reach and angle may end the view within a square, the proof takes the larger.
    assert nearest > (0.85 if kind == "cone and reach" else 0.9)
    assert most > (0.7 if kind == "cone and reach" else 0.8)


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
    ground = price_ground(coverage, 1.0, parts=2)
    bound_m = ground.least_length_m(1.0)
    line = np.array([[20.0, 22.0, 20.0], [20.0, 878.0, 20.0]])
    assert coverage.observed(line).all()
    assert 0.3 * 856.0 < bound_m <= 856.0


def ground_observed(site, path, reach_m, size_m, count=20_000):
    """Share of the ground, by its own area, that a disc, or a cone whose reach grows with height, sees from a path: random
    places, distances on the map, no cells and no lattice."""
    positions = np.random.default_rng(0).uniform((0.0, 0.0), size_m, (count, 2))
    heights_m = site.ground.heights_m
    up_m = heights_m(positions)
    rises = [heights_m(positions + step) - heights_m(positions - step) for step in ((0.5, 0.0), (0.0, 0.5))]
    area = np.sqrt(1.0 + np.hypot(*rises) ** 2)
    observed = np.zeros(count, dtype=bool)
    for e, n, up in path:
        observed |= np.hypot(positions[:, 0] - e, positions[:, 1] - n) <= reach_m(up - up_m)
    return float(area[observed].sum() / area.sum())


def lines_over(site, size_m, lanes, inset_m):
    """Close places of lines 30 m above ground, and their length on the map."""
    width_m, height_m = size_m
    line = lawnmower(width_m, height_m - 2.0 * inset_m, lanes, 0.0)
    line[:, 1] += inset_m
    dense = np.vstack([np.linspace(a, b, 1 + int(np.linalg.norm(b - a) / 2.0)) for a, b in itertools.pairwise(line)])
    dense[:, 2] = site.ground.heights_m(dense[:, :2]) + 30.0
    return dense, float(np.linalg.norm(np.diff(dense[:, :2], axis=0), axis=1).sum())


@pytest.mark.parametrize("lanes", [5])
def test_lines_that_see_enough_of_the_ground_are_not_shorter(lanes):
    """Both sides count ground, which is what the bound is proved for."""
    site = make_site(hills, limits=LOW, cell_m=5.0)
    coverage = CoverageMap(site, cell_size_m=5.0)
    path, length_m = lines_over(site, (300.0, 200.0), lanes, 0.0)
    tangent = math.tan(math.radians(35.0))
    fraction = ground_observed(site, path, lambda above_m: tangent * above_m, (300.0, 200.0))
    # Nothing hides ground from `ground_observed`, as in the proof; the share may be a little above that of the cells.
    assert 0.5 < coverage.fraction_of_coverable(coverage.observed(path)) <= fraction + 0.02
    ground = price_ground(coverage, fraction, parts=2)
    assert 0.0 < ground.least_length_m(fraction) <= length_m


@pytest.mark.parametrize(("kind", "seed", "least"), [("cone", 0, 0.92), ("cone", 1, 0.85)])
def test_the_bound_of_a_wide_area_is_nearly_what_lines_need(kind, seed, least):
    """Twenty reaches across, the bound is 90 % and more of a route that is there: one that is too high is noticed."""
    size_m, radius = (480.0, 480.0), 24.0
    ring = ((0.0, 0.0), (480.0, 0.0), (480.0, 480.0), (0.0, 480.0))
    angle_deg = 2.0 * math.degrees(math.atan(radius / 30.0))
    cone = NadirCamera(kind="nadir-camera", fov_deg=angle_deg, range_m=200.0)
    sensor = cone if kind == "cone" else DiscSensor(kind="disc", radius_m=radius, sensing="along-path")
    site = make_site(wide_bumps(seed) if seed else flat, ring=ring, sensor=sensor, limits=LOW, cell_m=12.0)
    path, length_m = lines_over(site, size_m, 10, 12.0)
    fraction = ground_observed(site, path, lambda above_m: 0.8 * above_m if kind == "cone" else radius, size_m)
    bound_m = price_ground(CoverageMap(site, cell_size_m=12.0), fraction, parts=3).least_length_m(fraction)
    assert fraction > 0.99
    assert least * length_m < bound_m <= length_m


def wide_bumps(seed):
    waves = np.random.default_rng(seed).uniform([40.0, 40.0, 0.0, 2.0], [120.0, 120.0, 6.0, 6.0], (4, 4))
    return lambda e, n: sum(h * np.sin(e / a + p) * np.cos(n / b - p) for a, b, p, h in waves)


def shortest_on_graph(reaches, targets, nodes, neighbours, fraction):
    """Shortest path over a graph that sees a share of the targets, all corners of each from one node: Dijkstra over pairs of a
    node and a set of targets."""
    observes = [
        sum(1 << t for t, corners in enumerate(targets) if (np.hypot(*(corners - node).T) <= reaches[t]).all())
        for node in nodes
    ]
    queue = [(0.0, k, mask) for k, mask in enumerate(observes)]
    heapq.heapify(queue)
    best = {}
    while queue:
        length, k, mask = heapq.heappop(queue)
        if mask.bit_count() >= fraction * len(targets) - 1e-9:
            return length
        if best.get((k, mask), math.inf) <= length:
            continue
        best[k, mask] = length
        for other, leg in neighbours[k]:
            further = length + leg
            if further < best.get((other, mask | observes[other]), math.inf):
                heapq.heappush(queue, (further, other, mask | observes[other]))
    raise AssertionError("the graph sees too little")


@pytest.mark.parametrize("seed", range(5))
def test_no_bound_exceeds_the_optimum_of_a_small_problem(seed):
    """Every optimum on a graph of places is that of a path, so the bound is at most as long; so is any plan found."""
    rng = np.random.default_rng(seed)
    columns, rows = int(rng.integers(8, 12)), 1
    side, radius = 20.0, float(rng.uniform(20.0, 24.0))
    fraction = float(rng.choice([0.7, 0.9, 1.0]))
    ring = ((0.0, 0.0), (columns * side, 0.0), (columns * side, rows * side), (0.0, rows * side))
    sensor = DiscSensor(kind="disc", radius_m=radius, sensing="along-path")
    coverage = CoverageMap(make_site(ring=ring, sensor=sensor, limits=LOW, cell_m=side), cell_size_m=side)
    assert coverage.coverable.all()
    # All of a cell is seen from one place: what a path sees is worth at least as much.
    corners = 0.5 * side * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    middles = np.stack(np.meshgrid((np.arange(columns) + 0.5) * side, (np.arange(rows) + 0.5) * side), axis=-1)
    targets = middles.reshape(-1, 1, 2) + corners
    step = 10.0
    axes = [np.arange(0.0, count * side + 0.1, step) for count in (columns, rows)]
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    legs = [
        [(b, float(d)) for b, d in enumerate(np.hypot(*(nodes - node).T)) if 0.0 < d < 1.5 * step] for node in nodes
    ]
    optimum_m = shortest_on_graph([radius] * len(targets), targets, nodes, legs, fraction)
    ground = price_ground(coverage, fraction, parts=4)
    assert ground.least_length_m(fraction - 1e-9) <= optimum_m + 1e-6
    assert least_path_length_m(coverage, fraction) <= optimum_m + 1e-6


def test_what_may_stay_unseen_is_what_saves_most():
    prices, highest, weight = (
        np.array([5.0, 9.0, 1.0, 6.0]),
        np.array([6.0, 9.0, 1.5, 8.0]),
        np.array([1.0, 3.0, 1.0, 1.0]),
    )
    ground = PricedGround(prices, highest, weight, 2.0)
    assert ground.least_length_m(1.0) == pytest.approx(19.0)
    # Of 6 square metres one and a half may stay unseen: all of the fourth cell, and the dearest half of the first.
    assert ground.least_length_m(0.75) == pytest.approx(19.0 - 6.0 - 3.0)
    assert ground.least_length_m(0.0) == 0.0


def test_the_lattice_is_as_fine_as_the_time_allows():
    coverage = covered("cone", 3)
    parts = [lattice_parts(coverage, time_s) for time_s in (0.0, 0.01, 10.0, 1e6)]
    assert parts[0] is None
    assert parts[1] is None
    assert parts[3] == 8
    assert parts[2] <= parts[3]


def test_where_limits_apply_to_waypoints_alone_the_legs_may_be_at_any_height():
    limits = {**LOW, "applies_to": "waypoints"}
    coverage = CoverageMap(make_site(hills, limits=limits, cell_m=20.0), cell_size_m=20.0)
    relief = relief_over(coverage, 2)
    assert relief.allowed.all()
    assert relief.tangent == 0.0
