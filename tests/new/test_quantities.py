"""Quantities with units, as people write them."""

import pytest

from uavcover.errors import InputError
from uavcover.new import quantities


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [
        (quantities.length_m, "2.5cm", 0.025), (quantities.length_m, "25 mm", 0.025), (quantities.length_m, "120M", 120.0),
        (quantities.length_m, "400ft", 121.92), (quantities.length_m, ".5 in", 0.0127), (quantities.time_s, "25min", 1500.0),
        (quantities.time_s, "1500s", 1500.0), (quantities.time_s, "0.5h", 1800.0), (quantities.speed_m_s, "8m/s", 8.0),
        (quantities.speed_m_s, "36 km/h", 10.0), (quantities.speed_m_s, "10 mph", 4.4704),
    ],
)  # fmt: skip
def test_quantities(read, text, value):
    assert read(text, option="--x", example="1m") == pytest.approx(value)


@pytest.mark.parametrize(
    "text", ["2.5", "cm", "", "-1cm", "0cm", "1e400cm", "2,5cm", "2.5 parsec", "nan cm", "2.5cm 3"]
)
def test_a_quantity_that_is_not_understood(text):
    with pytest.raises(InputError, match=r"^--gsd: .*(write it|such) as 2\.5cm"):
        quantities.length_m(text, option="--gsd", example="2.5cm")


@pytest.mark.parametrize(
    ("text", "fractions"), [("75/70", (0.75, 0.7)), ("80", (0.8, 0.8)), ("75%/60%", (0.75, 0.6)), ("75,70", (0.75, 0.7))]
)  # fmt: skip
def test_overlaps(text, fractions):
    assert quantities.overlaps(text) == pytest.approx(fractions)


@pytest.mark.parametrize("text", ["", "75/70/60", "a/b", "100/70", "-5", "0.75/0.7", "nan"])
def test_overlaps_that_are_not_understood(text):
    with pytest.raises(InputError, match=r"^--overlap: .*75/70"):
        quantities.overlaps(text)


@pytest.mark.parametrize("text", ["", "46", "46,8,3", "146,8", "8,200", "a,b", "nan,8"])
def test_a_place_that_is_none(text):
    with pytest.raises(InputError, match=r"^--home: "):
        quantities.lat_lon(text, option="--home")
    assert quantities.lat_lon("46.5, -8", option="--home") == (46.5, -8.0)
