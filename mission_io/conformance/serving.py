"""The fake vehicle on a real link, and a ground station's call on a simulated one."""

from collections.abc import Callable
from random import Random

from mission_io.client.client import Client
from mission_io.conformance.case import CaseResult
from mission_io.conformance.evidence import ClientCase
from mission_io.conformance.fake_vehicle import LONGEST_S, FakeVehicle
from mission_io.errors import MissionIoError
from mission_io.links.opening import Link
from mission_io.links.simulated import SimulatedLink
from mission_io.protocol.timing import Timing

_TICK_S = 0.02


def serve(link: Link, vehicle: FakeVehicle, *, stopped: Callable[[], bool]) -> None:
    """Be the vehicle on a link until all cases are judged, or ``stopped`` says so."""
    while (vehicle.open or vehicle.busy) and not stopped():
        now = link.clock.now()
        for datagram in vehicle.datagrams_to_send(now):
            link.send(datagram)
        data = link.receive(min(_TICK_S, max(0.0, vehicle.next_timer() - now)))
        if data is not None:
            vehicle.receive_datagram(data, link.clock.now())


def judge_client(
    case: ClientCase,
    call: Callable[[Client], None],
    *,
    wrap: Callable[[Link], Link] = lambda link: link,
    timing: Timing | None = None,
) -> CaseResult | None:
    """Judge a call of our own client by one case, in simulated time.

    Args:
        case: The case.
        call: Begins what the case is about; an error of mission_io is what it tells its user.
        wrap: Puts something between the client and the vehicle.
        timing: Of the client.

    Returns:
        The result; None when the call began something else.
    """
    vehicle = FakeVehicle([case])
    client = Client(wrap(SimulatedLink(vehicle, rng=Random(1))), timing=timing)
    client.wait_for_vehicle(60.0)
    try:
        call(client)
        succeeded = True
    except MissionIoError:
        succeeded = False
    vehicle.told(succeeded)
    until = client.clock.now() + LONGEST_S + 10.0
    while vehicle.busy and client.clock.now() < until:
        client.poll(1.0)
    return vehicle.results[0] if vehicle.results else None
