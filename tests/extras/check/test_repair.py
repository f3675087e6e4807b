import numpy as np
import pytest

from mission_io.model.items import Command, Frame, Mission, MissionItem
from tests.extras.check.worlds import COPTER, command, home, item, mission, up, way, world
from uavcover.extras.check.flown_path import flown_path
from uavcover.extras.check.repair import Repaired, repaired
from uavcover.extras.check.world import Limits

LIMITS = Limits(min_height_agl_m=10.0)


def fixed(*items: MissionItem) -> Repaired:
    here = world()
    return repaired(mission(*items), here, LIMITS, lambda changed: flown_path(changed, here, COPTER))


def lowest_m(changed: Mission) -> float:
    """The least height above the ridge along the straight lines between waypoints, looked at every metre or so."""
    path = flown_path(changed, world(), COPTER)
    heights = []
    for segment in path.segments:
        if segment.phase == "route" and segment.is_straight:
            t = np.linspace(0.0, 1.0, 900)[:, None]
            line = segment.enu_m[0] + t * (segment.enu_m[-1] - segment.enu_m[0])
            heights.append((line[:, 2] - 100.0 * np.maximum(0.0, 1.0 - np.abs(line[:, 0] - 400.0) / 50.0)).min())
    return min(heights)


def test_a_leg_through_the_ridge_gets_waypoints_over_it() -> None:
    made = fixed(up(), way(300.0, 0.0, 60.0), way(500.0, 0.0, 60.0), home())
    assert made.raised == ()
    assert len(made.inserted) >= 1
    assert lowest_m(made.mission) >= 9.9
    kept = [one for n, one in enumerate(made.mission.items, 1) if n not in made.inserted]
    assert kept == list(mission(up(), way(300.0, 0.0, 60.0), way(500.0, 0.0, 60.0), home()).items)


def test_a_waypoint_in_the_ground_is_raised_once() -> None:
    made = fixed(up(), way(380.0, 0.0, 115.0), way(400.0, 0.0, 60.0, Frame.ABOVE_HOME), way(420.0, 0.0, 115.0), home())
    assert (made.raised, made.inserted) == ((3,), ())
    assert made.mission.items[2].alt_m == pytest.approx(111.0, abs=0.2)


def test_heights_above_the_sea_stay_such() -> None:
    made = fixed(up(), way(300.0, 0.0, 760.0, Frame.AMSL), way(500.0, 0.0, 760.0, Frame.AMSL), home())
    assert {one.frame for one in made.mission.items[1:-1]} == {Frame.AMSL}
    assert lowest_m(made.mission) >= 9.9


def test_jumps_lead_where_they_led() -> None:
    jump = command(Command.DO_JUMP, 3.0, 1.0)
    made = fixed(up(), way(300.0, 0.0, 60.0), way(500.0, 0.0, 60.0), way(600.0, 0.0, 60.0), jump, home())
    target = made.mission.items[int(made.mission.items[-2].params[0]) - 1]
    assert target == way(500.0, 0.0, 60.0)


@pytest.mark.parametrize(
    "low",
    [
        item(Command.NAV_SPLINE_WAYPOINT, 500.0, 0.0, 60.0),
        item(Command.NAV_LOITER_TURNS, 400.0, 0.0, 60.0, params=(1.0, 0.0, 20.0, 0.0)),
        way(400.0, 0.0, 5.0, Frame.ABOVE_TERRAIN),
    ],
)
def test_what_is_not_plain_stays(low: MissionItem) -> None:
    made = fixed(up(), way(300.0, 0.0, 60.0), low, home())
    assert made.mission.items == mission(up(), way(300.0, 0.0, 60.0), low, home()).items
