"""The mock vehicle of this project, in a thread of this process, on real UDP."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from sitl_tests.simulators.running import RunningVehicle, Start, StartRequest
from uavcover.missions.mission_compiler import AUTOPILOTS
from uavcover.mock.behaviour import GroundSource, quick
from uavcover.mock.faults import parse_fault
from uavcover.mock.server import BackgroundMock
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.vehicle import AutopilotName


def starter(autopilot: AutopilotName, *, vehicle_type: int) -> Start:
    """What starts a mock vehicle with the ways of an autopilot, which says that it is of a MAV_TYPE."""

    @contextmanager
    def start(request: StartRequest) -> Iterator[RunningVehicle]:
        asks = replace(
            quick(), terrain=GroundSource.GROUND_STATION
        )  # as ArduPilot does; PX4's ways have no such question
        config = MockConfig(speed=request.speed, vehicle_type=vehicle_type, behaviour=asks)
        vehicle = MockVehicle(AUTOPILOTS[autopilot], request.home, config)
        for name, value in request.parameters.items():
            if vehicle.parameters.name_of(name, -1) is not None:
                vehicle.parameters.put(name, value)
        with BackgroundMock(vehicle, speed=request.speed) as background:
            url = f"udpout://127.0.0.1:{background.port}"
            yield RunningVehicle(
                url=url,
                second_url=url,
                home=request.home,
                version=f"mock {autopilot}",
                log_files=lambda: (),
                inject=lambda fault: vehicle.faults.add(parse_fault(fault)),
            )

    return start
