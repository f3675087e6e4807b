"""The clients that are compared: each transfers a mission over one link and says whether it believes that it worked."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from random import Random
from typing import Any

from mission_io.client import Client
from mission_io.errors import MissionIoError, MisuseError
from mission_io.items import MissionItem, MissionType
from mission_io.link import Link, UdpLink
from mission_io.protocol.exchange import Timing
from mission_io.simulated import SimulatedLink
from uavcover.benchmarks.link.trials import Outcome, Trial, items_on, mission_items
from uavcover.benchmarks.link.vehicles import conditions_of, vehicle_for
from uavcover.errors import VehicleError

_CONNECT_S = 60.0


@dataclass(frozen=True, slots=True)
class Transferred:
    """A transfer as its client saw it; ``received`` is what a download gave back."""

    claimed: bool
    time_s: float
    received: tuple[MissionItem, ...] = ()
    error: str = ""


def run_simulated(trial: Trial, timing: Timing | None = None) -> Outcome:
    """Our client in simulated time."""
    vehicle = vehicle_for(trial, now=0.0)
    rng = Random(f"{trial.vehicle} {trial.direction} {trial.loss} {trial.seed}")
    link = SimulatedLink(vehicle, rng=rng, conditions=conditions_of(trial))
    return outcome_of(trial, _with_our_client(link, trial, timing), vehicle.items)


def run_native(trial: Trial, port: int) -> Transferred:
    """Our client over UDP."""
    return _with_our_client(UdpLink.connecting("127.0.0.1", port), trial, None)


def _with_our_client(link: Link, trial: Trial, timing: Timing | None) -> Transferred:
    with Client(link, timing=timing) as client:
        client.wait_for_vehicle(_CONNECT_S)
        items = mission_items()
        start = client.clock.now()
        received: tuple[MissionItem, ...] = ()
        try:
            if trial.direction == "upload":
                client.upload(MissionType.MISSION, items)
            else:
                received = client.download(MissionType.MISSION)
        except MissionIoError as error:
            return Transferred(False, client.clock.now() - start, error=str(error))
        return Transferred(True, client.clock.now() - start, received)


def run_mavsdk(trial: Trial, port: int) -> Transferred:
    """MAVSDK's client over UDP."""
    from mavsdk.plugins.mission_raw import MissionRawError

    from uavcover.mavsdk_client.wire import items_from_raw, raw_items

    with _mission_raw(port) as raw:
        items = raw_items(mission_items(), MissionType.MISSION)
        call: Callable[[], Any] = raw.download_mission
        if trial.direction == "upload":
            call = lambda: raw.upload_mission(items)  # noqa: E731
        start = time.perf_counter()
        try:
            result = call()
        except MissionRawError as error:
            return Transferred(False, time.perf_counter() - start, error=str(error).partition(";")[0])
        time_s = time.perf_counter() - start
        received = () if trial.direction == "upload" else items_from_raw(result, MissionType.MISSION)
        return Transferred(True, time_s, received)


def outcome_of(trial: Trial, transferred: Transferred, held: tuple[MissionItem, ...]) -> Outcome:
    """What came of a transfer, given what the vehicle holds at the end."""
    there = held if trial.direction == "upload" else transferred.received
    return Outcome(
        trial,
        transferred.claimed,
        there == items_on(trial.vehicle),
        transferred.time_s,
        transferred.error,
    )


@contextmanager
def _mission_raw(port: int) -> Iterator[Any]:
    import mavsdk
    from mavsdk.plugins.mission_raw import MissionRaw

    mavsdk.log_subscribe(lambda *_: True)
    ground = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    try:
        ground.add_any_connection(f"udpout://127.0.0.1:{port}")
        system = ground.first_autopilot(_CONNECT_S)
        if system is None:
            raise VehicleError(f"MAVSDK found no vehicle at port {port} within {_CONNECT_S:g} s")
        raw = MissionRaw(system)
        try:
            yield raw
        finally:
            raw.destroy()
    finally:
        ground.destroy()


REAL_CLIENTS: dict[str, Callable[[Trial, int], Transferred]] = {"native": run_native, "mavsdk": run_mavsdk}
"""The clients that need a vehicle at a UDP port."""


def run_real(trial: Trial, port: int) -> Transferred:
    """Run a trial's client against the vehicle at a port.

    Raises:
        MisuseError: a client that is none of ``REAL_CLIENTS``.
    """
    try:
        run = REAL_CLIENTS[trial.client]
    except KeyError:
        raise MisuseError(f"{trial.client!r} is no client; there are {', '.join(REAL_CLIENTS)}") from None
    return run(trial, port)
