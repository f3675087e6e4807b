"""KMZ: a zip with a KML document, opened with limits so that a small file cannot fill memory or disk."""

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from uavcover.errors import InputError

MAX_ENTRIES = 2000
MAX_KML_BYTES = 64 * 1024 * 1024
MAX_RATIO = 200.0
"""Ratio of unpacked to packed size; text packs to about a twentieth, a bomb to a thousandth."""
_ARCHIVES = (".kmz", ".zip", ".7z", ".gz", ".rar", ".tar", ".bz2", ".xz")


def kml_of(path: Path) -> bytes:
    """The KML document of a KMZ file: ``doc.kml``, or the only one there is. Photos and the rest are not unpacked.

    Raises:
        InputError: no zip, a damaged or encrypted one, none or several documents, or one beyond the limits.
    """
    with _opened(path) as archive:
        return _unpacked(path, archive, _document(path, _files(path, archive)))


def entry_of(path: Path, name: str) -> bytes | None:
    """The entry of a KMZ file that has this name; none where there is none.

    Raises:
        InputError: no zip, a damaged or encrypted one, or an entry beyond the limits.
    """
    with _opened(path) as archive:
        found = [entry for entry in _files(path, archive) if entry.filename == name]
        return _unpacked(path, archive, found[0]) if found else None


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    try:
        with zipfile.ZipFile(path) as archive:
            yield archive
    except (zipfile.BadZipFile, NotImplementedError, EOFError, zlib.error) as error:
        raise InputError(
            f"{path}: the file cannot be opened as KMZ, which is a zip file ({error}); save it again, or save it as KML"
        ) from error


def _files(path: Path, archive: zipfile.ZipFile) -> list[zipfile.ZipInfo]:
    entries = archive.infolist()
    if len(entries) > MAX_ENTRIES:
        raise InputError(
            f"{path}: the archive has {len(entries)} entries; the limit is {MAX_ENTRIES}; save only the drawing as KML"
        )
    return [one for one in entries if not one.is_dir()]


def _unpacked(path: Path, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    if entry.flag_bits & 1:
        raise InputError(f"{path}: {entry.filename} is encrypted; save it without a password")
    # The sizes in the directory may lie, so what comes out is counted too.
    ratio = entry.file_size / max(entry.compress_size, 1)
    if entry.file_size > MAX_KML_BYTES or (ratio > MAX_RATIO and entry.file_size > MAX_KML_BYTES // 64):
        raise InputError(
            f"{path}: {entry.filename} unpacks to {entry.file_size:,} bytes, {ratio:.0f} times its packed size; the "
            f"limits are {MAX_KML_BYTES:,} bytes and {MAX_RATIO:g} times; save only the drawing as KML"
        )
    with archive.open(entry) as stream:
        data = stream.read(MAX_KML_BYTES + 1)
    if len(data) > MAX_KML_BYTES:
        raise InputError(
            f"{path}: {entry.filename} unpacks to more than {MAX_KML_BYTES:,} bytes; save only the drawing as KML"
        )
    return data


def _document(path: Path, entries: list[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    documents = [one for one in entries if one.filename.lower().endswith(".kml")]
    main = [one for one in documents if one.filename.lower() == "doc.kml"] or documents
    if len(main) == 1:
        return main[0]
    if documents:
        names = ", ".join(one.filename for one in documents[:5])
        raise InputError(
            f"{path}: the archive has {len(documents)} documents and no doc.kml ({names}); unpack it and use one of them"
        )
    nested = [one.filename for one in entries if one.filename.lower().endswith(_ARCHIVES)]
    if nested:
        raise InputError(
            f"{path}: the archive contains another archive ({nested[0]}), which is not opened; unpack it first"
        )
    raise InputError(f"{path}: the archive has no KML document; save the area again with the map program")
