"""Disturbances of a flight, each with what a flight with it may end in; see scripts/attack/disturbed_flights.py."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

import numpy as np

from mission_io.autopilots.autopilot import Mode
from mission_io.links.simulated import Conditions, ManualClock, Peer, SimulatedLink
from uavcover.mock.faults import parse_fault
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import Ending

GOOD = frozenset({Ending.LANDED, Ending.RESERVE_KEPT})
ALWAYS = frozenset({Ending.STATE_UNKNOWN, Ending.ENDED_EARLY})
Act = Callable[[MockVehicle, "DisturbedLink"], None]


class _Backlog:
    """A buffer on the way that fills and is emptied; see ``DisturbedLink.fall_behind``."""

    def __init__(
        self, began_s: float = math.inf, *, by_s: float = 0.0, over_s: float = 1.0, until_s: float = 0.0
    ) -> None:
        self._began_s, self._by_s, self._over_s, self._until_s = began_s, by_s, over_s, until_s

    def arrival_s(self, now: float, arrival_s: float) -> float:
        since_s, empty_s = now - self._began_s, self._began_s + self._until_s
        if not 0.0 <= since_s < self._until_s:
            return arrival_s
        return max(arrival_s, min(arrival_s + self._by_s * min(1.0, since_s / self._over_s), empty_s))


class DisturbedLink(SimulatedLink):
    """A simulated link that goes dark, falls behind or stands still on request."""

    def __init__(self, peer: Peer, *, rng: Random, conditions: Conditions, clock: ManualClock | None = None) -> None:
        super().__init__(peer, rng=rng, conditions=conditions, clock=clock)
        self._dark_until_s = -math.inf
        self._backlog = _Backlog()

    def go_dark(self, seconds: float) -> None:
        """Lose every datagram that is sent from now on, both ways, for some seconds."""
        self._dark_until_s = self._clock.now() + seconds

    def fall_behind(self, *, by_s: float, over_s: float, until_s: float) -> None:
        """Deliver what the peer sends later and later, in order and without a gap, as a radio whose buffer fills.

        Args:
            by_s: the delay that is reached.
            over_s: how long the delay grows.
            until_s: after this time from now the buffer is empty again.
        """
        self._backlog = _Backlog(self._clock.now(), by_s=by_s, over_s=over_s, until_s=until_s)

    def stand_still(self, seconds: float) -> None:
        """Let time pass as while this side's process is stopped: its buffer keeps the oldest datagrams and loses the rest."""
        kept, until_s = list(self._arrived), self._clock.now() + seconds
        self._arrived.clear()
        while (left_s := until_s - self._clock.now()) > 0.0:
            data = self.receive(left_s)
            # datagrams that a UDP socket keeps by default on Linux: 208 KiB, in which each small one takes 768 bytes
            if data is not None and len(kept) < 270:
                kept.append(data)
        self._arrived.extend(kept)

    def _dispatch(self, data: bytes, *, to_peer: bool) -> None:
        if self._clock.now() >= self._dark_until_s:
            super()._dispatch(data, to_peer=to_peer)

    def _carry(self, data: bytes, arrival_s: float, *, to_peer: bool) -> None:
        late_s = arrival_s if to_peer else self._backlog.arrival_s(self._clock.now(), arrival_s)
        super()._carry(data, late_s, to_peer=to_peer)


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of disturbance.

    Attributes:
        draw: what it does, and its words, from a random generator.
        endings: what a flight with it may be called, beside a good one.
    """

    draw: Callable[[np.random.Generator], tuple[str, Act]]
    endings: frozenset[Ending]


def _fault(name: str, low: float, high: float) -> Callable[[np.random.Generator], tuple[str, Act]]:
    def draw(rng: np.random.Generator) -> tuple[str, Act]:
        text = f"{name}:{rng.uniform(low, high):.1f}@0s" if high > low else f"{name}@0s"
        return text.removesuffix("@0s"), lambda vehicle, _: vehicle.faults.add(parse_fault(text))

    return draw


def _mode(rng: np.random.Generator) -> tuple[str, Act]:
    mode = [Mode.HOLD, Mode.LAND, Mode.RETURN][int(rng.integers(3))]
    return f"pilot:{mode.value}", lambda vehicle, _: _set_mode(vehicle, mode)


def _set_mode(vehicle: MockVehicle, mode: Mode) -> None:
    vehicle.control.set_mode(mode)


def _dark(rng: np.random.Generator) -> tuple[str, Act]:
    seconds = float(rng.uniform(5.0, 60.0))
    return f"blackout:{seconds:.0f}", lambda _, link: link.go_dark(seconds)


def _freeze(rng: np.random.Generator) -> tuple[str, Act]:
    seconds = float(rng.uniform(3.0, 40.0))
    return f"freeze:{seconds:.0f}", lambda _, link: link.stand_still(seconds)


def _behind(rng: np.random.Generator) -> tuple[str, Act]:
    seconds = float(rng.uniform(3.0, 30.0))
    return (
        f"behind:{seconds:.0f}",
        lambda _, link: link.fall_behind(by_s=seconds, over_s=1.5 * seconds, until_s=4.0 * seconds),
    )


def _home(rng: np.random.Generator) -> tuple[str, Act]:
    lower_m = float(rng.uniform(10.0, 40.0))

    def act(vehicle: MockVehicle, _: DisturbedLink) -> None:
        x, y, z = vehicle.body.home_m
        home = vehicle.body.geodetic_of((x, y, z - lower_m))
        vehicle.body.home, vehicle.body.home_m = home, (x, y, z - lower_m)

    return f"home-lower:{lower_m:.0f}", act


def _parameter(rng: np.random.Generator) -> tuple[str, Act]:
    ardupilot = ("FENCE_ALT_MAX", 40.0), ("RTL_ALT", 1500.0), ("MIS_RESTART", 1.0)
    px4 = ("GF_MAX_VER_DIST", 40.0), ("RTL_RETURN_ALT", 15.0), ("NAV_DLL_ACT", 3.0)
    number = int(rng.integers(3))

    def act(vehicle: MockVehicle, _: DisturbedLink) -> None:
        name, value = (ardupilot if vehicle.is_ardupilot else px4)[number]
        if vehicle.parameters.name_of(name, -1) is not None:
            vehicle.parameters.put(name, value)
            vehicle.send(vehicle.parameters.message(name))

    return f"parameter:{number}", act


_TAKEN = frozenset({Ending.PILOT_TOOK_OVER, Ending.TAKEN_OVER})
_OFF = frozenset({Ending.OFF_ROUTE, Ending.BAND_LEFT, Ending.FENCE_BREACHED, Ending.UNSAFE_LINE, Ending.HOLD_LOST})
KINDS: dict[str, Kind] = {
    "blackout": Kind(_dark, frozenset({Ending.LINK_LOST})),
    "behind": Kind(_behind, frozenset({Ending.LINK_LOST})),
    "freeze": Kind(_freeze, frozenset({Ending.LINK_LOST})),
    "pilot": Kind(_mode, _TAKEN),
    "gps-loss": Kind(_fault("gps-loss", 5.0, 60.0), frozenset({Ending.GPS_LOST, Ending.POSITION_LOST, *_OFF})),
    "gps-glitch": Kind(_fault("gps-glitch", 20.0, 120.0), frozenset({Ending.GPS_LOST, *_OFF})),
    "wind": Kind(  # blown over ground without elevation data there is no checked way home, and it is left holding
        _fault("strong-wind", 15.0, 28.0),
        frozenset({Ending.WIND_ABOVE_LIMITS, Ending.STUCK, Ending.CRASHED, Ending.BATTERY_LOW, *_OFF}),
    ),
    "motor": Kind(_fault("motor-failure", 0.0, 0.0), frozenset({Ending.CRASHED})),
    "battery": Kind(
        _fault("battery-failsafe", 0.0, 0.0),
        frozenset({Ending.BATTERY_FAILSAFE, Ending.RESERVE_USED, Ending.CRASHED, Ending.BATTERY_LOW}),
    ),
    "mission-lowered": Kind(_fault("mission-lowered", 5.0, 30.0), frozenset({Ending.MISSION_CHANGED})),
    "mission-changed": Kind(_fault("mission-changed", 0.0, 0.0), frozenset({Ending.MISSION_CHANGED})),
    "item-set-back": Kind(_fault("item-set-back", 0.0, 0.0), frozenset({Ending.MISSION_CHANGED})),
    "speed": Kind(_fault("speed-changed", 1.0, 4.0), frozenset({Ending.RESERVE_USED, Ending.STUCK})),
    "disarm": Kind(_fault("force-disarm", 0.0, 0.0), frozenset({Ending.CRASHED})),
    "reboot": Kind(_fault("reboot", 1.0, 8.0), frozenset({Ending.RESTARTED, Ending.CRASHED, Ending.LINK_LOST})),
    "heartbeat-loss": Kind(_fault("heartbeat-loss", 3.0, 40.0), frozenset({Ending.HEARTBEAT_LOST, Ending.STUCK})),
    "home": Kind(_home, frozenset({Ending.HOME_MOVED, *_OFF})),
    "parameter": Kind(_parameter, frozenset({Ending.SETTINGS_CHANGED, Ending.FENCE_BREACHED})),
}  # fmt: skip
