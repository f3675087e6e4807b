"""Numbers as text in mission files: the shortest plain decimals that read back as the same number, and back."""

import math
from decimal import Decimal

from mission_io.errors import FormatError

_LONGEST_NUMBER = 400  # the smallest double has 341 characters without an exponent


def plain_decimal(value: float, where: str) -> str:
    """The shortest decimal without an exponent that reads back as ``value``.

    Raises:
        FormatError: NaN or infinity, which no reader of these files understands.
    """
    if value == 0.0:
        return "0"
    text = repr(float(value))
    if "e" in text:
        text = format(Decimal(text), "f")
    elif text[-1] in "nf":
        raise FormatError(f"{value} cannot be written", where=where, advice="give a finite number")
    return text[:-2] if text.endswith(".0") else text


def degrees_text(value_deg: float, where: str) -> str:
    """Degrees with eight decimals, one more than MAVLink carries.

    Raises:
        FormatError: NaN or infinity.
    """
    if not math.isfinite(value_deg):
        raise FormatError(f"{value_deg} is no coordinate", where=where, advice="give degrees")
    text = f"{value_deg:.8f}"
    return "0.00000000" if text == "-0.00000000" else text


def finite_number(text: str, where: str) -> float:
    """The number that ``text`` says, in plain or exponent form.

    Raises:
        FormatError: no number, or one that is not finite.
    """
    try:
        value = float(text) if len(text) <= _LONGEST_NUMBER and "_" not in text and text.isascii() else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FormatError(f"{text[:20]!r} is not a finite number", where=where)
    return value


def place_problem(lat_deg: float, lon_deg: float) -> FormatError | None:
    """An error without a place in the file when two numbers are no latitude and longitude."""
    if -90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 180.0:
        return None
    advice = "latitude comes first" if abs(lon_deg) <= 90.0 and abs(lat_deg) <= 180.0 else ""
    return FormatError(f"latitude {lat_deg:g}, longitude {lon_deg:g} is no place", advice=advice)
