"""Flights over one area that belong together: one set of swaths, two that cross, or five directions for building models."""

import math
from dataclasses import dataclass

from uavcover.errors import InputError
from uavcover.new.tuning import SURVEY

PATTERNS = ("single", "crosshatch", "oblique")
_COMPASS = (("north", 0.0), ("east", 90.0), ("south", 180.0), ("west", 270.0))


@dataclass(frozen=True, slots=True)
class View:
    """Camera view of one flight of a pattern.

    Attributes:
        name: of the flight; empty where there is one.
        pitch_deg: of the camera's axis; -90 is straight down.
        heading_deg: that the camera keeps, clockwise from north; none: that of its legs.
        line_heading_deg: of the lines; none: the planner chooses every leg's.
    """

    name: str
    pitch_deg: float
    heading_deg: float | None
    line_heading_deg: float | None

    @property
    def is_tilted(self) -> bool:
        """Whether the camera does not look straight down."""
        return self.pitch_deg > -90.0


SINGLE = View("", -90.0, None, None)


def views_of(pattern: str | None, *, along_deg: float) -> tuple[View, ...]:
    """The flights of a pattern.

    Args:
        pattern: one of ``PATTERNS``; none: single.
        along_deg: heading of the longer side of the area.

    Raises:
        InputError: there is no such pattern.
    """
    match "single" if pattern is None else pattern.casefold():
        case "single":
            return (SINGLE,)
        case "crosshatch":
            along = _whole(along_deg)
            return (View("along", -90.0, None, along), View("across", -90.0, None, (along + 90.0) % 180.0))
        case "oblique":
            tilted = (View(name, SURVEY.oblique_pitch_deg, heading, heading) for name, heading in _COMPASS)
            return (View("nadir", -90.0, None, _whole(along_deg)), *tilted)
    raise InputError(f"--pattern: {pattern!r} is not known; use {', '.join(PATTERNS[:-1])} or {PATTERNS[-1]}")


def _whole(heading_deg: float) -> float:
    return float(math.floor(heading_deg + 0.5) % 180)
