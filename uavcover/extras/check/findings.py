"""Findings of a check: one row for each item that exceeds a limit or needs attention."""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from uavcover.kernels.arrays import FloatArray
from uavcover.model.verdict import Effect, Finding

Weight = Literal["breaks", "unknown", "look"]
"""``breaks`` a limit; ``unknown``: the question cannot be answered; ``look``: permitted, but probably unintended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckFinding:
    """One thing found."""

    kind: str  # what kind of thing, one of the words in docs/reference/checked_missions.md
    weight: Weight  # how much it weighs
    what: str  # what is wrong, as text
    do: str  # what to do about it
    # numbers of the first and the last item concerned, home being 0; None: the whole mission
    items: tuple[int, int] | None = None
    lat_deg: float | None = None  # where it is worst; None without a place
    lon_deg: float | None = None  # where it is worst; None without a position
    alt_amsl_m: float | None = None  # where it is worst; None without a position
    by: float = 0.0  # by how much, in the unit of ``unit``; 0 where there is no measure
    unit: str = ""  # "m", "s", or empty

    @property
    def decides(self) -> Finding:
        """Effect on the verdict."""
        effects: dict[Weight, Effect] = {"breaks": "fails", "unknown": "not proved", "look": "noted"}
        return Finding(effects[self.weight], ("mission",), self.what)

    def at(self, geodetic: tuple[float, float, float]) -> "CheckFinding":
        """The same with the place where it is worst: latitude and longitude in degrees, metres above sea level."""
        lat, lon, alt = geodetic
        return replace(self, lat_deg=lat, lon_deg=lon, alt_amsl_m=alt)

    def document(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "kind": self.kind, "weight": self.weight, "items": None if self.items is None else list(self.items),
            "lat_deg": self.lat_deg, "lon_deg": self.lon_deg, "alt_amsl_m": self.alt_amsl_m, "by": self.by,
            "unit": self.unit, "what": self.what, "do": self.do,
        }  # fmt: skip


def joined(findings: Iterable[CheckFinding], same: Callable[[CheckFinding], object]) -> list[CheckFinding]:
    """Join findings of consecutive legs; keep the worst position.

    Args:
        findings: in flying order, each with items.
        same: what findings must have in common to be joined.
    """
    runs: list[list[CheckFinding]] = []
    for found in findings:
        last = runs[-1][-1] if runs else None
        follows = (
            last is not None and found.items and last.items and last.items[0] <= found.items[0] <= last.items[1] + 1
        )
        if last is not None and follows and same(last) == same(found):
            runs[-1].append(found)
        else:
            runs.append([found])
    out = []
    for run in runs:
        worst = max(run, key=lambda one: one.by)
        numbers = list(itertools.chain.from_iterable(one.items or () for one in run))
        out.append(replace(worst, items=(min(numbers), max(numbers)) if numbers else None))
    return out


# The pieces of a flown path, for everything that judges them.

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

    @property
    def known_m(self) -> FloatArray:
        """(k, 3) its places that are known."""
        return np.asarray(self.enu_m[np.isfinite(self.enu_m).all(axis=1)])

    def found(self, kind: str, by_m: float, *, what: str, do: str, weight: Weight = "breaks") -> CheckFinding:
        """A finding about the segment, by some metres."""
        return CheckFinding(kind=kind, weight=weight, items=self.items, by=by_m, unit="m", what=what, do=do)


def along_m(line_m: FloatArray) -> FloatArray:
    """Distances (n,) of the places of an (n, 3) line from its begin, along the line."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1)))


def positions_at(at_m: FloatArray, line_m: FloatArray) -> FloatArray:
    """Places (k, 3) at distances (k,) along an (n, 3) line."""
    reached_m = along_m(line_m)
    return np.column_stack([np.interp(at_m, reached_m, line_m[:, axis]) for axis in range(3)])


@dataclass(frozen=True, slots=True)
class Deed:
    """An item that flies nowhere, such as a camera's: it is carried out where the segments before it end."""

    item: int  # its number
    after: int  # how many segments are flown before
    is_conditional: bool = False  # whether a condition before it delays it, or skips it where its leg ends first


@dataclass(frozen=True, eq=False, slots=True)
class FlownPath:
    """The whole path."""

    segments: tuple[Segment, ...]  # in flying order, repetitions included
    findings: tuple[CheckFinding, ...]  # what the items themselves show
    deeds: tuple[Deed, ...] = ()  # items that fly nowhere, in the order of their turn

    @property
    def distinct(self) -> tuple[Segment, ...]:
        """Every segment once, however often it is repeated."""
        first: dict[tuple[object, ...], Segment] = {}
        for segment in self.segments:
            ends = np.round(segment.enu_m[[0, -1]], 3).tobytes()
            first.setdefault((segment.items, segment.phase, len(segment.enu_m), ends), segment)
        return tuple(first.values())
