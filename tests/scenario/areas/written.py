"""Areas written in every format the reader knows, by shapely, json, zipfile and pyogrio."""

import json
import math
import zipfile

import numpy as np
import shapely
from pyproj import CRS, Transformer

POSITIONS = {
    "Alps, a valley at 2,500 m": (46.55, 8.03, 32632),
    "Swiss grid": (46.55, 8.03, 2056),
    "Tennessee": (36.48, -84.22, 32616),
    "southern hemisphere": (-33.45, -70.62, 32719),
    "across 180 degrees": (-16.80, 179.9999, 32760),
    "77 degrees south": (-77.52, 166.60, 3031),
    "78 degrees north": (78.22, 15.60, 32633),
    "on the equator and Greenwich": (0.0, 0.0, 32631),
}
"""Latitude, longitude, and a projected system there."""


def star(rng, *, corners, size, centre=(0.0, 0.0)):
    """A ring that does not cross itself: corners at rising angles around a centre, metres."""
    # Angles at least 0.3 of a step apart, so that no corner falls on another.
    angles = 2.0 * math.pi * (np.arange(corners) + rng.uniform(0.0, 0.7, corners)) / corners
    radii = size * rng.uniform(0.5, 1.0, corners)
    return np.column_stack([centre[0] + radii * np.cos(angles), centre[1] + radii * np.sin(angles)])


def drawn_parts(seed, parts, holes):
    """Polygons with holes in metres, side by side."""
    rng = np.random.default_rng(seed)
    found = []
    for part in range(parts):
        centre = (1500.0 * part, 400.0 * part)
        outer = star(rng, corners=int(rng.integers(5, 12)), size=500.0, centre=centre)
        courts = [
            star(rng, corners=4, size=30.0, centre=(centre[0] + 70.0 * (k - 1), centre[1] + 40.0 * (k % 2)))
            for k in range(holes)
        ]
        found.append(shapely.Polygon(outer, courts))
    return found


def at_position(parts, position):
    """The same in longitude and latitude, and in the projected system of the place; longitudes within 180 degrees."""
    lat, lon, epsg = POSITIONS[position]
    local = CRS.from_proj4(f"+proj=aeqd +lat_0={lat} +lon_0={lon} +datum=WGS84")
    to_degrees = Transformer.from_crs(local, 4326, always_xy=True)
    to_grid = Transformer.from_crs(4326, epsg, always_xy=True)

    def degrees(points):
        return np.column_stack(to_degrees.transform(points[:, 0], points[:, 1]))

    def grid(points):
        return np.column_stack(to_grid.transform(points[:, 0], points[:, 1]))

    geographic = [shapely.transform(part, degrees) for part in parts]
    return geographic, [shapely.transform(part, grid) for part in geographic], epsg


def features(parts):
    return [
        {"type": "Feature", "properties": {"name": f"field {n}"}, "geometry": shapely.geometry.mapping(part)}
        for n, part in enumerate(parts, start=1)
    ]


def geojson(path, parts, epsg=None):
    document = {"type": "FeatureCollection", "features": features(parts)}
    if epsg is not None:
        document["crs"] = {"type": "name", "properties": {"name": f"urn:ogc:def:crs:EPSG::{epsg}"}}
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def kml_text(parts, *, folder=None):
    def ring(tag, coords):
        text = " ".join(f"{x!r},{y!r},0" for x, y in np.asarray(coords).tolist())
        return f"<{tag}><LinearRing><coordinates>{text}</coordinates></LinearRing></{tag}>"

    marks = "".join(
        f"<Placemark><name>field {n}</name><Polygon>{ring('outerBoundaryIs', part.exterior.coords)}"
        f"{''.join(ring('innerBoundaryIs', hole.coords) for hole in part.interiors)}</Polygon></Placemark>"
        for n, part in enumerate(parts, start=1)
    )
    inside = marks if folder is None else f"<Folder><name>{folder}</name>{marks}</Folder>"
    return (
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><name>a map</name>'
        f"{inside}</Document></kml>"
    )


def kml(path, parts):
    path.write_text(kml_text(parts), encoding="utf-8")
    return path


def kmz(path, parts):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", kml_text(parts))
        archive.writestr("files/icon.png", b"\x89PNG")
    return path


def wkt(path, parts, epsg=None):
    shape = parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)
    prefix = "" if epsg is None else f"SRID={epsg};"
    path.write_text(prefix + shapely.to_wkt(shape, rounding_precision=-1), encoding="utf-8")
    return path


def gis(path, parts, epsg, *, driver, layer="fields"):
    import pyogrio

    pyogrio.raw.write(
        str(path), geometry=shapely.to_wkb(np.array(parts, dtype=object)), crs=f"EPSG:{epsg}", geometry_type="Polygon",
        fields=["name"], field_data=[np.array([f"field {n}" for n in range(1, len(parts) + 1)], dtype=object)],
        driver=driver, **({"layer": layer} if driver == "GPKG" else {}),
    )  # fmt: skip
    return path


def plan(path, *, surveys=(), fence=(), circles=()):
    """A .plan with rings of (longitude, latitude): surveys, and (inclusion, ring) of a fence."""

    def lat_lon(ring):
        return [[y, x] for x, y in list(ring)[:-1]]

    items = [
        {
            "type": "ComplexItem", "complexItemType": "survey", "version": 5, "polygon": lat_lon(ring),
            "TransectStyleComplexItem": {"Items": []},
        }
        for ring in surveys
    ]  # fmt: skip
    document = {
        "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
        "mission": {
            "version": 2, "items": items, "plannedHomePosition": [46.5, 8.0, 500.0], "firmwareType": 3, "vehicleType": 2,
            "cruiseSpeed": 15, "hoverSpeed": 5,
        },
        "geoFence": {
            "version": 2,
            "polygons": [{"inclusion": inside, "polygon": lat_lon(ring), "version": 1} for inside, ring in fence],
            "circles": [
                {"inclusion": True, "circle": {"center": [lat, lon], "radius": radius}, "version": 1}
                for lat, lon, radius in circles
            ],
        },
        "rallyPoints": {"version": 2, "points": []},
    }  # fmt: skip
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def poly(path, ring):
    lines = ["#saved by a test", *(f"{y!r} {x!r}" for x, y in np.asarray(ring).tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
