"""The pieces of a flown path, for everything that judges them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uavcover.extras.check.findings import CheckFinding
from uavcover.kernels.arrays import FloatArray

Phase = Literal["take-off", "route", "return", "landing"]


@dataclass(frozen=True, eq=False, slots=True)
class Segment:
    """A piece of the path."""

    items: tuple[int, int]  # the item that it begins at, home being 0, and the item that makes it
    phase: Phase  # take-off and landing are near the ground on purpose
    enu_m: FloatArray  # (n, 3) its places
    speed_m_s: float  # wanted horizontal speed
    wait_s: float = 0.0  # time spent at its end
    is_straight: bool = True  # whether it is one straight leg
    doubt: str = ""  # why the path there is not known from the mission; empty where it is


@dataclass(frozen=True, slots=True)
class Deed:
    """An item that flies nowhere, such as a camera's: it is carried out where the segments before it end."""

    item: int  # its number
    after: int  # how many segments are flown before


@dataclass(frozen=True, eq=False, slots=True)
class FlownPath:
    """The whole path."""

    segments: tuple[Segment, ...]  # in flying order, repetitions included
    findings: tuple[CheckFinding, ...]  # what the items themselves show
    deeds: tuple[Deed, ...] = ()  # items that fly nowhere, in the order of their turn

    @property
    def distinct(self) -> tuple[Segment, ...]:
        """Every segment once, however often it is repeated."""
        seen: dict[tuple[object, ...], Segment] = {}
        for segment in self.segments:
            ends = np.round(segment.enu_m[[0, -1]], 3).tobytes()
            seen.setdefault((segment.items, segment.phase, len(segment.enu_m), ends), segment)
        return tuple(seen.values())
