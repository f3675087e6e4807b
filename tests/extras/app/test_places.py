"""Typed positions, against pyproj and against references from elsewhere."""

import math
import random

import pytest
from pyproj import Transformer

from uavcover.errors import InputError
from uavcover.extras.app.workspace import position_of

M = 9e-6  # a metre in degrees


@pytest.mark.parametrize(
    ("text", "lat", "lon"),
    [
        ("47.37, 8.54", 47.37, 8.54),
        ("47.37 8.54", 47.37, 8.54),
        ("-33.8568, 151.2153", -33.8568, 151.2153),
        ("33.8568 S, 151.2153 E", -33.8568, 151.2153),
        ("47.37° N 8.54° W", 47.37, -8.54),
        ("47°22'12\"N 8°32'24\"E", 47.37, 8.54),
        ("47°22′12″N, 8°32′24″E", 47.37, 8.54),
        ("47 22 12 N 8 32 24 E", 47.37, 8.54),
        ("8°32'24\"E 47°22'12\"N", 47.37, 8.54),
        ("47°22.2'N 8°32.4'E", 47.37, 8.54),
        # The Statue of Liberty and the Sydney Opera House, from gazetteers.
        ("18T 580735 4504695", 40.6892, -74.0445),
        ("18TWL8073504695", 40.6892, -74.0445),
        ("56H 334900 6252300", -33.8568, 151.2153),
        ("56HLH3490052300", -33.8568, 151.2153),
    ],
)
def test_forms_that_people_type(text: str, lat: float, lon: float) -> None:
    found = position_of(text)
    assert found[0] == pytest.approx(lat, abs=0.001)
    assert found[1] == pytest.approx(lon, abs=0.001)


NO_POSITIONS = (
    "", "here", "91, 0", "0, 181", "47", "47,8,9", "47°61'0\"N 8°0'0\"E", "47N 8N", "61T 500000 5000000",
    "32I 500000 5000000", "32T", "32TXX1", "32TMT123", "1e400, 3", "nan, nan", "47°22'12\"N", "\x1b[2J",
)  # fmt: skip


@pytest.mark.parametrize("text", NO_POSITIONS, ids=repr)
def test_what_is_no_position_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        position_of(text)


def _mgrs_of(lat: float, lon: float) -> tuple[str, str]:
    """UTM and MGRS of a place, by pyproj and the lettering of NGA.SIG.0012: the twin."""
    zone = int((lon + 180.0) // 6.0) + 1
    band = "CDEFGHJKLMNPQRSTUVWX"[min(19, int((lat + 80.0) // 8.0))]
    east, north = Transformer.from_crs(4326, (32600 if lat >= 0 else 32700) + zone, always_xy=True).transform(lon, lat)
    column = ("ABCDEFGH", "JKLMNPQR", "STUVWXYZ")[(zone - 1) % 3][int(east // 100_000) - 1]
    row = "ABCDEFGHJKLMNPQRSTUV"[(int(north // 100_000) + (5 if zone % 2 == 0 else 0)) % 20]
    return (
        f"{zone}{band} {east:.1f} {north:.1f}",
        f"{zone}{band}{column}{row}{int(east % 100_000):05d}{int(north % 100_000):05d}",
    )


def test_utm_and_mgrs_anywhere_on_earth() -> None:
    rng = random.Random(4)
    for _ in range(400):
        lat, lon = math.degrees(math.asin(rng.uniform(-0.98, 0.99))), rng.uniform(-180.0, 180.0)
        if not -79.5 < lat < 83.5:
            continue
        for text, within_m in zip(_mgrs_of(lat, lon), (0.2, 1.6), strict=True):
            found = position_of(text)
            assert abs(found[0] - lat) < within_m * M, text
            assert abs(found[1] - lon) < within_m * M / math.cos(math.radians(lat)), text
