"""A companion computer that lies about all it can, with the vehicle's system id."""

import random
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from mission_io.model.enums import LandedState, MissionState
from mission_io.model.items import Command
from mission_io.wire import messages as m
from mission_io.wire.codec import Codec

COMPANION: Final = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""
Lie = Callable[[random.Random], m.Message]


def _anywhere(rng: random.Random) -> m.Message:
    height_m = rng.uniform(-50.0, 500.0)
    north_m_s, east_m_s, down_m_s = (rng.uniform(-30.0, 30.0) for _ in range(3))
    boot_s = rng.choice([0.0, rng.uniform(0.0, 5000.0)])
    lat_deg, lon_deg = rng.uniform(-60.0, 60.0), rng.uniform(-170.0, 170.0)
    return m.GlobalPositionInt(
        boot_s, lat_deg, lon_deg, 300.0 + height_m, height_m, north_m_s, east_m_s, down_m_s, 90.0
    )


LIES: Mapping[str, Lie] = MappingProxyType(
    {
        "system-time-0": lambda _: m.SystemTime(1.7e9, 0.0),
        "system-time-huge": lambda _: m.SystemTime(0.0, 4294967.0),
        "on-ground": lambda _: m.ExtendedSysState(int(LandedState.ON_GROUND)),
        "landed-state": lambda rng: m.ExtendedSysState(rng.choice([int(s) for s in LandedState])),
        "attitude": lambda rng: m.Attitude(0.0, rng.uniform(-3.0, 3.0), rng.uniform(-1.5, 1.5), 1.0, 0.0, 0.0, 0.0),
        "position": _anywhere,
        "mission-current": lambda rng: m.MissionCurrent(
            rng.randrange(40), rng.randrange(40), rng.choice([*MissionState])
        ),
        "mission-complete": lambda _: m.MissionCurrent(99, 3, MissionState.COMPLETE),
        "item-reached": lambda rng: m.MissionItemReached(rng.randrange(40)),
        "onboard-controller": lambda _: m.Heartbeat(8, 18, 128, 9, 5),
        "quadrotor-without-autopilot": lambda rng: m.Heartbeat(8, 2, 0, rng.randrange(30), 3),
        "autopilot": lambda rng: m.Heartbeat(rng.choice([3, 12]), rng.choice([1, 2]), 0, rng.randrange(30), 3),
        "sys-status": lambda _: m.SysStatus(0, 0, 0, 1.0, 3.1, 99.0, 1),
        "battery": lambda _: m.BatteryStatus(0, (3.1, *(None,) * 9), 99.0, 9000, 0, 1, 3),
        "gps": lambda _: m.GpsRawInt(0.0, 0, 1.0, 2.0, 3.0, 99.0, 99.0, 0.0, None, 0),
        "ekf": lambda _: m.EkfStatusReport(0x80),
        "text": lambda rng: m.StatusText(
            2, rng.choice(["Crash: Disarming", "Battery failsafe", "Fence breached", "GPS lost"])
        ),
        "mission-ack": lambda rng: m.MissionAck(255, 190, rng.randrange(16), rng.randrange(3)),
        "command-ack": lambda rng: m.CommandAck(
            rng.choice([*Command]), rng.randrange(7), target_system=255, target_component=190
        ),
        "home": lambda _: m.HomePosition(1.0, 2.0, 3.0),
        "version": lambda _: m.AutopilotVersion(0, 0, 0),
        "parameter": lambda _: m.ParamValue("SIM_SPEEDUP", 1.0, 9, 1, 0),
        "mission-count": lambda rng: m.MissionCount(255, 190, rng.randrange(9)),
        "mission-request": lambda rng: m.MissionRequestInt(255, 190, rng.randrange(20)),
    }
)
"""What it may say, by name."""

_EACH_S = 0.1


class Meddler:
    """Says every lie ten times a second of the link's clock.

    Args:
        system_id: of the vehicle that it is on.
        component_id: which of its components it claims to be.
        lies: what it says.
        seed: of the numbers in it.
    """

    def __init__(
        self,
        *,
        system_id: int = 1,
        component_id: int = COMPANION,
        lies: Sequence[Lie] = tuple(LIES.values()),
        seed: int = 14,
    ) -> None:
        self._codec = Codec(system_id=system_id, component_id=component_id)
        self._lies, self._rng, self._next_s = lies, random.Random(seed), 0.0

    def datagrams(self, now: float) -> list[bytes]:
        """What it says by ``now``."""
        if now < self._next_s:
            return []
        self._next_s = now + _EACH_S
        return [self._codec.encode(lie(self._rng)) for lie in self._lies]
