"""The pieces of a flown path, for everything that judges them."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uavcover.extras.check.findings import CheckFinding
from uavcover.kernels.arrays import FloatArray

Phase = Literal["take-off", "route", "return", "landing"]


@dataclass(frozen=True, eq=False, slots=True)
class Segment:
    """A piece of the path.

    Attributes:
        items: the item that it begins at, home being 0, and the item that makes it.
        phase: take-off and landing are near the ground on purpose.
        enu_m: (n, 3) its places.
        speed_m_s: wanted horizontal speed.
        wait_s: time spent at its end.
        is_straight: whether it is one straight leg.
        doubt: why the path there is not known from the mission; empty where it is.
    """

    items: tuple[int, int]
    phase: Phase
    enu_m: FloatArray
    speed_m_s: float
    wait_s: float = 0.0
    is_straight: bool = True
    doubt: str = ""


@dataclass(frozen=True, slots=True)
class Deed:
    """An item that flies nowhere, such as a camera's: it is carried out where the segments before it end.

    Attributes:
        item: its number.
        after: how many segments are flown before.
    """

    item: int
    after: int


@dataclass(frozen=True, eq=False, slots=True)
class FlownPath:
    """The whole path.

    Attributes:
        segments: in flying order, repetitions included.
        findings: what the items themselves show.
        deeds: items that fly nowhere, in the order of their turn.
    """

    segments: tuple[Segment, ...]
    findings: tuple[CheckFinding, ...]
    deeds: tuple[Deed, ...] = ()

    @property
    def distinct(self) -> tuple[Segment, ...]:
        """Every segment once, however often it is repeated."""
        seen: dict[tuple[object, ...], Segment] = {}
        for segment in self.segments:
            ends = np.round(segment.enu_m[[0, -1]], 3).tobytes()
            seen.setdefault((segment.items, segment.phase, len(segment.enu_m), ends), segment)
        return tuple(seen.values())
