"""Obstacles in a scenario: where they come from, what is refused, and where they stand on the ground."""

import dataclasses
import json
import math

import numpy as np
import pytest
import shapely

from uavcover.errors import ScenarioError
from uavcover.model.limits import Obstacle, Obstacles
from uavcover.scenario.obstacles import box_corners_m, read_obstacles
from uavcover.scenario.scenario_file import dump_scenario, load_scenario, parse_scenario
from uavcover.scenario.site import load_site
from uavcover.sensing.cells import make_cells

BOX = ((0.0, 0.0), (10.0, 0.0), (10.0, 20.0), (0.0, 20.0))


def ridge(**changes):
    scenario = load_scenario("ridge-obstacles")
    return dataclasses.replace(scenario, obstacles=dataclasses.replace(scenario.obstacles, **changes))


@pytest.fixture(scope="module")
def site():
    return load_site("ridge-obstacles")


def test_the_bundled_boxes(site):
    heights = [prism.footprint.height_m for prism in site.prisms]
    assert len(heights) == 60
    assert 10.0 <= min(heights) < 12.0 < 23.0 < max(heights) <= 25.0
    assert make_cells(site, 5.0).count == 40_000
    footprints = [prism.footprint.polygon for prism in site.prisms]
    assert shapely.union_all(footprints).area == pytest.approx(sum(f.area for f in footprints)), "none overlap"


def test_a_box_stands_on_the_highest_ground_below_it(site):
    for prism in site.prisms[:12]:
        west, south, east, north = prism.footprint.polygon.bounds
        positions = np.array([(e, n) for e in np.linspace(west, east, 60) for n in np.linspace(south, north, 60)])
        inside = shapely.contains_xy(prism.footprint.polygon, positions)
        highest = site.ground.heights_m(positions[inside]).max()
        assert prism.top_m == pytest.approx(highest + prism.footprint.height_m, abs=0.6)
        assert prism.top_m >= highest + prism.footprint.height_m - 1e-9


def test_on_the_papers_surface_a_peak_inside_the_footprint_counts():
    scenario = load_scenario("paper-R2")
    # sin(y) cos(x) is 1 at (2 pi, pi / 2); the corners of the box lie lower.
    prism = Obstacle(height_m=0.25, rings_east_north_m=(((5.9, 1.2), (6.7, 1.2), (6.7, 2.0), (5.9, 2.0)),))
    site = load_site(dataclasses.replace(scenario, obstacles=Obstacles(prisms=(prism,), clearance_beside_m=0.1)))
    assert site.prisms[0].top_m == pytest.approx(1.25, abs=1e-9)


def test_a_cell_under_a_box_is_a_part_of_its_roof(site):
    cells = make_cells(site, 5.0).cells
    roofs = site.ground.roofs_m(cells.centre_m[:, :2])
    there = np.isfinite(roofs)
    assert 0.015 < there.mean() < 0.025
    assert (cells.centre_m[there, 2] == roofs[there]).all()
    assert (cells.normal[there] == (0.0, 0.0, 1.0)).all()
    np.testing.assert_array_equal(cells.centre_m[~there, 2], site.ground.heights_m(cells.centre_m[~there, :2]))


def test_a_scenario_with_obstacles_comes_back_from_its_text(tmp_path):
    scenario = load_scenario("ridge-obstacles")
    assert scenario.obstacles.file is None
    assert parse_scenario(dump_scenario(scenario), source="again", folder=tmp_path) == scenario


def test_boxes_of_a_table(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text("height_m,east_m,north_m,length_m,width_m,heading_deg\n7.5,100,50,20,10,90\n")
    (box,) = read_obstacles(path)
    assert (box.height_m, box.name) == (7.5, "0")
    # Its length lies along the heading: eastwards.
    assert shapely.Polygon(box.rings_east_north_m[0]).bounds == pytest.approx((90.0, 45.0, 110.0, 55.0))
    assert shapely.Polygon(box_corners_m(0, 0, 20, 10, 30)).area == pytest.approx(200.0)


def test_polygons_of_geojson_with_a_courtyard(tmp_path):
    outer = [[-84.2212, 36.4804], [-84.2209, 36.4804], [-84.2209, 36.4807], [-84.2212, 36.4807], [-84.2212, 36.4804]]
    court = [[-84.2211, 36.4805], [-84.2210, 36.4805], [-84.2210, 36.4806], [-84.2211, 36.4805]]
    feature = {
        "type": "Feature", "properties": {"name": "school", "height_m": 12},
        "geometry": {"type": "Polygon", "coordinates": [outer, court]},
    }  # fmt: skip
    path = tmp_path / "town.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    text = dump_scenario(ridge(prisms=())).replace("[obstacles]", '[obstacles]\nfile = "town.geojson"')
    scenario = parse_scenario(text, source="mine.toml", folder=tmp_path)
    (prism,) = load_site(scenario).prisms
    assert prism.footprint.name == "school"
    assert len(prism.footprint.polygon.interiors) == 1
    assert prism.footprint.polygon.area == pytest.approx(26.9 * 33.3 - 0.5 * 8.95 * 11.1, rel=0.01)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", "east_m,north_m\n1,2\n", "has no column length_m, width_m, heading_deg, height_m"),
        ("a.csv", "east_m,north_m,length_m,width_m,heading_deg,height_m\n1,2,3,x,5,6\n", "line 2: could not convert"),
        (
            "a.csv",
            "east_m,north_m,length_m,width_m,heading_deg,height_m\n1,2,3,4,5,-6\n",
            "line 2: height_m: must be greater than 0, not -6.0",
        ),
        (
            "a.csv",
            "east_m,north_m,length_m,width_m,heading_deg,height_m\n1,2,3,0,5,6\n",
            "line 2: length_m and width_m",
        ),
        ("a.geojson", "{", "cannot read the file as GeoJSON"),
        (
            "a.geojson",
            '{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]]]}',
            "polygon 0 has no height_m",
        ),
        (
            "a.geojson",
            '{"type": "Feature", "properties": {"height_m": "9"}, "geometry": {"type": "Polygon", "coordinates": '
            "[[[0, 0], [1, 0], [1, 1]]]}}",
            "polygon 0: height_m: expected a number",
        ),
        ("a.txt", "", "use a .geojson, .kml, .kmz or .csv"),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line(tmp_path, name, content, words):
    (tmp_path / name).write_text(content)
    text = dump_scenario(ridge(prisms=())).replace("[obstacles]", f'[obstacles]\nfile = "{name}"')
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, source="mine.toml", folder=tmp_path)
    message = str(caught.value)
    assert message.startswith("mine.toml: obstacles.file: ")
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "clearance_beside_m = 10.0",
            "clearance_beside_m = -1.0",
            "obstacles.clearance_beside_m: must not be negative",
        ),
        (
            "clearance_beside_m = 10.0",
            "clearance_beside_m = 90.0",
            "obstacles.clearance_beside_m: must be at most",
        ),
        (
            'line_of_sight = "ray"',
            'line_of_sight = "midpoint"',
            'sensor.line_of_sight: with obstacles, this must be "ray"',
        ),
        ("height_m = 22.2", "height_m = 0.0", "obstacles.prisms.0: height_m: must be greater"),
        ("height_m = 22.2", "hight_m = 22.2", "obstacles.prisms.0.hight_m: unknown key"),
    ],
)
def test_wrong_obstacles_are_one_line(tmp_path, old, new, words):
    text = dump_scenario(load_scenario("ridge-obstacles"))
    assert old in text
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text.replace(old, new, 1), source="mine.toml", folder=tmp_path)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_footprint_that_crosses_itself_is_refused(tmp_path):
    bow = Obstacle(height_m=5.0, rings_east_north_m=(((0, 0), (10, 10), (10, 0), (0, 10)),), name="bow")
    with pytest.raises(ScenarioError, match=r"obstacles.prisms.0 \(bow\): Self-intersection"):
        parse_scenario(dump_scenario(ridge(prisms=(bow,))), source="mine.toml", folder=tmp_path)


def test_home_keeps_clear_of_obstacles():
    near = Obstacle(height_m=5.0, rings_east_north_m=(tuple((465.0 + e, -462.0 + n) for e, n in BOX),), name="shed")
    with pytest.raises(
        ScenarioError,
        match=r"home: the position is 8\.0 m from obstacle 'shed', but obstacles\.clearance_beside_m is 10 m",
    ):
        load_site(ridge(prisms=(near,)))


def test_obstacles_far_away_are_no_matter():
    far = Obstacle(height_m=5.0, rings_east_north_m=(tuple((9000.0 + e, n) for e, n in BOX),), name="far")
    assert load_site(ridge(prisms=(far,))).prisms == ()
    assert math.isinf(load_site(ridge(prisms=(far,))).ground.roofs_m([[9005.0, 5.0]])[0])
