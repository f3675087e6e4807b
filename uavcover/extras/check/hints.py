"""Why heights may be wrong: feet taken for metres, or heights above one thing taken for heights above another."""

import dataclasses
import math
from collections.abc import Sequence

from mission_io.model.items import Frame, Mission, MissionItem
from uavcover.extras.check.findings import CheckFinding
from uavcover.extras.check.limits import Limits
from uavcover.extras.check.world import World

_FOOT_M = 0.3048
_SLACK_M = 5.0
_MOST_M = 150.0


def with_hints(findings: Sequence[CheckFinding], mission: Mission, world: World, limits: Limits) -> list[CheckFinding]:
    """Findings about heights with the likely reason, where another unit or another frame would keep the band."""
    return [_with_hint(one, mission, world, limits) if one.kind in ("ground", "height") else one for one in findings]


def _with_hint(finding: CheckFinding, mission: Mission, world: World, limits: Limits) -> CheckFinding:
    first, last = finding.items or (1, 0)
    items = [
        (n, mission.items[n - 1])
        for n in range(max(1, first), last + 1)
        if mission.items[n - 1].has_position
        and math.isfinite(mission.items[n - 1].alt_m)
        and mission.items[n - 1].lat_deg != 0.0
    ]
    wrong = [(n, item) for n, item in items if not _fits(_agl_m(item, world, item.frame, item.alt_m), limits)]
    if not wrong:
        return finding
    for words, change in _CHANGES.items():
        if all(change(item, world, limits) for _, item in wrong):
            return dataclasses.replace(finding, what=f"{finding.what}; {words}")
    return finding


def _agl_m(item: MissionItem, world: World, frame: Frame, alt_m: float) -> float:
    """Height above ground of an item's place with its number read in another way."""
    if frame is Frame.ABOVE_TERRAIN:
        return alt_m
    east, north = world.place(item.lat_deg, item.lon_deg)
    alt = alt_m + (world.home_alt_amsl_m if frame is Frame.ABOVE_HOME else 0.0)
    return float(world.ground.heights_agl_m(world.at_alts([[east, north]], alt))[0])


def _fits(height_agl_m: float, limits: Limits) -> bool:
    most = _MOST_M if limits.max_height_agl_m is None else limits.max_height_agl_m
    return limits.min_height_agl_m - _SLACK_M <= height_agl_m <= most + _SLACK_M


def _as_amsl(item: MissionItem, world: World, limits: Limits) -> bool:
    return item.frame is not Frame.AMSL and _fits(_agl_m(item, world, Frame.AMSL, item.alt_m), limits)


def _as_above_home(item: MissionItem, world: World, limits: Limits) -> bool:
    return item.frame is Frame.AMSL and _fits(_agl_m(item, world, Frame.ABOVE_HOME, item.alt_m), limits)


def _as_above_terrain(item: MissionItem, _: World, limits: Limits) -> bool:
    return item.frame is not Frame.ABOVE_TERRAIN and _fits(item.alt_m, limits)


def _as_feet(item: MissionItem, world: World, limits: Limits) -> bool:
    return _fits(_agl_m(item, world, item.frame, item.alt_m * _FOOT_M), limits)


def _as_metres(item: MissionItem, world: World, limits: Limits) -> bool:
    return _fits(_agl_m(item, world, item.frame, item.alt_m / _FOOT_M), limits)


_CHANGES = {
    "its number fits a height above sea level: is the frame wrong?": _as_amsl,
    "its number fits a height above home: is the frame wrong?": _as_above_home,
    "its number fits feet: is the unit wrong?": _as_feet,
    "its number fits a height above the terrain: is the frame wrong?": _as_above_terrain,
    "it fits if the number were metres that somebody took for feet": _as_metres,
}
