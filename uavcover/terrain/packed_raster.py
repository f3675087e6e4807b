"""Packed elevation files: the one raster inside a zip or gzip file, which GDAL reads in place, within limits."""

import gzip
import zipfile
import zlib
from functools import lru_cache
from pathlib import Path

from uavcover.errors import TerrainError
from uavcover.terrain.tuning import FILES

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
        raise TerrainError(f"{file}: the file is packed ({file.suffix}); unpack it and specify the raster")
    return str(file)


def _inside_zip(file: Path) -> str:
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, OSError) as error:
        raise TerrainError(f"{file}: the file cannot be opened as a zip file ({error}); unpack it") from error
    rasters = [entry for entry in entries if entry.filename.lower().endswith(RASTERS)]
    if len(entries) > MAX_ZIP_ENTRIES or len(rasters) != 1:
        raise TerrainError(
            f"{file}: the archive contains {len(rasters)} elevation files in {len(entries)} entries instead of one; unpack it"
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
