"""The options that make a survey of an area, for ``new`` and ``plan``."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.flight.vehicle_terrain import ElevationData
    from uavcover.new.detection import DetectionCurve
    from uavcover.new.elevation_questions import NewRequest

# Options for the accuracy of photos, and for the target of a search, of ``judge-photos`` and ``verify``.


@dataclass(frozen=True, slots=True)
class PhotoOptions:
    """Heights of photos, and assumed errors where they record none."""

    takeoff: Annotated[
        str | None,
        typer.Option(
            help="Take-off position of the vehicle. Photo heights are then relative to it.", metavar="LAT,LON"
        ),
    ] = None
    geoid_height: Annotated[
        float | None,
        typer.Option(
            help="Height of mean sea level above the ellipsoid, for use if PROJ has no geoid grid.", metavar="METRES"
        ),
    ] = None
    position_error: Annotated[
        float, typer.Option(help="Position error of photos that do not state one.", metavar="METRES")
    ] = 3.0
    height_error: Annotated[
        float, typer.Option(help="Height error of photos that do not state one.", metavar="METRES")
    ] = 10.0
    angle_error: Annotated[
        float, typer.Option(help="Error of the camera angles in the photo metadata.", metavar="DEGREES")
    ] = 2.0

    max_blur: Annotated[
        float | None,
        typer.Option(
            help="Ignore photos in which the ground moves more than this during the exposure.", metavar="PIXELS"
        ),
    ] = None

    def assumed(self) -> dict[str, Any]:
        """Assumptions where photos record nothing, as arguments of `uavcover.extras.photos.placing.Assumptions`.

        Raises:
            InputError: a number is out of range.
        """
        from uavcover.errors import InputError

        for option, value in (
            ("--position-error", self.position_error), ("--height-error", self.height_error),
            ("--angle-error", self.angle_error),
        ):  # fmt: skip
            if not 0.0 <= value < 1000.0:
                raise InputError(f"{option}: {value:g} is out of range; use 0 or more")
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

    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude of take-off."""
        from uavcover.new.quantities import lat_lon

        return None if self.takeoff is None else lat_lon(self.takeoff, option="--takeoff")


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """Target of the search, and the required probability of detection."""

    detection: Annotated[
        str | None,
        typer.Option(
            help="Detection curve: a name, your own TOML file, or list to show the names.", metavar="NAME|FILE.toml"
        ),
    ] = None
    pod: Annotated[float | None, typer.Option(help="Required mean probability of detection, such as 0.8.")] = None

    def curve(self) -> "DetectionCurve | None":
        """Probability that one look finds the target; none without a search.

        Raises:
            InputError: it is not known, or the probability asked for is none.
        """
        from uavcover.errors import InputError
        from uavcover.new.detection import curve_named

        if self.pod is not None and not 0.0 < self.pod <= 1.0:
            raise InputError(f"--pod: {self.pod:g} is not a probability; specify a value above 0 and at most 1")
        if self.detection is None:
            if self.pod is not None:
                raise InputError(
                    "--pod: this option requires --detection, the probability that one photo finds the target"
                )
            return None
        return curve_named(self.detection)


def list_curves(console: "Console") -> int:
    """Say which curves of detection come with the package."""
    from uavcover.new.detection import all_curves

    curves = all_curves()
    console.say(f"{'curve':20}{'50 % detection at':>30}  title")
    for one in curves:
        console.say(f"{one.name:20}{f'{100.0 * one.half_at_m:.3g} cm per pixel':>30}  {one.title}")
    console.say("These curves are examples and rules of thumb; measure your own (docs/reference/detection.md)")
    console.result({"curves": [one.name for one in curves]})
    return 0


Dem = Annotated[
    list[str] | None,
    typer.Option(
        "--dem", help="Elevation data: a raster, or a folder or pattern of tiles. Can be repeated.", metavar="FILE"
    ),
]
Dsm = Annotated[
    list[str] | None,
    typer.Option(
        "--dsm",
        help=(
            "Surface model with trees and roofs, in addition to the ground of --dem. Heights above ground "
            "then refer to the higher of both. Can be repeated."
        ),
        metavar="FILE",
    ),
]
VerticalDatum = Annotated[
    str | None,
    typer.Option(
        "--vertical-datum", help="Vertical datum of the elevation data: EGM96, EGM2008 or ellipsoid.", metavar="DATUM"
    ),
]
DemCrs = Annotated[
    str | None,
    typer.Option(
        "--dem-crs", help="Coordinate system of the elevation data, if the file does not state it.", metavar="EPSG:N"
    ),
]
HeightUnit = Annotated[
    str | None,
    typer.Option(
        "--height-unit",
        help="Unit of the elevation data, if the file does not state it: m, cm, ft or us-ft.",
        metavar="UNIT",
    ),
]
At = Annotated[
    str | None,
    typer.Option(
        "--at",
        help=(
            "Time of the flight, as START/END or START/2h, such as 2026-07-01T09:00Z/2h. The default duration is 2h. "
            "No-fly zones that are inactive during the flight are ignored."
        ),
        metavar="TIME",
    ),
]
WaterHeight = Annotated[
    str | None,
    typer.Option(
        "--water-height",
        help="Treat missing elevation data as open water at this altitude, such as 0m.",
        metavar="HEIGHT",
    ),
]
TrustDem = Annotated[
    bool,
    typer.Option(
        "--trust-dem", help="Accept suspicious elevation data, such as filled voids, spikes and steps between tiles."
    ),
]
Band = Annotated[
    str | None, typer.Option("--band", help="Number or name of the band with the heights; default: the first band.")
]


@dataclass(frozen=True, slots=True)
class DemOptions:
    """The elevation data, and properties that its file does not record."""

    dem: Dem = None
    vertical_datum: VerticalDatum = None
    dem_crs: DemCrs = None
    height_unit: HeightUnit = None
    band: Band = None
    water_height: WaterHeight = None

    def data(self) -> "ElevationData":
        """The named elevation data."""
        from uavcover.flight.vehicle_terrain import ElevationData

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
    camera: Annotated[
        str | None, typer.Option(help="Camera: a name, your own TOML file, or list to show the names.", metavar="NAME")
    ] = None
    gsd: Annotated[
        str | None, typer.Option(help="Maximum ground sample distance, such as 2.5cm.", metavar="LENGTH")
    ] = None
    overlap: Annotated[
        str | None, typer.Option(help="Forward and side overlap in percent; default: 75/70.", metavar="F/S")
    ] = None
    battery: Annotated[
        str | None, typer.Option(help="Flight time on a full battery, such as 25min.", metavar="TIME")
    ] = None
    vehicle: Annotated[
        str | None, typer.Option(help="Vehicle: a name, your own TOML file, or list to show the names.", metavar="NAME")
    ] = None
    home: Annotated[
        str | None,
        typer.Option(
            help="Take-off position; default: the lowest level ground at the edge of the area.", metavar="LAT,LON"
        ),
    ] = None
    max_height: Annotated[
        str | None, typer.Option(help="Maximum height above ground; default: 120m.", metavar="LENGTH")
    ] = None
    speed: Annotated[
        str | None, typer.Option(help="Ground speed; default: the vehicle's speed, or 10m/s.", metavar="SPEED")
    ] = None
    margin: Annotated[
        str | None,
        typer.Option(
            help="Distance by which the area is extended; default: far enough for full overlap at its edge.",
            metavar="LENGTH",
        ),
    ] = None
    mount: Annotated[str | None, typer.Option(help="Camera mount: stabilised (default) or fixed.", metavar="MOUNT")] = (
        None
    )
    vertical_datum: VerticalDatum = None
    dem_crs: DemCrs = None
    height_unit: HeightUnit = None
    band: Band = None
    trust_dem: TrustDem = False
    fill_lakes: Annotated[
        str | None,
        typer.Option(help="Interpolate gaps in the elevation data up to this length, such as 200m.", metavar="LENGTH"),
    ] = None
    water_height: WaterHeight = None
    no_fly: Annotated[
        list[str] | None,
        typer.Option(
            "--no-fly",
            help=(
                "No-fly zones: an ED-269, ED-318, OpenAir, GeoJSON or KML file, or another area format. Can be "
                "repeated."
            ),
            metavar="FILE",
        ),
    ] = None
    at: At = None
    pattern: Annotated[
        str | None,
        typer.Option(
            "--pattern",
            help=(
                "Flight pattern: single (default), crosshatch (two crossing flights) or oblique (one vertical and "
                "four tilted flights)."
            ),
            metavar="NAME",
        ),
    ] = None
    layer: Annotated[str | None, typer.Option(help="Layer or folder in the area file.")] = None
    feature: Annotated[str | None, typer.Option(help="Name or number (from 1) of a feature in the area file.")] = None
    crs: Annotated[
        str | None,
        typer.Option(help="Coordinate system of the area file, if the file does not state it.", metavar="EPSG:N"),
    ] = None
    make_valid: Annotated[
        bool, typer.Option("--make-valid", help="Repair outlines that cross themselves, and close open rings.")
    ] = False
    swap_axes: Annotated[
        bool, typer.Option("--swap-axes", help="Read coordinates in the area file as latitude (or north) first.")
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
