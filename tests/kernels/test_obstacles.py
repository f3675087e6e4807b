import math

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.compiled_kernels import cases
from tests.naive import obstacles as naive
from uavcover.kernels.obstacle_breach import edge_distances_m, parts_over, tops_near_m, worst_breach
from uavcover.kernels.obstacles import NO_OBSTACLES, horizons, keeps_clear, make_obstacles, roofs_m, top_within_m

deterministic = settings(derandomize=True, deadline=None, max_examples=cases(compiled=150, interpreted=15))

GROWN_M = 6.0


def obstacles_of(prisms, grown_m=GROWN_M):
    """Kernels' obstacles of (polygon, top) pairs."""
    edges, first = [], [0]
    for footprint, _ in prisms:
        for ring in (footprint.exterior, *footprint.interiors):
            corners = np.array(ring.coords)
            edges.append(np.hstack([corners[:-1], corners[1:]]))
        first.append(sum(map(len, edges)))
    tops = np.array([top for _, top in prisms], dtype=float)
    return make_obstacles(np.vstack(edges), np.array(first), tops, grown_m=grown_m)


coordinates = st.integers(-40, 40).map(float)
odd = st.floats(-40.0, 40.0, width=32)
heights = st.one_of(st.integers(0, 30).map(float), st.floats(0.0, 30.0, width=32))


@st.composite
def footprints(draw):
    east, north = draw(coordinates), draw(coordinates)
    wide, deep = draw(st.integers(1, 15)), draw(st.integers(1, 15))
    box = shapely.box(east, north, east + wide, north + deep)
    kind = draw(st.sampled_from(["box", "turned", "court", "corner"]))
    if kind == "turned":
        return shapely.affinity.rotate(box, draw(st.floats(0.0, 90.0, width=32)))
    if kind == "court" and min(wide, deep) > 2:
        return box.difference(box.buffer(-1.0))
    if kind == "corner" and min(wide, deep) > 1:
        return box.difference(shapely.box(east + wide / 2, north + deep / 2, east + wide, north + deep))
    return box


prism_lists = st.lists(st.tuples(footprints(), heights), min_size=1, max_size=5)
positions = st.tuples(st.one_of(coordinates, odd), st.one_of(coordinates, odd), heights)


def clear(prisms, p, q, beside=0.0, above=0.0):
    return keeps_clear(obstacles_of(prisms), tuple(p), tuple(q), beside, above)


def walls_of(*footprints):
    """The walls, as thick as rounding: along them, or with an end on them, a line is inside or outside, as rounding goes."""
    return shapely.union_all([footprint.boundary.buffer(1e-9) for footprint in footprints])


@deterministic
@given(prism_lists, positions, positions)
def test_a_line_enters_a_prism_when_shapely_says_so(prisms, p, q):
    line, walls = naive.lower_part(p, q, math.inf), walls_of(*(footprint for footprint, _ in prisms))
    inside = naive.enters(prisms, p, q)
    if inside - line.intersection(walls).length > 1e-6:
        assert not clear(prisms, p, q)
    elif not walls.intersects(line):
        assert clear(prisms, p, q)


@pytest.mark.parametrize("end", [(0.0, 10.0), (0.0, 0.0)], ids=["along a wall", "at a corner"])
def test_the_comparison_leaves_out_what_lies_on_a_wall(end):
    """Regression: hypothesis draws these where it knows the constants of other modules."""
    test_a_line_enters_a_prism_when_shapely_says_so.hypothesis.inner_test(BOX, (0.0, 0.0, 0.0), (*end, 0.0))


@deterministic
@given(prism_lists, positions, positions, st.floats(0.125, GROWN_M, width=32), st.floats(0.0, 10.0, width=32))
def test_clearance_is_that_of_shapely(prisms, p, q, beside, above):
    distance = naive.clearance_beside(prisms, p, q, above)
    if abs(distance - beside) > 1e-6:
        assert clear(prisms, p, q, beside, above) == (distance > beside)


@deterministic
@given(footprints(), heights, positions, positions, st.floats(0.5, GROWN_M, width=32), st.floats(0.0, 10.0, width=32))
def test_what_a_line_lacks_is_found_by_trying_places(footprint, top, p, q, beside, above):
    walls = walls_of(footprint)
    assume(naive.lower_part(p, q, math.inf).intersection(walls).length < 1e-6)
    assume(not any(walls.intersects(shapely.Point(end[:2])) for end in (p, q)))
    expected = naive.lacking(footprint, top, p, q, beside, above)
    number, lacking, at = worst_breach(obstacles_of([(footprint, top)]), tuple(p), tuple(q), beside, above)
    # Between two places that were tried lie at most 0.03 m, and as much height.
    assert lacking == pytest.approx(expected, abs=0.06)
    assert (number == 0) == (lacking > 0.0)
    assert 0.0 <= at <= 1.0


@deterministic
@given(prism_lists, positions)
def test_the_horizon_passes_over_every_prism(prisms, position):
    lattice = np.zeros((1, 1), dtype=np.int32)
    centre = np.array([position])
    found = horizons(obstacles_of(prisms), lattice, centre, position[0], position[1], 5.0, 30.0)[0]
    assert found == pytest.approx(naive.horizon(prisms, position, 30.0), rel=1e-9)


@deterministic
@given(prism_lists, positions)
def test_roofs_are_the_highest_tops_over_a_place(prisms, position):
    inside = [top for footprint, top in prisms if footprint.contains(shapely.Point(position[:2]))]
    on_edge = any(footprint.boundary.distance(shapely.Point(position[:2])) < 1e-9 for footprint, _ in prisms)
    if not on_edge:
        found = roofs_m(obstacles_of(prisms), np.array([position[0]]), np.array([position[1]]))[0]
        assert found == max(inside, default=-math.inf)


@deterministic
@given(prism_lists, positions, positions, st.floats(0.125, GROWN_M, width=32))
def test_the_highest_top_near_a_leg(prisms, p, q, beside):
    distances = [footprint.distance(shapely.LineString([p[:2], q[:2]])) for footprint, _ in prisms]
    if all(abs(d - beside) > 1e-6 for d in distances):
        expected = max((top for d, (_, top) in zip(distances, prisms, strict=True) if d < beside), default=-math.inf)
        assert tops_near_m(obstacles_of(prisms), np.array([[*p[:2], *q[:2]]]), beside).tolist() == [expected]


@deterministic
@given(prism_lists, positions, st.floats(0.0, 25.0, width=32))
def test_the_highest_top_around_a_place(prisms, position, radius):
    distances = [footprint.distance(shapely.Point(position[:2])) for footprint, _ in prisms]
    if all(abs(d - radius) > 1e-6 and (d == 0.0 or d > 1e-6) for d in distances):
        tops = [top for d, (_, top) in zip(distances, prisms, strict=True) if d < radius or d == 0.0]
        assert top_within_m(obstacles_of(prisms), *position[:2], radius) == max(tops, default=-math.inf)


BOX = [(shapely.box(0.0, 0.0, 10.0, 10.0), 20.0)]


@pytest.mark.parametrize(
    ("p", "q", "is_clear"),
    [
        ((-5.0, 5.0, 10.0), (15.0, 5.0, 10.0), False),  # straight through
        ((-5.0, 5.0, 21.0), (15.0, 5.0, 21.0), True),  # over it
        ((-5.0, 5.0, 35.5), (15.0, 5.0, 15.5), True),  # just over the far edge of the roof
        ((-5.0, 5.0, 34.5), (15.0, 5.0, 14.5), False),
        ((-5.0, -5.0, 5.0), (15.0, 15.0, 5.0), False),  # through two corners
        ((-5.0, 5.5, 5.0), (5.0, 15.5, 5.0), True),  # past a corner
        ((-5.0, 4.5, 5.0), (5.0, 14.5, 5.0), False),
        ((0.0, 5.0, 0.0), (-10.0, 5.0, 3.0), True),  # from the foot of a wall away
        ((0.0, 5.0, 0.0), (10.0, 5.0, 30.0), False),  # from the foot of a wall over it
        ((5.0, 5.0, 20.0), (40.0, 5.0, 22.0), True),  # from the roof
        ((5.0, 5.0, 19.0), (5.0, 5.0, 40.0), False),  # straight up from inside
        ((5.0, 5.0, 20.0), (5.0, 5.0, 40.0), True),
        ((math.nan, 5.0, 20.0), (5.0, 5.0, 40.0), False),
    ],
)
def test_a_ray_and_a_box(p, q, is_clear):
    assert clear(BOX, p, q) == is_clear
    if math.isfinite(p[0]):
        assert clear(BOX, q, p) == is_clear


def test_no_obstacles_are_never_in_the_way():
    assert keeps_clear(NO_OBSTACLES, (-5.0, 5.0, 10.0), (15.0, 5.0, 10.0), 5.0, 5.0)
    assert worst_breach(NO_OBSTACLES, (-5.0, 5.0, 10.0), (15.0, 5.0, 10.0), 5.0, 5.0)[0] == -1
    assert roofs_m(NO_OBSTACLES, np.zeros(1), np.zeros(1)).tolist() == [-math.inf]


def test_tiles_leave_no_prism_out():
    rng = np.random.default_rng(5)
    corners = rng.uniform(0.0, 2000.0, (300, 2))
    prisms = [
        (shapely.box(e, n, e + w, n + d), top)
        for (e, n), (w, d), top in zip(
            corners, rng.uniform(2.0, 60.0, (300, 2)), rng.uniform(5.0, 30.0, 300), strict=True
        )
    ]
    obstacles = obstacles_of(prisms)
    answers = set()
    for p, q in rng.uniform([0.0, 0.0, 0.0], [2000.0, 2000.0, 120.0], (300, 2, 3)):
        q = p + (q - p) * rng.choice([0.02, 0.1, 1.0])
        answer = keeps_clear(obstacles, tuple(p), tuple(q), 5.0, 4.0)
        assert answer == (naive.clearance_beside(prisms, p, q, 4.0) > 5.0)
        answers.add(answer)
    assert answers == {True, False}


def test_only_prisms_beside_a_line_are_asked_and_the_answers_stay():
    rng = np.random.default_rng(6)
    corners = rng.uniform(0.0, 600.0, (200, 2))
    prisms = [
        (shapely.box(e, n, e + 15.0, n + 9.0), float(top))
        for (e, n), top in zip(corners, rng.uniform(5, 30, 200), strict=True)
    ]
    obstacles, singles = obstacles_of(prisms), [obstacles_of([each]) for each in prisms]
    found = set()
    for p, q in rng.uniform([-50.0, -50.0, 0.0], [650.0, 650.0, 45.0], (cases(compiled=300, interpreted=40), 2, 3)):
        q = p + (q - p) * rng.choice([0.0, 0.1, 1.0])
        alone = [worst_breach(each, tuple(p), tuple(q), GROWN_M, 2.0)[1] for each in singles]
        number, lacking, _ = worst_breach(obstacles, tuple(p), tuple(q), GROWN_M, 2.0)
        assert number == (int(np.argmax(alone)) if max(alone) > 0.0 else -1)
        assert lacking == pytest.approx(max(alone))
        line = np.array([[*p[:2], *q[:2]]])
        tops = [tops_near_m(each, line, GROWN_M)[0] for each in singles]
        assert tops_near_m(obstacles, line, GROWN_M)[0] == max(tops)
        found.add(number >= 0)
    assert found == {True, False}
    assert tops_near_m(obstacles, np.full((1, 4), np.nan), GROWN_M).tolist() == [-math.inf]


def star(rng):
    """A footprint with a courtyard that lines enter several times."""
    angles = np.linspace(0.0, 2.0 * np.pi, 14, endpoint=False)
    reach = np.where(np.arange(14) % 2, rng.uniform(8.0, 14.0), rng.uniform(25.0, 35.0))
    outer = np.column_stack([reach * np.cos(angles), reach * np.sin(angles)])
    return shapely.Polygon(outer, [shapely.Point(0.0, 0.0).buffer(5.0, 2).exterior.coords])


def test_parts_over_a_footprint_and_depths_are_those_of_shapely():
    rng = np.random.default_rng(7)
    shapes = [star(rng) for _ in range(3)]
    footprints = obstacles_of([(shape, 1.0) for shape in shapes])
    count = cases(compiled=200, interpreted=40)
    lines, numbers = rng.uniform(-45.0, 45.0, (count, 4)), rng.integers(0, 3, count)
    lines[::7, 2:] = lines[::7, :2]
    owners, fractions = parts_over(footprints, numbers, lines)
    assert (np.diff(owners) >= 0).all()
    several = 0
    for k, (line, shape) in enumerate(zip(lines, (shapes[number] for number in numbers), strict=True)):
        found, p, step = fractions[owners == k], line[:2], line[2:] - line[:2]
        if not step.any():
            assert found.tolist() == ([[0.0, 1.0]] if shape.contains(shapely.Point(p)) else [])
            continue
        over = shapely.union_all([shapely.LineString([p + t * step for t in part]) for part in found])
        expected = shapely.LineString([p, p + step]).intersection(shape)
        assert over.symmetric_difference(expected).length < 1e-6 or over.hausdorff_distance(expected) < 1e-9
        assert len(found) == sum(part.length > 0.0 for part in shapely.get_parts(expected))
        several += len(found) > 1
    assert several > 5
    positions = lines[:, None, :2] + np.linspace(0.0, 1.0, 33)[:, None] * (lines[:, 2:] - lines[:, :2])[:, None]
    expected = shapely.distance(shapely.boundary([shapes[k] for k in numbers])[:, None], shapely.points(positions))
    found = edge_distances_m(footprints, numbers, positions)
    np.testing.assert_allclose(found[found >= 0.0], expected[found >= 0.0])
    np.testing.assert_allclose(found.max(axis=1), expected.max(axis=1))
    np.testing.assert_array_equal(found.argmax(axis=1), expected.argmax(axis=1))
    assert (found < 0.0).mean() > 0.3
