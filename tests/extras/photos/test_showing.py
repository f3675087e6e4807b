"""What pictures show, against brute force over every picture, and strips of pictures that were withheld."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from tests.naive import photos as naive
from tests.planner.sites import HIGH_M, LOW_M, STEP_M, hills, make_site, ridge
from uavcover.extras.photos.placing import LocatedPhotos
from uavcover.extras.photos.showing import DIRECTIONS, looking_towards, shown_cells
from uavcover.model.sensor import FrameCamera
from uavcover.sensing.site_maps import judging_map

CAMERA = FrameCamera(
    kind="frame-camera", fov_across_deg=62.0, fov_along_deg=47.0, range_m=260.0, pixels_across=4000, mount="stabilised"
)
GROUNDS = {"hills": hills, "ridge": ridge(150.0, 60.0)}
LINES_M, STEPS_M = 20.0, 15.0
NEEDED = 6


def flight(seed):
    """Pictures of a lawnmower over the square of the sites, its places a little off; and which line each belongs to."""
    rng = np.random.default_rng(seed)
    positions, yaws, lines = [], [], []
    for number, north in enumerate(np.arange(-40.0, 241.0, LINES_M)):
        easts = np.arange(-40.0, 341.0, STEPS_M)
        for east in easts if number % 2 == 0 else easts[::-1]:
            positions.append((east, north, 95.0))
            yaws.append(90.0 if number % 2 == 0 else 270.0)
            lines.append(number)
    return np.array(positions) + rng.uniform(-3.0, 3.0, (len(positions), 3)), np.array(yaws), np.array(lines)


def placed(eyes_m, yaws_deg, *, horizontal_m=0.0, vertical_m=0.0, turn_deg=0.0):
    count = len(eyes_m)
    yaw = np.radians(yaws_deg)
    return LocatedPhotos(
        (), eyes_m, np.tile([0.0, 0.0, -1.0], (count, 1)), np.column_stack([np.sin(yaw), np.cos(yaw), np.zeros(count)]),
        np.ones(count, bool), np.full(count, horizontal_m), np.full(count, vertical_m), np.full(count, turn_deg), {},
    )  # fmt: skip


def brute_force(site, coverage, eyes_m, yaws_deg, ground):
    axis = np.arange(LOW_M, HIGH_M + STEP_M / 2, STEP_M)
    between = RegularGridInterpolator((axis, axis), ground(axis[None, :], axis[:, None]))
    cells = coverage.grid.cells
    counts, _, doubtful = naive.count(
        site.scenario.sensor, lambda at: between(at[:, ::-1]), eyes_m, yaws_deg, cells.centre_m, cells.normal
    )
    return counts, doubtful


@pytest.mark.parametrize("ground", GROUNDS)
def test_pictures_are_counted_as_by_brute_force(ground):
    site = make_site(GROUNDS[ground], sensor=CAMERA, cell_m=25.0)
    coverage = judging_map(site)
    eyes_m, yaws_deg, _ = (part[::2] for part in flight(1))
    shown = shown_cells(coverage, placed(eyes_m, yaws_deg))
    expected, doubtful = brute_force(site, coverage, eyes_m, yaws_deg, GROUNDS[ground])
    np.testing.assert_array_equal(shown.photos[~doubtful], expected[~doubtful])
    assert doubtful.mean() < 0.2
    assert (shown.directions == (shown.photos > 0)).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_strip_that_was_withheld_is_found_and_nothing_else(seed, lawnmower):
    coverage, eyes_m, yaws_deg, lines, whole = lawnmower
    rng = np.random.default_rng(seed)
    first, count = int(rng.integers(2, 7)), int(rng.integers(6, 9))
    kept = (lines < first) | (lines >= first + count)
    shown = shown_cells(coverage, placed(eyes_m[kept], yaws_deg[kept]))
    withheld = shown_cells(coverage, placed(eyes_m[~kept], yaws_deg[~kept]))
    assert (whole.photos >= NEEDED).all()
    missing = ~shown.enough(NEEDED)
    np.testing.assert_array_equal(shown.photos + withheld.photos, whole.photos)
    middle_m = -40.0 + LINES_M * (first + 0.5 * (count - 1))
    away_m = np.abs(coverage.grid.middles_m[:, 1] - middle_m)
    assert missing.any()
    assert away_m[missing].max() < 0.5 * LINES_M * count + 60.0
    assert missing[away_m < 5.0].mean() > 0.9


@pytest.fixture(scope="module")
def lawnmower():
    coverage = judging_map(make_site(hills, sensor=CAMERA, cell_m=8.0))
    eyes_m, yaws_deg, lines = flight(2)
    return coverage, eyes_m, yaws_deg, lines, shown_cells(coverage, placed(eyes_m, yaws_deg))


def test_what_is_surely_seen_is_seen_wherever_the_cameras_were(lawnmower):
    coverage, eyes_m, yaws_deg, lines, _ = lawnmower
    few = lines % 5 == 0
    errors = {"horizontal_m": 5.0, "vertical_m": 5.0, "turn_deg": 3.0}
    shown = shown_cells(coverage, placed(eyes_m[few], yaws_deg[few], **errors)).coverage
    assert 0 < shown.certain_cells.sum() < shown.observed.sum() < shown.possible_cells.sum()
    rng = np.random.default_rng(4)
    for _ in range(5):
        aside = rng.normal(size=(int(few.sum()), 3))
        aside *= 4.9 / np.linalg.norm(aside, axis=1)[:, None]
        shifted = shown_cells(coverage, placed(eyes_m[few] + aside, yaws_deg[few] + rng.uniform(-2.9, 2.9))).coverage
        assert not (shown.certain_cells & ~shifted.observed).any()
        assert not (shifted.observed & ~shown.possible_cells).any()


def test_a_limit_on_the_sample_distance_makes_pictures_too_coarse_but_leaves_their_number(lawnmower):
    _, eyes_m, yaws_deg, _, whole = lawnmower
    fine = dataclasses.replace(CAMERA, max_ground_sample_m=float(np.nanmedian(whole.coverage.ground_sample_m)))
    limited = judging_map(make_site(hills, sensor=fine, cell_m=8.0))
    shown = shown_cells(limited, placed(eyes_m, yaws_deg))
    np.testing.assert_array_equal(shown.photos, whole.photos)
    assert 0.2 < shown.coverage.observed.mean() < 0.8
    assert (whole.coverage.ground_sample_m[shown.coverage.observed] <= fine.max_ground_sample_m * (1 + 1e-9)).all()


def test_cameras_to_four_sides_are_four_directions(lawnmower):
    coverage = lawnmower[0]
    tilt = np.radians(45.0)
    eyes, axes, tops = [], [], []
    for east, north in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        eyes.append((150.0 - 90.0 * east, 100.0 - 90.0 * north, 110.0))
        axes.append((np.sin(tilt) * east, np.sin(tilt) * north, -np.cos(tilt)))
        tops.append((np.cos(tilt) * east, np.cos(tilt) * north, np.sin(tilt)))
    four = dataclasses.replace(
        placed(np.array(eyes), np.zeros(4)), axes=np.array(axes, float), tops=np.array(tops, float)
    )
    assert [DIRECTIONS[k] for k in looking_towards(four.axes)] == ["north", "east", "south", "west"]
    shown = shown_cells(coverage, four)
    assert shown.directions.max() == 4
    assert (shown.directions == shown.photos).all()
