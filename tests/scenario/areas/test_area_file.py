"""Areas of every format, in every coordinate system and place, read back as they were written."""

import json
import math
import re
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from tests.scenario.areas import written
from tests.scenario.scenario_texts import survey_text
from uavcover.errors import InputError, ScenarioError
from uavcover.scenario.areas.area_file import AreaQuery, is_area_file, is_area_text, read_area
from uavcover.scenario.scenario_file import dump_scenario, load_scenario, parse_scenario
from uavcover.terrain.frames import LocalFrame

GIS = {"gpkg": "GPKG", "shp": "ESRI Shapefile", "fgb": "FlatGeobuf"}
PROJECTED = ("geojson", "wkt", *GIS)


def write(folder, name, geographic, grid, epsg):
    """The polygons in a format and, where it can hold one, in the projected system of the place."""
    path = folder / f"area.{name}"
    match name:
        case "geojson":
            return written.geojson(path, grid, epsg)
        case "wkt":
            return written.wkt(path, grid, epsg)
        case "kml":
            return written.kml(path, geographic)
        case "kmz":
            return written.kmz(path, geographic)
        case "plan":
            return written.plan(path, surveys=[list(part.exterior.coords) for part in geographic])
        case "poly":
            return written.poly(path, geographic[0].exterior.coords)
    pytest.importorskip("pyogrio")
    return written.gis(path, grid, epsg, driver=GIS[name])


def in_metres(parts, position):
    """The union of parts of (longitude, latitude) rings in a frame at the place."""
    lat, lon, _ = written.POSITIONS[position]
    frame = LocalFrame(lat, lon, 0.0)

    def ring(corners):
        corners = np.asarray(corners, dtype=float)
        assert np.abs(corners[:, 0]).max() <= 180.0
        return frame.enu_from_geodetic(corners[:, 1], corners[:, 0], 0.0)[:, :2]

    return shapely.union_all([shapely.Polygon(ring(r[0]), [ring(hole) for hole in r[1:]]) for r in parts])


def rings(part):
    return [list(part.exterior.coords), *[list(hole.coords) for hole in part.interiors]]


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32),
    position=st.sampled_from(sorted(written.POSITIONS)),
    form=st.sampled_from(["geojson", "wkt", "kml", "kmz", "plan", "poly", *GIS]),
    parts=st.integers(1, 3),
    holes=st.integers(0, 2),
)
def test_what_is_written_is_read(tmp_path_factory, seed, position, form, parts, holes):
    parts, holes = (1 if form == "poly" else parts), (0 if form in ("poly", "plan") else holes)
    geographic, grid, epsg = written.at_position(written.drawn_parts(seed, parts, holes), position)
    path = write(tmp_path_factory.mktemp("area"), form, geographic, grid, epsg)
    found = read_area(AreaQuery(source=str(path)))
    assert found.is_file
    assert not found.notes
    assert len(found.parts) == parts
    assert sum(len(rings) - 1 for rings in found.parts) == parts * holes
    truth, read = in_metres([rings(part) for part in geographic], position), in_metres(found.parts, position)
    # A Swiss place goes through a datum shift of metres and back; the others keep every corner within a millimetre.
    assert truth.symmetric_difference(read).area < truth.length * (2.0 if epsg == 2056 else 1e-3)


@pytest.mark.parametrize("position", sorted(written.POSITIONS))
def test_one_feature_by_name_or_number(tmp_path, position):
    geographic, _, _ = written.at_position(written.drawn_parts(7, 3, 1), position)
    for path in (written.geojson(tmp_path / "a.geojson", geographic), written.kml(tmp_path / "a.kml", geographic)):
        second = read_area(AreaQuery(source=str(path), feature="2"))
        assert second == read_area(AreaQuery(source=str(path), feature="FIELD 2"))
        assert second.name == "field 2"
        truth = in_metres([rings(geographic[1])], position)
        assert in_metres(second.parts, position).symmetric_difference(truth).area < 1e-3


def test_folders_of_kml_and_layers_of_a_geopackage_are_layers(tmp_path):
    one, _, _ = written.at_position(written.drawn_parts(1, 1, 0), "Tennessee")
    two, _, _ = written.at_position(written.drawn_parts(2, 2, 0), "Tennessee")
    text = written.kml_text(one, folder="north")
    inside = written.kml_text(two, folder="south").partition("<name>a map</name>")[2].partition("</Document>")[0]
    (tmp_path / "a.kml").write_text(text.replace("</Document>", inside + "</Document>"), encoding="utf-8")
    assert len(read_area(AreaQuery(source="a.kml", layer="South"), folder=tmp_path).parts) == 2
    pytest.importorskip("pyogrio")
    written.gis(tmp_path / "a.gpkg", one, 4326, driver="GPKG", layer="north")
    import pyogrio

    pyogrio.raw.write(
        str(tmp_path / "a.gpkg"), geometry=shapely.to_wkb(np.array(two, dtype=object)), crs="EPSG:4326",
        geometry_type="Polygon", fields=[], field_data=[], driver="GPKG", layer="south", append=True,
    )  # fmt: skip
    assert len(read_area(AreaQuery(source="a.gpkg", layer="SOUTH"), folder=tmp_path).parts) == 2


def test_geojson_that_was_cut_at_180_degrees_is_one_polygon(tmp_path):
    west = shapely.box(179.99, -16.81, 180.0, -16.80)
    east = shapely.box(-180.0, -16.81, -179.99, -16.80)
    path = written.geojson(tmp_path / "a.geojson", [shapely.MultiPolygon([west, east])])
    (part,) = read_area(AreaQuery(source=str(path))).parts
    assert {lon for lon, _ in part[0]} >= {179.99, -179.99}
    assert in_metres([part], "across 180 degrees").area == pytest.approx(0.02 * 0.01 * 111_320.0**2 * 0.957, rel=0.01)


def test_rings_keep_every_bit_without_a_change_of_system(tmp_path):
    geographic, _, _ = written.at_position(written.drawn_parts(3, 1, 2), "Tennessee")
    path = written.geojson(tmp_path / "a.geojson", geographic)
    (part,) = read_area(AreaQuery(source=str(path))).parts
    assert [list(ring) for ring in part] == rings(geographic[0])


def test_a_plan_without_surveys_gives_its_fence(tmp_path):
    outer = shapely.box(8.0, 46.5, 8.02, 46.52)
    hole = shapely.box(8.005, 46.505, 8.01, 46.51)
    path = written.plan(
        tmp_path / "a.plan", fence=[(True, outer.exterior.coords), (False, hole.exterior.coords)],
    )  # fmt: skip
    (part,) = read_area(AreaQuery(source=str(path))).parts
    assert shapely.Polygon(part[0], part[1:]).equals(outer.difference(hole))
    path = written.plan(tmp_path / "b.plan", circles=[(46.5, 8.0, 300.0)])
    (part,) = read_area(AreaQuery(source=str(path))).parts
    assert _size_m2(part) == pytest.approx(math.pi * 300.0**2, rel=0.003)


def _size_m2(part):
    return abs(Geod(ellps="WGS84").geometry_area_perimeter(shapely.Polygon(part[0], part[1:]))[0])


@pytest.mark.parametrize("text", ["8.0,46.5,8.02,46.52", "bbox:8.0,46.5,8.02,46.52", "BOX: 8.0, 46.5, 8.02, 46.52"])
def test_a_box(text):
    assert is_area_text(text)
    (part,) = read_area(AreaQuery(source=text)).parts
    assert shapely.Polygon(part[0]).equals(shapely.box(8.0, 46.5, 8.02, 46.52))


def test_a_box_across_180_degrees():
    (part,) = read_area(AreaQuery(source="179.99,-16.81,-179.99,-16.80")).parts
    assert in_metres([part], "across 180 degrees").area == pytest.approx(0.02 * 0.01 * 111_320.0**2 * 0.957, rel=0.01)


@pytest.mark.parametrize("text", ["46.5,8.0,300", "46.5,8.0,300m", "circle:46.5,8.0,0.3km", "circle: 46.5, 8, 300 m"])
def test_a_point_and_a_radius(text):
    (part,) = read_area(AreaQuery(source=text)).parts
    assert _size_m2(part) == pytest.approx(math.pi * 300.0**2, rel=0.003)
    lons, lats = np.array(part[0]).T
    _, _, metres = Geod(ellps="WGS84").inv(np.full_like(lons, 8.0), np.full_like(lats, 46.5), lons, lats)
    assert np.allclose(metres, 300.0, atol=1e-6)


def test_wkt_as_an_argument():
    text = "MULTIPOLYGON (((8 46, 8.01 46, 8.01 46.01, 8 46)), ((9 46, 9.01 46, 9.01 46.01, 9 46)))"
    assert is_area_file(text)
    assert len(read_area(AreaQuery(source=text)).parts) == 2


@pytest.mark.parametrize("source", ["survey.toml", "jacksboro", "area,1.toml", "run-2"])
def test_a_scenario_is_no_area(source):
    assert not is_area_file(source)


def test_swapped_axes_and_a_system_that_is_told(tmp_path):
    geographic, grid, epsg = written.at_position(written.drawn_parts(5, 1, 1), "southern hemisphere")
    right = in_metres([rings(geographic[0])], "southern hemisphere")
    swapped = [shapely.transform(part, lambda p: p[:, ::-1]) for part in geographic]
    path = written.geojson(tmp_path / "a.geojson", swapped)
    found = read_area(AreaQuery(source=str(path), swap_axes=True))
    assert in_metres(found.parts, "southern hemisphere").symmetric_difference(right).area < 1.0
    path = written.geojson(tmp_path / "b.geojson", grid)
    found = read_area(AreaQuery(source=str(path), crs=f"EPSG:{epsg}"))
    assert in_metres(found.parts, "southern hemisphere").symmetric_difference(right).area < 1.0


def test_an_area_in_place_of_a_scenario_is_told_the_way(tmp_path):
    with pytest.raises(
        ScenarioError, match=r"this is an area, not a scenario; create a scenario with: uavcover new .*"
    ):
        load_scenario(tmp_path / "a.kml")


BOW_TIE = [[8.0, 46.5], [8.02, 46.52], [8.02, 46.5], [8.0, 46.52], [8.0, 46.5]]


def test_a_crossing_outline_is_mended_when_that_is_asked_for(tmp_path):
    path = tmp_path / "a.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [BOW_TIE]}), encoding="utf-8")
    found = read_area(AreaQuery(source=str(path), make_valid=True))
    assert len(found.parts) == 2
    assert all(shapely.Polygon(part[0]).is_valid for part in found.parts)


def _ring(draw, *, within):
    """A closed ring of three to seven corners on a coarse grid: it often crosses itself and shares edges with others."""
    corner = st.tuples(st.integers(0, within), st.integers(0, within))
    ring = draw(st.lists(corner, min_size=3, max_size=7, unique=True))
    return [*ring, ring[0]]


@st.composite
def drawn_rings(draw):
    return [_ring(draw, within=10), *[_ring(draw, within=10) for _ in range(draw(st.integers(0, 3)))]]


@settings(max_examples=200, deadline=None)
@given(drawn_rings())
def test_mended_area_is_the_outline_without_any_hole(drawn):
    """No place of a hole is in the area, and no other place of the outline is lost (places on edges are left aside)."""
    outer, *holes = ([(8.0 + 1e-3 * x, 46.0 + 1e-3 * y) for x, y in ring] for ring in drawn)
    source = shapely.Polygon(outer, holes).wkt
    try:
        found = read_area(AreaQuery(source=source, make_valid=True))
    except InputError as error:
        if not re.search("the holes cover the whole area|on one line|square metres", str(error)):
            raise
        found = None
    mended = shapely.union_all([shapely.Polygon(r[0], r[1:]) for r in found.parts]) if found else shapely.Polygon()
    positions = shapely.points(
        [(8.0 + 1e-3 * (x + 0.31), 46.0 + 1e-3 * (y + 0.37)) for x in range(10) for y in range(10)]
    )
    lines = shapely.union_all([shapely.LineString(ring) for ring in (outer, *holes)])

    def enclosed(ring, position):
        """By the winding number: independent of any library's idea of a valid ring."""
        turns = [math.atan2(y - position.y, x - position.x) for x, y in ring]
        steps = [math.remainder(b - a, 2.0 * math.pi) for a, b in pairwise(turns)]
        return round(sum(steps) / (2.0 * math.pi)) != 0

    def crossings(ring, position):
        """By the number of crossings, which counts a part that a ring encloses twice in both directions."""
        hits = [
            (y0 > position.y) != (y1 > position.y) and position.x < x0 + (position.y - y0) / (y1 - y0) * (x1 - x0)
            for (x0, y0), (x1, y1) in pairwise(ring)
        ]
        return sum(hits) % 2 == 1

    for position in positions:
        if lines.distance(position) < 1e-5:
            continue
        in_hole = any(enclosed(hole, position) or crossings(hole, position) for hole in holes)
        in_outline = enclosed(outer, position) or crossings(outer, position)
        assert mended.covers(position) == (in_outline and not in_hole), (source, position.wkt)


def test_a_scenario_names_such_a_file_and_is_whole_without_it(tmp_path):
    geographic, _, _ = written.at_position(written.drawn_parts(9, 2, 1), "Tennessee")
    (tmp_path / "sub").mkdir()
    written.kml(tmp_path / "sub" / "area.kml", geographic)
    text = survey_text('file = "sub/area.kml"\nfeature = "field 2"', '"bundled:jacksboro.tif"', (36.48, -84.22))
    scenario = parse_scenario(text, source="a.toml", folder=tmp_path)
    truth = in_metres([rings(geographic[1])], "Tennessee")
    assert in_metres(scenario.area.parts, "Tennessee").symmetric_difference(truth).area < 1e-3
    assert scenario.area.file is None
    assert parse_scenario(dump_scenario(scenario), source="a.toml", folder=tmp_path / "elsewhere") == scenario


def test_a_poly_file_of_openstreetmaps_tools(tmp_path):
    """Osmosis and Geofabrik: longitude first, sections with END, holes with an exclamation mark; rings closed or not."""
    squares = {"1": (8.0, 46.0, 1.0), "!2": (8.4, 46.4, 0.2), "island": (12.0, 47.0, 0.5)}
    text = "somewhere\n"
    for name, (lon, lat, side) in squares.items():
        ring = [(lon, lat), (lon + side, lat), (lon + side, lat + side), (lon, lat + side)]
        ring += ring[:1] if name == "1" else []
        text += f"{name}\n" + "".join(f"   {x:.7E}   {y:.7E}\n" for x, y in ring) + "END\n"
    (tmp_path / "a.poly").write_text(text + "END\n")
    area = read_area(AreaQuery(source="a.poly"), folder=tmp_path)
    assert area.name == "somewhere"
    found = [shapely.Polygon(rings[0], rings[1:]) for rings in area.parts]
    assert [part.bounds for part in found] == [(8.0, 46.0, 9.0, 47.0), (12.0, 47.0, 12.5, 47.5)]
    assert [round(part.area, 9) for part in found] == [0.96, 0.25]
