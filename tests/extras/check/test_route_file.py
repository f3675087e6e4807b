"""Route files and return lines."""

import struct
import zipfile

import numpy as np
import pytest

from mission_io.formats.wpml import DOCUMENT
from uavcover.errors import InputError
from uavcover.extras.check.check_elevation import read_route_file
from uavcover.extras.check.return_checks import cut, with_gaps


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


def test_pieces_are_those_of_linspace() -> None:
    pieces = np.array([1, 3, 7, 2])
    owner, t = cut(pieces)
    assert owner.tolist() == [0] * 2 + [1] * 4 + [2] * 8 + [3] * 3
    assert t.tolist() == np.concatenate([np.linspace(0.0, 1.0, count + 1) for count in pieces]).tolist()


def test_lines_of_equal_number_beside_each_other() -> None:
    first = with_gaps(np.arange(9.0).reshape(3, 3), np.array([0, 0, 1]))
    second = with_gaps(10.0 + np.arange(6.0).reshape(2, 3), np.array([0, 1]))
    both = first + second
    assert both.owner.tolist() == [0, 0, 0, 0, 0, 1, 1, 1, 1]
    assert np.nan_to_num(both.points_m[:, 0], nan=-1.0).tolist() == [0, 3, -1, 10, -1, 6, -1, 13, -1]
