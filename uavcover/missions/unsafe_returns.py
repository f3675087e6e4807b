"""Intervals of legs from which a return is unsafe, with the reason, as data."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from uavcover.missions.failsafe_parameters import Response
from uavcover.missions.failsafe_states import HOME, IN_PLACE

Danger = Literal["terrain", "descent", "unknown ground", "obstacle", "fence", "zone", "battery"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnsafeReturn:
    """Consecutive moments from which one response is unsafe in one respect.

    Attributes:
        responses: that lead there.
        danger: in which respect.
        begin_s: first moment, since take-off.
        end_s: last moment.
        first_leg: vertex of the route that the vehicle flies to at the first moment.
        last_leg: at the last one.
        value: worst value: least height above ground; metres of missing clearance, outside the fence or inside the zone;
            seconds of flight.
        limit: the allowed value.
        place_m: (east, north, up) where it is worst.
        worst_s: the moment whose path is worst.
        destination: number of the rally point there, ``HOME`` or ``IN_PLACE``.
        name: of the obstacle or zone.
        note: what the path depends on.
    """

    responses: tuple[Response, ...]
    danger: Danger
    begin_s: float
    end_s: float
    first_leg: int
    last_leg: int
    value: float
    limit: float
    place_m: tuple[float, float, float]
    worst_s: float
    destination: int
    name: str = ""
    note: str = ""

    @property
    def what(self) -> str:
        """The problem as text, without the moments and the position."""
        to = {HOME: "home", IN_PLACE: "down at the current position"}.get(
            self.destination, f"to rally point {self.destination + 1}"
        )
        path = f"the path {to}{f', {self.note},' if self.note else ''}"
        match self.danger:
            case "terrain" if self.value < 0.0:
                return f"{path} goes {-self.value:.1f} m below the ground"
            case "terrain":
                return f"{path} is {self.value:.1f} m above ground; at least {self.limit:.1f} m are required"
            case "descent" if self.value < 0.0:
                return f"{path} descends {-self.value:.1f} m below the ground at flying speed"
            case "descent":
                return f"{path} comes within {self.value:.1f} m of the ground at flying speed"
            case "unknown ground":
                return f"{path} leads over unknown ground"
            case "obstacle":
                return f"{path} lacks {self.value:.1f} m of clearance from obstacle {self.name!r}"
            case "fence":
                return f"{path} comes {self.value:.1f} m outside the fence"
            case "zone":
                return f"{path} comes {self.value:.1f} m into no-fly zone {self.name!r}"
            case "battery":
                return f"{path} ends after {self.value:.0f} s, but the battery lasts {self.limit:.0f} s"


def joined_returns(unsafe: Iterable[UnsafeReturn]) -> list[UnsafeReturn]:
    """Join intervals of different responses with the same path from the same legs; keep the worst figures."""
    found: dict[tuple[object, ...], UnsafeReturn] = {}
    for one in unsafe:
        key = (one.danger, one.destination, one.name, one.note, one.first_leg, one.last_leg)
        other = found.get(key)
        if other is None:
            found[key] = one
            continue
        worse = one if abs(one.value - one.limit) > abs(other.value - other.limit) else other
        found[key] = replace(
            worse, responses=(*other.responses, *one.responses), begin_s=min(one.begin_s, other.begin_s),
            end_s=max(one.end_s, other.end_s),
        )  # fmt: skip
    return list(found.values())
