"""Flights inside KMZ files are opened with the limits of any KMZ."""

import struct
import zipfile

import pytest

from mission_io.formats.wpml import DOCUMENT
from uavcover.errors import InputError
from uavcover.extras.check.check_elevation import read_route_file


def kmz(path, content, *, encrypted=False):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(DOCUMENT, content)
    if encrypted:
        data = bytearray(path.read_bytes())
        # Bit 0 of the flags: in the entry's own header, and in the directory.
        for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
            begin = data.index(mark) + at
            data[begin : begin + 2] = struct.pack("<H", struct.unpack_from("<H", data, begin)[0] | 1)
        path.write_bytes(bytes(data))
    return path


@pytest.mark.parametrize(
    ("content", "encrypted", "words"),
    [("<kml/>", True, "is encrypted"), (b"\0" * 2_000_000, False, "times its packed size")],
)
def test_a_flight_that_is_encrypted_or_a_bomb_is_one_line(tmp_path, content, encrypted, words):
    path = kmz(tmp_path / "flight.kmz", content, encrypted=encrypted)
    with pytest.raises(InputError, match=words) as raised:
        read_route_file(path)
    assert str(raised.value).startswith(str(path))


def test_a_file_that_is_no_zip_is_one_line(tmp_path):
    (tmp_path / "flight.kmz").write_bytes(b"no zip")
    with pytest.raises(InputError, match="which is a zip file"):
        read_route_file(tmp_path / "flight.kmz")
