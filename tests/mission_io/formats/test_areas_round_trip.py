"""Any fence and any rally points, through every format that holds them."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission_io.formats import plan, wpl
from mission_io.model.items import (
    Fence,
    FenceCircle,
    FencePolygon,
    Frame,
    FramedPoint,
    LatLon,
    RallyPoints,
    fence_from_items,
    items_from_fence,
    items_from_rally,
    rally_from_items,
)
from tests.mission_io.formats.samples import HOME, LATITUDES, LONGITUDES, MISSION

_POSITIONS = st.builds(LatLon, LATITUDES, LONGITUDES)
_RINGS = st.lists(_POSITIONS, min_size=3, max_size=6, unique=True).map(tuple)
_HEIGHTS = st.floats(-1e4, 1e5)
_POINTS = st.builds(FramedPoint, LATITUDES, LONGITUDES, _HEIGHTS, st.sampled_from([Frame.AMSL, Frame.ABOVE_HOME]))
_POLYGONS = st.builds(FencePolygon, _RINGS, st.booleans())
_CIRCLES = st.builds(FenceCircle, _POSITIONS, st.floats(0.1, 1e6), st.booleans())
_FENCES = st.builds(
    Fence,
    st.lists(_POLYGONS, max_size=3).map(tuple),
    st.lists(_CIRCLES, max_size=3).map(tuple),
    st.none() | _POINTS,
)
_RALLY = st.builds(RallyPoints, st.lists(_POINTS, max_size=4).map(tuple))


@settings(derandomize=True, max_examples=150)
@given(_FENCES, _RALLY)
def test_items_and_waypoints_hold_every_bit(fence: Fence, rally: RallyPoints) -> None:
    assert fence_from_items(items_from_fence(fence)) == fence
    assert rally_from_items(items_from_rally(rally)) == rally
    assert wpl.read(wpl.write_fence(fence, HOME)).fence() == fence
    assert wpl.read(wpl.write_rally(rally, HOME)).rally() == rally


@settings(derandomize=True, max_examples=150)
@given(_FENCES, _RALLY)
@pytest.mark.no_cover
def test_a_plan_holds_every_bit_of_heights_above_home(fence: Fence, rally: RallyPoints) -> None:
    if fence.return_point is not None:
        fence = replace(fence, return_point=replace(fence.return_point, frame=Frame.ABOVE_HOME))
    rally = RallyPoints(tuple(replace(point, frame=Frame.ABOVE_HOME) for point in rally.points))
    whole = plan.PlanFile(MISSION, fence, rally, mav_autopilot=12)
    assert plan.read(plan.write(whole)) == whole
