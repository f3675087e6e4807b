"""Movement between reported positions, at any longitude and across the 180th meridian."""

from types import SimpleNamespace
from typing import Any

import pytest

from mission_io.wire import messages as m
from uavcover.flight.evidence import Causes
from uavcover.flight.follower import Stillness
from uavcover.flight.position_watch import HoldWatch
from uavcover.flight.session import FOLLOWING


def at(lat_deg: float, lon_deg: float, time_s: float = 1.0) -> m.GlobalPositionInt:
    return m.GlobalPositionInt(time_s, lat_deg, lon_deg, 100.0, 20.0, 0.0, 0.0, 0.0, None)


class Monitor:
    time_s, position_at_s, current_seq = 0.0, 0.0, 3
    position: Any = None

    def latest(self, _kind: type) -> Any:
        return self.position


def session() -> Any:
    return SimpleNamespace(
        monitor=Monitor(), client=SimpleNamespace(clock=SimpleNamespace(now=lambda: 0.0)),
        timeouts=SimpleNamespace(watchdog=2.0, held_s=60.0, deadman_s=3.0),
    )  # fmt: skip


@pytest.mark.parametrize("lon_deg", [0.0, 100.0, -179.9999999])
@pytest.mark.parametrize("moves_m", [0.9 * FOLLOWING.moved_m, 1.1 * FOLLOWING.moved_m])
def test_a_vehicle_that_moves_less_than_it_has_to_stands_still_everywhere(lon_deg, moves_m):
    ours = session()
    still = Stillness(ours, timeout_s=5.0)
    ours.monitor.position = at(45.0, lon_deg)
    assert not still.too_long
    ours.monitor.position, ours.monitor.time_s = at(45.0 + moves_m / 111_132.0, lon_deg), 6.0
    assert still.too_long is (moves_m < FOLLOWING.moved_m)


def test_a_hold_across_the_180th_meridian_is_no_drift():
    ours = session()
    hold = HoldWatch(ours, None, may_go_on=False)
    hold._position, ours.monitor.position = at(10.0, 179.99999), at(10.0, -179.99999)
    assert 1.0 < hold.drift_m < 4.0


def test_a_flight_across_the_180th_meridian_is_no_jump(monkeypatch):
    evidence, found = Causes.__new__(Causes), []
    evidence._before, evidence._monitor = None, Monitor()
    monkeypatch.setattr(Causes, "_note", lambda _self, cause, text: found.append((cause, text)))
    for position in (at(10.0, 179.99999, 1.0), at(10.0, -179.99999, 1.5)):
        evidence._monitor.position = position
        evidence._look_for_jump()
    assert not found
    evidence._monitor.position = at(10.01, -179.99999, 2.0)
    evidence._look_for_jump()
    assert len(found) == 1
