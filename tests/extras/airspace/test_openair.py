"""OpenAir: shapes are compared with circles and rings made from the same numbers by pyproj and by hand."""

import itertools
import math

import numpy as np
import pytest
import shapely
from pyproj import Geod

from mission_io.errors import FormatError
from uavcover.extras.airspace.openair import looks_like_openair, read_openair

EARTH = Geod(ellps="WGS84")
MILE_M = 1852.0
SQUARE = "DP 46:00:00 N 007:00:00 E\nDP 46:00:00 N 007:01:00 E\nDP 46:01:00 N 007:01:00 E\nDP 46:01:00 N 007:00:00 E\n"


def one(text):
    (zone,) = read_openair(text).zones
    return zone


@pytest.mark.parametrize("written", ["\n", "\r\n"])
def test_a_polygon_with_its_heights(written):
    text = f"* a comment\nAC R\nAN Firing range * inside a line\nAL 1500ft AMSL\nAH FL65\n{SQUARE}".replace(
        "\n", written
    )
    zone = one(text)
    assert zone.name == "Firing range"
    assert zone.polygons == (
        (((7.0, 46.0), (7.0 + 1 / 60, 46.0), (7.0 + 1 / 60, 46.0 + 1 / 60), (7.0, 46.0 + 1 / 60)),),
    )
    assert zone.heights == {"floor_amsl_m": pytest.approx(457.2)}  # a ceiling in flight levels has no sure height
    assert looks_like_openair(text)


@pytest.mark.parametrize(
    ("low", "high", "heights"),
    [
        ("GND", "UNL", {}),
        ("SFC", "UNLIMITED", {}),
        ("0 AGL", "400ft AGL", {"ceiling_agl_m": 121.92}),
        ("100m GND", "300 M MSL", {"floor_agl_m": 100.0, "ceiling_amsl_m": 300.0}),
        (
            "2000",
            "3500",
            {"floor_amsl_m": 609.6, "ceiling_amsl_m": 1066.8},
        ),  # feet above sea level where nothing is written
        ("1500 ft ASFC", "2500F MSL", {"floor_agl_m": 457.2, "ceiling_amsl_m": 762.0}),
    ],
)
def test_heights(low, high, heights):
    zone = one(f"AC Q\nAN x\nAL {low}\nAH {high}\n{SQUARE}")
    assert zone.heights == pytest.approx(heights)


@pytest.mark.parametrize("level", [30, 65, 195])
@pytest.mark.parametrize(("pressure_hpa", "colder"), [(950.0, 40.0), (1013.25, 0.0), (1050.0, -20.0)])
def test_the_floor_of_a_flight_level_is_never_below_what_counts(level, pressure_hpa, colder):
    # Hypsometric heights of the standard atmosphere between two pressures, in air colder by so many degrees.
    def height_m(pressure):
        return 44330.77 * (1.0 - (pressure / 1013.25) ** 0.190263)

    pressure = 1013.25 * (1.0 - level * 30.48 / 44330.77) ** (1 / 0.190263)
    true_m = (height_m(pressure) - height_m(pressure_hpa)) * (1.0 - colder / 288.15)
    assert one(f"AC D\nAN x\nAL FL{level}\nAH UNL\n{SQUARE}").heights["floor_amsl_m"] <= true_m


def test_a_circle():
    zone = one("AC P\nAN x\nAL GND\nAH UNL\nV X=46:30:00 N 007:30:00 W\nDC 2.5\n")
    assert zone.circle == (-7.5, 46.5, 2.5 * MILE_M)
    assert zone.polygons == ()


@pytest.mark.parametrize("direction", ["+", "-"])
@pytest.mark.parametrize(("begin", "end"), [(270.0, 90.0), (350.0, 10.0), (10.0, 350.0), (0.0, 180.0), (45.0, 46.0)])
def test_an_arc_turns_the_way_that_is_written(direction, begin, end):
    text = f"AC R\nAN x\nV X=46:30:00 N 007:30:00 E\nV D={direction}\nDA 3,{begin},{end}\nDP 46:30:00 N 007:30:00 E\n"
    corners = one(text).polygons[0][0][:-1]
    bearings, _, radii = EARTH.inv([7.5] * len(corners), [46.5] * len(corners), *np.transpose(corners))
    assert radii == pytest.approx([3 * MILE_M] * len(corners), abs=0.01)
    sign = 1.0 if direction == "+" else -1.0
    steps = [math.remainder(b - a, 360.0) for a, b in itertools.pairwise(bearings)]
    assert all(0.0 < sign * step <= 1.001 for step in steps)
    assert math.isclose(sum(steps), sign * (((end - begin) * sign) % 360.0), abs_tol=1e-6)


def test_an_arc_between_two_places():
    text = "AC R\nAN x\nV X=44:10:29 N 000:35:26 E\nDB 44:13:48 N 000:45:33 E,44:02:56 N 000:39:07 E\nDP 44:05:39 N 000:31:05 E\n"
    ring = one(text).polygons[0][0]
    assert ring[0] == pytest.approx((0.75916667, 44.23))
    assert ring[-2] == pytest.approx((0.65194444, 44.04888889))
    _, _, radii = EARTH.inv([0.59055556] * (len(ring) - 1), [44.17472222] * (len(ring) - 1), *np.transpose(ring[:-1]))
    assert max(radii) - min(radii) < 150.0  # the file rounds its places to seconds
    assert shapely.Polygon(ring).is_valid


def test_classes_open_to_all_are_left_out_and_told():
    read = read_openair(f"AC E\nAN a\n{SQUARE}\nAC G\nAN b\n{SQUARE}\nAC CTR\nAN c\n{SQUARE}\nAC E\nAN d\n{SQUARE}")
    assert [zone.name for zone in read.zones] == ["c"]
    assert read.notes == (
        "ignored 2 zones of class E, which are open to all",
        "ignored 1 zone of class G, which is open to all",
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("DP 46:00:00 N 007:00:00 E", "line 1: the record DP precedes the first AC"),
        ("AC R\nAN x\nDP 46:00:00 N", "line 3, zone x: '46:00:00 N' is not a position"),
        ("AC R\nAN x\nDP 46:61:00 N 007:00:00 E", "46:61:0 is not an angle"),
        ("AC R\nAN x\nDP 91:00:00 N 007:00:00 E", "is not an angle"),
        ("AC R\nAN x\nAL high", "'high' is not a height"),
        ("AC R\nAN x\nDC 2", "the arc or circle has no centre"),
        ("AC R\nAN x\nV X=46:00:00 N 007:00:00 E\nDC -2", "the first a radius"),
        ("AC R\nAN x\nV X=46:00:00 N 007:00:00 E\nDA 2,10", "3 numbers"),
        ("AC R\nAN x\nV X=46:00:00 N 007:00:00 E\nDC nan", "the first a radius"),
        (
            "AC R\nAN x\nV X=46:00:00 N 007:00:00 E\nDB 46:01:00 N 007:00:00 E, 46:09:00 N 007:00:00 E",
            "from its centre",
        ),
        ("AC R\nAN x\nDY 46:00:00 N 007:00:00 E", "unsupported"),
        ("AC R\nAN x\nhello", "'hello' is not an OpenAir record"),
        (
            "AC R\nAN x\nDP 46:00:00 N 007:00:00 E\nDP 46:01:00 N 007:00:00 E",
            "the zone has 2 different corners, but needs at least 3",
        ),
        (f"AC R\nAN x\nV X=46:00:00 N 007:00:00 E\nDC 1\n{SQUARE}", "both a circle"),
        ("AC R\nAN x\nV Q=1", "unsupported"),
    ],
)
def test_what_cannot_be_understood(text, message):
    with pytest.raises(FormatError) as error:
        read_openair(text)
    assert message in str(error.value)


def test_an_error_with_a_long_name_is_short():
    with pytest.raises(FormatError) as error:
        read_openair(f"AC R\nAN {'a ' * 5000}\nDP nowhere\n")
    assert len(str(error.value)) < 200
