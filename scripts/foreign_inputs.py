"""Plans and exports areas over elevation models as people publish them: one command each, no scenario edited.

    .venv/bin/python scripts/foreign_inputs.py FOLDER            # prints which files FOLDER lacks, or writes the table

FOLDER holds the elevation files of ``INPUTS``, from the public repositories that are named there; none of them is part of this
project. Areas are drawn around a place in each, in the format and coordinate system that the table says.
"""

import argparse
import csv
import datetime
import json
import math
import subprocess
import sys
import tempfile
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyogrio.raw
import shapely
from pyproj import Transformer

from scripts.options import existing_folder, file_to_write

PAGE = Path(__file__).parent.parent / "docs" / "results" / "foreign_inputs.md"
_METRES_PER_DEGREE = 111_195.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """Elevation files and an area on them.

    Attributes:
        name: of the row.
        source: repositories and paths of the elevation files.
        files: their names in the folder.
        place: latitude and longitude of the middle of the area.
        shape: of the area.
        size_m: its side.
        form: format of the area.
        crs: its coordinate system.
        options: of ``plan``, beside area, elevation model and battery.
    """

    name: str
    source: str
    files: tuple[str, ...]
    place: tuple[float, float]
    shape: str
    size_m: float = 500.0
    form: str
    crs: str = "EPSG:4326"
    options: tuple[str, ...] = ("--camera", "dji-m3e", "--gsd", "3cm")


_QGIS = "qgis/QGIS-Training-Data, exercise_data/"
_SRTM = "nicholas-fong/SRTM-GeoTIFF, library/GeoTIFF/"
_LANDLAB = "landlab/landlab, docs/source/tutorials/"
INPUTS = (
    Input(name="Texas, 3 arc seconds", source="mdbartos/pysheds, data/dem.tif", files=("pysheds_dem.tif",),
          place=(32.65, -97.3), shape="hole", form="kml"),
    Input(name="Davos, 10 m, Swiss grid LV03", source="ethz-asl/terrain-navigation, resources/davosdorf.tif",
          files=("davosdorf.tif",), place=(46.8237, 9.8467), shape="L", form="shp", crs="EPSG:21781",
          options=("--camera", "sony-a7r4-35mm", "--gsd", "2cm")),
    Input(name="Davos, home at 2,500 m, area in LV95", source="ethz-asl/terrain-navigation, resources/davosdorf.tif",
          files=("davosdorf.tif",), place=(46.8152, 9.8291), shape="square", size_m=400.0, form="gpkg", crs="EPSG:2056",
          options=("--camera", "dji-p1-35mm", "--gsd", "1.5cm")),
    Input(name="Oregon, a cinder cone", source="OpenTopography/RiverREM, tests/smith_SRTM.tif", files=("smith.tif",),
          place=(44.367, -121.12), shape="triangle", form="kmz", options=("--camera", "dji-m3m", "--gsd", "4cm")),
    Input(name="Olinda, Brazil, UTM 25 S", source="r-spatial/stars, inst/tif/olinda_dem_utm25s.tif", files=("olinda.tif",),
          place=(-7.99, -34.88), shape="two parts", form="geojson", options=("--camera", "dji-mini-3-pro", "--gsd", "3cm")),
    Input(name="Luxembourg, 30 arc seconds", source="rspatial/terra, inst/ex/elev.tif", files=("lux.tif",),
          place=(49.8, 6.1), shape="square", form="wkt", options=("--camera", "dji-m4e", "--gsd", "3cm")),
    Input(name="Vinschgau, 250 m", source="rspatial/terra, inst/ex/elev_vinschgau.tif", files=("vinschgau.tif",),
          place=(46.65, 10.8), shape="square", form="fgb", crs="EPSG:25832"),
    Input(name="Table Mountain, the cliffs", source=_QGIS + "more_analysis/DEM/SRTM.tif", files=("cape.tif",),
          place=(-33.96, 18.41), shape="L", form="plan"),
    Input(name="Oregon, two tiles in NAD83", source=_QGIS + "processing/cutting_merging/dem1.tif and dem2.tif",
          files=("dem1.tif", "dem2.tif"), place=(42.3, -123.3), shape="square", form="poly"),
    Input(name="Sierra de Avila, UTM 30 on ED50", source=_QGIS + "processing/hydro/dem25.tif", files=("dem25.tif",),
          place=(40.27, -5.7), shape="square", form="box"),
    Input(name="Longs Peak, an ASCII grid without system", source=_LANDLAB + "flow_direction_and_accumulation/.bmi_topography/",
          files=("longs.asc",), place=(40.15, -105.5), shape="square", form="circle",
          options=("--camera", "dji-m3e", "--gsd", "3cm", "--dem-crs", "EPSG:4326")),
    Input(name="Coast Mountains, an ASCII grid and .prj", source="GeospatialPython/Learn, dem.zip", files=("dem.asc",),
          place=(50.38, -123.8), shape="strip", size_m=300.0, form="shp", crs="EPSG:26910"),
    Input(name="White Mountains, one arc second .hgt", source="tkrajina/srtm.py, test_files/N44W072.hgt",
          files=("N44W072.hgt",), place=(44.27, -71.3), shape="square", form="kml",
          options=("--camera", "dji-m30t", "--gsd", "5cm")),
    Input(name="Provence, a zipped .hgt", source="dem-net/DEM.Net, DEM.Net.xUnit.Test/TestData/N43E005.hgt.zip",
          files=("N43E005.hgt.zip",), place=(43.53, 5.6), shape="hole", form="geojson"),
    Input(name="Vancouver, across two tiles", source=_SRTM + "N49W123.tif and N49W124.tif",
          files=("N49W123.tif", "N49W124.tif"), place=(49.373, -123.0), shape="square", form="gpkg", crs="EPSG:3857"),
    Input(name="Andes, 32 degrees south", source=_SRTM + "S33W071.tif", files=("S33W071.tif",), place=(-32.65, -70.02),
          shape="square", size_m=400.0, form="kml", options=("--camera", "dji-m3e", "--gsd", "3cm", "--speed", "8m/s")),
    Input(name="Canberra, two fields", source=_SRTM + "S36E149.tif", files=("S36E149.tif",), place=(-35.3, 149.1),
          shape="two parts", form="kmz", options=("--camera", "dji-m3e", "--gsd", "3cm", "--overlap", "80/70")),
    Input(name="Bernese Alps, 3 arc seconds", source=_SRTM + "N46E008.tif", files=("N46E008.tif",), place=(46.55, 8.55),
          shape="triangle", form="shp", crs="EPSG:21781"),
    Input(name="Washington, 10 m, no system", source=_LANDLAB + "mass_wasting_runout/pre_runout_DEM.asc", files=("runout.asc",),
          place=(0.6408, -124.2455), shape="square", size_m=300.0, form="shp", crs="EPSG:32610",
          options=("--camera", "dji-m3e", "--gsd", "3cm", "--dem-crs", "EPSG:32610")),
    Input(name="Iowa, 3 m, whole centimetres", source="corteva/rioxarray, test/test_data/compare/small_dem_3m_merged.tif",
          files=("small3m.tif",), place=(41.6871, -93.8900), shape="square", size_m=300.0, form="geojson",
          options=("--camera", "dji-m3e", "--gsd", "3cm", "--height-unit", "cm")),
    Input(name="Pacific, a zipped tile of sea", source="rasterio/rasterio, tests/data/N10W110.hgt.zip",
          files=("N10W110.hgt.zip",), place=(10.5, -109.5), shape="square", size_m=300.0, form="geojson"),
)  # fmt: skip

_SHAPES: dict[str, list[list[list[tuple[float, float]]]]] = {
    "square": [[[(-1, -1), (1, -1), (1, 1), (-1, 1)]]],
    "hole": [[[(-1, -1), (1, -1), (1, 1), (-1, 1)], [(-0.6, -0.6), (-0.6, 0.6), (0.6, 0.6), (0.6, -0.6)]]],
    "L": [[[(-1, -1), (1, -1), (1, 0), (0, 0), (0, 1), (-1, 1)]]],
    "triangle": [[[(-1, -1), (1, -0.8), (0, 1)]]],
    "strip": [[[(-3, -0.4), (3, -0.4), (3, 0.4), (-3, 0.4)]]],
    "two parts": [[[(-1, -1), (-0.2, -1), (-0.2, 1), (-1, 1)]], [[(0.2, -1), (1, -1), (1, 1), (0.2, 1)]]],
}
"""Polygons, each an outline and holes; corners in halves of the side."""


def area_of(given: Input) -> list[shapely.Polygon]:
    """The area in longitude and latitude."""
    lat, lon = given.place
    up = 0.5 * given.size_m / _METRES_PER_DEGREE
    right = up / math.cos(math.radians(lat))
    return [
        shapely.Polygon(rings[0], rings[1:])
        for rings in (
            [[(lon + x * right, lat + y * up) for x, y in ring] for ring in polygon] for polygon in _SHAPES[given.shape]
        )
    ]


def write_area(given: Input, folder: Path) -> str:
    """Write the area in its format, or say it as text; what the command takes."""
    parts = area_of(given)
    path = folder / f"area.{given.form}"
    if given.form in ("gpkg", "shp", "fgb"):
        there = Transformer.from_crs("EPSG:4326", given.crs, always_xy=True)
        shapes = [shapely.transform(part, there.transform, interleaved=False) for part in parts]
        pyogrio.raw.write(
            path, np.array([shapely.to_wkb(shape) for shape in shapes], dtype=object),
            [np.array([f"field {n}" for n in range(len(shapes))], dtype=object)], ["name"],
            geometry_type="Polygon", crs=given.crs,
        )  # fmt: skip
        return str(path)
    if given.form == "box":
        return ",".join(f"{value:.6f}" for value in parts[0].bounds)
    if given.form == "circle":
        return f"{given.place[0]},{given.place[1]},{0.5 * given.size_m:g}"
    if given.form == "kmz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("doc.kml", _kml(parts))
    else:
        path.write_text(_text(given.form, parts), encoding="utf-8")
    return str(path)


def _text(form: str, parts: list[shapely.Polygon]) -> str:
    outline = list(parts[0].exterior.coords)[:-1]
    if form == "kml":
        return _kml(parts)
    if form == "wkt":
        return str(shapely.union_all(parts).wkt)
    if form == "poly":
        return "# a field\n" + "".join(f"{y} {x}\n" for x, y in outline)
    if form == "plan":
        survey = {
            "type": "ComplexItem", "complexItemType": "survey", "version": 5, "angle": 0,
            "polygon": [[y, x] for x, y in outline], "TransectStyleComplexItem": {"version": 2, "Items": []},
        }  # fmt: skip
        mission = {
            "version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5, "items": [survey],
            "plannedHomePosition": [outline[0][1], outline[0][0], None],
        }  # fmt: skip
        nothing = {"circles": [], "polygons": [], "version": 2}
        return json.dumps(
            {"fileType": "Plan", "version": 1, "mission": mission, "geoFence": nothing,
             "rallyPoints": {"points": [], "version": 2}}
        )  # fmt: skip
    features = [{"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(part)} for part in parts]
    return json.dumps({"type": "FeatureCollection", "features": features})


def _kml(parts: list[shapely.Polygon]) -> str:
    def ring(kind: str, places: list[tuple[float, ...]]) -> str:
        text = " ".join(f"{lon},{lat},0" for lon, lat in places)
        return f"<{kind}><LinearRing><coordinates>{text}</coordinates></LinearRing></{kind}>"

    placemarks = "".join(
        f"<Placemark><name>field {number}</name><Polygon>{ring('outerBoundaryIs', list(part.exterior.coords))}"
        + "".join(ring("innerBoundaryIs", list(hole.coords)) for hole in part.interiors)
        + "</Polygon></Placemark>"
        for number, part in enumerate(parts, start=1)
    )
    return f'<kml xmlns="http://www.opengis.net/kml/2.2"><Document>{placemarks}</Document></kml>'


def plan_and_export(given: Input, data: Path, *, evaluations: int) -> dict[str, str]:
    """One row of the table; ends the script when a command says more than done, or that no route reaches what was asked."""
    uavcover = [sys.executable, "-m", "uavcover"]
    with tempfile.TemporaryDirectory() as folder:
        area = write_area(given, Path(folder))
        run = Path(folder) / "run"
        dem = [word for name in given.files for word in ("--dem", str(data / name))]
        began = time.monotonic()
        done = subprocess.run(
            [*uavcover, "plan", area, *dem, *given.options, "--battery", "25min", "-o", str(run),
             "--evaluations", str(evaluations), "--json"],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        seconds = time.monotonic() - began
        if done.returncode not in (0, 1):
            raise SystemExit(f"{given.name}: {done.stderr.strip()}")
        plan = json.loads((run / "plan.json").read_text(encoding="utf-8"))
        metrics = plan["metrics"]
        flights = len(list(run.glob("sortie-*"))) or 1
        for form in ("waypoints", "kml"):
            sortie = ["--sortie", "1"] if flights > 1 else []
            exported = [*uavcover, "export", str(run), "--format", form, "-o", str(run / f"out.{form}"), *sortie]
            subprocess.run(exported, check=True, capture_output=True)
    return {
        "input": given.name, "source": given.source, "area": f"{given.shape}, {given.form}, {given.crs}",
        "coverage": f"{100.0 * metrics['coverage_of_coverable']:.1f} %", "flights": str(flights),
        "mission": f"{metrics['mission_time_s']:.0f} s", "seconds": f"{seconds:.0f}",
    }  # fmt: skip


def _commit() -> str:
    shown = ["git", "-C", str(PAGE.parent), "rev-parse", "--short", "HEAD"]
    return subprocess.run(shown, capture_output=True, text=True, check=False).stdout.strip()


def page(rows: list[dict[str, str]], *, evaluations: int) -> str:
    """The table as Markdown."""
    heads = {
        "input": "elevation model", "source": "from", "area": "area", "coverage": "coverage", "flights": "flights",
        "mission": "mission", "seconds": "planned in s",
    }  # fmt: skip
    lines = [
        "# Foreign inputs",
        "",
        f"Command: `.venv/bin/python scripts/foreign_inputs.py FOLDER --evaluations {evaluations}`, "
        f"{datetime.date.today().isoformat()}, commit {_commit()}.",
        "",
        "Elevation models from public repositories, as they are; none is part of this project. Around a place in each",
        "an area is drawn, in the format and coordinate system of the table. `uavcover plan AREA --dem ... --camera ...",
        "--gsd ... --battery 25min` plans it, `export` writes it for other software: one command each, no scenario edited.",
        "98 % of what can be seen is asked for.",
        "",
        "| " + " | ".join(heads.values()) + " |",
        "|---|---|---|---:|---:|---:|---:|",
        *("| " + " | ".join(row[key] for key in heads) + " |" for row in rows),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the page, or say which files are missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=existing_folder)
    parser.add_argument("--evaluations", type=int, default=100)
    parser.add_argument("-o", "--out", type=file_to_write, default=PAGE)
    chosen = parser.parse_args()
    missing = [
        f"{name} ({each.source})" for each in INPUTS for name in each.files if not (chosen.folder / name).is_file()
    ]
    if missing:
        raise SystemExit("missing in the folder:\n" + "\n".join(missing))
    rows: list[dict[str, str]] = []
    for given in INPUTS:
        rows.append(plan_and_export(given, chosen.folder, evaluations=chosen.evaluations))
        csv.DictWriter(sys.stdout, rows[0]).writerow(rows[-1])
        sys.stdout.flush()
    chosen.out.write_text(page(rows, evaluations=chosen.evaluations), encoding="utf-8")


if __name__ == "__main__":
    main()
