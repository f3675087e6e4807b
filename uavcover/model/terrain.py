"""Sources of ground heights."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uavcover.model.value_checks import STRICT, require, require_not_negative, require_positive

VerticalDatum = Literal["EGM96", "EGM2008", "WGS84-ellipsoid"]
HeightUnit = Literal["m", "dm", "cm", "ft", "us-ft"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RasterTerrain:
    """Elevation data in a file that rasterio reads.

    Attributes:
        kind: name of this source in a scenario.
        file: a path relative to the scenario file, or ``bundled:NAME`` for data that comes with the package; or a folder of
            tiles, a pattern such as "tiles/*.hgt", a zipped tile, or a list of these.
        vertical_datum: reference of the heights. Heights above the ellipsoid are brought to sea level (EGM96), with a geoid grid
            that PROJ has.
        crs: coordinate system, such as "EPSG:32632", where the file does not name its own.
        band: number or name of the band with the heights; default: the first.
        height_unit: unit of the heights, where the file does not say; default: metres, or what the file says.
        fill_no_data_m: gaps without data up to this long, such as lakes, are closed by interpolation from their rim.
        water_height_m: height of open water above sea level: wherever there is no data, also around the files, is water of this
            height; default: such places have no height.
        trust_heights: whether heights are taken as they are where they look like a filled void, a warp's collar, a spike or a
            step between tiles; without it such places stop planning.
        grid_step_m: step of a square grid to resample the data to; default: none, the ground keeps the file's pixels.
        surface_file: a surface model, with trees and roofs, of the same place; named as ``file`` is. Flights keep their heights
            above the higher of the two, and what it covers is hidden; ``file`` is the ground that is looked at.
        surface_vertical_datum: reference of the surface model's heights; default: ``vertical_datum``.
        surface_crs: coordinate system of the surface model, where the file does not name its own.
        surface_band: number or name of its band; default: the first.
        surface_height_unit: unit of its heights, where the file does not say.
        surface_hides_m: ground that lies more than this under the surface is hidden by trees or a roof; lower growth, and the
            errors of both models, hide nothing.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["raster"]
    file: str | tuple[str, ...]
    vertical_datum: VerticalDatum
    crs: str | None = None
    band: int | str | None = None
    height_unit: HeightUnit | None = None
    fill_no_data_m: float = 0.0
    water_height_m: float | None = None
    trust_heights: bool = False
    grid_step_m: float | None = None
    surface_file: str | tuple[str, ...] | None = None
    surface_vertical_datum: VerticalDatum | None = None
    surface_crs: str | None = None
    surface_band: int | str | None = None
    surface_height_unit: HeightUnit | None = None
    surface_hides_m: float = 2.0

    def __post_init__(self) -> None:
        require(bool(self.file), "file: is empty; give an elevation file")
        require(self.surface_file is None or bool(self.surface_file), "surface_file: is empty; give a surface model")
        for key in ("surface_vertical_datum", "surface_crs", "surface_band", "surface_height_unit"):
            require(
                self.surface_file is not None or getattr(self, key) is None,
                f"{key}: says how a surface model is read; give surface_file too, or leave it out",
            )
        band = self.surface_band
        require(not isinstance(band, int) or band >= 1, f"surface_band: {band} is below 1, the first band")
        require_positive(surface_hides_m=self.surface_hides_m)
        require(not isinstance(self.band, int) or self.band >= 1, f"band: {self.band} is below 1, the first band")
        require_not_negative(fill_no_data_m=self.fill_no_data_m)
        require(
            self.fill_no_data_m == 0.0 or self.grid_step_m is None,
            "fill_no_data_m: requires the file's own pixels; leave grid_step_m out",
        )
        require(
            self.water_height_m is None or self.fill_no_data_m == 0.0,
            "water_height_m: makes water of all gaps, and fill_no_data_m ground; give one of the two",
        )
        require(
            self.water_height_m is None or -500.0 <= self.water_height_m <= 9000.0,
            f"water_height_m: {self.water_height_m} is outside -500..9000 m",
        )
        if self.grid_step_m is not None:
            require_positive(grid_step_m=self.grid_step_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class SineCosineTerrain:
    """The paper's surface, Eq. 26: z = s sin(y / s) cos(x / s), with s = ``scale_m`` metres to the paper's unit.

    Attributes:
        kind: name of this source in a scenario.
        scale_m: metres per unit of the paper.
    """

    __pydantic_config__: ClassVar = STRICT

    kind: Literal["sine-cosine"]
    scale_m: float = 1.0

    def __post_init__(self) -> None:
        require_positive(scale_m=self.scale_m)


Terrain = RasterTerrain | SineCosineTerrain
