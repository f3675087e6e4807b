"""Value checks for the dataclasses of a scenario: one wording, with the key first."""

import math
from typing import Any

STRICT: dict[str, Any] = {"extra": "forbid", "allow_inf_nan": False}
"""Settings for the scenario reader's validator: a misspelt key is an error."""


def require(condition: bool, message: str) -> None:
    """Raise ValueError with ``message`` (which starts with the key) unless ``condition`` holds."""
    if not condition:
        raise ValueError(message)


def require_positive(checked: object, *keys: str) -> None:
    """Require every named value that is given to be a finite number above zero."""
    for key in keys:
        value = getattr(checked, key)
        require(value is None or (math.isfinite(value) and value > 0.0), f"{key}: must be greater than 0, not {value}")


def require_not_negative(checked: object, *keys: str) -> None:
    """Require every named value that is given to be a finite number of at least zero."""
    for key in keys:
        value = getattr(checked, key)
        require(
            value is None or (math.isfinite(value) and value >= 0.0), f"{key}: must not be negative, but is {value}"
        )


def require_between(checked: object, low: float, high: float, *keys: str, unit: str = "") -> None:
    """Require every named value that is given to be between two numbers, both included."""
    for key in keys:
        value = getattr(checked, key)
        within = value is None or low <= value <= high
        require(within, f"{key}: must be between {low:g} and {high:g}{unit}, not {value}")


def require_lon_lat(ring: tuple[tuple[float, float], ...], key: str) -> None:
    """Require every corner to be a longitude and a latitude on Earth."""
    for lon, lat in ring:
        require(
            abs(lat) <= 90.0 and abs(lon) <= 180.0,
            f"{key}: ({lon}, {lat}) is not a longitude and latitude in degrees, in this order",
        )
