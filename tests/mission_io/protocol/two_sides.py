"""What the tests of faults share: a client or a vehicle that is told a script, and a vehicle that loses what it sends."""

from collections.abc import Callable, Container, Iterable
from typing import Any

import pytest

from mission_io.autopilots.autopilot import ARDUPILOT, PX4, Autopilot
from mission_io.model.items import Command, Frame, MissionItem, MissionType
from mission_io.protocol.server import MissionServer
from mission_io.protocol.tables import UploadState
from mission_io.protocol.upload import Upload
from mission_io.wire.messages import MissionCount, Received, message_from_item
from tests.mission_io.protocol.scripts import GROUND, VEHICLE, items, play, text
from tests.mission_io.vehicle import VehiclePeer

BOTH = pytest.mark.parametrize("autopilot", [ARDUPILOT, PX4], ids=lambda a: a.name)


def untested(faults: Iterable[str], names: Container[str]) -> list[str]:
    """The tests that are missing: of each fault there is one from the client's side and one from the vehicle's."""
    wanted = [f"test_{side}_{fault}" for fault in faults for side in ("client", "vehicle")]
    return [name for name in wanted if name not in names]


def upload(count: int = 5) -> Upload:
    return Upload(items(count), mission_type=MissionType.MISSION, local=GROUND, vehicle=VEHICLE, now=0.0)


def client_script(steps: str, count: int = 5) -> tuple[UploadState, list[str]]:
    machine = upload(count)
    sent = play(machine, steps, sender=VEHICLE, to=GROUND)
    return machine.state, sent


def vehicle(autopilot: Autopilot = PX4, *, capacity: int | None = None, held: int = 0) -> MissionServer:
    server = MissionServer(autopilot, local=VEHICLE, capacity=capacity)
    server.set_items(MissionType.MISSION, items(held))
    return server


def vehicle_script(steps: str, server: MissionServer) -> list[str]:
    return play(server, steps, sender=GROUND, to=VEHICLE)


def held(peer: VehiclePeer) -> tuple[MissionItem, ...]:
    return peer.server.items(MissionType.MISSION)


def losing(peer: VehiclePeer, lose: Callable[[Any], bool]) -> VehiclePeer:
    """The peer without some of what its server sends."""
    send = peer.server.messages_to_send
    peer.server.messages_to_send = lambda now: [m for m in send(now) if not lose(m)]  # type: ignore[method-assign]
    return peer


def first_of(kind: type, count: int = 1) -> Callable[[Any], bool]:
    """True for the first messages of a kind."""
    left = [count]

    def is_first(message: Any) -> bool:
        if isinstance(message, kind) and left[0]:
            left[0] -= 1
            return True
        return False

    return is_first


def polygon_items(*, count: int, vertices: int, frame: Frame = Frame.AMSL) -> list[MissionItem]:
    return [
        MissionItem(
            Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, frame, (float(count), 0.0, 0.0, 0.0), 46.0 + i * i, 7.0 + i
        )
        for i in range(vertices)
    ]


def fence_answer(server: MissionServer, fence: list[MissionItem]) -> str:
    server.receive(Received(MissionCount(1, 1, len(fence), MissionType.FENCE), 255, 190), 0.0)
    for seq, item in enumerate(fence):
        message = message_from_item(item, seq, mission_type=MissionType.FENCE, target_system=1, target_component=1)
        server.receive(Received(message, 255, 190), 0.0)
    return text(server.messages_to_send(0.0)[-1])
