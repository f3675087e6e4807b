"""Bad inputs of `uavcover new`: what is given, and what the one line of its error has to say.

docs/results/kinds.md shows the lines (scripts/bad_inputs.py).
"""

from pathlib import Path

import numpy as np
import rasterio
import shapely
from rasterio.crs import CRS
from rasterio.transform import Affine

from tests.scenario.areas import written
from tests.scenario.areas.test_bad_areas import TEXTS
from tests.terrain.dem_files import write_dem

SIZE_M = 400.0
# Latitude, longitude, system and pixels of the elevation model, ground at 0 in metres above sea level.
POSITIONS = {
    "Alps, UTM, 2,500 m": (46.55, 8.03, 32632, 10.0, 1900.0),
    "Alps, the Swiss grid": (46.55, 8.03, 2056, 10.0, 1000.0),
    "Tennessee, one arc second": (36.48, -84.22, 4326, 30.0, 0.0),
    "southern hemisphere, UTM": (-33.45, -70.62, 32719, 5.0, 0.0),
    "across 180 degrees": (-16.80, 180.0, 32760, 10.0, -300.0),
    "77 degrees south": (-77.52, 166.60, 3031, 10.0, -300.0),
    "78 degrees north, degrees": (78.22, 15.60, 4326, 30.0, -400.0),
}


def square_parts(position, hole=True):
    """A square of SIZE_M with a hole, in longitude and latitude."""
    lat, lon = POSITIONS[position][:2]
    half = 0.5 * SIZE_M / 111_195.0
    across = half / np.cos(np.radians(lat))
    inner = [(lon + 0.3 * x * across, lat + 0.3 * y * half) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    outer = [(lon + x * across, lat + y * half) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    wrapped = [[(x - 360.0 if x > 180.0 else x, y) for x, y in ring] for ring in (outer, inner)]
    return [shapely.Polygon(wrapped[0], [wrapped[1]] if hole else [])]


def dem_at(folder, position, *, steepest=0.35):
    lat, lon, epsg, pixel_m, level_m = POSITIONS[position]
    lon = 179.95 if lon == 180.0 and epsg == 4326 else lon
    path = write_dem(
        folder / "dem.tif", np.random.default_rng(3), lat_deg=lat, lon_deg=lon, epsg=epsg, pixel_m=pixel_m, size_m=1600.0,
        steepest=steepest,
    )  # fmt: skip
    with rasterio.open(path, "r+") as file:
        file.write(file.read(1) + np.float32(level_m), 1)
    return path


def options(dem, *, camera="dji-m3e", gsd="3cm"):
    return ("--dem", dem, "--camera", camera, "--gsd", gsd)


AT = "Tennessee, one arc second"

BAD = {
    "nothing": ((), "specify an area, such as area.kml"),
    "no options": (("AREA",), "an area also requires --dem dem.tif, --camera NAME, --gsd 2.5cm (to show"),
    "no camera": (("AREA", "--dem", "DEM"), "an area also requires --camera NAME, --gsd 2.5cm (to show"),
    "no such area": (("nowhere.kml", "OPTIONS"), "no such file; an area is a file"),
    "not an area": (("DEM", "OPTIONS"), ".tif is not a supported area format"),
    "no such model": (
        ("AREA", "--dem", "no.tif", "--camera", "m3e", "--gsd", "3cm"),
        "no.tif: no such file; specify elevation data",
    ),
    "a model that is none": (
        ("AREA", "--dem", "AREA", "--camera", "m3e", "--gsd", "3cm"),
        "the file cannot be read as elevation data",
    ),
    "a picture": (
        ("AREA", "--dem", "PICTURE", "--camera", "m3e", "--gsd", "3cm"),
        "is an image (3 bands of 8 bits), not elevation data",
    ),
    "camera": (("AREA", "--dem", "DEM", "--camera", "dji-m33e", "--gsd", "3cm"), "did you mean dji-m3e"),
    "gsd without unit": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "3"), "has no unit; write it as 2.5cm"),
    "gsd": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "fine"), "is not a valid quantity; write it as 2.5cm"),
    "gsd too fine": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "1mm"), "use 0.67 cm or more"),
    "overlap": (("AREA", "OPTIONS", "--overlap", "0.75/0.7"), "must be in percent, such as 75/70"),
    "overlap of everything": (("AREA", "OPTIONS", "--overlap", "100/70"), "between 0 and 95 percent"),
    "too much overlap": (
        ("AREA", "--dem", "DEM", "--camera", "mini 3 pro", "--gsd", "1cm", "--overlap", "95/70"),
        "use less forward overlap, a coarser --gsd",
    ),
    "battery": (("AREA", "OPTIONS", "--battery", "25"), "has no unit; write it as 25min"),
    "negative battery": (("AREA", "OPTIONS", "--battery", "-5min"), "must be greater than 0"),
    "vehicle": (("AREA", "OPTIONS", "--vehicle", "dji"), "did you mean dji-m3e"),
    "home": (("AREA", "OPTIONS", "--home", "here"), "write it as LAT,LON in degrees"),
    "home swapped": (
        ("AREA", "OPTIONS", "--home", "-84.22,36.48"),
        "km; specify a closer position, with latitude first",
    ),
    "home elsewhere": (("AREA", "OPTIONS", "--home", "36.9,-84.22"), "km from the area; the limit is"),
    "max height": (("AREA", "OPTIONS", "--max-height", "10m"), "leaves no room for a height band"),
    "speed": (("AREA", "OPTIONS", "--speed", "fast"), "write it as 8m/s"),
    "speed beyond the vehicle": (
        ("AREA", "OPTIONS", "--vehicle", "px4", "--speed", "50km/h"),
        "exceeds the maximum of px4, 12 m/s",
    ),
    "margin": (("AREA", "OPTIONS", "--margin", "some"), "write it as 40m"),
    "mount": (("AREA", "OPTIONS", "--mount", "loose"), "must be stabilised (a gimbal) or fixed"),
    "datum": (("AREA", "OPTIONS", "--vertical-datum", "NN"), "must be EGM96 (SRTM), EGM2008 (Copernicus) or ellipsoid"),
    "autopilot": (("AREA", "OPTIONS", "--autopilot", "dji"), "must be ardupilot or px4"),
    "height unit": (("AREA", "OPTIONS", "--height-unit", "yard"), "use m, dm, cm, ft or us-ft"),
    "band": (("AREA", "OPTIONS", "--band", "7"), "has no band '7'; set terrain.band to one of: 1"),
    "lakes": (("AREA", "OPTIONS", "--fill-lakes", "all"), "write it as 200m"),
    "no tiles": (("AREA", "--dem", "none/*.hgt", "--camera", "m3e", "--gsd", "3cm"), "none/*.hgt contains no tile"),
    "pattern": (("AREA", "OPTIONS", "--pattern", "grid"), "must be single, crosshatch or oblique"),
    "a fixed camera in an oblique set": (
        ("AREA", "OPTIONS", "--pattern", "oblique", "--mount", "fixed"),
        "use stabilised, or another --pattern",
    ),
    "feature": (("AREA", "OPTIONS", "--feature", "feild 1"), "did you mean 'field 1'?"),
    "layer": (("AREA", "OPTIONS", "--layer", "x"), "omit this option"),
    "crs": (("AREA", "OPTIONS", "--crs", "EPSG:x"), "use, for example, EPSG:32632"),
    "elsewhere": (("46.5,8.0,200", "OPTIONS"), "is outside the elevation data"),
    "beyond the model": (("36.48,-84.22,5km", "OPTIONS"), "the area reaches beyond the elevation data"),
    "too large": (("36.48,-84.22,40km", "OPTIONS"), "km by"),
    "swapped": (("SWAPPED", "OPTIONS"), "swapped axes; use --swap-axes"),
    "no folder": (("AREA", "OPTIONS", "-o", "no/where/a.toml"), "the folder"),
    "no scenario": (("AREA", "OPTIONS", "-o", "a.kml"), "is not a .toml file"),
    "unknown option": (("AREA", "OPTIONS", "--gds", "3"), "No such option"),
}

LONG = "x" * 5000
DEEP = "[" * 3000
DOOR = {
    "an empty layer": (("AREA", "OPTIONS", "--layer", ""), "--layer: the value is empty; specify a value"),
    "an empty battery": (("AREA", "OPTIONS", "--battery", " "), "--battery: the value is empty; specify a value"),
    "an empty surface model": (("AREA", "OPTIONS", "--dsm", ""), "--dsm: the value is empty; specify a value"),
    "an empty area": (("", "OPTIONS"), "area: the argument is empty; specify a file"),
    "gsd of Arabic digits and a unit": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "٣furlong"), "not a valid quantity"),
    "gsd with a comma": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "2,5cm"), "write it as 2.5cm"),
    "gsd that is not a number": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "nan"), "write it as 2.5cm"),
    "gsd of a kilometre": (("AREA", "--dem", "DEM", "--camera", "m3e", "--gsd", "1e9m"), "write it as 2.5cm"),
    "a long option": (("AREA", "OPTIONS", "--autopilot", LONG), "must be ardupilot or px4"),
    "control characters": (("\x1b[2J\x07.kml", "OPTIONS"), "?[2J?.kml: no such file"),
    "an overlap of three": (("AREA", "OPTIONS", "--overlap", "75/70/60"), "such as 75/70"),
    "an overlap that is not a number": (("AREA", "OPTIONS", "--overlap", "nan/nan"), "such as 75/70"),
    "home at the pole's far side": (("AREA", "OPTIONS", "--home", "91,0"), "--home: "),
    "home that is not a number": (("AREA", "OPTIONS", "--home", "nan,nan"), "--home: "),
    "home of three numbers": (("AREA", "OPTIONS", "--home", "36.4,-84.2,300"), "--home: "),
    "a code that is none": (("AREA", "OPTIONS", "--crs", "EPSG:99999999"), "use, for example, EPSG:32632"),
    "a code of the model that is none": (("AREA", "OPTIONS", "--dem-crs", "EPSG:99999999"), "EPSG:99999999"),
    "feature number 0": (("AREA", "OPTIONS", "--feature", "0"), "has no feature"),
    "feature number 99": (("AREA", "OPTIONS", "--feature", "99"), "has no feature"),
    "a time of flight": (("AREA", "OPTIONS", "--at", "tomorrow"), "not a valid flight time; write it as 2026-07-01T09"),
    "a time of flight without a zone": (("AREA", "OPTIONS", "--at", "2026-07-01T09:00"), "write it as 2026-07-01T09:00Z/2h"),
    "a flight that lands before it begins": (
        ("AREA", "OPTIONS", "--at", "2026-07-01T09:00Z/2026-07-01T08:00Z"), "the latest landing must be after",
    ),
    "zones of no file": (("AREA", "OPTIONS", "--no-fly", "nowhere.json"), "nowhere.json: no such file"),
    "zones of nothing": (("AREA", "OPTIONS", "--no-fly", "   "), "--no-fly: the value is empty; specify a value"),
    "zones in a model": (("AREA", "OPTIONS", "--no-fly", "DEM"), "is not a supported zone format"),
    "zones in a folder": (("AREA", "OPTIONS", "--no-fly", "FOLDER"), "is a folder"),
    "an area in a folder": (("FOLDER", "OPTIONS"), "is a folder; use one of"),
    "a model in an empty folder": (("AREA", "--dem", "FOLDER", "--camera", "m3e", "--gsd", "3cm"), "contains no tile"),
    "a camera in a folder": (("AREA", "--dem", "DEM", "--camera", "FOLDER", "--gsd", "3cm"), "--camera: "),
    "a box that is inside out": (("-84.21,36.49,-84.23,36.47", "OPTIONS"), "-84.21,36.49"),
    "a circle of nothing": (("36.48,-84.22,0", "OPTIONS"), "36.48,-84.22,0"),
    "a polygon of nothing": (("POLYGON EMPTY", "OPTIONS"), "contains no polygons (only 1 empty shape)"),
    "a polygon that is cut off": (("POLYGON ((-84.2 36.4, -84.1", "OPTIONS"), "not valid WKT"),
    "an option without a value": (("AREA", "OPTIONS", "--at"), "requires an argument"),
}  # fmt: skip
"""Options, files and areas of the kinds that fuzzing gave to `new` and `plan AREA`."""

_MODEL = ("AREA", "--dem", "MODEL", "--camera", "m3e", "--gsd", "3cm")
MODELS = {
    "a model without a system": ({"crs": None}, "specify it with terrain.crs (--dem-crs), such as EPSG:32632"),
    "a model in degrees called metres": ({"crs": "EPSG:32616"}, "seem to be in degrees instead of metres; assign the correct"),
    "a model of another sea level": ({"crs": "EPSG:4326+5703"}, "the file says NAVD88"),
    "a model above the ellipsoid": ({"crs": "EPSG:4979"}, "require the geoid grid us_nga_egm96_15.tif"),
    "a model in fathoms": ({"unit": "fathom"}, "heights are in 'fathom'; convert them to metres"),
    "no-data that is not declared": ({"hole": -32768.0}, "declare it as the no-data value of the file"),
    "a hole in the model": ({"hole": float("nan")}, "--fill-lakes"),
    "a model of a site grid": (
        {"crs": CRS.from_wkt('LOCAL_CS["site grid",UNIT["metre",1]]')}, "assign a known system, or convert the file",
    ),
    "a model that was cut off": ({"kept_bytes": 900}, "the file cannot be read as elevation data"),
    "an empty model": ({"kept_bytes": 0}, "the file is empty"),
}  # fmt: skip

_SURFACE = ("AREA", "OPTIONS", "--dsm", "SURFACE")
SURFACES = {
    "no such surface model": ({"missing": True}, "surface.tif: no such file; specify elevation data"),
    "a surface model that is the ground": ({"copied": True}, "is the same file as terrain.file"),
    "ground and surface swapped": ({"trees_m": -25.0}, "check that the files are not swapped"),
    "a surface model in feet": ({"factor": 1.0 / 0.3048}, "the surface seems to be in feet"),
    "a surface model above the ellipsoid": ({"shift_m": -31.0}, "vertical datums or units seem to differ"),
    "a surface model of a part": ({"until": 0.5}, "use a surface model that covers it, or omit --dsm"),
    "towers in the surface model": ({"trees_m": 90.0}, "use a coarser --gsd or a larger --max-height"),
    "a surface model that says another datum": ({"crs": "EPSG:4326+5703"}, "terrain.surface_vertical_datum: the scenario says"),
}  # fmt: skip


def prepare(folder: Path) -> None:
    """An elevation model and areas around 36.48 N, 84.22 W."""
    dem_at(folder, AT)
    parts = square_parts(AT)
    written.kml(folder / "area.kml", parts)
    written.geojson(folder / "area.geojson", parts)


def arguments_of(what: str, prepared: Path, folder: Path) -> tuple[list[object], str]:
    """The arguments of one bad input, whose own files are written into a folder, and words of its error."""
    if what in MODELS:
        change, words = MODELS[what]
        _write_model(prepared / "dem.tif", folder / "model.tif", **change)
        arguments: tuple[object, ...] = _MODEL
    elif what in SURFACES:
        change, words = SURFACES[what]
        _write_surface(prepared / "dem.tif", folder / "surface.tif", **change)
        arguments = _SURFACE
    elif what in TEXTS:
        name, text, words = TEXTS[what]
        (folder / name).write_text(text, encoding="utf-8")
        arguments = (name, "OPTIONS")
    else:
        arguments, words = (BAD | DOOR)[what]
    swapped = [shapely.transform(part, lambda p: p[:, ::-1]) for part in square_parts(AT)]
    if what == "swapped":
        # 36 degrees east of Greenwich and 84 degrees south is a place too: only the elevation model knows better.
        written.geojson(folder / "swapped.geojson", swapped)
    if what == "a picture":
        photo = np.zeros((3, 8, 8), dtype=np.uint8)
        with rasterio.open(
            folder / "photo.tif", "w", driver="GTiff", width=8, height=8, count=3, dtype="uint8", crs="EPSG:4326",
            transform=Affine(0.025, 0.0, -84.3, 0.0, -0.025, 36.6),
        ) as file:  # fmt: skip
            file.write(photo)
    names = {
        "AREA": (prepared / "area.kml",), "DEM": (prepared / "dem.tif",), "OPTIONS": options(prepared / "dem.tif"),
        "SWAPPED": (folder / "swapped.geojson",), "PICTURE": (folder / "photo.tif",), "MODEL": (folder / "model.tif",),
        "FOLDER": (_empty_folder(folder),),
        "SURFACE": ("surface.tif",) if what == "no such surface model" else (folder / "surface.tif",),
    }  # fmt: skip
    return [each for argument in arguments for each in names.get(str(argument), (argument,))], words


ALL = (*BAD, *DOOR, *MODELS, *SURFACES, *(what for what in TEXTS if what not in BAD))


def _empty_folder(folder):
    (folder / "empty").mkdir(exist_ok=True)
    return folder / "empty"


def _write_model(source, path, *, crs=..., unit=None, hole=None, kept_bytes=None):
    with rasterio.open(source) as file:
        values, profile = file.read(1), file.profile
    if crs is not ...:
        profile["crs"] = crs
    if hole is not None:
        rows, columns = values.shape
        values[rows // 2 - 6 : rows // 2 - 3, columns // 2 - 1 : columns // 2 + 1] = hole
        if np.isfinite(hole):
            profile["nodata"] = None
    with rasterio.open(path, "w", **profile) as file:
        file.write(values, 1)
        if unit is not None:
            file.units = (unit,)
    if kept_bytes is not None:
        path.write_bytes(path.read_bytes()[:kept_bytes])


def _write_surface(
    source, path, *, missing=False, copied=False, factor=1.0, shift_m=0.0, trees_m=0.0, until=1.0, crs=...
):
    """The ground's heights with a change: a wood in the middle, another unit or datum, nothing in the east."""
    with rasterio.open(source) as file:
        values, profile = file.read(1), file.profile
    if missing:
        return
    if copied:
        path.write_bytes(source.read_bytes())
        return
    rows, columns = values.shape
    values[rows // 2 - 3 : rows // 2 + 3, columns // 2 - 3 : columns // 2 + 3] += trees_m
    values = (factor * (values + shift_m)).astype(np.float32)
    values[:, round(until * columns) :] = np.nan
    if crs is not ...:
        profile["crs"] = crs
    with rasterio.open(path, "w", **profile) as file:
        file.write(values, 1)
