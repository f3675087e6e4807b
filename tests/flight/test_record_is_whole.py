"""Each position of the vehicle's own log is a sample, whatever happens to the mission and however often it tells."""

import contextlib

import numpy as np
import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.wire import messages as m
from tests.flight.scene import Scene, make_scene, mission
from uavcover.flight.orders import FlightTimeouts
from uavcover.mock.faults import parse_fault
from uavcover.mock.state import Streams
from uavcover.mock.telemetry import TruthSample
from uavcover.model.outcome import Ending, FlightFailedError

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
TIMEOUTS = FlightTimeouts(override_s=10.0, held_s=10.0, ready_s=20.0, stuck_s=20.0)


def scene_at(
    rate_hz: float, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch, *faults: str
) -> tuple[Scene, list[TruthSample]]:
    """A vehicle that tells its position and attitude so often, whatever it is asked for, and its own log."""
    asked = Streams.set_interval

    def set_interval(self: Streams, kind: type[m.Message], interval_s: float | None, now: float) -> None:
        own = kind in (m.GlobalPositionInt, m.Attitude)
        asked(self, kind, 1.0 / rate_hz if own else interval_s, now)

    monkeypatch.setattr(Streams, "set_interval", set_interval)
    log: list[TruthSample] = []
    scene = make_scene(autopilot, on_truth=log.append, faults=[parse_fault(fault) for fault in faults])
    scene.upload(mission())
    return scene, log


def assert_whole(scene: Scene, log: list[TruthSample]) -> None:
    times_s = [sample.time_s for sample in scene.samples]
    told = [true for true in log if times_s[0] - 1e-9 <= true.time_s <= times_s[-1] + 1e-9]
    assert times_s == pytest.approx([true.time_s for true in told], abs=0.0011), "MAVLink counts milliseconds"
    recorded = np.array([(s.lat_deg, s.lon_deg, s.alt_amsl_m) for s in scene.samples])
    true = np.array([(s.lat_deg, s.lon_deg, s.alt_amsl_m) for s in told])
    assert np.abs(recorded[:, :2] - true[:, :2]).max() <= 0.6e-7
    assert np.abs(recorded[:, 2] - true[:, 2]).max() <= 0.0006


@pytest.mark.thinned
@BOTH
@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 17.0, 50.0])
def test_at_every_rate_each_position_is_a_sample(
    rate_hz: float, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, log = scene_at(rate_hz, autopilot, monkeypatch)
    outcome = scene.fly()
    assert outcome.ending is Ending.LANDED
    assert_whole(scene, log)
    assert len(scene.samples) == pytest.approx(rate_hz * outcome.duration_s, rel=0.02)


@BOTH
@pytest.mark.parametrize("rate_hz", [1.0, 2.0, 4.0])
def test_a_rate_that_is_too_low_keeps_it_on_the_ground(
    rate_hz: float, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, _ = scene_at(rate_hz, autopilot, monkeypatch)
    begun: list[bool] = []
    with pytest.raises(FlightFailedError, match=r"GlobalPositionInt .*requires 5|no position messages") as caught:
        scene.fly(on_begin=lambda: begun.append(True))
    assert caught.value.outcome.ending is Ending.NOT_READY
    assert not scene.vehicle.armed
    assert begun == scene.samples == []


@pytest.mark.thinned
@BOTH
@pytest.mark.parametrize(
    "fault", ["mission-changed@15s", "mission-changed@25s", "pilot-mode:land@20s", "pilot-mode@20s"]
)
def test_nothing_is_left_out_when_somebody_else_has_the_vehicle_or_its_mission(
    fault: str, autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, log = scene_at(10.0, autopilot, monkeypatch, fault)
    with pytest.raises(FlightFailedError):
        scene.fly(timeouts=TIMEOUTS)
    assert_whole(scene, log)
    assert -1 in [sample.current_waypoint for sample in scene.samples[-20:]]
    assert scene.samples[-1].time_s > 25.0


@BOTH
def test_what_cannot_be_written_keeps_it_on_the_ground(autopilot: Autopilot, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, _ = scene_at(10.0, autopilot, monkeypatch)

    def refuse() -> None:
        raise OSError("no room")

    with contextlib.suppress(OSError):
        scene.fly(on_begin=refuse)
        pytest.fail("it flew")
    assert not scene.vehicle.armed
    assert scene.samples == []
    assert scene.monitor.on_position is None
