"""Commands, parameters and logs with a vehicle that answers anything: each call ends within the time it was given."""

import contextlib
import math
import random
import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from mission_io.autopilots.autopilot import PX4
from mission_io.client.client import Client
from mission_io.client.files import FlightLogDownloads, list_flight_logs
from mission_io.errors import CommandRefusedError, FormatError, MissionIoError, TransferSilentError, VehicleSilentError
from mission_io.model.enums import CommandResult
from mission_io.model.items import Command, Frame, MissionItem, MissionType
from mission_io.wire import messages as m
from tests.mission_io.vehicle import VehiclePeer, connected

TIMEOUT_S = 6.0
LOG = m.LogEntry(3, 1, 3, 0, 50_000)


class AnswersAnything(VehiclePeer):
    """Answers whatever it hears with messages drawn at random, and goes on without being asked."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.rng = random.Random(seed)
        self.makers = self.rng.sample(self._makers(), self.rng.randrange(1, 7))
        self.each_s = self.rng.choice([0.01, 0.3, 5.0])
        self.talks_at = 0.0

    def _makers(self) -> list[Callable[[], m.Message]]:
        rng = self.rng
        return [
            lambda: m.CommandAck(rng.choice([400, 511, 512, 176]), CommandResult.IN_PROGRESS, target_system=255),
            lambda: m.CommandAck(rng.randrange(65536), rng.randrange(256), target_system=rng.choice([0, 9, 255])),
            lambda: m.CommandAck(400, rng.randrange(256), target_system=255),
            lambda: m.ParamValue(rng.choice(["", "OTHER", "WPNAV_SPEE", "ÿ"]), rng.choice([math.nan, math.inf, 0.0])),
            lambda: m.ParamValue("WPNAV_SPEED", rng.choice([math.nan, math.inf, -1.0])),
            lambda: m.LogEntry(rng.randrange(9), rng.randrange(1, 40), 9, 0, rng.randrange(2**32)),
            lambda: m.LogData(3, rng.choice([0, 90, 50_000, 2**32 - 1]), rng.randrange(256), (7,) * 90),
            lambda: m.LogData(3, rng.randrange(50_000), 0, (0,) * 90),
            lambda: m.LogData(rng.randrange(9), rng.randrange(50_000), 90, (1,) * 90),
            lambda: m.HomePosition(46.0, 7.0, 1.0),
        ]

    def on_message(self, received: m.Received, *_: object) -> None:
        if not isinstance(received.message, m.Heartbeat):
            self.outbox += [self.rng.choice(self.makers)() for _ in range(3)]

    def datagrams_to_send(self, now: float) -> list[bytes]:
        if now >= self.talks_at:
            self.talks_at = now + self.each_s
            self.outbox.append(self.rng.choice(self.makers)())
        return super().datagrams_to_send(now)

    def next_timer(self) -> float | None:
        timer = super().next_timer()
        return self.talks_at if timer is None else min(timer, self.talks_at)


CALLS: dict[str, Callable[[Client], object]] = {
    "command": lambda client: client.command(Command.COMPONENT_ARM_DISARM, 1.0, timeout_s=TIMEOUT_S),
    "mode": lambda client: client.set_mode(5, timeout_s=TIMEOUT_S / 2.0),
    "request": lambda client: client.request_message(m.HomePosition, timeout_s=TIMEOUT_S),
    "read parameter": lambda client: client.read_parameter("WPNAV_SPEED", timeout_s=TIMEOUT_S),
    "set parameter": lambda client: client.set_parameter("WPNAV_SPEED", 500.0, timeout_s=TIMEOUT_S),
    "list logs": lambda client: list_flight_logs(client, timeout_s=TIMEOUT_S),
    "log": lambda client: FlightLogDownloads(client, silent_s=TIMEOUT_S / 3.0).download(LOG),
}


@pytest.mark.parametrize("seed", [*range(20), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(20, 40))])
@pytest.mark.no_cover
def test_each_call_ends_in_time_with_an_answer_or_a_named_error(seed: int) -> None:
    for call in CALLS.values():
        peer = AnswersAnything(seed)
        client = connected(peer)
        peer.heard.clear()
        began_at = client.clock.now()
        with contextlib.suppress(MissionIoError):
            call(client)
        time_s = client.clock.now() - began_at
        assert time_s <= TIMEOUT_S + 0.01
        assert len([r for r in peer.heard if not isinstance(r.message, m.Heartbeat)]) <= 3 + 4 * TIMEOUT_S


@pytest.mark.parametrize(
    ("result", "error", "match"),
    [
        (CommandResult.IN_PROGRESS, VehicleSilentError, r"answer to command .* within 6 s"),
        (200, CommandRefusedError, "200"),
    ],
    ids=["in progress for ever", "a result that is none"],
)
def test_an_answer_to_a_command_that_is_no_end_or_no_result(
    result: int, error: type[MissionIoError], match: str
) -> None:
    class Answering(VehiclePeer):
        def on_message(self, received: m.Received, *_: object) -> None:
            if isinstance(received.message, m.CommandLong | m.Heartbeat):
                self.outbox.append(m.CommandAck(400, result, target_system=255, target_component=190))

    with pytest.raises(error, match=match):
        connected(Answering()).command(Command.COMPONENT_ARM_DISARM, 1.0, timeout_s=TIMEOUT_S)


@pytest.mark.parametrize(("count", "padded", "taken"), [(255, (), 0), (90, (), 90), (1, (7,) * 90, 0)])
def test_a_log_in_pieces_that_are_none_is_given_up(count: int, padded: tuple[int, ...], taken: int) -> None:
    """A piece that says that it has bytes and has none does not hang the download."""

    class Pieces(VehiclePeer):
        def on_message(self, received: m.Received, *_: object) -> None:
            if not isinstance(received.message, m.Heartbeat):
                self.outbox += [
                    m.LogData(3, 0, count, (*padded, *(0,) * (90 - len(padded)))),
                    m.LogData(3, 2**31, 90, (0,) * 90),
                ]

    with pytest.raises(TransferSilentError, match=f"stopped answering after {taken} of 50000 bytes"):
        FlightLogDownloads(connected(Pieces()), silent_s=2.0).download(LOG)


UP = MissionItem(Command.NAV_WAYPOINT, Frame.ABOVE_HOME, (0.0, 0.0, 0.0, 0.0), 46.5, -7.5, 40.0)
NOWHERE = [
    (
        replace(UP, lat_deg=214.7483647),
        "item 1, lat_deg: the latitude must be between -90 and 90, not 214.7483647; the vehicle cannot fly",
    ),
    (
        replace(UP, lat_deg=-90.0000001),
        "item 1, lat_deg: the latitude must be between -90 and 90, not -90.0000001; the vehicle cannot fly",
    ),
    (replace(UP, lon_deg=-180.1), "item 1, lon_deg: the longitude must be between -180 and 180"),
    (replace(UP, alt_m=math.nan), "item 1, alt_m: NaN is not a valid height"),
    (replace(UP, alt_m=-math.inf), "item 1, alt_m: -inf is not a number"),
    (replace(UP, params=(0.0, math.inf, 0.0, math.nan)), "item 1, param2: inf is not a number"),
]


@pytest.mark.parametrize(("item", "says"), NOWHERE)
@pytest.mark.parametrize("mission_type", [MissionType.MISSION, MissionType.RALLY])
def test_a_position_that_is_none_is_an_error_that_names_it(
    item: MissionItem, says: str, mission_type: MissionType
) -> None:
    """A download returned a latitude of 214.7 degrees and a NaN height."""
    peer = VehiclePeer(PX4)
    peer.server.set_items(mission_type, [UP, item, UP])
    with pytest.raises(FormatError, match=re.escape(says)) as raised:
        connected(peer).download(mission_type)
    assert str(raised.value).endswith("; the vehicle cannot fly its current list; upload the list again, or clear it")


def test_what_is_no_position_may_be_any_number() -> None:
    peer = VehiclePeer(PX4)
    speed = MissionItem(Command.DO_CHANGE_SPEED, Frame.COMMAND, (1.0, 5.0, -1.0, math.nan), 0.0, 0.0, math.nan)
    yaw_unset = replace(UP, params=(0.0, 2.0, math.nan, math.nan))
    peer.server.set_items(MissionType.MISSION, [yaw_unset, speed])
    assert len(connected(peer).download(MissionType.MISSION)) == 2


def test_mavsdk_refuses_the_same() -> None:
    session = pytest.importorskip("uavcover.extras.mavsdk.session")
    for item, says in NOWHERE[:5]:
        raw = session.raw_items([UP, item], MissionType.MISSION)
        with pytest.raises(FormatError, match=re.escape(says)):
            session.contents_of(session.Answer("SUCCESS", raw), MissionType.MISSION)
