"""Sources of elevation data: a file, a packed file, or adjacent tiles, which GDAL then reads as one raster."""

import gzip
import hashlib
import math
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import rasterio
import rasterio.errors
from pyproj import CRS
from pyproj.exceptions import CRSError
from rasterio.warp import transform_bounds

from mission_io.data_tables import data_table
from mission_io.model.items import M_PER_DEG
from uavcover.errors import NoTileNearError, TerrainError
from uavcover.terrain.frames import Bounds


@dataclass(frozen=True, slots=True, kw_only=True)
class _Files:
    max_nodes: int
    max_error_m: float
    checked_blocks: int
    pixels_of_block: float
    positions_of_block: int
    above_m: float
    most_pixels: int
    harmless_zip_bytes: int
    max_gzip_bytes: int
    max_tiles: int
    around_deg: float
    off_grid: float
    water_m: float


FILES = data_table(_Files, "uavcover/data/terrain.toml", "files")


# Packed elevation files: the one raster inside a zip or gzip file, which GDAL reads in place, within limits.

RASTERS = (".tif", ".tiff", ".hgt", ".img", ".asc", ".dt1", ".dt2")
_GZIPPED = tuple(f"{suffix}.gz" for suffix in RASTERS)
_OTHER_ARCHIVES = (".gz", ".tgz", ".tar", ".bz2", ".xz", ".zst", ".7z", ".rar")
MAX_ZIP_ENTRIES, MAX_ZIP_BYTES, MAX_ZIP_RATIO = 500, 2_000_000_000, 200.0
_BLOCK_BYTES = 1 << 20


def is_tile(file: Path) -> bool:
    """Whether a file of a folder counts as a tile, by its name. Of zip files those with a raster inside, and damaged ones."""
    name = file.name.lower()
    if not name.endswith(".zip"):
        return name.endswith((*RASTERS, *_GZIPPED))
    try:
        with zipfile.ZipFile(file) as archive:
            return any(entry.lower().endswith(RASTERS) for entry in archive.namelist())
    except (zipfile.BadZipFile, OSError):
        return True  # its own error tells more


def gdal_name(file: Path) -> str:
    """Name for GDAL: the file, or the only raster inside a packed one.

    Raises:
        TerrainError: it is packed in a way that is not read, holds none or several rasters, is damaged, or beyond the limits.
    """
    name = file.name.lower()
    if name.endswith(".zip"):
        return _inside_zip(file)
    if name.endswith(_GZIPPED):
        stat = file.stat()
        _check_gzip(file, stat.st_size, stat.st_mtime_ns)
        return f"/vsigzip/{file.resolve()}"
    if name.endswith(_OTHER_ARCHIVES):
        raise TerrainError(f"{file}: the file is compressed ({file.suffix}); unpack it and specify the raster")
    return str(file)


def _inside_zip(file: Path) -> str:
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, OSError) as error:
        raise TerrainError(f"{file}: cannot open the file as a zip archive ({error}); unpack it yourself") from error
    rasters = [entry for entry in entries if entry.filename.lower().endswith(RASTERS)]
    if len(entries) > MAX_ZIP_ENTRIES or len(rasters) != 1:
        raise TerrainError(
            f"{file}: the archive must contain one elevation file, but {len(rasters)} of its {len(entries)} entries "
            "are elevation files; unpack it yourself"
        )
    (entry,) = rasters
    ratio = entry.file_size / max(entry.compress_size, 1)
    if entry.file_size > MAX_ZIP_BYTES or (entry.file_size > FILES.harmless_zip_bytes and ratio > MAX_ZIP_RATIO):
        raise TerrainError(
            f"{file}: {entry.filename} unpacks to {entry.file_size:,} bytes, {ratio:.0f} times its packed size; "
            "unpack it yourself if you trust it"
        )
    return f"/vsizip/{file}/{entry.filename}"


@lru_cache(maxsize=1024)
def _check_gzip(file: Path, _packed_bytes: int, _changed_ns: int) -> None:
    """Unpack the file, once for each of its states, and keep nothing. GDAL checks only what it reads, and no length is stated."""
    size = 0
    try:
        with gzip.open(file) as stream:
            while block := stream.read(_BLOCK_BYTES):
                size += len(block)
                if size > FILES.max_gzip_bytes:
                    raise TerrainError(
                        f"{file}: the archive unpacks to more than {FILES.max_gzip_bytes:,} bytes; unpack it "
                        "yourself (gunzip) if you trust it"
                    )
    except (OSError, EOFError, zlib.error) as error:
        raise TerrainError(f"{file}: the file cannot be unpacked ({error}); download it again") from error
    if size == 0:
        raise TerrainError(f"{file}: the archive is empty; download it again")


_CACHE_BYTES = 128 * 2**20
_HEIGHTS = re.compile(r"elev|height|altitude|h(ö|oe)he|(?<![a-z])(dem|dtm|dsm|dgm|mnt|mdt|z)(?![a-z])", re.IGNORECASE)
"""In the name of a band."""


@dataclass(frozen=True, slots=True)
class TerrainSource:
    """One or more files whose pixels lie on one grid."""

    files: tuple[Path, ...]  # the files
    crs: str | None = None  # coordinate system, where the files do not name theirs
    band: int | str | None = None  # number or name of the band with the heights; None: the first
    height_unit: str | None = None  # unit of the heights, where the files do not say
    fill_no_data_m: float = 0.0  # gaps without data up to this long are closed by interpolation
    # height above sea level of open water, which is wherever there is no data, also around the files; None: such places have no
    # height
    water_height_m: float | None = None
    key: str = "terrain.file"  # of the scenario, or the option, for errors

    def __str__(self) -> str:
        more = len(self.files) - 1
        return str(self.files[0]) if not more else f"{self.files[0]} and {more} more"

    @property
    def name(self) -> str:
        """Name of the file, or of the first one."""
        more = len(self.files) - 1
        return self.files[0].name if not more else f"{self.files[0].name} and {more} more"

    @contextmanager
    def opened(self) -> Iterator[Any]:
        """The raster, open.

        Raises:
            TerrainError: a file is not there, empty, lies on another grid than the first, or names its coordinate system itself.
            rasterio.errors.RasterioError, OSError: it cannot be read.
        """
        for file in self.files:
            if not file.is_file():
                relative = "" if self.key.startswith("--") else f" ({self.key} is relative to the scenario file)"
                raise TerrainError(
                    f"{file}: no such file{relative or f'; set {self.key} to a raster, a folder or a pattern'}"
                )
            if file.stat().st_size == 0:
                raise TerrainError(f"{file}: the file is empty; download it again")
        around_m = 0.0 if self.water_height_m is None else FILES.water_m
        name = (
            _mosaic(self.files, self.band, self.crs, around_m=around_m)
            if self._is_virtual
            else gdal_name(self.files[0])
        )
        with _gdal(), rasterio.open(name) as dataset:
            yield dataset

    @property
    def _is_virtual(self) -> bool:
        return len(self.files) > 1 or self.crs is not None or self.water_height_m is not None

    def band_of(self, dataset: Any) -> int:
        """Number of the band with the heights, in an open raster; adjacent tiles share one.

        Raises:
            TerrainError: there is no such band.
        """
        return 1 if self._is_virtual else band_number(dataset, self.band, self.files[0])

    def sha256(self) -> str:
        """Hash of the data: of a file, or of the names and hashes of all files that GDAL reads for it.

        A world file or an ``.aux.xml`` beside it shifts or scales the heights, and a virtual raster keeps them in other files.

        Raises:
            OSError: a file, or one that it needs, cannot be read.
        """
        files = set(self.files)
        for file in self.files:
            try:
                with rasterio.open(file) as dataset:
                    files |= {Path(name) for name in dataset.files if Path(name).is_file()}
            except rasterio.errors.RasterioError:
                continue
        if len(files) == 1:
            return _sha256(self.files[0])
        names = [f"{file.name} {_sha256(file)}\n" for file in sorted(files)]
        return hashlib.sha256("".join(names).encode()).hexdigest()


def band_number(dataset: Any, band: int | str | None, file: Path) -> int:
    """Number of a band by number or name.

    Raises:
        TerrainError: there is none, or none is requested and the first does not seem to be it; says which there are.
    """
    names = [name or "" for name in dataset.descriptions]
    there = ", ".join(f"{number} {name}".strip() for number, name in enumerate(names, start=1))
    if band is None:
        others = [name for name in names[1:] if _HEIGHTS.search(name)]
        if others and names[0] and not _HEIGHTS.search(names[0]):
            raise TerrainError(
                f"{file}: the first band is {names[0]!r}, but the band {others[0]!r} seems to contain the heights; "
                f"set terrain.band (--band) to one of: {there}"
            )
        return 1
    if isinstance(band, int) or band.isdigit():
        if 1 <= int(band) <= dataset.count:
            return int(band)
    else:
        alike = [number for number, name in enumerate(names, start=1) if name.casefold() == band.casefold()]
        if alike:
            return alike[0]
    raise TerrainError(f"{file}: the file has no band {band!r}; set terrain.band to one of: {there}")


def as_source(source: "Path | TerrainSource") -> TerrainSource:
    """A file, or several, as a source."""
    return source if isinstance(source, TerrainSource) else TerrainSource((source,))


def find_tiles(
    names: Sequence[str], *, folder: Path, around: Bounds | None, key: str = "terrain.file"
) -> tuple[Path, ...]:
    """The files of names: a file, a folder of tiles, a pattern such as ``tiles/*.hgt``, or several of them.

    Args:
        names: as in the scenario.
        folder: base of relative paths.
        around: west, south, east, north in degrees of the required ground; of several files only nearby ones are used.
        key: of the scenario, or the option, for errors.

    Raises:
        NoTileNearError: none of the tiles is near.
        TerrainError: a folder or a pattern has no tile, or too many.
    """
    found: list[Path] = []
    for name in names:
        path = (folder / name).resolve()
        if path.is_dir():
            tiles = sorted(tile for tile in path.iterdir() if is_tile(tile))
        elif any(sign in name for sign in "*?[") and not path.exists():
            pattern = Path(name)
            base = Path(pattern.anchor) if pattern.is_absolute() else folder
            tiles = sorted(
                tile.resolve() for tile in base.glob(str(pattern.relative_to(pattern.anchor))) if tile.is_file()
            )
        else:
            found.append(path)
            continue
        if not tiles:
            raise TerrainError(
                f"{key}: {name} contains no tiles ({', '.join(RASTERS)}, .zip, .gz); use files, a folder or a "
                "pattern with tiles"
            )
        found += tiles
    found = list(dict.fromkeys(found))
    if len(found) > FILES.max_tiles:
        raise TerrainError(
            f"{key}: {len(found)} tiles exceed the limit of {FILES.max_tiles}; use only the tiles of the area"
        )
    if len(found) > 1 and around is not None:
        near = [tile for tile in found if _is_near(tile, around)]
        if not near:
            west, south, east, north = around
            raise NoTileNearError(
                f"{key}: none of {len(found)} tiles is near the area (latitude {south:.3f} to {north:.3f}, longitude "
                f"{west:.3f} to {east:.3f}); use the tiles of that location"
            )
        found = near
    return tuple(found)


def _gdal() -> rasterio.Env:
    """Settings of GDAL while a file is open.

    It leaves no notes (``.gz.properties``) beside the user's files and caches little; by default it would use a twentieth of the
    machine's memory.
    """
    return rasterio.Env(CPL_VSIL_GZIP_WRITE_PROPERTIES="NO", GDAL_CACHEMAX=_CACHE_BYTES)


def _is_near(tile: Path, around: Bounds) -> bool:
    west, south, east, north = around
    try:
        with _gdal(), rasterio.open(gdal_name(tile)) as dataset:
            if dataset.crs is None:
                return True
            bounds = transform_bounds(dataset.crs, "EPSG:4326", *dataset.bounds)
    except (rasterio.errors.RasterioError, OSError):
        return True  # its own error tells more
    low, bottom, high, top = bounds
    high += 360.0 if high < low else 0.0
    margin = FILES.around_deg
    if bottom > north + margin or top < south - margin:
        return False
    return any(low + turn <= east + margin and high + turn >= west - margin for turn in (-360.0, 0.0, 360.0))


@dataclass(frozen=True, slots=True)
class _Tile:
    file: Path
    name: str
    wkt: str
    transform: Any
    size: tuple[int, int]
    unit: str
    scale: tuple[float, float]
    band: int
    turn: float
    unit_m: float


def _mosaic(files: Sequence[Path], band: int | str | None, crs: str | None, *, around_m: float) -> str:
    """A virtual raster of tiles, pixel by pixel. Between the tiles and within ``around_m`` there is no data."""
    tiles = [_tile(file, band, None if crs is None else _wkt(crs)) for file in files]
    first = tiles[0]
    a, b, c, d, e, f = tuple(first.transform)[:6]
    if b or d:
        raise TerrainError(
            f"{first.file}: the grid is rotated, which is not supported for several tiles; merge them first (gdalwarp)"
        )
    corners = []
    for tile in tiles:
        for what, mine, other in (
            ("coordinate system", tile.wkt, first.wkt), ("unit", tile.unit, first.unit), ("scale", tile.scale, first.scale),
        ):  # fmt: skip
            if mine != other:
                raise TerrainError(
                    f"{tile.file}: the {what} differs from that of {first.file.name}; merge the tiles first "
                    "(gdalbuildvrt, gdalwarp)"
                )
        other_grid = tuple(tile.transform)[:6]
        size_differs = not np.allclose([other_grid[k] for k in (0, 1, 3, 4)], (a, b, d, e), rtol=1e-6, atol=0.0)
        column, row = (tile.transform.c - c) / a, (tile.transform.f - f) / e
        # Tiles that meet at 180 degrees are adjacent.
        turn = tile.turn / a
        column -= turn * round(column / turn) if turn else 0.0
        if size_differs or max(abs(column - round(column)), abs(row - round(row))) > FILES.off_grid:
            raise TerrainError(
                f"{tile.file}: the pixel grid differs from that of {first.file.name}; merge the tiles first (gdalwarp)"
            )
        corners.append((round(column), round(row)))
    around = math.ceil(around_m / (abs(a) * first.unit_m))
    left, top = min(x for x, _ in corners) - around, min(y for _, y in corners) - around
    width = max(x + t.size[0] for (x, _), t in zip(corners, tiles, strict=True)) - left + around
    height = max(y + t.size[1] for (_, y), t in zip(corners, tiles, strict=True)) - top + around
    sources = "".join(_source(tile, x - left, y - top) for tile, (x, y) in zip(tiles, corners, strict=True))
    scale, offset = first.scale
    return (
        f'<VRTDataset rasterXSize="{width}" rasterYSize="{height}"><SRS>{escape(first.wkt)}</SRS>'
        f"<GeoTransform>{c + a * left!r},{a!r},0.0,{f + e * top!r},0.0,{e!r}</GeoTransform>"
        '<VRTRasterBand dataType="Float64" band="1"><NoDataValue>nan</NoDataValue>'
        f"<UnitType>{escape(first.unit)}</UnitType><Scale>{scale!r}</Scale><Offset>{offset!r}</Offset>"
        f"{sources}</VRTRasterBand></VRTDataset>"
    )


def _wkt(crs: str) -> str:
    try:
        return str(CRS.from_user_input(crs).to_wkt())
    except CRSError:
        raise TerrainError(
            f"terrain.crs: unknown coordinate system {crs!r}; specify it (--dem-crs) as, for example, EPSG:32632"
        ) from None


def _tile(file: Path, band: int | str | None, crs_wkt: str | None) -> _Tile:
    name = gdal_name(file)
    try:
        with _gdal(), rasterio.open(name) as dataset:
            if dataset.crs is None and crs_wkt is None:
                raise TerrainError(
                    f"{file}: the file does not state its coordinate system; specify it with terrain.crs "
                    "(--dem-crs), such as EPSG:32632"
                )
            if dataset.crs is not None and crs_wkt is not None:
                own = dataset.crs.to_string()[:40]
                raise TerrainError(
                    f"{file}: the file already states its coordinate system ({own}); remove terrain.crs (--dem-crs)"
                )
            number = band_number(dataset, band, file)
            wkt = crs_wkt or dataset.crs.to_wkt()
            scale = (float(dataset.scales[number - 1]), float(dataset.offsets[number - 1]))
            return _Tile(
                file, name, wkt, dataset.transform, (dataset.width, dataset.height),
                dataset.units[number - 1] or "", scale, number, *_full_turn(wkt),
            )  # fmt: skip
    except (rasterio.errors.RasterioError, OSError) as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TerrainError(unreadable(file, file, reason)) from error


def _full_turn(wkt: str) -> tuple[float, float]:
    """360 degrees in the unit of a system's longitudes, 0 where it has none. Also the approximate metres of its unit."""
    crs = CRS.from_wkt(wkt)
    unit = crs.axis_info[0].unit_conversion_factor
    return (2.0 * math.pi / unit, math.degrees(unit) * M_PER_DEG) if crs.is_geographic else (0.0, unit)


def unreadable(named: object, file: Path, reason: str) -> str:
    """Error for elevation data that GDAL does not read; ``file`` is the probably unreadable one of several."""
    remedy = "use a complete raster of heights"
    if file.suffix.lower() == ".hgt":
        remedy = "an .hgt file is named after its corner (N46E008.hgt) and has 2,884,802 or 25,934,402 bytes"
    return f"{named}: the file cannot be read as elevation data ({reason}); {remedy}"


def _source(tile: _Tile, column: int, row: int) -> str:
    width, height = tile.size
    return (
        f'<ComplexSource><SourceFilename relativeToVRT="0">{escape(tile.name)}</SourceFilename>'
        f"<SourceBand>{tile.band}</SourceBand>"
        f'<SrcRect xOff="0" yOff="0" xSize="{width}" ySize="{height}"/>'
        f'<DstRect xOff="{column}" yOff="{row}" xSize="{width}" ySize="{height}"/>'
        # Of the no-data value, a mask, or an alpha band.
        "<UseMaskBand>true</UseMaskBand></ComplexSource>"
    )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
