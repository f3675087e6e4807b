"""No sequence of messages, however senseless, finds a situation that a transition table does not know."""

import random

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.model.items import MissionType
from mission_io.protocol.download import Download
from mission_io.protocol.exchange import Clear
from mission_io.protocol.server import MissionServer
from mission_io.protocol.upload import Upload
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, items, play

RESULTS = ("ACCEPTED", "ERROR", "NO_SPACE", "INVALID", "INVALID_SEQUENCE", "DENIED", "OPERATION_CANCELLED")
STEPS = (
    *(f"ack {result}" for result in RESULTS),
    *(f"{kind} {number}" for kind in ("req", "oldreq", "item", "count") for number in (0, 1, 2, 3, 11)),
    *("list", "clear", "clear /all", "list /rally", "list /unknown", "count 2 /rally", "count 2 @9", "item 1 bad"),
    *("wait 0.06", "wait 0.3", "wait 1.1", "wait 6", "wait 17"),
)
CLIENT = {"mission_type": MissionType.MISSION, "local": GROUND, "vehicle": VEHICLE, "now": 0.0}


@pytest.mark.parametrize("kind", ["upload", "empty upload", "download", "clear"])
def test_client(kind: str) -> None:
    rng = random.Random(kind)
    for _ in range(150):
        machine: Upload | Download | Clear
        if kind == "clear":
            machine = Clear(**CLIENT)
        else:
            machine = Download(**CLIENT) if kind == "download" else Upload(items(0 if "empty" in kind else 3), **CLIENT)
        steps = (*STEPS, *([] if kind == "clear" else ["cancel"]))
        play(machine, ", ".join(rng.choices(steps, k=30)), sender=VEHICLE, to=GROUND)
        assert machine.finished == (machine.next_timer() is None)


@pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)
def test_server(autopilot: Autopilot) -> None:
    rng = random.Random(autopilot.name)
    for _ in range(150):
        server = MissionServer(autopilot, local=VEHICLE, capacity=10)
        play(server, ", ".join(rng.choices(STEPS, k=30)), sender=GROUND, to=VEHICLE)
        assert all(len(server.items(mission_type)) <= 10 for mission_type in MissionType)
