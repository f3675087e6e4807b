"""The options that make a survey of an area, for ``new`` and ``plan``."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from uavcover.flight.vehicle_terrain import ElevationData
    from uavcover.new.elevation_questions import NewRequest


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
            "Time of the flight, as START/END or START/2h, such as 2026-07-01T09:00Z/2h. The default "
            "duration is 2h. No-fly zones that are inactive then do not count."
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
        "--trust-dem",
        help="Accept suspicious elevation data, such as filled voids, spikes and steps between tiles.",
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
        str | None,
        typer.Option("--camera", help="Camera: a name, your own TOML file, or list to show the names.", metavar="NAME"),
    ] = None
    gsd: Annotated[
        str | None, typer.Option("--gsd", help="Largest ground sample distance, such as 2.5cm.", metavar="LENGTH")
    ] = None
    overlap: Annotated[
        str | None,
        typer.Option("--overlap", help="Forward and side overlap in percent; default: 75/70.", metavar="F/S"),
    ] = None
    battery: Annotated[
        str | None, typer.Option("--battery", help="Flight time of a full battery, such as 25min.", metavar="TIME")
    ] = None
    vehicle: Annotated[
        str | None,
        typer.Option(
            "--vehicle", help="Vehicle: a name, your own TOML file, or list to show the names.", metavar="NAME"
        ),
    ] = None
    home: Annotated[
        str | None,
        typer.Option(
            "--home",
            help="Take-off position; default: the lowest level ground at the edge of the area.",
            metavar="LAT,LON",
        ),
    ] = None
    max_height: Annotated[
        str | None,
        typer.Option("--max-height", help="Greatest height above ground; default: 120m.", metavar="LENGTH"),
    ] = None
    speed: Annotated[
        str | None,
        typer.Option("--speed", help="Ground speed; default: that of the vehicle, or 10m/s.", metavar="SPEED"),
    ] = None
    margin: Annotated[
        str | None,
        typer.Option(
            "--margin",
            help="Distance by which the area is extended; default: far enough for full overlap at its edge.",
            metavar="LENGTH",
        ),
    ] = None
    mount: Annotated[
        str | None, typer.Option("--mount", help="Mount of the camera: stabilised (default) or fixed.", metavar="MOUNT")
    ] = None
    vertical_datum: VerticalDatum = None
    dem_crs: DemCrs = None
    height_unit: HeightUnit = None
    band: Band = None
    trust_dem: TrustDem = False
    fill_lakes: Annotated[
        str | None,
        typer.Option(
            "--fill-lakes",
            help="Interpolate gaps in the elevation data up to this length, such as 200m.",
            metavar="LENGTH",
        ),
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
                "Flights over the area: single (default), crosshatch (two crossing flights) or oblique (one "
                "vertical and four tilted flights)."
            ),
            metavar="NAME",
        ),
    ] = None
    layer: Annotated[str | None, typer.Option("--layer", help="Layer or folder in the area file.")] = None
    feature: Annotated[
        str | None, typer.Option("--feature", help="Name or number (from 1) of a feature in the area file.")
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", help="Coordinate system of the area file, if the file does not state it.", metavar="EPSG:N"
        ),
    ] = None
    make_valid: Annotated[
        bool, typer.Option("--make-valid", help="Repair outlines that cross themselves, and close open rings.")
    ] = False
    swap_axes: Annotated[bool, typer.Option("--swap-axes", help="Read latitude or north first in the area file.")] = (
        False
    )

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
            raise InputError("the area: the argument is empty; specify a file, WEST,SOUTH,EAST,NORTH or LAT,LON,RADIUS")
        for option in fields(self):
            value = getattr(self, option.name)
            if any(
                isinstance(text, str) and not text.strip() for text in (value if isinstance(value, list) else [value])
            ):
                raise InputError(
                    f"--{option.name.replace('_', '-')}: the value is empty; specify a value, or omit the option"
                )
        query = AreaQuery(
            source=area, layer=self.layer, feature=self.feature, crs=self.crs, make_valid=self.make_valid,
            swap_axes=self.swap_axes,
        )  # fmt: skip
        return NewRequest(
            area=query, dem=tuple(self.dem or ()), camera=self.camera, gsd=self.gsd, overlap=self.overlap, battery=self.battery,
            vehicle=self.vehicle, home=self.home, max_height=self.max_height, speed=self.speed, margin=self.margin,
            mount=self.mount, vertical_datum=self.vertical_datum, autopilot=autopilot,
            dem_crs=self.dem_crs, height_unit=self.height_unit, band=self.band, fill_lakes=self.fill_lakes,
            water_height=self.water_height,
            no_fly=tuple(self.no_fly or ()), at=self.at, pattern=self.pattern,
            dsm=tuple(self.dsm or ()), trust_dem=self.trust_dem,
        )  # fmt: skip
