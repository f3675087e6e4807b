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
        file: a path relative to the scenario file, `bundled:NAME` for included data, a folder of tiles, a pattern such
            as "tiles/*.hgt", a zipped tile, or a list of these.
        vertical_datum: vertical datum of the heights. Heights above the ellipsoid are converted to sea level (EGM96) if
            PROJ has the geoid grid.
        crs: coordinate system, such as "EPSG:32632", if the file does not state it.
        band: number or name of the band with the heights; default: the first band.
        height_unit: unit of the heights if the file does not state it; default: metres.
        fill_no_data_m: longest gap without data that is interpolated from its edge, such as a lake.
        water_height_m: altitude of open water, which replaces missing data in and around the files; default: missing
            data has no height.
        trust_heights: whether to accept heights that look like a filled void, the edge of a warped image, a spike or a
            step between tiles; otherwise such heights stop the planning.
        grid_step_m: spacing of a square grid to which the data is resampled; default: the pixels of the file.
        surface_file: a surface model with trees and roofs for the same area, in any form that `file` accepts. Heights
            above ground then refer to the higher of both models, and the surface can hide the ground.
        surface_vertical_datum: vertical datum of the surface model; default: `vertical_datum`.
        surface_crs: coordinate system of the surface model if the file does not state it.
        surface_band: number or name of the band of the surface model; default: the first band.
        surface_height_unit: unit of the surface model if the file does not state it.
        surface_hides_m: height of the surface above the ground from which trees or roofs hide the ground.
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
        require(bool(self.file), "file: the name is empty; specify an elevation file")
        require(
            self.surface_file is None or bool(self.surface_file),
            "surface_file: the name is empty; specify a surface model",
        )
        for key in ("surface_vertical_datum", "surface_crs", "surface_band", "surface_height_unit"):
            require(
                self.surface_file is not None or getattr(self, key) is None,
                f"{key}: this key describes a surface model; add surface_file, or remove this key",
            )
        band = self.surface_band
        require(
            not isinstance(band, int) or band >= 1, f"surface_band: must be at least 1 (the first band), not {band}"
        )
        require_positive(self, "surface_hides_m")
        require(
            not isinstance(self.band, int) or self.band >= 1,
            f"band: must be at least 1 (the first band), not {self.band}",
        )
        require_not_negative(self, "fill_no_data_m")
        require(
            self.fill_no_data_m == 0.0 or self.grid_step_m is None,
            "fill_no_data_m: this key requires the file's own pixels; remove grid_step_m",
        )
        require(
            self.water_height_m is None or self.fill_no_data_m == 0.0,
            "water_height_m: use either this key, which treats gaps as water, or fill_no_data_m, which treats them as ground",
        )
        require(
            self.water_height_m is None or -500.0 <= self.water_height_m <= 9000.0,
            f"water_height_m: must be between -500 and 9000 m, not {self.water_height_m}",
        )
        require_positive(self, "grid_step_m")


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
        require_positive(self, "scale_m")


Terrain = RasterTerrain | SineCosineTerrain
