"""The parts of the picture, as arrays."""

import dataclasses
import itertools

import numpy as np
import pytest
import shapely

from tests.planner.sites import flat, hills, make_site
from tests.recording.flights import Flight
from uavcover.model.limits import NoFly, Obstacle, Obstacles
from uavcover.recording import layout
from uavcover.recording.flight import body_rotations, coverage_tiles, footprints_m, lift_m, shown_from_s, tick_times_s
from uavcover.recording.scene import (
    LEGEND_TEXT,
    obstacle_triangles_m,
    relief_mesh,
    scene_bounds_m,
    waypoint_labels,
    zone_lines_m,
)
from uavcover.sensing.coverage_map import CoverageMap, LevelObservations
from uavcover.terrain.ground import Ground, grid_ground, hillshade

DOWN = np.array([[0.0, 0.0, -1.0]])
NORTH = np.array([[0.0, 1.0, 0.0]])


def plane(slope_east: float, *, hole: bool = False) -> Ground:
    up = np.tile(slope_east * np.arange(0.0, 501.0, 10.0), (51, 1)) + 100.0
    if hole:
        up[20:25, 30:35] = np.nan
    return grid_ground(up, east0_m=0.0, north0_m=0.0, step_m=10.0, source="a plane", vertical_datum="local")


def test_relief_lies_on_the_ground_and_faces_up() -> None:
    mesh = relief_mesh(plane(0.5), (50.0, 50.0, 450.0, 250.0))
    np.testing.assert_allclose(mesh.vertices_m[:, 2], 100.0 + 0.5 * mesh.vertices_m[:, 0], atol=1e-9)
    a, b, c = (mesh.vertices_m[mesh.triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0.0).all()
    assert 0.5 * normals[:, 2].sum() == pytest.approx(400.0 * 200.0)


def test_relief_leaves_out_what_has_no_data() -> None:
    mesh = relief_mesh(plane(0.5, hole=True), (50.0, 50.0, 450.0, 450.0))
    used = mesh.vertices_m[np.unique(mesh.triangles)]
    inside_hole = (np.abs(used[:, 0] - 320.0) < 20.0) & (np.abs(used[:, 1] - 220.0) < 20.0)
    assert not inside_hole.any()
    assert np.isfinite(mesh.vertices_m).all()


def test_light_comes_from_the_north_west() -> None:
    level, to_north_west, to_south_east, unknown = hillshade(
        np.array([[0.0, 0.0], [0.5, -0.5], [-0.5, 0.5], [np.nan, np.nan]])
    )
    assert level == pytest.approx(1.0)
    assert to_north_west > level > to_south_east > unknown == 0.0


def test_footprint_of_a_nadir_camera_over_a_plane_is_a_circle(flight: Flight) -> None:
    site = dataclasses.replace(flight.site, ground=plane(0.0))
    coverage = _over(flight, site.ground)
    (ring,) = footprints_m(coverage, np.array([[250.0, 250.0, 180.0]]), DOWN, NORTH)
    radius_m = np.hypot(ring[:, 0] - 250.0, ring[:, 1] - 250.0)
    expected_m = 80.0 * np.tan(np.radians(site.scenario.sensor.fov_deg / 2.0))  # type: ignore[union-attr]
    step_m = 200.0 * np.sin(np.radians(site.scenario.sensor.fov_deg / 2.0)) / 40.0  # type: ignore[union-attr]
    assert ((radius_m <= expected_m) & (radius_m > expected_m - step_m)).all()
    np.testing.assert_array_equal(ring[0, :2].round(9), ring[-1, :2].round(9))
    np.testing.assert_allclose(ring[:, 2], 100.0)


@pytest.mark.parametrize("roll_deg", [10.0, -30.0])
def test_footprint_of_a_rolled_camera_lies_where_its_rays_meet_the_plane(flight: Flight, roll_deg: float) -> None:
    coverage = _over(flight, plane(0.0))
    # Flying north, a roll to the right points the camera of a fixed mount to the west.
    axis = body_rotations(np.array([[roll_deg, 0.0, 0.0]])).apply(DOWN)
    assert axis[0] == pytest.approx([-np.sin(np.radians(roll_deg)), 0.0, -np.cos(np.radians(roll_deg))])
    height_m = 60.0
    (ring,) = footprints_m(coverage, np.array([[250.0, 250.0, 100.0 + height_m]]), axis, NORTH)
    half_deg = coverage.site.scenario.sensor.fov_deg / 2.0  # type: ignore[union-attr]
    ends = [250.0 - height_m * np.tan(np.radians(roll_deg + side * half_deg)) for side in (1.0, -1.0)]
    np.testing.assert_allclose([ring[:, 0].min(), ring[:, 0].max()], ends, atol=12.0)
    np.testing.assert_allclose(ring[:, 2], 100.0)


def test_the_texture_lies_on_the_mesh_with_north_on_top() -> None:
    mesh = relief_mesh(plane(0.5), (50.0, 50.0, 450.0, 250.0))
    rows, columns = mesh.texture.shape[:2]
    assert (rows, columns) == (257, 512)
    corner = mesh.vertices_m[:, :2] == (50.0, 250.0)
    np.testing.assert_allclose(mesh.texture_positions[corner.all(axis=1)], [[0.5 / columns, 0.5 / rows]])
    assert mesh.texture_positions.min() > 0.0
    assert mesh.texture_positions.max() < 1.0


def test_footprint_is_empty_out_of_reach_and_below_ground(flight: Flight) -> None:
    coverage = _over(flight, plane(0.0))
    high, buried = footprints_m(
        coverage,
        np.array([[250.0, 250.0, 400.0], [250.0, 250.0, 50.0]]),
        np.repeat(DOWN, 2, axis=0),
        np.repeat(NORTH, 2, axis=0),
    )
    assert high.shape == buried.shape == (0, 3)


def test_seen_cells_lie_in_the_footprint(flight: Flight) -> None:
    eye = flight.track.enu_m[300:301]
    (ring,) = footprints_m(flight.coverage, eye, DOWN, NORTH)
    centres = flight.coverage.grid.cells.centre_m[flight.coverage.observed_by(LevelObservations.towards_north(eye))]
    # The outline is known to a 40th of the reach.
    outline = shapely.Polygon(ring[:, :2]).buffer(5.0)
    assert len(centres) > 10
    assert shapely.contains_xy(outline, centres[:, 0], centres[:, 1]).all()


def test_cells_turn_at_the_tick_after_they_were_seen() -> None:
    ticks = tick_times_s(2.0, 5.5)
    np.testing.assert_array_equal(ticks, [2.0, 3.0, 4.0, 5.0, 5.5])
    observed = np.array([2.0, 2.1, 3.0, 5.2, 5.5, np.nan, np.inf])
    np.testing.assert_array_equal(shown_from_s(observed, ticks), [2.0, 3.0, 3.0, 5.5, 5.5, np.inf, np.inf])
    np.testing.assert_array_equal(tick_times_s(4.0, 4.0), [4.0])


def test_tiles_are_cells_on_the_ground(flight: Flight) -> None:
    coverage = flight.coverage
    tiles = coverage_tiles(coverage, np.full(coverage.grid.count, np.inf), 0.0)
    assert sorted(np.concatenate([t.cells for t in tiles])) == list(range(coverage.grid.count))
    for tile in tiles:
        corners = tile.vertices_m.reshape(-1, 4, 3)
        np.testing.assert_allclose(corners[..., :2].mean(axis=1), coverage.grid.cells.centre_m[tile.cells, :2])
        ground = coverage.site.ground.heights_m(tile.vertices_m[:, :2])
        np.testing.assert_allclose(tile.vertices_m[:, 2] - ground, lift_m(coverage), atol=1e-9)
        a, b, c = (tile.vertices_m[tile.triangles[:, i]] for i in range(3))
        area = 0.5 * np.cross(b - a, c - a)[:, 2]
        np.testing.assert_allclose(area, coverage.grid.cells.size_m**2 / 2.0)
        assert tile.rgba.shape == (1, tile.cells.size)


def test_labels_are_thinned_out_and_keep_the_last() -> None:
    assert waypoint_labels(3) == ["0", "1", "2"]
    assert waypoint_labels(0) == []
    many = [label for label in waypoint_labels(1234) if label]
    assert len(many) <= 61
    assert many[0] == "0"
    assert many[1] == "50"
    assert many[-1] == "1233"


def _over(flight: Flight, ground: Ground) -> CoverageMap:
    area = shapely.box(100.0, 100.0, 400.0, 400.0)
    return CoverageMap(dataclasses.replace(flight.site, ground=ground, area=area), cell_size_m=20.0)


def test_an_obstacle_is_its_roof_and_its_walls() -> None:
    outer, court = ((50, 50), (80, 50), (80, 90), (50, 90)), ((60, 60), (70, 60), (70, 80), (60, 80))
    school = Obstacle(height_m=12.0, rings_east_north_m=(outer, court), name="school")
    site = make_site(hills, obstacles=Obstacles(prisms=(school,)))
    a, b, c = np.moveaxis(obstacle_triangles_m(site).reshape(-1, 3, 3), 1, 0)
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    top = site.prisms[0].top_m
    roof = (a[:, 2] == top) & (b[:, 2] == top) & (c[:, 2] == top)
    assert areas[roof].sum() == pytest.approx(30.0 * 40.0 - 10.0 * 20.0)
    # Every other corner stands on the ground below it or at the height of the roof; eight walls of two triangles.
    corners = np.vstack([a[~roof], b[~roof], c[~roof]])
    on_ground = np.isclose(corners[:, 2], site.ground.heights_m(corners[:, :2]))
    assert (on_ground | (corners[:, 2] == top)).all()
    assert (~roof).sum() == 16


def test_limits_and_fence_have_colours_of_their_own_and_are_in_the_legend() -> None:
    lines = {
        "fence": layout.FENCE_RGB, "ceiling": layout.CEILING_RGB, "floor": layout.FLOOR_RGB, "area": layout.AREA_RGB,
        "planned": layout.PLANNED_RGB, "flown": layout.FLOWN_RGB, "no-fly zone": layout.NO_FLY_RGB,
    }  # fmt: skip
    for (one, rgb), (other, another) in itertools.combinations(lines.items(), 2):
        assert np.linalg.norm(np.subtract(rgb, another)) > 70.0, (one, other)
    for words in (
        "orange outline | the fence",
        "maximum height above ground",
        "minimum height above ground",
        "no-fly zones",
    ):
        assert words in LEGEND_TEXT


@pytest.mark.parametrize(
    ("heights", "low", "high"),
    [
        ({"floor_agl_m": 50.0, "ceiling_agl_m": 90.0}, 50.0, 90.0),
        ({"floor_amsl_m": 460.0, "ceiling_amsl_m": 480.0}, 60.0, 80.0),  # the local frame lies at 400 m
        ({}, 0.0, None),
    ],
)
def test_a_no_fly_zone_is_its_floor_its_ceiling_and_its_corners(heights, low, high) -> None:
    corners = ((100.0, 20.0), (160.0, 20.0), (160.0, 90.0))
    site = make_site(flat, no_fly=(NoFly(polygon_east_north_m=corners, **heights),))
    lines = zone_lines_m(site, site.zones[0], scene_bounds_m(site))
    assert len(lines) == 2 + 4  # the first corner is the last one too
    high = site.scenario.transit_ceiling_agl_m if high is None else high
    assert {round(float(up), 6) for line in lines for up in line[:, 2]} == {low, high}
    everywhere = make_site(flat, no_fly=(NoFly(center_east_north_m=(0.0, 0.0), radius_m=90_000.0, floor_agl_m=300.0),))
    west, south, east, north = bounds = scene_bounds_m(everywhere)
    for line in zone_lines_m(everywhere, everywhere.zones[0], bounds):
        assert west <= line[:, 0].min() <= line[:, 0].max() <= east
        assert south <= line[:, 1].min() <= line[:, 1].max() <= north
