"""What the mock vehicle does with each kind of message that reaches it."""

from typing import TYPE_CHECKING

from mission_io import messages as m
from mission_io.enums import VehicleClass
from uavcover.flight.mock.commands import answer_command, answer_parameter, request_stream
from uavcover.flight.modes import mode_from_custom

if TYPE_CHECKING:
    from uavcover.flight.mock.vehicle import MockVehicle


def take(vehicle: "MockVehicle", received: m.Received) -> list[m.Message]:
    """Act on a message, and return what is answered at once."""
    message = received.message
    match message:
        case m.Heartbeat():
            if message.vehicle_type == VehicleClass.GROUND_STATION:
                vehicle.failsafes.hear_ground_station(vehicle)
        case m.CommandLong() | m.CommandInt():
            result = answer_command(vehicle, message)
            to = {"target_system": received.system_id, "target_component": received.component_id}
            return [m.CommandAck(message.command, result, **to)]
        case m.SetMode():
            mode = mode_from_custom(vehicle.autopilot, message.custom_mode)
            if mode is not None:
                vehicle.set_mode(mode)
        case m.MissionSetCurrent():
            vehicle.set_current(message.seq)
        case m.ParamRequestRead() | m.ParamSet():
            value = answer_parameter(vehicle, message)
            return [] if value is None else [value]
        case m.ParamRequestList():
            return list(vehicle.parameters.messages())
        case m.RequestDataStream():
            request_stream(vehicle, message)
        case m.TerrainData():
            if vehicle.terrain is not None:
                vehicle.terrain.take(message)
        case m.LogRequestList():
            return [m.LogEntry(log_id=0, log_count=0, last_log_id=0, time_unix_s=0, size_bytes=0)]  # it keeps none
        case _:
            return vehicle.take_mission_message(received)
    return []
