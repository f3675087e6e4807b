"""Where a vehicle may be, as far as that can be judged from one position in flight; and looking at it all the time."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from uavcover.vehicle.outcome import Ending
from uavcover.vehicle.progress import Progress
from uavcover.vehicle.session import Conversation

_BAND_SLACK_M = 2.0
"""Positions are measured: what is outside of the band by less is left to the judge after the flight."""
_FENCE_SLACK_M = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """The ground, the fence and the height band around a plan.

    Attributes:
        ground_up_m: from east and north the height of the ground in the local frame; NaN where it is not known.
        outside_fence_m: from east and north how far outside of the fence; 0 inside.
        min_height_agl_m: lower end of the band from the first planned waypoint to the last.
        max_height_agl_m: its upper end.
    """

    ground_up_m: Callable[[float, float], float]
    outside_fence_m: Callable[[float, float], float]
    min_height_agl_m: float
    max_height_agl_m: float


class PlaceWatch:
    """Tells when the vehicle leaves its fence, the height band of its route, or the ground that is known.

    Args:
        conversation: with the vehicle.
        surroundings: of the plan; None for a plan that has none.
        progress: along the plan.
    """

    def __init__(self, conversation: Conversation, surroundings: Surroundings | None, progress: Progress) -> None:
        self._watch, self._around, self._progress = conversation.watch, surroundings, progress

    def look(self, *, in_mission: bool) -> None:
        """Look at the latest position; called while the vehicle is in the air."""
        around, place_m = self._around, self._progress.place_m
        if around is None or place_m is None:
            return
        east_m, north_m, up_m = place_m.tolist()
        outside_m = around.outside_fence_m(east_m, north_m)
        self._watch.measure(
            Ending.FENCE_BREACHED, outside_m if outside_m > _FENCE_SLACK_M else None,
            f"the vehicle is {outside_m:.0f} m outside of its fence", "the vehicle is inside of its fence again",
        )  # fmt: skip
        height_m = up_m - around.ground_up_m(east_m, north_m)
        unknown = math.isnan(height_m)
        self._watch.measure(
            Ending.GROUND_UNKNOWN, 0.0 if unknown else None,
            "the height of the ground below the vehicle is not known: there is no elevation data",
            "the height of the ground is known again",
        )  # fmt: skip
        on_route = in_mission and self._progress.heading_for > 0
        outside_m, text = self._outside_band(around, height_m) if on_route and not unknown else (0.0, "")
        self._watch.measure(
            Ending.BAND_LEFT, outside_m if outside_m > _BAND_SLACK_M else None, text,
            "the vehicle is in its height band again" if on_route else "the vehicle has left the planned route",
        )  # fmt: skip

    @staticmethod
    def _outside_band(around: Surroundings, height_m: float) -> tuple[float, str]:
        low_m, high_m = around.min_height_agl_m - height_m, height_m - around.max_height_agl_m
        side, outside_m = ("below", low_m) if low_m > high_m else ("above", high_m)
        band = f"{around.min_height_agl_m:g} to {around.max_height_agl_m:g} m"
        return (
            outside_m,
            f"the vehicle is {height_m:.0f} m above the ground, {outside_m:.0f} m {side} its band of {band}",
        )
