"""Files of zones in every format: what is read, what is left out, and one line for what cannot be."""

import json
import re

import pytest
import shapely

from mission_io.errors import FormatError
from uavcover.errors import InputError
from uavcover.model.limits import NoFly
from uavcover.scenario.airspace.zone_file import _of_text, read_zones

RING = [[8.0, 46.5], [8.02, 46.5], [8.02, 46.52], [8.0, 46.52], [8.0, 46.5]]
OPEN = tuple((lon, lat) for lon, lat in RING[:-1])
NEAR = (8.0, 46.5, 8.02, 46.52)


def zones_of(tmp_path, name, text, near=NEAR, **keys):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_zones(NoFly(file=str(path), **keys), near=near)


def geojson(*features):
    return json.dumps({"type": "FeatureCollection", "features": list(features)})


def feature(geometry=None, **properties):
    geometry = geometry or {"type": "Polygon", "coordinates": [RING]}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def ed269(*volumes, **about):
    reported = {"identifier": "CHE-1", "country": "CHE", "name": "Airport", "restriction": "REQ_AUTHORISATION", **about}
    return {**reported, "geometry": list(volumes)}


def volume(shape=None, **heights):
    shape = shape or {"type": "Polygon", "coordinates": [RING]}
    return {
        "uomDimensions": "M",
        "lowerLimit": 0,
        "lowerVerticalReference": "AGL",
        **heights,
        "horizontalProjection": shape,
    }


def test_geojson_with_heights_of_its_own_and_of_the_entry(tmp_path):
    text = geojson(feature(name="a", floor_agl_m=50, ceiling_amsl_m=900.5), feature(name="b"))
    (a, b), notes = zones_of(tmp_path, "z.geojson", text, floor_agl_m=10.0, margin_m=3.0)
    assert (a.name, a.floor_agl_m, a.ceiling_amsl_m, a.margin_m) == ("a", 50.0, 900.5, 3.0)
    assert (b.name, b.floor_agl_m, b.ceiling_amsl_m) == ("b", 10.0, None)
    assert a.polygons_lon_lat_deg == ((OPEN,),)
    assert notes == ()


TEXTS = {
    ".geojson": json.dumps({"type": "Polygon", "coordinates": [RING]}),
    ".wkt": shapely.Polygon(RING).wkt,
    ".kml": "<kml><Placemark><name>north</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
    + " ".join(f"{lon},{lat},0" for lon, lat in RING)
    + "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>",
    ".poly": "# made\n" + "\n".join(f"{lat} {lon}" for lon, lat in RING),
}


@pytest.mark.parametrize("suffix", TEXTS)
def test_formats_of_areas(tmp_path, suffix):
    (zone,), _ = zones_of(tmp_path, f"z{suffix}", TEXTS[suffix])
    assert shapely.Polygon(zone.parts[0][0]).equals(shapely.Polygon(RING))


def test_a_plan_file_gives_its_exclusions(tmp_path):
    corners = [[lat, lon] for lon, lat in RING[:-1]]
    fence = {
        "version": 2,
        "polygons": [{"version": 1, "inclusion": inside, "polygon": corners} for inside in (True, False)],
        "circles": [{"version": 1, "inclusion": False, "circle": {"center": [46.51, 8.01], "radius": 120.0}}],
    }
    mission = {"version": 2, "firmwareType": 3, "vehicleType": 2, "cruiseSpeed": 10, "hoverSpeed": 5, "items": [],
               "plannedHomePosition": [46.5, 8.0, 500]}  # fmt: skip
    document = {"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "geoFence": fence, "mission": mission,
                "rallyPoints": {"version": 2, "points": []}}  # fmt: skip
    (polygon, circle), _ = zones_of(tmp_path, "z.plan", json.dumps(document))
    assert polygon.polygons_lon_lat_deg == ((OPEN,),)
    assert (circle.center_lon_lat_deg, circle.radius_m) == ((8.01, 46.51), 120.0)


def test_ed269(tmp_path):
    circle = {"type": "Circle", "center": [8.01, 46.51], "radius": 1000}
    features = [
        ed269(
            volume(upperLimit=120, upperVerticalReference="AGL"),
            volume(circle, uomDimensions="FT", lowerLimit=1000, lowerVerticalReference="AMSL"),
            applicability=[
                {"permanent": "NO", "startDateTime": "2026-06-01T06:00:00Z", "endDateTime": "2026-06-02T06:00:00Z"}
            ],
        ),
        ed269(volume(), identifier="CHE-2", name="open", restriction="NO_RESTRICTION"),
        ed269(volume(), identifier="CHE-3", name="prison", restriction="PROHIBITED"),
    ]
    text = json.dumps({"title": "zones", "features": features})
    (a, b, c), notes = zones_of(tmp_path, "z.json", text)
    assert (a.name, a.ceiling_agl_m, a.floor_agl_m, a.from_utc, a.until_utc) == (
        "Airport", 120.0, None, "2026-06-01T06:00:00Z", "2026-06-02T06:00:00Z",
    )  # fmt: skip
    assert b.floor_amsl_m == pytest.approx(304.8)
    assert b.radius_m == pytest.approx(304.8)
    assert c.name == "prison"
    assert notes == ("z.json: ignored 1 zone of type NO_RESTRICTION",)
    (left,), _ = zones_of(tmp_path, "z.json", text, ignore=("Airport",))
    assert left.name == "prison"
    (left,), _ = zones_of(tmp_path, "z.json", text, ignore=("CHE-1",))
    assert left.name == "prison"
    (whole,), _ = zones_of(tmp_path, "list.json", json.dumps([features[2]]))
    assert whole.name == "prison"


def test_ed318(tmp_path):
    layer = {"upper": 400, "upperReference": "AGL", "lower": 0, "lowerReference": "AGL", "uom": "ft"}
    shapes = {
        "type": "GeometryCollection",
        "geometries": [
            {"type": "Polygon", "coordinates": [RING], "layer": layer},
            {
                "type": "Point",
                "coordinates": [8.01, 46.51],
                "extent": {"subType": "Circle", "radius": 250.0},
                "layer": layer,
            },
        ],
    }
    text = geojson(
        feature(shapes, identifier="A1", name=[{"text": "Hospital", "lang": "en-GB"}], type="REQ_AUTHORIZATION"),
        feature({"type": "Polygon", "coordinates": [RING], "layer": layer}, identifier="A2", type="NO_RESTRICTION"),
    )
    (polygon, circle), notes = zones_of(tmp_path, "z.json", text)
    assert (polygon.name, polygon.ceiling_agl_m) == ("Hospital", pytest.approx(121.92))
    assert (circle.center_lon_lat_deg, circle.radius_m) == ((8.01, 46.51), 250.0)
    assert len(notes) == 1


def test_zones_far_away_are_left_out_and_told(tmp_path):
    far = [[lon + 1.0, lat] for lon, lat in RING]
    text = geojson(feature(name="a"), feature({"type": "Polygon", "coordinates": [far]}, name="b"))
    (a,), notes = zones_of(tmp_path, "z.geojson", text)
    assert a.name == "a"
    assert notes == ("z.geojson: ignored 1 of 2 zones, because they are more than 20 km away",)
    assert len(zones_of(tmp_path, "z.geojson", text, near=None)[0]) == 2


@pytest.mark.parametrize("near", [(179.99, -17.1, 180.01, -17.0), (-180.01, -17.1, -179.99, -17.0)])
@pytest.mark.parametrize("lon", [179.995, -179.995])
def test_near_across_180(tmp_path, near, lon):
    ring = [[lon, -17.05], [lon + 0.004, -17.05], [lon + 0.004, -17.04], [lon, -17.05]]
    assert (
        len(zones_of(tmp_path, "z.geojson", geojson(feature({"type": "Polygon", "coordinates": [ring]})), near=near)[0])
        == 1
    )


def test_a_zone_across_180_is_one(tmp_path):
    ring = [[179.99, -17.05], [-179.99, -17.05], [-179.99, -17.04], [179.99, -17.04], [179.99, -17.05]]
    text = geojson(feature({"type": "Polygon", "coordinates": [ring]}))
    (zone,), _ = zones_of(tmp_path, "z.geojson", text, near=(179.9, -17.1, 180.1, -17.0))
    assert [abs(lon) for lon, _ in zone.parts[0][0]] == pytest.approx([179.99] * 4)


BOW_TIE = [[8.0, 46.5], [8.02, 46.52], [8.02, 46.5], [8.0, 46.52], [8.0, 46.5]]
BAD = {
    "no such file": (None, "", "no such file; use one of"),
    "another format": ("z.csv", "a", ".csv is not a supported zone format"),
    "empty": ("z.txt", "", "the file is empty"),
    "a text of somebody": ("z.txt", "Dear Sir", "not an OpenAir file"),
    "no JSON": ("z.json", "{", "cannot read the file as JSON"),
    "bytes": ("z.air", b"\xff\xfe\x00\x01", "z.air"),
    "crosses itself": (
        "z.geojson", geojson(feature({"type": "Polygon", "coordinates": [BOW_TIE]}, name="bow")),
        "zone 1 (bow): the outline crosses itself at longitude 8.010000",
    ),
    "OpenAir that crosses itself": (
        "z.txt", "AC R\nAN bow\n" + "".join(f"DP {lat:.2f} N {lon:.2f} E\n" for lon, lat in BOW_TIE),
        "zone 1 (bow): the outline crosses itself",
    ),
    "a height in words": ("z.geojson", geojson(feature(floor_agl_m="high")), 'must be a number of metres, not "high"'),
    "upside down": ("z.geojson", geojson(feature(floor_agl_m=90, ceiling_agl_m=30)), "ceiling_agl_m: must be greater"),
    "lines": ("z.geojson", geojson(feature({"type": "LineString", "coordinates": RING})), "no polygons (only 1 LineString)"),
    "no zone": ("z.geojson", geojson(), "contains no polygons"),
    "ED-269 in leagues": ("z.json", json.dumps({"features": [ed269(volume(uomDimensions="LG"))]}), "not a supported unit"),
    "ED-269 above the ellipsoid": (
        "z.json", json.dumps({"features": [ed269(volume(lowerLimit=5, lowerVerticalReference="WGS84"))]}),
        "'WGS84' is not a supported height reference",
    ),
    "ED-269 without a shape": (
        "z.json", json.dumps({"features": [{"name": "a", "geometry": [{"uomDimensions": "M"}]}]}), "Projection: the key is",
    ),
    "ED-269 of an ellipse": ("z.json", json.dumps({"features": [ed269(volume({"type": "Ellipse"}))]}), "is "
    "not a supported shape"),
    "a radius below 0": (
        "z.json", json.dumps({"features": [ed269(volume({"type": "Circle", "center": [8, 46.5], "radius": -5}))]}), "radius must",
    ),
    "a time that is none": (
        "z.json", json.dumps({"features": [ed269(volume(), applicability=[{"startDateTime": "soon"}])]}), "is not a valid time",
    ),
    "a centre at the pole's other side": (
        "z.json", json.dumps({"features": [ed269(volume({"type": "Circle", "center": [46.5, 98.0], "radius": 5}))]}),
        "is not a longitude and latitude",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_one_line(tmp_path, case):
    name, text, message = BAD[case]
    if name is not None:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as error:
        read_zones(NoFly(file=str(tmp_path / (name or "missing.txt"))), near=NEAR)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert (name or "missing.txt") in str(error.value)


def test_a_name_to_ignore_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="ignore names the zone 'X', which is not in the file; write the name"):
        zones_of(tmp_path, "z.geojson", geojson(feature(name="a")), ignore=("X",))


def test_a_broken_zone_far_away_is_nobodys_concern(tmp_path):
    far = [[lon + 3.0, lat] for lon, lat in BOW_TIE]
    text = geojson(feature(name="a"), feature({"type": "Polygon", "coordinates": [far]}, name="b"))
    (a,), notes = zones_of(tmp_path, "z.geojson", text)
    assert a.name == "a"
    assert "ignored 1 of 2 zones, because they are more than 20 km away" in notes[0]


def test_a_file_of_another_place_asks(tmp_path):
    swapped = [[lat, lon] for lon, lat in RING]
    zones, (note,) = zones_of(tmp_path, "z.geojson", geojson(feature({"type": "Polygon", "coordinates": [swapped]})))
    assert zones == ()
    assert "are longitude and latitude swapped" in note


def test_zones_can_be_mended(tmp_path):
    text = geojson(feature({"type": "Polygon", "coordinates": [BOW_TIE]}, name="bow"))
    with pytest.raises(InputError, match="set make_valid = true"):
        zones_of(tmp_path, "z.geojson", text)
    (zone,), notes = zones_of(tmp_path, "z.geojson", text, make_valid=True)
    assert len(zone.parts) == 2
    assert zone.make_valid is False
    assert re.search(r"zone 1 \(bow\): repaired with make_valid \(.* ha before, 170.6 ha after\)", notes[0])


def test_a_mended_zone_keeps_its_holes_and_nothing_else_open(tmp_path):
    holes = [[[8.0, y], [8.004, y], [8.004, y + 0.006], [8.0, y + 0.006], [8.0, y]] for y in (46.504, 46.508)]
    text = geojson(feature({"type": "Polygon", "coordinates": [RING, *holes]}, name="a"))
    (zone,), _ = zones_of(tmp_path, "z.geojson", text, make_valid=True)
    repairs = shapely.union_all([shapely.Polygon(rings[0], rings[1:]) for rings in zone.parts])
    assert repairs.area == pytest.approx(0.02 * 0.02 - 0.004 * 0.010)


def test_fuzzed_zones_are_one_short_line(tmp_path):
    layer = {"type": "Polygon", "coordinates": [RING], "layer": [1, 2]}
    with pytest.raises(InputError, match="layer: expected an object"):
        zones_of(tmp_path, "z.json", geojson(feature(layer, name="a")))
    with pytest.raises(FormatError) as refused:
        _of_text(json.dumps({"features": [ed269(volume({"type": "Poly\ngon"}))]}), ".json")
    assert "\n" not in str(refused.value)
    long = {"type": "Polygon", "coordinates": [RING], "layer": {"upper": 1, "upperReference": "M" * 5000}}
    with pytest.raises(InputError) as error:
        zones_of(tmp_path, "z.json", geojson(feature(long, name="a\nb" * 5000)))
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 500 + len(str(tmp_path))
