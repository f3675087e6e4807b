"""On the ground, and fallen: only where word, height and motion agree."""

import itertools

import pytest

from mission_io.model.enums import LandedState
from mission_io.wire import messages as m
from uavcover.flight.ground_contact import GroundContact
from uavcover.flight.session import FOLLOWING

HOME_ALT_M = 312.5


def position(time_s: float, height_m: float, *, sink_m_s: float = 0.0, speed_m_s: float = 0.0, lat_deg: float = 36.5):
    return m.GlobalPositionInt(time_s, lat_deg, -84.2, HOME_ALT_M + height_m, height_m, speed_m_s, 0.0, sink_m_s, 0.0)


def contact(
    state: LandedState | None, height_m: float, *, sink_m_s: float = 0.0, speed_m_s: float = 0.0, words: int = 9
):
    """Three seconds at 10 Hz; now is 3.0 s."""
    ground = GroundContact()
    for step in range(31):
        ground.take_position(
            position(0.1 * step, height_m - sink_m_s * 0.1 * step, sink_m_s=sink_m_s, speed_m_s=speed_m_s)
        )
    if state is not None:
        for number in range(words):
            ground.take_word(state, 3.0 - 0.3 * (words - 1 - number))
    return ground


def test_all_that_tells_agrees():
    assert contact(LandedState.ON_GROUND, 0.3).on_ground(3.0) is True


@pytest.mark.parametrize(
    ("state", "height_m", "sink_m_s", "speed_m_s", "words"),
    [
        case
        for case in itertools.product(
            [None, *LandedState], [0.3, 60.0, -40.0], [0.0, 0.8, 19.0, -3.0], [0.0, 8.0], [1, 9]
        )
        if case != (LandedState.ON_GROUND, 0.3, 0.0, 0.0, 9)
    ],
)
def test_one_that_disagrees_is_enough(state, height_m, sink_m_s, speed_m_s, words):
    ground = contact(state, height_m, sink_m_s=sink_m_s, speed_m_s=speed_m_s, words=words)
    assert ground.on_ground(3.0) is not True


def test_without_a_position_its_word_proves_nothing():
    ground = GroundContact()
    for step in range(9):
        ground.take_word(LandedState.ON_GROUND, 0.3 * step)
    assert ground.on_ground(2.4) is None
    old = contact(LandedState.ON_GROUND, 0.3)
    assert old.on_ground(30.0) is None


def test_on_a_hill_the_terrain_tells_the_height():
    ground = contact(LandedState.ON_GROUND, 60.0)
    assert ground.on_ground(3.0) is None, "60 m above home, and nothing is known of a hill"
    hill = GroundContact()
    hill.know_ground(lambda *_: 310.0 + 60.0, home_alt_amsl_m=310.0)
    for step in range(31):
        hill.take_position(position(0.1 * step, 60.4))
    for step in range(9):
        hill.take_word(LandedState.ON_GROUND, 0.6 + 0.3 * step)
    assert hill.on_ground(3.0) is True


def fall_from(
    height_m: float, *, ground_m: float = 0.0, hz: float = 10.0, at_s: float = 10.0, heard_after_s: float = 0.8,
    judged_after_s: float = 8.0,
):  # fmt: skip
    """Disarmed ``height_m`` above the ground, which is ``ground_m`` above home; the heartbeat tells it later."""
    ground, time_s = GroundContact(), 0.0
    while time_s < at_s + judged_after_s:
        since_s = max(0.0, time_s - at_s)
        above_m = max(0.0, height_m - 4.9 * since_s**2)
        sink_m_s = 9.8 * since_s if above_m > 0.0 else 0.0
        ground.take_position(position(time_s, ground_m + above_m, sink_m_s=sink_m_s))
        ground.take_word(LandedState.ON_GROUND if since_s > 0.0 else LandedState.IN_AIR, time_s)
        time_s += 1.0 / hz
    return ground.fall(at_s + heard_after_s, time_s)


@pytest.mark.parametrize("ground_m", [-120.0, 0.0, 80.0])
@pytest.mark.parametrize("hz", [4.0, 10.0, 50.0])
@pytest.mark.parametrize("heard_after_s", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("height_m", [5.0, 30.0, 120.0])
def test_a_fall_is_known_by_its_motion_with_its_height(height_m, heard_after_s, hz, ground_m):
    fall = fall_from(height_m, ground_m=ground_m, hz=hz, heard_after_s=heard_after_s)
    assert fall is not None
    assert fall.height_m == pytest.approx(ground_m + height_m, abs=0.5)
    assert fall.above == "home"


@pytest.mark.parametrize("ground_m", [-120.0, 0.0, 80.0])
@pytest.mark.parametrize("land_m_s", [0.3, 0.7, 1.5])
@pytest.mark.parametrize("rest_s", [0.5, 2.0, 8.0])
@pytest.mark.parametrize("descent_m_s", [1.5, 6.0])
def test_a_landing_is_no_fall_however_high_the_ground_is(land_m_s, rest_s, ground_m, descent_m_s):
    ground, touch_s, time_s = GroundContact(), 30.0, 0.0
    while time_s <= touch_s + rest_s:
        left_s = max(0.0, touch_s - time_s)
        slow = left_s < 8.0
        above_m = land_m_s * left_s if slow else 8.0 * land_m_s + descent_m_s * (left_s - 8.0)
        sink_m_s = 0.0 if left_s == 0.0 else land_m_s if slow else descent_m_s
        ground.take_position(position(time_s, ground_m + above_m, sink_m_s=sink_m_s))
        ground.take_word(LandedState.ON_GROUND if left_s == 0.0 else LandedState.LANDING, time_s)
        time_s += 0.1
    assert ground.fall(time_s, time_s) is None


@pytest.mark.parametrize("land_m_s", [0.3, 0.7, 1.5])
@pytest.mark.parametrize("hz", [1.0, 10.0])
def test_a_landing_is_no_fall_where_it_is_told_late(hz, land_m_s):
    """Many messages come at once, those of the landing and of the disarmed vehicle among them."""
    ground, time_s, touch_s = GroundContact(), 0.0, 10.0
    while time_s < touch_s + 3.0:
        left_s = max(0.0, touch_s - time_s)
        ground.take_position(position(time_s, land_m_s * left_s, sink_m_s=land_m_s if left_s > 0.0 else 0.0))
        ground.take_word(LandedState.LANDING if left_s > 0.0 else LandedState.ON_GROUND, time_s)
        time_s += 1.0 / hz
    assert ground.fall(1.0, time_s) is None


@pytest.mark.parametrize("hz", [0.5, 1.0])
def test_a_fall_that_few_positions_show_is_one(hz):
    ground, time_s = GroundContact(), 0.0
    while time_s < 12.0:
        fallen_s = max(0.0, time_s - 4.1)
        above_m = max(0.0, 6.0 - 0.7 * min(time_s, 4.1) - 4.9 * fallen_s**2) + 3.0 * (time_s < 4.1)
        ground.take_position(position(time_s, above_m, sink_m_s=0.7 if fallen_s == 0.0 else 0.0))
        ground.take_word(LandedState.ON_GROUND if fallen_s > 0.0 else LandedState.LANDING, time_s)
        time_s += 1.0 / hz
    assert ground.fall(4.5, time_s) is not None


def test_disarmed_high_up_and_not_heard_again_is_a_fall():
    ground = contact(LandedState.ON_GROUND, 45.0)
    assert ground.fall(3.0, 3.5) is None
    fall = ground.fall(3.0, 9.0)
    assert fall is not None
    assert fall.height_m == 45.0


def test_a_fall_is_known_until_following_has_waited_for_all():
    """Above the ground of the elevation model, as in a tree, it is never on the ground, so following waits longest."""
    longest_s = FOLLOWING.second_beat_s + FOLLOWING.evidence_s + FOLLOWING.comes_to_rest_s
    fall = fall_from(70.0, ground_m=28.0, hz=10.0, heard_after_s=0.0, judged_after_s=longest_s)
    assert fall is not None
    assert fall.height_m == pytest.approx(98.0, abs=0.5)
