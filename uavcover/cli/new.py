"""``uavcover new``: from an area, elevation data and a camera to a scenario; and the options of a survey, for ``plan`` too."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.new.catalog import DetectionCurve
    from uavcover.new.elevation_questions import NewRequest
    from uavcover.terrain.frames import Bounds
    from uavcover.terrain.terrain_source import TerrainSource

# Options for the accuracy of photos, and for the target of a search, of ``judge-photos`` and ``verify``.


@dataclass(frozen=True, slots=True)
class PhotoOptions:
    """Heights of photos, and assumed errors where they record none."""

    takeoff: Annotated[
        str | None, option("Take-off position of the vehicle. Photo heights are then relative to it.", "LAT,LON")
    ] = None
    geoid_height: Annotated[
        float | None,
        option("Height of mean sea level above the ellipsoid, for use if PROJ has no geoid grid.", "METRES"),
    ] = None
    position_error: Annotated[float, option("Position error of photos that do not state one.", "METRES")] = 3.0
    height_error: Annotated[float, option("Height error of photos that do not state one.", "METRES")] = 10.0
    angle_error: Annotated[float, option("Error of the camera angles in the photo metadata.", "DEGREES")] = 2.0

    max_blur: Annotated[
        float | None, option("Ignore photos in which the ground moves more than this during the exposure.", "PIXELS")
    ] = None

    def assumed(self) -> dict[str, Any]:
        """Assumptions where photos record nothing, as arguments of `uavcover.extras.photos.placing.Assumptions`.

        Raises:
            InputError: a number is out of range.
        """
        from uavcover.errors import InputError

        for name, value in (
            ("--position-error", self.position_error), ("--height-error", self.height_error),
            ("--angle-error", self.angle_error),
        ):  # fmt: skip
            if not 0.0 <= value < 1000.0:
                raise InputError(f"{name}: {value:g} is out of range; use 0 or more")
        if self.max_blur is not None and not 0.0 < self.max_blur < 1000.0:
            raise InputError(f"--max-blur: {self.max_blur:g} is out of range; use pixels above 0, such as 1")
        if self.geoid_height is not None and not abs(self.geoid_height) <= 200.0:
            raise InputError(
                f"--geoid-height: {self.geoid_height:g} is out of range; it is between -110 and 90 m on Earth"
            )
        return {
            "horizontal_m": self.position_error, "vertical_m": self.height_error, "attitude_deg": self.angle_error,
            "geoid_height_m": self.geoid_height,
        }  # fmt: skip

    def position(self) -> tuple[float, float] | None:
        """Latitude and longitude of take-off."""
        from uavcover.new.quantities import lat_lon

        return None if self.takeoff is None else lat_lon(self.takeoff, option="--takeoff")


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """Target of the search, and the required probability of detection."""

    detection: Annotated[
        str | None, option("Detection curve: a name, your own TOML file, or list to show the names.", "NAME|FILE.toml")
    ] = None
    pod: Annotated[float | None, option("Required mean probability of detection, such as 0.8.")] = None

    def curve(self) -> "DetectionCurve | None":
        """Probability that one look finds the target; None without a search.

        Raises:
            InputError: it is not known, or the probability asked for is none.
        """
        from uavcover.errors import InputError
        from uavcover.new.catalog import CURVES

        if self.pod is not None and not 0.0 < self.pod <= 1.0:
            raise InputError(f"--pod: {self.pod:g} is not a probability; specify a value above 0 and at most 1")
        if self.detection is None:
            if self.pod is not None:
                raise InputError(
                    "--pod: this option requires --detection, the probability that one photo finds the target"
                )
            return None
        return CURVES.named(self.detection)


def list_curves(console: "Console") -> int:
    """Say which curves of detection come with the package."""
    from uavcover.new.catalog import CURVES

    curves = CURVES.by_name().values()
    console.say(f"{'curve':20}{'50 % detection at':>30}  title")
    for one in curves:
        console.say(f"{one.name:20}{f'{100.0 * one.half_at_m:.3g} cm per pixel':>30}  {one.title}")
    console.say("These curves are examples and rules of thumb; measure your own (docs/reference/detection.md)")
    console.result({"curves": [one.name for one in curves]})
    return 0


Dem = Annotated[
    list[str] | None,
    option("--dem", "Elevation data: a raster, or a folder or pattern of tiles. Can be repeated.", "FILE"),
]
Dsm = Annotated[
    list[str] | None,
    option(
        "--dsm",
        "Surface model with trees and roofs, in addition to the ground of --dem. Heights above ground "
        "then refer to the higher of both. Can be repeated.",
        "FILE",
    ),
]
VerticalDatum = Annotated[
    str | None,
    option("--vertical-datum", "Vertical datum of the elevation data: EGM96, EGM2008 or ellipsoid.", "DATUM"),
]
DemCrs = Annotated[
    str | None, option("--dem-crs", "Coordinate system of the elevation data, if the file does not state it.", "EPSG:N")
]
HeightUnit = Annotated[
    str | None,
    option("--height-unit", "Unit of the elevation data, if the file does not state it: m, cm, ft or us-ft.", "UNIT"),
]
At = Annotated[
    str | None,
    option(
        "--at",
        "Time of the flight, as START/END or START/2h, such as 2026-07-01T09:00Z/2h. The default duration is 2h. "
        "No-fly zones that are inactive during the flight are ignored.",
        "TIME",
    ),
]
WaterHeight = Annotated[
    str | None,
    option("--water-height", "Treat missing elevation data as open water at this altitude, such as 0m.", "HEIGHT"),
]
TrustDem = Annotated[
    bool,
    option("--trust-dem", "Accept suspicious elevation data, such as filled voids, spikes and steps between tiles."),
]
Band = Annotated[str | None, option("--band", "Number or name of the band with the heights; default: the first band.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class ElevationData:
    """Elevation files as the user names them, beside any scenario."""

    names: tuple[str, ...]  # files, folders or patterns of tiles
    vertical_datum: str | None = None  # "EGM96", "EGM2008" or "ellipsoid"; None: what the files say, or EGM96
    crs: str | None = None  # coordinate system, where the files name none
    height_unit: str | None = None  # "m", "dm", "cm", "ft" or "us-ft", where the files do not say
    band: str | None = None  # number or name of the band with the heights
    water_height: str | None = None  # of open water above sea level, as "0m"; None: places without data have no height
    option: str = "--dem"  # that names them, for errors


def open_elevation_data(data: ElevationData, *, around: "Bounds | None" = None) -> "tuple[TerrainSource, str]":
    """The files, and the datum of their heights.

    Args:
        data: what the user named.
        around: west, south, east, north in degrees of what is needed; of several files only those near it are taken.

    Raises:
        InputError: no file, or a unit or a datum that is not known.
        TerrainError: the files cannot be used.
    """
    from pathlib import Path
    from typing import get_args

    from uavcover.errors import InputError
    from uavcover.model.area import HeightUnit as HeightUnitName
    from uavcover.new.quantities import water_height_m
    from uavcover.new.terrain_look import possible_datums
    from uavcover.terrain.frames import ELLIPSOID, datum_named
    from uavcover.terrain.terrain_source import TerrainSource, find_tiles

    if not data.names:
        raise InputError(f"{data.option}: specify elevation data, such as a raster, a folder or a pattern of tiles")
    unit = None if data.height_unit is None else data.height_unit.casefold()
    if unit not in (None, *get_args(HeightUnitName)):
        raise InputError(f"--height-unit: unknown unit {data.height_unit!r}; use m, dm, cm, ft or us-ft")
    source = TerrainSource(
        find_tiles(data.names, folder=Path(), around=around),
        crs=data.crs,
        band=data.band,
        height_unit=unit,
        water_height_m=water_height_m(data.water_height),
        key=data.option,
    )
    fitting = possible_datums(source)
    if data.vertical_datum is None:
        return source, fitting[0]
    wanted = datum_named(data.vertical_datum)
    if wanted not in fitting and not (wanted == ELLIPSOID and len(fitting) > 1):
        raise InputError(f"--vertical-datum: the option is {wanted}, but {source} is {fitting[0]}; omit this option")
    return source, wanted


@dataclass(frozen=True, slots=True)
class DemOptions:
    """The elevation data, and properties that its file does not record."""

    dem: Dem = None
    vertical_datum: VerticalDatum = None
    dem_crs: DemCrs = None
    height_unit: HeightUnit = None
    band: Band = None
    water_height: WaterHeight = None

    def data(self) -> ElevationData:
        """The named elevation data."""
        return ElevationData(
            names=tuple(self.dem or ()),
            vertical_datum=self.vertical_datum,
            crs=self.dem_crs,
            height_unit=self.height_unit,
            band=self.band,
            water_height=self.water_height,
        )


@dataclass(frozen=True, slots=True)
class SurveyOptions:
    """Area, camera and vehicle of a survey."""

    dem: Dem = None
    dsm: Dsm = None
    camera: Annotated[str | None, option("Camera: a name, your own TOML file, or list to show the names.", "NAME")] = (
        None
    )
    gsd: Annotated[str | None, option("Maximum ground sample distance, such as 2.5cm.", "LENGTH")] = None
    overlap: Annotated[str | None, option("Forward and side overlap in percent; default: 75/70.", "F/S")] = None
    battery: Annotated[str | None, option("Flight time on a full battery, such as 25min.", "TIME")] = None
    vehicle: Annotated[
        str | None, option("Vehicle: a name, your own TOML file, or list to show the names.", "NAME")
    ] = None
    home: Annotated[
        str | None, option("Take-off position; default: the lowest level ground at the edge of the area.", "LAT,LON")
    ] = None
    max_height: Annotated[str | None, option("Maximum height above ground; default: 120m.", "LENGTH")] = None
    speed: Annotated[str | None, option("Ground speed; default: the vehicle's speed, or 10m/s.", "SPEED")] = None
    margin: Annotated[
        str | None,
        option("Distance by which the area is extended; default: far enough for full overlap at its edge.", "LENGTH"),
    ] = None
    mount: Annotated[str | None, option("Camera mount: stabilised (default) or fixed.", "MOUNT")] = None
    vertical_datum: VerticalDatum = None
    dem_crs: DemCrs = None
    height_unit: HeightUnit = None
    band: Band = None
    trust_dem: TrustDem = False
    fill_lakes: Annotated[
        str | None, option("Interpolate gaps in the elevation data up to this length, such as 200m.", "LENGTH")
    ] = None
    water_height: WaterHeight = None
    no_fly: Annotated[
        list[str] | None,
        option(
            "--no-fly",
            "No-fly zones: an ED-269, ED-318, OpenAir, GeoJSON or KML file, or another area format. Can be repeated.",
            "FILE",
        ),
    ] = None
    at: At = None
    pattern: Annotated[
        str | None,
        option(
            "--pattern",
            "Flight pattern: single (default), crosshatch (two crossing flights) or oblique (one vertical and "
            "four tilted flights).",
            "NAME",
        ),
    ] = None
    layer: Annotated[str | None, option("Layer or folder in the area file.")] = None
    feature: Annotated[str | None, option("Name or number (from 1) of a feature in the area file.")] = None
    crs: Annotated[
        str | None, option("Coordinate system of the area file, if the file does not state it.", "EPSG:N")
    ] = None
    make_valid: Annotated[
        bool, option("--make-valid", "Repair outlines that cross themselves, and close open rings.")
    ] = False
    swap_axes: Annotated[
        bool, option("--swap-axes", "Read coordinates in the area file as latitude (or north) first.")
    ] = False

    def given(self) -> list[str]:
        """The options that were given."""
        return [f"--{field.name.replace('_', '-')}" for field in fields(self) if getattr(self, field.name)]

    def request(self, area: str, *, autopilot: str | None) -> "NewRequest":
        """The request that these options make.

        Raises:
            InputError: an option was given without a value, as by a script whose variable is empty.
        """
        from uavcover.errors import InputError
        from uavcover.new.elevation_questions import NewRequest
        from uavcover.scenario.areas.area_file import AreaQuery

        if not area.strip():
            raise InputError("area: the argument is empty; specify a file, WEST,SOUTH,EAST,NORTH or LAT,LON,RADIUS")
        options = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in options.items():
            texts = value if isinstance(value, list) else [value]
            if any(isinstance(text, str) and not text.strip() for text in texts):
                raise InputError(f"--{name.replace('_', '-')}: the value is empty; specify a value, or omit the option")
        of_area = {name: options.pop(name) for name in ("layer", "feature", "crs", "make_valid", "swap_axes")}
        options |= {name: tuple(options[name] or ()) for name in ("dem", "dsm", "no_fly")}
        return NewRequest(area=AreaQuery(source=area, **of_area), autopilot=autopilot, **options)


def new(
    area: Annotated[
        str | None,
        typer.Argument(
            help=(
                "Area to cover: a GeoJSON, KML, KMZ, GeoPackage, Shapefile, WKT, .plan or .poly file; "
                "WEST,SOUTH,EAST,NORTH; or LAT,LON,RADIUS."
            ),
        ),
    ] = None,
    *,
    out: Annotated[
        Path | None, option("-o", "--out", "Scenario file to write; default: named after the area.", "FILE.toml")
    ] = None,
    survey: SurveyOptions,
    autopilot: options.Autopilot = None,
    force: options.Force = False,
    output: options.Output,
) -> int:
    """Create a scenario file from an area, an elevation model and a camera, and print the derived values.

    The file explains each key in a comment. To show known cameras or vehicles, use --camera list or --vehicle list.
    """
    from uavcover.errors import InputError, OutputError

    console = output.console()
    if "list" in (survey.camera, survey.vehicle):
        return _list(console, cameras=survey.camera == "list", vehicles=survey.vehicle == "list")
    from uavcover.new.command import new_scenarios, print_design, print_estimate
    from uavcover.new.survey import name_of  # the lists need no planner
    from uavcover.run.user import to_paste

    if area is None:
        raise InputError("new: specify an area, such as area.kml, with --dem dem.tif --camera NAME --gsd 2.5cm")
    path = out if out is not None else Path(f"{name_of(Path(area).stem)}.toml")
    if path.suffix.lower() != ".toml":
        raise InputError(f"-o: {path} is not a .toml file; use a name such as survey.toml")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist; create it first")
    _refuse_to_replace([path], force=force)
    scenarios = new_scenarios(survey.request(area, autopilot=autopilot), console, folder=path.parent)
    paths = [path.with_stem("-".join(part for part in (path.stem, each.view.name) if part)) for each in scenarios]
    _refuse_to_replace(paths, force=force)
    for scenario, file in zip(scenarios, paths, strict=True):
        file.write_text(scenario.text, encoding="utf-8")
    document = print_design(scenarios[0], console)
    estimates = [print_estimate(scenario, console) for scenario in scenarios]
    for file in paths:
        console.say(f"wrote {file}")
    console.suggest(*(to_paste("plan", file, "-o", file.stem, "--budget", "60s") for file in paths))
    flights = [{"scenario": str(file), **estimate} for file, estimate in zip(paths, estimates, strict=True)]
    console.result({**document, **flights[0], "flights": flights})
    return 0


def _refuse_to_replace(paths: list[Path], *, force: bool) -> None:
    from uavcover.errors import OutputError

    for path in paths:
        if path.exists() and not force:
            raise OutputError(f"{path} already exists; use --force to overwrite it, or choose another name with -o")


def _list(console: "Console", *, cameras: bool, vehicles: bool) -> int:
    from uavcover.new.catalog import CAMERAS, VEHICLES

    document: dict[str, Any] = {}
    if cameras:
        console.say(f"{'camera':32}{'pixels':>14}{'sensor':>16}{'lens':>10}{'interval':>10}  title")
        for camera in CAMERAS.by_name().values():
            interval = f"{camera.min_interval_s:g} s" if camera.min_interval_s is not None else "unknown"
            console.say(
                f"{camera.name:32}{f'{camera.pixels_across} x {camera.pixels_along}':>14}"
                f"{f'{camera.sensor_across_mm:.4g} x {camera.sensor_along_mm:.4g}':>16}{f'{camera.focal_length_mm:g} mm':>10}"
                f"{interval:>10}  {camera.title}"
            )
        document["cameras"] = list(CAMERAS.by_name())
    if vehicles:
        console.say(f"{'vehicle':20}{'endurance':>12}{'usual':>9}{'largest':>9}{'climb':>9}{'descent':>9}  title")
        for one in VEHICLES.by_name().values():
            air = "unknown" if one.endurance_s is None else f"{one.endurance_s / 60.0:.0f} min"
            speeds = "".join(
                f"{'unknown' if speed is None else f'{speed:g} m/s':>9}"
                for speed in (one.cruise_speed_m_s, one.max_speed_m_s, one.max_climb_m_s, one.max_descent_m_s)
            )
            console.say(f"{one.name:20}{air:>12}{speeds}  {one.title}")
        document["vehicles"] = list(VEHICLES.by_name())
    console.result(document)
    return 0
