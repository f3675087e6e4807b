"""Terrain heights for the vehicle of a client, whenever the client waits for anything."""

import logging

from mission_io.client.client import Client
from mission_io.errors import CommandRefusedError, VehicleSilentError
from mission_io.model.enums import AutopilotId
from mission_io.protocol.terrain import TerrainAnswers
from mission_io.protocol.tuning import CALLS
from mission_io.wire.messages import TerrainRequest

_log = logging.getLogger(__name__)


def answer_terrain_requests(client: Client, answers: TerrainAnswers) -> None:
    """Answer the vehicle's requests from now on, and have it send them.

    ArduPilot sends TERRAIN_REQUEST only on links that have asked for that message, or for the stream it belongs to. A vehicle
    without terrain refuses, which is no error: it has no requests either.
    """
    if answers not in client.services:
        client.services.append(answers)
    if client.vehicle.mav_autopilot != AutopilotId.ARDUPILOT:
        return
    try:
        client.request_message_interval(TerrainRequest, CALLS.terrain_every_s, timeout_s=CALLS.terrain_answer_s)
    except (CommandRefusedError, VehicleSilentError) as error:
        _log.info("the vehicle may not ask for terrain heights: %s", error)
