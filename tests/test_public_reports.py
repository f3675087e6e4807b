"""Classes of mistakes in public bug reports of planners and ground stations, with made-up data and the right answer for each.

Those of flights are in :mod:`tests.test_public_flight_reports`.
"""

import json
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import shapely
from rasterio.transform import Affine

from mission_io.errors import FormatError
from mission_io.formats import plan
from tests.extras.photos.camera_files import write_jpeg
from tests.extras.photos.test_placing import FRAME as PHOTO_FRAME
from tests.extras.photos.test_placing import survey
from tests.planner.sites import make_site
from tests.run.test_judged_inputs import nested
from tests.scenario.scenario_texts import survey_text
from tests.verification.test_dates import BOUNDS, NOON_S, track_at
from tests.verification.track_logs.samples import FRAME, GROUND_M, write_dataflash, write_tlog, write_ulog
from uavcover.errors import InputError, TrackError
from uavcover.extras.check.mission_file import read_mission_file, read_parameter_file
from uavcover.extras.photos.placing import Assumptions, locate_photos, missing_stretches
from uavcover.extras.photos.readers import read_photos
from uavcover.model.track import COLUMNS
from uavcover.model.verdict import Judgement, noted, unproved
from uavcover.run.track_file import read_track_with_warnings
from uavcover.scenario.areas.area_file import AreaQuery, read_area
from uavcover.scenario.obstacles import read_obstacles
from uavcover.scenario.scenario_file import parse_scenario
from uavcover.scenario.site import build_site, load_site
from uavcover.sensing.coverage_map import CoverageMap
from uavcover.terrain.elevation_file import read_heights_amsl_m
from uavcover.terrain.suspect_heights import suspect_positions
from uavcover.terrain.terrain_source import TerrainSource
from uavcover.verification.command import elevation_biases, widened
from uavcover.verification.run_logs import ROLLOVER_S, dated
from uavcover.verification.track_logs.readers import read_foreign_log


@dataclass(frozen=True, slots=True)
class Report:
    """A class of reports.

    Attributes:
        name: of the class.
        case: makes the data in a folder, gives it to the code concerned, and returns the answer as text.
        answer: that the text matches.
    """

    name: str
    case: Callable[[Path], str]
    answer: str


def _mended(rings: list[str]) -> str:
    found = read_area(AreaQuery(source=f"POLYGON ({', '.join(rings)})", make_valid=True))
    square = sum(shapely.Polygon(part[0], part[1:]).area for part in found.parts) * 1e6
    return f"{square:.0f} {' '.join(found.notes)}"


_OUTLINE = "(8 46, 8.01 46, 8.01 46.01, 8 46.01, 8 46)"
"""A hundred squares of 0.001 degrees."""


def hole_on_the_edge(_: Path) -> str:
    return _mended([_OUTLINE, "(8 46.002, 8.003 46.002, 8.003 46.005, 8 46.005, 8 46.002)"])


def holes_that_overlap(_: Path) -> str:
    corners = ((2, 2), (6, 2), (6, 6), (2, 6), (2, 2))
    holes = [f"({', '.join(f'8.00{x + d} 46.00{y + d}' for x, y in corners)})" for d in (0, 2)]
    return _mended([_OUTLINE, *holes])


def hole_that_takes_all(_: Path) -> str:
    try:
        return _mended([_OUTLINE, "(7.99 45.99, 8.02 45.99, 8.02 46.02, 7.99 46.02, 7.99 45.99)"])
    except InputError as error:
        return str(error)


def _dem(folder: Path, heights: np.ndarray, *, west: float = 8.0, step: float = 1.3e-4) -> Path:
    """A file of pixels of 10 m around 46 N, 8 E."""
    path = folder / "dem.tif"
    with rasterio.open(
        path, "w", driver="GTiff", width=heights.shape[1], height=heights.shape[0], count=1, crs="EPSG:4326",
        dtype="float32", transform=Affine(step, 0.0, west, 0.0, -9e-5, 46.02),
    ) as file:  # fmt: skip
        file.write(heights.astype(np.float32), 1)
    return path


def _doubts(heights: np.ndarray, folder: Path) -> str:
    return "; ".join(one.words for one in suspect_positions(_dem(folder, heights), "EGM96", (8.0, 46.0, 8.025, 46.02)))


def _relief() -> np.ndarray:
    rows, columns = np.mgrid[0:220, 0:220]
    return 700.0 + 60.0 * np.sin(rows / 19.0) * np.cos(columns / 23.0) + 0.3 * columns


def void_filled_with_zero(folder: Path) -> str:
    heights = _relief()
    heights[80:120, 90:130] = 0.0
    return _doubts(heights, folder)


def warp_collar(folder: Path) -> str:
    rows, columns = np.mgrid[0:220, 0:220]
    return _doubts(np.where(rows < 0.2 * columns, 0.0, _relief()), folder)


def tile_in_feet_beside_one_in_metres(folder: Path) -> str:
    heights = _relief()
    heights[:, 110:] /= 0.3048
    return _doubts(heights, folder)


def sea_without_data(folder: Path) -> str:
    rows, columns = np.mgrid[0:220, 0:220]
    land = 0.8 * (columns - 110.0 - 10.0 * np.sin(rows / 15.0))
    source = TerrainSource((_dem(folder, np.where(land > 0.0, land, np.nan)),), water_height_m=0.0)
    heights = read_heights_amsl_m(source, "EGM96", np.array([46.01, 46.01]), np.array([8.001, 7.99]))
    return f"{heights} {suspect_positions(source, 'EGM96', (7.99, 46.005, 8.02, 46.015))}"


def rangefinder_and_dem(folder: Path) -> str:
    site = make_site()
    path = folder / "flight.bin"
    write_dataflash(path, ranging=True)
    track = read_foreign_log(path, FRAME).track
    ranged = np.column_stack(
        [np.full(len(track.ranged), site.frame.lat_deg), np.full(len(track.ranged), site.frame.lon_deg)]
    )
    level_m = site.ground_alt_amsl_m(site.frame.lat_deg, site.frame.lon_deg) + track.ranged[:, 2] - GROUND_M + 4.0
    track = replace(track, ranged=np.column_stack([ranged, level_m]))
    return "; ".join(widened(site, elevation_biases(site, [track]))[1])


def station_with_a_position(folder: Path) -> str:
    path = folder / "flight.tlog"
    write_tlog(path, stations=((255, 6, 8),))
    track = read_foreign_log(path, FRAME).track
    write_tlog(path, systems=(1, 2))
    try:
        read_foreign_log(path, FRAME)
    except TrackError as error:
        return f"{len(track)} positions; {error}"
    return "no error"


def log_without_an_estimate(folder: Path) -> str:
    path = folder / "flight.ulg"
    write_ulog(path, receiver="vehicle_gps_position")
    return "; ".join(read_foreign_log(path, FRAME).warnings)


def table_of_another_country(folder: Path) -> str:
    """Obstacles, parameters and a track, as a spreadsheet in German saves them."""
    path = folder / "boxes.csv"
    path.write_text(
        '"name";"east_m";"north_m";"length_m";"width_m";"heading_deg";"height_m"\nmast;1,5;2,5;4;4;0;12,5\n'
    )
    (mast,) = read_obstacles(path)
    (folder / "a.param").write_text("RTL_ALT;2500,5\nWPNAV_SPEED;500\n")
    parameters = read_parameter_file(folder / "a.param")
    sample = dict.fromkeys(COLUMNS, "0") | {"lat_deg": "46,5", "lon_deg": "8,5", "alt_amsl_m": "500,5"}
    rows = [sample, sample | {"time_s": "0,5"}]
    table = [";".join(COLUMNS), *(";".join(row.values()) for row in rows)]
    (folder / "track.csv").write_text("\n".join(table) + "\n")
    read = read_track_with_warnings(folder / "track.csv")
    return f"{mast.height_m} {parameters['RTL_ALT']} {read.track.geodetic[1].tolist()} {read.track.time_s[1]} {read.warnings[0]}"


def take_off_in_row_0(folder: Path) -> str:
    path = folder / "m.waypoints"
    rows = ["0\t0\t3\t22\t0\t0\t0\t0\t46.5\t8.5\t50\t1", "1\t0\t3\t16\t0\t0\t0\t0\t46.51\t8.5\t50\t1"]
    path.write_text("QGC WPL 110\n" + "\n".join(rows) + "\n")
    read = read_mission_file(path)
    return f"{read.mission.home} {[item.command for item in read.mission.items]} {read.repairs[0]}"


def plan_that_contradicts_itself(folder: Path) -> str:
    item = {
        "type": "SimpleItem", "command": 16, "frame": 3, "autoContinue": True, "doJumpId": 1, "Altitude": 120,
        "AltitudeMode": 2, "AMSLAltAboveTerrain": None, "params": [0, 0, 0, None, 46.5, 8.5, 50],
    }  # fmt: skip
    ring = {"polygon": [[46, 8], [46, 9], [47, 9]], "inclusion": True, "version": 1}
    fence = {"version": 2, "circles": [], "polygons": [ring], "breachReturn": [48, 8, 50]}
    mission = {
        "version": 2, "firmwareType": 3, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5, "items": [item],
        "plannedHomePosition": [46.5, 8.5, 500],
    }  # fmt: skip
    text = json.dumps({
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "mission": mission, "geoFence": fence,
        "rallyPoints": {"version": 2, "points": []},
    })  # fmt: skip
    (folder / "m.plan").write_text(text)
    read = read_mission_file(folder / "m.plan")
    return "; ".join([*read.repairs, *plan.read(text).doubts()])


def template_of_dji(folder: Path) -> str:
    kml = '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.2"><Document/></kml>'
    (folder / "template.kml").write_text(kml)
    with zipfile.ZipFile(folder / "flight.kmz", "w") as archive:
        archive.writestr("wpmz/template.kml", kml)
    said = []
    for name in ("template.kml", "flight.kmz"):
        try:
            read_mission_file(folder / name)
        except FormatError as error:
            said.append(str(error).replace(str(folder), ""))
    return "; ".join(said)


def lake(folder: Path) -> str:
    return f"{_doubts(np.maximum(_relief(), 720.0), folder)}nothing"


def narrow_sensor(folder: Path) -> str:
    text = """
name = "disc"
[area]
polygon_east_north_m = [[0, 0], [60, 0], [60, 3], [0, 3]]
cell_size_m = 0.5
[terrain]
kind = "sine-cosine"
scale_m = 1e-3
[sensor]
kind = "disc"
radius_m = 1.5
sensing = "along-path"
[limits]
min_height_agl_m = 5.0
max_height_agl_m = 20.0
"""
    site = build_site(parse_scenario(text, source="disc", folder=folder))
    coverage = CoverageMap(site, cell_size_m=0.5)
    observed = coverage.observed(np.array([[0.0, 1.5, 10.0], [60.0, 1.5, 10.0]]))
    return f"{100.0 * float(np.mean(observed)):.0f} %"


def tile_under_two_virtual_rasters(folder: Path) -> str:
    for level, inner in enumerate((_dem(folder, _relief()), folder / "level0.vrt")):
        nested(folder / f"level{level}.vrt", inner)
    area = "polygons_lon_lat_deg = [[[[8.01, 46.01], [8.012, 46.01], [8.012, 46.012]]]]"
    text = survey_text(area, f'"{folder / "level1.vrt"}"', (46.01, 8.01))
    scenario = parse_scenario(text, source="nested", folder=folder)
    before = load_site(scenario).bare_ground.sha256
    same = load_site(scenario).bare_ground.sha256 == before
    _dem(folder, _relief() + 1.0)
    return f"{same} {load_site(scenario).bare_ground.sha256 == before}"


def date_of_1024_weeks_before(_: Path) -> str:
    found, findings = dated(track_at(NOON_S - ROLLOVER_S), BOUNDS)
    return f"{np.isfinite(found.unix_time_s).any()} {'; '.join(findings)}"


def row_that_contradicts_the_verdict(_: Path) -> str:
    judgement = Judgement(
        (unproved("photos", "no limit failed; not allowed: no"), noted("coverage is not proved, it failed"))
    )
    return f"{judgement.verdict}; {judgement.holds('photos')}; {judgement.holds('coverage')}"


def table_of_exiftool(folder: Path) -> str:
    (folder / "a.csv").write_text(
        "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude,DateTimeOriginal\n"
        """./a.jpg,"8 deg 27' 55.22"" S","13 deg 12' 0.92"" W",3 m Below Sea Level,2025:04:16 07:25:57\n"""
    )
    (one,) = read_photos([folder / "a.csv"]).photos
    return f"{one.lat_deg:.6f} {one.lon_deg:.6f} {one.alt_m} {one.time_s}"


def photos_deleted_from_lines(_: Path) -> str:
    whole = survey(np.random.default_rng(0), by="time")
    lost = [one for k, one in enumerate(whole) if k not in (5, 44, 45, 46)]
    found = [missing_stretches(locate_photos(some, PHOTO_FRAME, Assumptions())) for some in (whole, lost)]
    return f"{found[0]} {[(one.after, one.photos) for one in found[1]]}"


def photos_without_positions(folder: Path) -> str:
    write_jpeg(folder / "a.jpg")
    try:
        locate_photos(read_photos([folder]).photos, PHOTO_FRAME, Assumptions())
    except TrackError as error:
        return str(error)
    return "no error"


def tiles_that_meet_at_180_degrees(folder: Path) -> str:
    tiles = []
    for name, west in (("west", 179.98), ("east", -180.0)):
        (folder / name).mkdir()
        tiles.append(_dem(folder / name, np.full((220, 200), 7.0), west=west, step=1e-4))
    heights = read_heights_amsl_m(
        TerrainSource(tuple(tiles)), "EGM96", np.full(3, 46.01), np.array([179.99, 180.0, -179.99])
    )
    return str(heights)


REPORTS = (
    Report("a hole on the outline's edge is filled", hole_on_the_edge, r"^91 .* ha before, .* ha after.$"),
    Report("holes that overlap are half filled", holes_that_overlap, r"^72 .* ha before, .* ha after.$"),
    Report(
        "a hole takes all of the area",
        hole_that_takes_all,
        "^the area: the holes cover the whole area; remove some of them$",
    ),
    Report(
        "a void filled with 0 reads as ground", void_filled_with_zero, "^a block .* of exactly 0 m whose rim is at 7"
    ),
    Report("a warp's collar reads as ground", warp_collar, "^a block .* of exactly 0 m whose rim is at"),
    Report(
        "tiles do not fit",
        tile_in_feet_beside_one_in_metres,
        "^a straight step of 1.* m over 1.* m, as between mismatched tiles",
    ),
    Report("a narrow sensor counts only spots of its swath", narrow_sensor, "^(9[5-9]|100) %$"),
    Report("the sea has no data, or no tile", sea_without_data, r"^\[0\. 0\.\] \(\)$"),
    Report(
        "is my elevation data right?", rangefinder_and_dem, r"the ground is 4\.\d m above the .*uncertainty is 4\.\d m"
    ),
    Report(
        "a ground station counts as a vehicle", station_with_a_position, "^40 positions; .*choose one with --system$"
    ),
    Report("a log has GPS positions alone", log_without_an_estimate, "using its receiver's positions"),
    Report(
        "semicolons, quoted headers and decimal commas",
        table_of_another_country,
        r"^12\.5 2500\.5 \[46\.5, 8\.5, 500\.5\] 0\.5 .*read as columns separated by semicolons, decimal commas$",
    ),
    Report(
        "a take-off in row 0 becomes a home of 50 m",
        take_off_in_row_0,
        r"^None \[22, 16\] the first row is command 22, not home; it is now item 1, and home is missing$",
    ),
    Report(
        "a plan contradicts itself",
        plan_that_contradicts_itself,
        "AltitudeMode 2 is AMSL, but .* ABOVE_HOME.*Altitude is 120, but params.6. is 50.*return point.* outside the fence",
    ),
    Report(
        "DJI's template is no flight",
        template_of_dji,
        "^/template.kml: kml: the file is DJI's template.kml.*/flight.kmz: the file contains DJI's template .* but no",
    ),
    Report("a lake is no void", lake, "^nothing$"),
    Report("tiles meet at 180 degrees", tiles_that_meet_at_180_degrees, r"^\[7\. 7\. 7\.\]$"),
    Report("a tile changes under nested rasters", tile_under_two_virtual_rasters, "^True False$"),
    Report(
        "a week number rolls over",
        date_of_1024_weeks_before,
        "^False .* a date 1,024 weeks later is plausible .* rolled over",
    ),
    Report("a row contradicts the verdict", row_that_contradicts_the_verdict, "^not proved; not proved; yes$"),
    Report("a table as ExifTool prints it", table_of_exiftool, r"^-8\.465339 -13\.200256 -3\.0 1744788357\.0$"),
    Report("photos are deleted", photos_deleted_from_lines, r"^\[\] \[\('IMG_0004.JPG', 1\), \('IMG_0043.JPG', 3\)\]$"),
    Report("photos have no places", photos_without_positions, r"no position\); add a list of their positions"),
)


@pytest.mark.parametrize("report", REPORTS, ids=lambda report: report.name)
def test_each_class_has_the_right_answer(report, tmp_path):
    answer = report.case(tmp_path)
    assert re.search(report.answer, answer), answer
