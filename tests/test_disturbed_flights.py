"""The reader of ``scripts/attack/disturbed_flights.py`` finds commands without current evidence, and the flights are as drawn."""

from pathlib import Path

import pytest

from mission_io.autopilots.autopilot import Mode
from mission_io.links.opening import TelemetryLogWriter
from mission_io.model.enums import AutopilotId, ModeFlag, VehicleClass
from mission_io.model.items import Command
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec
from scripts.attack.disturbed_flights import Steered, against, steering_commands
from tests.disturbances import KINDS

VEHICLE, STATION = Codec(system_id=1, component_id=1), Codec(system_id=255, component_id=190)
AUTO, RTL = 3, 6
TAKE = m.CommandLong(1, 1, Command.DO_SET_MODE, (1.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0))
HEARD = m.Attitude(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def beat(mode: int) -> m.Heartbeat:
    return m.Heartbeat(AutopilotId.ARDUPILOT, VehicleClass.QUADROTOR, int(ModeFlag.SAFETY_ARMED), mode, 4)


class Hands:
    """A time of day that is set by hand."""

    now = 0.0

    def unix_s(self) -> float:
        return 1.7e9 + self.now


def log_of(path: Path, rows: list[tuple[float, m.Message]]) -> list[Steered]:
    clock = Hands()
    with TelemetryLogWriter(path, clock=clock) as log:
        for clock.now, message in rows:
            sender = STATION if isinstance(message, m.CommandLong) else VEHICLE
            log.write(sender.encode(message))
    return steering_commands(path, frozenset({AUTO, 4}))


STEADY = [(t / 2.0, HEARD) for t in range(10)]


@pytest.mark.parametrize(
    ("rows", "proved"),
    [
        ([*STEADY, (5.0, beat(AUTO)), (5.1, TAKE)], [True]),
        ([*STEADY, (5.0, beat(RTL)), (5.1, TAKE)], [False]),
        ([*STEADY, (4.6, beat(AUTO)), (12.0, HEARD), (12.1, TAKE)], [False]),  # a gap lies between
        ([*STEADY, (4.6, beat(AUTO)), (12.0, HEARD), (12.5, beat(AUTO)), (12.6, TAKE)], [True]),
        ([*STEADY, (5.0, beat(AUTO)), *((5.0 + t, HEARD) for t in range(1, 6)), (10.1, TAKE)], [False]),  # an old beat
    ],
)
def test_a_command_is_proved_by_a_current_heartbeat_alone(
    tmp_path: Path, rows: list[tuple[float, m.Message]], proved: list[bool]
) -> None:
    assert [one.proved for one in log_of(tmp_path / "flight.tlog", sorted(rows, key=lambda row: row[0]))] == proved


def test_a_command_in_a_return_counts_as_against_it_after_the_race() -> None:
    modes = [(0.0, Mode.MISSION, True), (10.0, Mode.RETURN, True), (40.0, Mode.RETURN, False)]
    ours = frozenset({Mode.MISSION, Mode.GUIDED})
    counted = [against([Steered(at_s, True)], modes, ours, 1.5) for at_s in (9.0, 11.0, 12.0, 39.0, 41.0)]
    assert counted == [0, 0, 1, 1, 0]


def test_every_fault_that_a_flight_may_have_is_drawn() -> None:
    assert {"blackout", "freeze", "pilot", "motor", "wind", "battery", "home", "parameter"} <= set(KINDS)
