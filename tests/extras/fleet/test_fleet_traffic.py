"""Who may start, who holds its place and who may fly home, on paths that are easy to see through."""

from collections.abc import Callable

import numpy as np
import pytest

from uavcover.errors import InfeasibleError
from uavcover.extras.fleet.traffic import FleetPhase, Traffic
from uavcover.missions.fleet_schedule import Timeline
from uavcover.model.vehicle import Fleet

FLEET = Fleet(vehicles=3, separation_m=20.0, path_error_m=2.0, timing_error_fraction=0.0, start_error_s=1.0, pad_s=10.0)
HOME = (0.0, 0.0, 0.0)


def out_and_back(north_m: float, *, home: tuple[float, float, float] = HOME, speed_m_s: float = 10.0) -> Timeline:
    """Up to 50 m, 300 m east beside home, back, and down."""
    e, n, u = home
    position = np.array([home, (e, n, u + 50.0), (e, n + north_m, u + 50.0), (e + 300.0, n + north_m, u + 50.0)])
    position = np.vstack([position, position[2::-1]])
    legs = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return Timeline(np.concatenate([[0.0], np.cumsum(np.maximum(legs / speed_m_s, 1.0))]), position)


def traffic(**flights: tuple[Timeline, float]) -> Traffic:
    made = Traffic(FLEET)
    for name, (timeline, planned_s) in flights.items():
        made.add(name, timeline, planned_s=planned_s, pace_m_s=(10.0, 3.0))
    return made


def test_in_the_order_and_at_the_times_of_the_plan() -> None:
    flights = traffic(a=(out_and_back(0.0), 0.0), b=(out_and_back(200.0, home=(0.0, 400.0, 0.0)), 30.0))
    assert not flights.begun
    assert not flights.start("b", 50.0)
    assert flights.start("a", 100.0)
    assert flights.phase("a") is FleetPhase.FLYING
    assert not flights.start("b", 129.0)
    assert flights.start("b", 130.0)
    assert flights.since_first_s(140.0) == 40.0


def test_one_that_is_dropped_is_not_waited_for() -> None:
    flights = traffic(a=(out_and_back(0.0), 0.0), b=(out_and_back(200.0, home=(0.0, 400.0, 0.0)), 0.0))
    flights.drop("a")
    assert flights.start("b", 5.0)


def test_a_start_waits_for_where_the_other_really_is() -> None:
    """Planned 12 s after the first, which hangs in the column above home for 40 s."""
    flights = traffic(a=(out_and_back(0.0), 0.0), b=(out_and_back(150.0), 16.0))
    assert flights.start("a", 0.0)
    for now in range(1, 41):
        flights.moved("a", float(now), np.array([0.0, 0.0, 10.0]))
        assert not flights.start("b", float(now))
    began = None
    for now in range(41, 70):
        flights.moved("a", float(now), out_and_back(0.0).positions_m(np.array([now - 39.0]))[0])
        if flights.start("b", float(now)):
            began = now
            break
    assert began is not None
    assert began - 39.0 >= 5.0  # it is out of the column, and far enough
    assert flights.late_s("a") == pytest.approx(39.0, abs=1.0)


def begin_of_the_second(aloft_s_at: Callable[[float], float]) -> int:
    """When the second of two flights begins, by how far along its line the first one is at each time."""
    line = out_and_back(0.0)
    flights = traffic(a=(line, 0.0), b=(out_and_back(150.0), 42.0))
    assert flights.start("a", 0.0)
    for now in range(1, 400):
        aloft_s = min(aloft_s_at(now), line.duration_s)
        flights.moved("a", float(now), line.positions_m(np.array([aloft_s]))[0])
        if aloft_s >= line.duration_s and flights.phase("a") is FleetPhase.FLYING:
            flights.landed("a", float(now))
        if flights.start("b", float(now)):
            return now
    pytest.fail("it never begins")


def test_a_start_waits_for_one_that_gets_later_all_the_way() -> None:
    """The first one flies at half its speed; the second one, on another line, is to come home behind it."""
    line, short = out_and_back(0.0), out_and_back(150.0)
    began = {}
    for pace in (1.0, 0.5):
        began[pace] = begin_of_the_second(lambda now: pace * now)  # noqa: B023
        # Seen along its line at that pace, the first one is out of the way of the whole flight of the second one.
        times = np.arange(0.0, short.duration_s, 0.5)
        first = line.positions_m(np.minimum(pace * (began[pace] + times), line.duration_s))
        landed = pace * (began[pace] + times) >= line.duration_s
        apart = np.linalg.norm(first - short.positions_m(times), axis=1)
        assert apart[~landed].min(initial=np.inf) >= FLEET.separation_m
    assert began[0.5] > began[1.0]


def test_a_delay_on_the_ground_is_not_taken_for_wind() -> None:
    """The first one stands armed for a while and then flies as planned: the second one is apart from it at its time."""
    assert begin_of_the_second(lambda now: now) == 42
    assert begin_of_the_second(lambda now: max(now - 20.0, 0.0)) == 42


def test_who_comes_to_the_pad_holds_until_it_is_free() -> None:
    line = out_and_back(0.0)
    flights = traffic(a=(out_and_back(100.0), 0.0), b=(line, 60.0))
    assert flights.start("a", 0.0)
    flights.moved("a", 1.0, np.array([300.0, 100.0, 50.0]))
    flights._flights["a"].progress_s = 50.0
    assert not flights.start("b", 60.0), "the first one is still out"
    flights.landed("a", 100.0)
    flights._flights["b"].phase = FleetPhase.FLYING
    flights._flights["b"].progress_s = line.duration_s - 8.0
    flights._flights["b"].observed_s = 101.0
    assert flights.must_hold("b", 101.0)
    assert not flights.must_hold("b", 111.0)


def test_nobody_holds_for_one_that_will_have_landed_and_left_the_pad() -> None:
    """Both as planned: the second one hung in the air until the first one had landed and left the pad."""
    first, second = out_and_back(0.0), out_and_back(150.0)
    flights = traffic(a=(first, 0.0), b=(second, 6.0))
    assert flights.start("a", 0.0)
    began = None
    for now in range(1, 120):
        flights.moved("a", float(now), first.positions_m(np.array([float(now)]))[0])
        if now == first.duration_s:
            flights.landed("a", float(now))
        if began is None:
            began = now if flights.start("b", float(now)) else None
        else:
            flights.moved("b", float(now), second.positions_m(np.array([float(now - began)]))[0])
            assert not flights.must_hold("b", float(now)), now
    assert began is not None
    assert began + second.duration_s < first.duration_s + 45.0


def test_who_comes_before_the_pad_is_free_holds_in_time() -> None:
    """The first one hangs over home: what comes behind it holds before it is there, although the plan has it down by then."""
    first, second = out_and_back(0.0), out_and_back(150.0)
    flights = traffic(a=(first, 0.0), b=(second, 6.0))
    assert flights.start("a", 0.0)
    began = None
    for now in range(1, 140):
        flights.moved("a", float(now), first.positions_m(np.array([min(now, 67.0)]))[0])
        if began is None:
            began = now if flights.start("b", float(now)) else None
        else:
            position_m = second.positions_m(np.array([float(now - began)]))[0]
            flights.moved("b", float(now), position_m)
            if flights.must_hold("b", float(now)):
                break
    assert flights.must_hold("b", float(now))
    assert float(np.linalg.norm(position_m - np.array([0.0, 0.0, 50.0]))) > FLEET.held_apart_m


def test_the_later_one_lets_the_earlier_one_pass() -> None:
    """Two lines that cross in the middle, both there at the same time."""
    one = Timeline(np.array([0.0, 10.0, 50.0]), np.array([(-200.0, 0.0, 0.0), (-200.0, 0.0, 50.0), (200.0, 0.0, 50.0)]))
    two = Timeline(np.array([0.0, 10.0, 50.0]), np.array([(0.0, -200.0, 0.0), (0.0, -200.0, 50.0), (0.0, 200.0, 50.0)]))
    flights = traffic(a=(one, 0.0), b=(two, 1.0))
    assert flights.start("a", 0.0)
    flights._flights["b"].phase = FleetPhase.FLYING  # as if the first had been late
    at = {"a": 12.0, "b": 12.0}
    least = np.inf
    held = 0
    for step in range(120):
        now = 12.0 + 0.5 * step
        for name, line in (("a", one), ("b", two)):
            position = line.positions_m(np.array([at[name]]))[0]
            flights.moved(name, now, position)
            if not flights.must_hold(name, now):
                at[name] = min(at[name] + 0.5, 50.0)
            elif name == "b":
                held += 1
            else:
                pytest.fail("the earlier one need not hold")
        apart = np.linalg.norm(one.positions_m(np.array([at["a"]])) - two.positions_m(np.array([at["b"]])))
        least = min(least, float(apart))
    assert at == {"a": 50.0, "b": 50.0}
    assert held > 0
    assert least >= FLEET.separation_m


def test_home_one_after_the_other_the_nearest_first() -> None:
    flights = traffic(a=(out_and_back(0.0), 0.0), b=(out_and_back(60.0), 0.0), c=(out_and_back(-60.0), 0.0))
    positions = {"a": (100.0, 0.0, 50.0), "b": (200.0, 60.0, 50.0), "c": (250.0, -60.0, 50.0)}
    paths = {name: np.array([position, (0.0, 0.0, 50.0), HOME]) for name, position in positions.items()}
    for name, position in positions.items():
        flights._flights[name].phase = FleetPhase.FLYING
        flights.moved(name, 10.0, np.array(position))
    assert not flights.may_go_home("b", 10.0, paths["b"], all_return=True)  # the others do not hold yet
    assert not flights.may_go_home("c", 10.0, paths["c"], all_return=True)
    assert flights.may_go_home("a", 11.0, paths["a"], all_return=True)
    assert not flights.may_go_home("b", 12.0, paths["b"], all_return=True)
    flights.landed("a", 50.0)
    assert not flights.may_go_home("c", 51.0, paths["c"], all_return=True)  # b is nearer
    assert flights.may_go_home("b", 51.0, paths["b"], all_return=True)
    flights.landed("b", 90.0)
    assert flights.may_go_home("c", 91.0, paths["c"], all_return=True)


def flying(**positions: tuple[float, float, float]) -> Traffic:
    """Flights along lines 60 m beside each other, seen at these places."""
    flights = traffic(**{name: (out_and_back(60.0 * k), 0.0) for k, name in enumerate(positions)})
    for name, position in positions.items():
        flights._flights[name].phase = FleetPhase.FLYING
        flights.moved(name, 10.0, np.array(position))
    return flights


PATH = np.array([(150.0, 60.0, 50.0), (0.0, 0.0, 50.0), HOME])


def test_a_way_home_is_given_before_the_vehicle_stops() -> None:
    flights = flying(a=(250.0, 0.0, 50.0), b=(150.0, 60.0, 50.0))
    assert not flights.give_return("b", 10.0, PATH, within_s=60.0)  # a comes home by then
    assert flights.phase("b") is FleetPhase.FLYING
    flights = flying(a=(40.0, 0.0, 50.0), b=(150.0, 60.0, 50.0))
    flights._flights["a"].progress_s = 10.0  # on its way out
    assert not flights.give_return("b", 10.0, PATH, within_s=20.0)
    flights.moved("a", 20.0, np.array([140.0, 0.0, 50.0]))
    assert flights.give_return("b", 20.0, PATH, within_s=20.0)
    assert flights.phase("b") is FleetPhase.HOMEWARD
    stopped = PATH.copy()
    stopped[0] = (170.0, 60.0, 50.0)
    assert flights.may_go_home("b", 25.0, stopped, all_return=False)
    flights._flights["a"].progress_s = flights._flights["a"].timeline.duration_s - 20.0
    assert flights.must_hold("a", 26.0)  # it comes near, and keeps clear


@pytest.mark.parametrize("phase", [FleetPhase.HOLDING, FleetPhase.HOMEWARD])
def test_no_way_home_is_given_while_another_one_has_or_wants_one(phase: FleetPhase) -> None:
    flights = flying(a=(250.0, 0.0, 50.0), b=(150.0, 60.0, 50.0))
    flights._flights["a"].phase = phase
    assert not flights.give_return("b", 10.0, PATH, within_s=1.0)
    assert flights.phase("b") is FleetPhase.FLYING


def test_no_way_home_leads_to_where_another_vehicle_stands() -> None:
    flights = flying(a=(250.0, 0.0, 50.0), b=(150.0, 60.0, 50.0))
    flights.landed("a", 10.0)
    assert not flights.give_return("b", 10.0, PATH, within_s=FLEET.pad_s - 1.0)
    assert flights.give_return("b", 10.0, PATH, within_s=FLEET.pad_s + 1.0)


def test_two_in_each_others_way_are_told() -> None:
    flights = traffic(a=(out_and_back(0.0), 0.0), b=(out_and_back(0.0, home=(300.0, 0.0, 0.0)), 0.0))
    flights._flights["a"].phase = flights._flights["b"].phase = FleetPhase.FLYING
    flights.moved("a", 10.0, np.array([200.0, 0.0, 50.0]))
    flights.moved("b", 10.0, np.array([100.0, 0.0, 50.0]))
    path_a = np.array([(200.0, 0.0, 50.0), (0.0, 0.0, 50.0), HOME])
    path_b = np.array([(100.0, 0.0, 50.0), (300.0, 0.0, 50.0), (300.0, 0.0, 0.0)])
    assert not flights.may_go_home("a", 10.0, path_a, all_return=True)
    with pytest.raises(InfeasibleError, match="do not keep the separation from each other"):
        flights.may_go_home("b", 10.0, path_b, all_return=True)


def test_nobody_starts_while_a_lost_one_may_be_anywhere() -> None:
    flights = traffic(a=(out_and_back(0.0), 0.0), b=(out_and_back(0.0, home=(0.0, 900.0, 0.0)), 0.0))
    assert flights.start("a", 0.0)
    flights.lost("a", down_by_s=300.0)
    assert not flights.start("b", 299.0)
    assert flights.start("b", 300.0)


def test_where_a_flight_is_in_its_plan() -> None:
    line = out_and_back(30.0)
    for time_s in np.linspace(0.0, line.duration_s, 40):
        position = line.positions_m(np.array([time_s]))[0] + [0.0, 1.0, 0.5]
        found = line.nearest_time_s(position, from_s=time_s - 4.0, to_s=time_s + 6.0)
        assert found == pytest.approx(time_s, abs=4.0)  # at a turn the same place comes twice
        assert np.linalg.norm(line.positions_m(np.array([found]))[0] - position) < 1.2


def lost_on_return(*, may_wait_s: float) -> list[float]:
    """Seconds at which a vehicle that comes home a little later must hold because of one that was lost on the same line."""
    line = out_and_back(0.0)
    flights = traffic(a=(line, 0.0), b=(line, 16.0))
    flights._flights["a"].phase = flights._flights["b"].phase = FleetPhase.FLYING
    for name, progress_s in (("a", line.duration_s - 40.0), ("b", line.duration_s - 43.0)):
        flights._flights[name].progress_s = progress_s
        flights.moved(name, 0.0, line.positions_m(np.array([progress_s]))[0])
    flights.lost("a", down_by_s=500.0)
    return [now for now in np.arange(0.0, 200.0, 5.0) if flights.must_hold("b", now, may_wait_s=may_wait_s)]


def test_nobody_in_the_air_waits_for_a_lost_one_longer_than_it_may_fly() -> None:
    """On the ground they wait until its battery is empty; in the air that would empty theirs."""
    held_s = lost_on_return(may_wait_s=60.0)
    assert held_s[0] == 0.0
    assert 30.0 <= held_s[-1] <= 40.0 + FLEET.pad_s


def test_whose_battery_does_not_last_does_not_wait_for_a_lost_one() -> None:
    assert lost_on_return(may_wait_s=-1.0) == []


def test_a_lost_one_that_is_heard_again_is_where_it_is() -> None:
    line = out_and_back(0.0)
    flights = traffic(a=(line, 0.0), b=(out_and_back(300.0, home=(0.0, 600.0, 0.0)), 0.0))
    assert flights.start("a", 0.0)
    flights.moved("a", 20.0, line.positions_m(np.array([20.0]))[0])
    flights.lost("a", down_by_s=300.0)
    late = line.positions_m(np.array([30.0]))[0]
    flights.moved("a", 50.0, late)
    assert flights.lands_s("a") == pytest.approx(50.0 + line.duration_s - 30.0, abs=0.5)
    flights.landed("a", 90.0)
    assert flights.phase("a") is FleetPhase.DOWN
