"""Flights for controllers: what is in the files is the checked path, for every sensor and autopilot, however it is split."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from mission_io.errors import FormatError
from tests.mission_io.formats.wpml_tables import ReadPoint, check_kmz
from tests.missions.test_sorties import there_and_back
from tests.planner.sites import flat, hills, make_site, ridge
from uavcover.errors import InfeasibleError, InputError, OutputError, TerrainError
from uavcover.extras.exports.command import DJI_AIRCRAFT
from uavcover.extras.exports.export import ExportRequest, FlightFile, export_mission, flight_files, write_exported
from uavcover.missions.leg_checks import find_problems
from uavcover.missions.mission_compiler import compile_mission
from uavcover.model.limits import NoFly
from uavcover.model.scenario import Origin
from uavcover.model.sensor import DiscSensor, FrameCamera, NadirCamera, Sensor, SphereSensor
from uavcover.model.vehicle import AutopilotName
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site

M3E = DJI_AIRCRAFT.named("m3e")
FRAME: dict[str, Any] = {"kind": "frame-camera", "fov_across_deg": 70.0, "fov_along_deg": 50.0, "range_m": 300.0}
SENSORS: dict[str, Sensor] = {
    "nadir, fixed": NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0),
    "nadir, gimbal": NadirCamera(kind="nadir-camera", fov_deg=70.0, range_m=200.0, mount="stabilised"),
    "frame, overlap": FrameCamera(**FRAME, mount="stabilised", forward_overlap=0.75),
    "frame, tilted and fixed": FrameCamera(**FRAME, pitch_deg=-62.5, trigger_distance_m=17.0),
    "frame, held heading": FrameCamera(**FRAME, pitch_deg=-45.0, heading_deg=225.0, mount="stabilised"),
    "frame, at waypoints": FrameCamera(**FRAME, heading_deg=10.0, mount="stabilised", sensing="at-waypoints"),
    "sphere": SphereSensor(kind="sphere", range_m=150.0, sensing="at-waypoints"),
    "disc": DiscSensor(kind="disc", radius_m=60.0, sensing="along-path"),
}  # fmt: skip


def request(file_format: str = "wpml", **options: Any) -> ExportRequest:
    aircraft = M3E if file_format == "wpml" else None
    return ExportRequest(file_format=file_format, out=Path("x.kmz"), aircraft=aircraft, **options)


def read_litchi(content: bytes) -> list[ReadPoint]:
    return [
        ReadPoint(
            float(row["latitude"]), float(row["longitude"]), float(row["altitude(m)"]), float(row["speed(m/s)"]), None, ()
        )
        for row in csv.DictReader(io.StringIO(content.decode()))
    ]  # fmt: skip


READERS: dict[str, Callable[[bytes], list[ReadPoint]]] = {
    "wpml": lambda content: check_kmz(content).points,
    "litchi": read_litchi,
}


def enu_of(site: Site, points: list[ReadPoint]) -> np.ndarray:
    """(n, 3) ENU of points of a file, by PROJ's topocentric conversion and not by the frames of the product."""
    origin = site.scenario.origin
    assert origin is not None
    assert site.home_m is not None
    home_alt_m = float(site.alts_amsl_m(site.home_m)[0])
    pipeline = pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
        f"+lon_0={origin.lon_deg!r} +lat_0={origin.lat_deg!r} +h_0={origin.alt_amsl_m!r}"
    )
    lon, lat, height = (
        [p.lon_deg for p in points], [p.lat_deg for p in points], [p.height_m + home_alt_m for p in points],
    )  # fmt: skip
    return np.column_stack(pipeline.transform(lon, lat, height))


def assert_flown_safely(site: Site, path_m: np.ndarray) -> None:
    home = site.home_m
    assert home is not None
    assert np.hypot(*(path_m[[0, -1], :2] - home[:2]).T).max() < 0.02, "from home, to home"
    limits = site.scenario.limits
    problems = find_problems(site, path_m, lowest_agl_m=limits.transit_clearance_m - 0.02, highest_agl_m=None)
    vertical = np.hypot(*np.diff(path_m[:, :2], axis=0).T) < 0.1
    assert [p for p in problems if p.kind != "climb" or not vertical[p.leg - 1]] == []


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize("file_format", READERS)
@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
@pytest.mark.thinned
def test_the_file_is_the_checked_path(sensor: Sensor, file_format: str, autopilot: AutopilotName) -> None:
    site = make_site(hills, sensor=sensor)
    route = there_and_back(site)
    if isinstance(sensor, FrameCamera) and autopilot == "ardupilot" and sensor.mount == "stabilised":
        assert float(sensor.pitch_deg).is_integer()
    (flight,) = flight_files(site, route, request(file_format, autopilot=autopilot))
    points = READERS[file_format](flight.content)
    compiled = compile_mission(site, route, autopilot=autopilot)
    assert len(points) == len(compiled.path_m) == flight.items
    assert np.abs(enu_of(site, points) - compiled.path_m).max() < 0.01
    assert {p.speed_m_s for p in points} == {10.0}
    assert_flown_safely(site, enu_of(site, points))
    assert flight.photos == (not sensor.looks_along_path or ("frame" in sensor.kind and bool(
        getattr(sensor, "forward_overlap", None) or getattr(sensor, "trigger_distance_m", None)
    )))  # fmt: skip


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_the_camera_looks_where_the_scenario_says(autopilot: AutopilotName) -> None:
    for name, pitch_deg in (
        ("nadir, fixed", -90.0), ("nadir, gimbal", -90.0), ("frame, overlap", -90.0),
        ("frame, tilted and fixed", -62.5), ("frame, held heading", -45.0), ("sphere", None),
    ):  # fmt: skip
        sensor = SENSORS[name]
        site = make_site(hills, sensor=sensor)
        (flight,) = flight_files(site, there_and_back(site), request(autopilot=autopilot))
        points = check_kmz(flight.content).points
        turned = [value for p in points for _, _, function, value in p.actions if function == "gimbalRotate"]
        assert turned == ([] if pitch_deg is None else [pitch_deg]), name
        held = {p.heading_deg for p in points} - {None}
        assert held == ({-135.0} if name == "frame, held heading" else set())


def test_pictures_by_distance_last_from_the_first_to_the_last_planned_waypoint() -> None:
    site = make_site(hills, sensor=SENSORS["frame, tilted and fixed"])
    route = there_and_back(site)
    compiled = compile_mission(site, route, autopilot="ardupilot")
    (flight,) = flight_files(site, route, request())
    points = check_kmz(flight.content).points
    first = int(np.argmin(np.linalg.norm(compiled.path_m - route.waypoints_m[0], axis=1)))
    groups = [(k, *a[1:]) for k, p in enumerate(points) for a in p.actions if a[0] == "multipleDistance"]
    assert groups == [(first, first + len(route) - 1, "takePhoto", 17.0)]


@pytest.mark.parametrize("file_format", [*READERS, "waypoints"])
@pytest.mark.parametrize("most", [12, 25, 40])
@pytest.mark.parametrize("name", ["nadir, fixed", "sphere"])
def test_each_file_of_a_split_is_a_checked_flight(name: str, most: int, file_format: str) -> None:
    site = make_site(hills, sensor=SENSORS[name])
    route = there_and_back(site, lines=6, spacing_m=30.0)
    flights = flight_files(site, route, request(file_format, most_points=most))
    assert len(flights) > 1
    if file_format not in READERS:
        return
    observed = np.vstack([enu_of(site, READERS[file_format](flight.content)) for flight in flights])
    for flight in flights:
        points = READERS[file_format](flight.content)
        assert len(points) == flight.items <= most
        assert_flown_safely(site, enu_of(site, points))
    # Every planned waypoint is flown; along the path, the legs that a split cuts are joined at a waypoint of both flights.
    distances = np.linalg.norm(observed[:, None] - route.waypoints_m[None], axis=2)
    assert distances.min(axis=0).max() < 0.01
    assert (distances < 0.01).sum() == len(route) + (len(flights) - 1 if name == "nadir, fixed" else 0)


def test_heights_above_the_ellipsoid_are_those_above_sea_level_and_the_geoid(monkeypatch: pytest.MonkeyPatch) -> None:
    class Geoid:
        """A slope, so that each point has its own."""

        def heights_m(self, lat_deg: np.ndarray, lon_deg: np.ndarray) -> np.ndarray:
            return -31.0 + 1000.0 * (lat_deg - 36.5) + 500.0 * (lon_deg + 84.2)

    site, (relative,) = make_site(hills), flight_files(make_site(hills), there_and_back(make_site(hills)), request())
    monkeypatch.setattr("uavcover.extras.exports.export.Undulation", Geoid)
    (flight,) = flight_files(site, there_and_back(site), request(heights="ellipsoid"))
    read, above_home = check_kmz(flight.content), check_kmz(relative.content).points
    assert read.mode == "WGS84"
    assert site.home_m is not None
    home_m = float(site.alts_amsl_m(site.home_m)[0])
    for point, same, amsl_m in zip(read.points, above_home, read.template_heights_m, strict=True):
        assert (point.lat_deg, point.lon_deg) == (same.lat_deg, same.lon_deg)
        assert amsl_m == pytest.approx(home_m + same.height_m, abs=2e-3)
        geoid_m = Geoid().heights_m(np.array(point.lat_deg), np.array(point.lon_deg))
        assert point.height_m == pytest.approx(amsl_m + float(geoid_m), abs=2e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"heights": "wgs84"}, "--heights: must be takeoff or ellipsoid, not 'wgs84'"),
        (
            {"file_format": "litchi", "heights": "ellipsoid"},
            "--heights ellipsoid: this option requires --format wpml, not litchi",
        ),
    ],
)
def test_heights_that_no_file_has(tmp_path: Path, options: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        export_mission(RunFolder(tmp_path), request(**options))


def test_without_a_geoid_grid_the_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> None:
        raise TerrainError("terrain.vertical_datum: needs the geoid grid us_nga_egm96_15.tif")

    monkeypatch.setattr("uavcover.extras.exports.export.Undulation", none)
    site = make_site(hills)
    with pytest.raises(InputError, match=r"^--heights ellipsoid: needs the geoid grid us_nga_egm96_15\.tif"):
        flight_files(site, there_and_back(site), request(heights="ellipsoid"))


def test_heights_below_home_are_negative() -> None:
    site = make_site(
        lambda east, north: np.maximum(0.0, 200.0 - 0.8 * np.hypot(east + 300.0, north)), home=(-300.0, 0.0)
    )
    (flight,) = flight_files(site, there_and_back(site), request())
    points = check_kmz(flight.content).points
    assert min(p.height_m for p in points) < -50.0
    assert_flown_safely(site, enu_of(site, points))


@pytest.mark.parametrize(("lat_deg", "lon_deg"), [(-16.5, 179.9999), (65.0, -179.9995), (83.5, 20.0), (-54.8, -68.3)])
def test_across_180_degrees_and_far_from_the_equator(
    monkeypatch: pytest.MonkeyPatch, lat_deg: float, lon_deg: float
) -> None:
    monkeypatch.setattr("tests.planner.sites.ORIGIN", Origin(lat_deg=lat_deg, lon_deg=lon_deg, alt_amsl_m=2500.0))
    site = make_site(hills)
    for file_format, read in READERS.items():
        (flight,) = flight_files(site, there_and_back(site), request(file_format))
        points = read(flight.content)
        assert_flown_safely(site, enu_of(site, points))
        if abs(lon_deg) > 179.0:
            assert {p.lon_deg > 0.0 for p in points} == {True, False}


def test_stops_at_each_point_count_towards_the_endurance() -> None:
    free = make_site(hills)
    route = there_and_back(free, lines=5, spacing_m=30.0)
    (whole,) = flight_files(free, route, request())
    without_stops = compile_mission(free, route, autopilot="ardupilot").flight_time_s
    assert whole.flight_time_s > 1.2 * without_stops
    between_s = 0.5 * (without_stops + whole.flight_time_s)
    site = make_site(hills, vehicle={"endurance_s": between_s, "reserve_fraction": 0.0})
    flights = flight_files(site, route, request())
    assert len(flights) > 1
    assert max(flight.flight_time_s for flight in flights) <= between_s
    assert len(flight_files(site, route, request("waypoints"))) == 1


def test_a_plan_that_no_flight_with_stops_completes() -> None:
    free = make_site(flat)
    route = there_and_back(free, lines=2, spacing_m=300.0)
    alone = max(f.flight_time_s for f in flight_files(free, route, request(most_points=5)))
    site = make_site(flat, vehicle={"endurance_s": 0.9 * alone, "reserve_fraction": 0.0})
    with pytest.raises(
        InfeasibleError, match=r"a flight that stops at each point takes|a sortie with this part alone (takes|uses)"
    ):
        flight_files(site, route, request())


def test_too_few_points_for_any_leg() -> None:
    site = make_site(hills)
    with pytest.raises(InfeasibleError, match=r"the leg to waypoint \d+: a sortie with this part alone has \d+ points"):
        flight_files(site, there_and_back(site), request(most_points=3))


@pytest.mark.parametrize(
    ("on_earth", "home", "match"), [(False, (0.0, 0.0), "no position on Earth"), (True, None, "no .home")]
)
def test_without_a_place_or_a_home_there_is_no_flight(on_earth: bool, home: Any, match: str) -> None:
    site = make_site(flat, on_earth=on_earth, home=home)
    for file_format in (*READERS, "gpx"):
        with pytest.raises(InputError, match=match):
            flight_files(site, there_and_back(site), request(file_format))


def test_an_aircraft_that_is_too_slow_is_told() -> None:
    site = make_site(flat, vehicle={"cruise_speed_m_s": 16.0})
    with pytest.raises(FormatError, match="16 m/s, but the DJI Mavic 3E flies at most 15"):
        flight_files(site, there_and_back(site), request())


CONTENTS = {"m-1.kmz": b"one", "m-2.kmz": b"two", "m-3.kmz": b"three"}


def files_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_all_files_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever write or rename fails or is interrupted: afterwards there are the old files, or the new ones."""
    import os

    import uavcover.run.file_group as group

    names = {"fill": (group, "_fill"), "rename": (os, "rename")}
    outcomes = set()
    for what, error in [(n, e) for n in names for e in (OSError(28, "No space left on device"), KeyboardInterrupt())]:
        for after in range(8):
            folder = tmp_path / f"{what}-{type(error).__name__}-{after}"
            folder.mkdir()
            old = dict.fromkeys(CONTENTS, b"old")
            for name, content in old.items():
                (folder / name).write_bytes(content)
            owner, name = names[what]
            real, calls = getattr(owner, name), [0]

            def fail(
                *args: Any, real: Any = real, calls: list[int] = calls, after: int = after, error: Any = error
            ) -> Any:
                calls[0] += 1
                if calls[0] == after + 1:
                    raise error
                return real(*args)

            with monkeypatch.context() as patch:
                patch.setattr(owner, name, fail)
                try:
                    write_exported(folder / "m.kmz", CONTENTS, force=True)
                except (OutputError, KeyboardInterrupt):
                    outcomes.add("failed")
            assert files_in(folder) in (old, CONTENTS), (what, error, after)
            assert {path.name for path in folder.iterdir()} == set(CONTENTS)
            outcomes.add("new" if files_in(folder) == CONTENTS else "old")
    assert outcomes == {"failed", "new", "old"}


def test_a_part_of_an_older_export_is_not_left_beside_new_ones(tmp_path: Path) -> None:
    out = tmp_path / "m.kmz"
    write_exported(out, CONTENTS, force=False)
    with pytest.raises(OutputError, match=r"m-1\.kmz, m-2\.kmz, m-3\.kmz; use --force"):
        write_exported(out, CONTENTS, force=False)
    fewer = dict.fromkeys(("m-1.kmz", "m-2.kmz"), b"new")
    with pytest.raises(
        OutputError, match=r"m-3.kmz: this file belongs to another export and could be mistaken for a part of this one"
    ):
        write_exported(out, fewer, force=True, older=["m-1.kmz", "m-2.kmz", "m-3.kmz"])
    assert files_in(tmp_path) == CONTENTS


def test_a_return_by_the_controller_itself_is_safe_or_warned_of() -> None:
    """The return height of the file clears every straight line home; zones and unknown ground are told."""
    site = make_site(ridge(-50.0, 60.0))
    route = there_and_back(site)
    (flight,) = flight_files(site, route, request())
    advice = compile_mission(site, route, autopilot="ardupilot").return_advice
    assert advice.safe_return_height_m > site.scenario.vehicle.return_height_m
    height_m = float(check_kmz(flight.content).config["globalRTHHeight"])
    assert height_m == flight.return_height_m
    assert 0.0 <= height_m - advice.safe_return_height_m < 1.0
    assert flight.warnings == ()
    assert flight_files(site, route, request("litchi"))[0].return_height_m == height_m

    zone = NoFly(polygon_east_north_m=((-60.0, 20.0), (-30.0, 20.0), (-30.0, 180.0), (-60.0, 180.0)), name="pad")
    (flight,) = flight_files(make_site(ridge(-50.0, 60.0), no_fly=(zone,)), route, request())
    assert flight.warnings == ("a straight return enters no-fly zone pad; let the aircraft return along the route",)


def test_what_a_file_says_of_itself() -> None:
    site = make_site(hills)
    (flight,) = flight_files(site, there_and_back(site), request("waypoints"))
    assert isinstance(flight, FlightFile)
    assert flight.photos is None
    assert flight.highest_m > 60.0
