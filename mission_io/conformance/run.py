"""Tests a vehicle case by case and restores its lists, or tests a ground station."""

import json
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from mission_io.client.client import Client
from mission_io.conformance.case import LIST_NAMES, STATION, CaseResult, ProtocolCase, difference
from mission_io.conformance.client_case import ClientCase
from mission_io.conformance.fake_vehicle import FakeVehicle
from mission_io.conformance.probe import Probe
from mission_io.errors import FormatError, MissionIoError, MisuseError, TransferError, TransferSilentError
from mission_io.links.datagrams import Link
from mission_io.links.simulated import SimulatedLink
from mission_io.model.enums import MissionResult
from mission_io.model.items import MissionItem, MissionType
from mission_io.protocol.timing import Timing

Tell = Callable[[str], None]


def ask_vehicle(
    probe: Probe,  # speaks to it
    cases: Sequence[ProtocolCase[Probe]],  # what to ask
    *,
    tell: Tell,  # called with lines for the user
    answered: Callable[[CaseResult], None] | None = None,  # called with each result
) -> list[CaseResult]:
    """Run the cases on a disarmed vehicle whose lists may be overwritten.

    Its lists are read before the first case and restored after the last one, also after a failure.

    Raises:
        MisuseError: the vehicle is armed, or its lists cannot be read or restored.
    """
    _refuse_armed(probe)
    kept = keep(probe.client)
    if kept.copy is not None:
        tell(f"the vehicle's lists are kept until they are restored; a copy is in {kept.copy}")
    results: list[CaseResult] = []
    try:
        for case in cases:
            _refuse_armed(probe)
            result = ask_one(probe, case)
            results.append(result)
            if answered is not None:
                answered(result)
    finally:
        if not probe.vehicle.armed:
            probe.rest()
            tell(put_back(probe.client, kept))
        else:
            where = f"; its items are in {kept.copy}" if kept.copy is not None else ""
            tell(f"the vehicle is armed, so its lists were not restored{where}")
    return results


def ask_one(probe: Probe, case: ProtocolCase[Probe]) -> CaseResult:
    """Run one case, from an idle vehicle to an idle vehicle."""
    probe.rest()
    began = probe.now()
    verdict, seen = case.answered_by(probe)
    return CaseResult(case.name, verdict, seen, probe.now() - began)


def _refuse_armed(probe: Probe) -> None:
    if probe.vehicle.armed:
        raise MisuseError(
            f"vehicle {probe.vehicle.system_id} is armed; disarm it first, because this overwrites its mission"
        )


@dataclass(frozen=True, slots=True)
class Kept:
    """The lists that a vehicle held; a list that it does not have is not in it."""

    lists: Mapping[MissionType, tuple[MissionItem, ...]]  # their items as on the wire
    copy: Path | None  # a file with them, while they are not put back; None when there was nothing to keep


def keep(client: Client) -> Kept:
    """Read every list of the vehicle, and write them to a file for the case that this program ends early.

    Raises:
        MisuseError: its mission cannot be read or kept, so nothing may be overwritten.
    """
    lists: dict[MissionType, tuple[MissionItem, ...]] = {}
    for mission_type in MissionType:
        try:
            lists[mission_type] = client.download(mission_type)
        except FormatError as error:
            raise MisuseError(
                f"the vehicle's {LIST_NAMES[mission_type]} cannot be saved: {error}; save and clear it by other means first"
            ) from None
        except TransferSilentError as error:
            if mission_type is MissionType.MISSION:
                raise MisuseError(f"the vehicle's mission cannot be read, so it is not overwritten: {error}") from None
        except TransferError as error:
            lacking = error.refusal in (MissionResult.UNSUPPORTED, MissionResult.UNSUPPORTED_FRAME)
            if mission_type is MissionType.MISSION or not lacking:
                raise MisuseError(
                    f"the vehicle's {LIST_NAMES[mission_type]} cannot be read, so nothing is overwritten: {error}"
                ) from None
    return Kept(lists, _written(lists) if any(lists.values()) else None)


def put_back(client: Client, kept: Kept) -> str:
    """Restore the vehicle's lists, read them, and remove the copy.

    Returns:
        The vehicle's lists now, one line.

    Raises:
        MisuseError: that failed; names the copy.
    """
    said = []
    for mission_type, items in kept.lists.items():
        try:
            _put_back_list(client, mission_type, items)
        except MissionIoError as error:
            where = f"; its items are in {kept.copy}" if kept.copy is not None else ""
            raise MisuseError(
                f"the vehicle's {LIST_NAMES[mission_type]} could not be restored: {error}{where}"
            ) from None
        said.append(f"{LIST_NAMES[mission_type]} {len(items)}")
    if kept.copy is not None:
        kept.copy.unlink(missing_ok=True)
    return f"the vehicle has its previous lists again ({', '.join(said)} items)"


def _put_back_list(client: Client, mission_type: MissionType, items: tuple[MissionItem, ...]) -> None:
    autopilot = client.known_autopilot
    home_first = autopilot is not None and autopilot.home_in_item_0 and mission_type is MissionType.MISSION
    if len(items) <= int(home_first):
        client.clear(mission_type)
        return
    client.upload(mission_type, items)
    held = client.download(mission_type)
    wrong = difference(items, held, home_first=home_first)
    if wrong:
        raise MisuseError(wrong)


def _written(lists: Mapping[MissionType, tuple[MissionItem, ...]]) -> Path:
    content = {
        LIST_NAMES[mission_type]: [
            {
                "command": int(item.command),
                "frame": item.frame.name,
                "params": [repr(value) for value in item.params],
                "lat_deg": item.lat_deg,
                "lon_deg": item.lon_deg,
                "alt_m": repr(item.alt_m),
                "autocontinue": item.autocontinue,
            }
            for item in items
        ]
        for mission_type, items in lists.items()
    }
    number, name = tempfile.mkstemp(prefix="kept-missions-", suffix=".json")
    with os.fdopen(number, "w", encoding="utf-8") as file:
        json.dump(content, file, indent=1)
    return Path(name)


# Judging a ground station.


def serve(link: Link, vehicle: FakeVehicle, *, stopped: Callable[[], bool]) -> None:
    """Be the vehicle on a link until all cases are judged, or ``stopped`` is true."""
    while (vehicle.open or vehicle.busy) and not stopped():
        now = link.clock.now()
        for datagram in vehicle.datagrams_to_send(now):
            link.send(datagram)
        data = link.receive(min(STATION.tick_s, max(0.0, vehicle.next_timer() - now)))
        if data is not None:
            vehicle.receive_datagram(data, link.clock.now())


def judge_client(
    case: ClientCase,  # the case
    call: Callable[[Client], None],  # begins what the case is about; its user sees an error of mission_io
    *,
    wrap: Callable[[Link], Link] = lambda link: link,  # puts something between the client and the vehicle
    timing: Timing | None = None,  # of the client
) -> CaseResult | None:
    """Judge a call of our own client by one case, in simulated time.

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
    until = client.clock.now() + STATION.longest_s + 10.0
    while vehicle.busy and client.clock.now() < until:
        client.poll(1.0)
    return vehicle.results[0] if vehicle.results else None
