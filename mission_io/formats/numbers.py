"""Numbers as text in mission files: the shortest plain decimals that read back as the same number."""

import math
from decimal import Decimal

from mission_io.errors import FormatError


def plain_decimal(value: float, where: str) -> str:
    """The shortest decimal without an exponent that reads back as ``value``.

    Raises:
        FormatError: NaN or infinity, which no reader of these files understands.
    """
    if not math.isfinite(value):
        raise FormatError(f"{value} cannot be written", where=where, advice="give a finite number")
    text = format(Decimal(repr(float(value))), "f")
    text = text[:-2] if text.endswith(".0") else text
    return "0" if text == "-0" else text


def degrees_text(value_deg: float, where: str) -> str:
    """Degrees with eight decimals, one more than MAVLink carries.

    Raises:
        FormatError: NaN or infinity.
    """
    if not math.isfinite(value_deg):
        raise FormatError(f"{value_deg} is no coordinate", where=where, advice="give degrees")
    text = f"{value_deg:.8f}"
    return text[1:] if text == "-0.00000000" else text
