"""The lists that the cases send: asymmetric positions, which reveal every mix-up, and whole metres."""

from collections.abc import Sequence
from typing import Final

from mission_io.conformance.tuning import PROBE
from mission_io.model.areas import (
    Fence,
    FencePolygon,
    FramedPoint,
    LatLon,
    RallyPoints,
    items_from_fence,
    items_from_rally,
)
from mission_io.model.items import Frame, MissionItem, MissionType, waypoint
from mission_io.wire.mission_items import degrees_on_wire

LIST_NAMES: Final = {MissionType.MISSION: "mission", MissionType.FENCE: "fence", MissionType.RALLY: "rally points"}


def sample(mission_type: MissionType, count: int, *, first: int = 0) -> tuple[MissionItem, ...]:
    """``count`` items of a list that differ from each other, and from those of another ``first``.

    A fence is one polygon, so it needs three items.
    """
    places = [
        (degrees_on_wire(47.1 + 1e-4 * (first + i) + 1e-6 * i * i), degrees_on_wire(-8.2 - 2e-4 * (first + i)))
        for i in range(count)
    ]
    if mission_type is MissionType.FENCE:
        return items_from_fence(Fence((FencePolygon(tuple(LatLon(*place) for place in places)),), ()))
    heights_m = [float(20 + first + i) for i in range(count)]
    if mission_type is MissionType.RALLY:
        points = (FramedPoint(*place, height) for place, height in zip(places, heights_m, strict=True))
        return items_from_rally(RallyPoints(tuple(points)))
    return tuple(
        waypoint(*place, height, frame=Frame.ABOVE_HOME) for place, height in zip(places, heights_m, strict=True)
    )


def difference(sent: Sequence[MissionItem], held: Sequence[MissionItem], *, home_first: bool = False) -> str:
    """The difference between a list and its read-back, one line; empty when there is none.

    Args:
        sent: What was sent.
        held: What came back.
        home_first: Whether item 0 is the vehicle's own home, which no upload can set.
    """
    if len(sent) != len(held):
        return f"{len(held)} items in place of {len(sent)}"
    for seq, (a, b) in enumerate(zip(sent, held, strict=True)):
        if seq == 0 and home_first:
            continue
        if a.command != b.command:
            return f"item {seq} is command {b.command} in place of {a.command}"
        if a.frame is not b.frame:
            return f"item {seq} is in frame {b.frame.name} in place of {a.frame.name}"
        if abs(a.lat_deg - b.lat_deg) > PROBE.same_deg or abs(a.lon_deg - b.lon_deg) > PROBE.same_deg:
            return f"item {seq} is at {b.lat_deg:.7f}, {b.lon_deg:.7f} in place of {a.lat_deg:.7f}, {a.lon_deg:.7f}"
        if not abs(a.alt_m - b.alt_m) <= PROBE.same_m:
            return f"item {seq} is at {b.alt_m:g} m in place of {a.alt_m:g} m"
    return ""
