"""A few of the flights of ``scripts/fly_faults.py``, over a smaller mission."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from mission_io.links.simulated import Conditions
from tests.vehicle.scene import make_scene, mission, plan_for, way_home
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.faults import parse_fault
from uavcover.model.track import TrackSample
from uavcover.vehicle.fly import Orders, fly
from uavcover.vehicle.monitor import open_vehicle
from uavcover.vehicle.outcome import Ending, FlightFailedError
from uavcover.vehicle.precautions import OnBreach, Precautions

SCRIPT = Path(__file__).parents[2] / "scripts" / "fly_faults.py"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fly_faults", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fly_faults"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("flight", [*range(6), *(pytest.param(k, marks=pytest.mark.slow) for k in range(6, 12))])
def test_it_ends_in_a_name_and_no_sample_is_lost(
    script: ModuleType, flight: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "LONGEST_S", 70.0)
    drawn = script.draw(flight, seed=1)
    scene = make_scene(
        ARDUPILOT if drawn.autopilot == "ardupilot" else PX4, seed=flight, battery=BatteryData(endurance_s=400.0),
        conditions=Conditions(loss=drawn.loss), faults=[parse_fault(fault) for fault in drawn.faults],
    )  # fmt: skip
    link = script.CountedLink(scene.link)
    client, monitor = open_vehicle(link)
    client.wait_for_vehicle()
    assert client.upload_and_verify(mission()).passed
    samples: list[TrackSample] = []
    first: list[int] = []

    def take(sample: TrackSample) -> None:
        if not first:
            first.append(len(link.position_times_ms) - 1)
        samples.append(sample)

    try:
        outcome = fly(
            client,
            monitor,
            plan_for(mission()),
            Orders(
                on_sample=take,
                on_event=lambda _: None,
                timeouts=script.TIMEOUTS,
                stop=lambda: sum(scene.vehicle.powered_s >= s for s in drawn.stops_s),
                precautions=Precautions(on_breach=OnBreach.TELL),
            ),
            plan_return=way_home,
        )
    except FlightFailedError as error:
        outcome = error.outcome
    assert outcome.ending in Ending
    assert outcome.sample_count == len(samples)
    assert len(samples) == (script.in_order(link.position_times_ms[first[0] :]) if first else 0)


def test_draws_are_the_same_every_time_and_of_all_kinds(script: ModuleType) -> None:
    drawn = [script.draw(flight, seed=0) for flight in range(100)]
    assert drawn == [script.draw(flight, seed=0) for flight in range(100)]
    names = {fault.split(":")[0].split("@")[0] for one in drawn for fault in one.faults}
    assert names == {kind.value for kind in script.FaultKind}
    assert {one.autopilot for one in drawn} == {"ardupilot", "px4"}
    assert 3 < sum(bool(one.stops_s) for one in drawn) < 30
