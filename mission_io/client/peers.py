"""Peers on a link: vehicles, others that use our own ids, and those limited to MAVLink 1.

Also chooses which vehicle on the link is meant, and which of its components is the autopilot.
"""

import logging
from dataclasses import dataclass
from typing import Final

from mission_io.autopilots.autopilot import Autopilot, autopilot_for
from mission_io.errors import AmbiguousVehicleError, MisuseError
from mission_io.model.enums import AutopilotId, VehicleClass, VehicleKind, kind_of, type_name
from mission_io.model.plain_text import counted
from mission_io.protocol.timing import CALLS
from mission_io.wire.codec import LinkStatistics
from mission_io.wire.messages import Address, Heartbeat, Received

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class VehicleInfo:
    """A vehicle as its latest heartbeat describes it."""

    system_id: int  # its MAVLink system
    component_id: int  # the autopilot's component
    mav_autopilot: int  # MAV_AUTOPILOT number
    vehicle_type: int  # MAV_TYPE number
    armed: bool  # whether it is armed
    custom_mode: int  # the autopilot's own number of its flight mode
    system_status: int  # MAV_STATE number

    @property
    def address(self) -> Address:
        """Its address for messages."""
        return Address(self.system_id, self.component_id)

    @property
    def autopilot(self) -> Autopilot:
        """The known properties of its autopilot.

        Raises:
            MisuseError: an autopilot that mission_io does not know.
        """
        return autopilot_for(self.mav_autopilot, self.vehicle_type)

    @property
    def kind(self) -> VehicleKind:
        """Its kind, by the way it moves."""
        return kind_of(self.vehicle_type)

    @property
    def described(self) -> str:
        """Its own description as text: ``ArduPilot, quadrotor``."""
        names: dict[int, str] = {AutopilotId.ARDUPILOT: "ArduPilot", AutopilotId.PX4: "PX4"}
        return f"{names.get(self.mav_autopilot, f'autopilot {self.mav_autopilot}')}, {type_name(self.vehicle_type)}"

    def may_become(self, later: "VehicleInfo") -> bool:
        """Whether a later heartbeat can be of the same vehicle; the type may change only from generic."""
        if self.address != later.address or self.mav_autopilot != later.mav_autopilot:
            return False
        return self.vehicle_type in (later.vehicle_type, VehicleClass.GENERIC)


class Peers:
    """All senders of messages; logs once for each what a pilot should know.

    Args:
        local: Our own address.
    """

    def __init__(self, local: Address) -> None:
        self._local = local
        self._vehicles: dict[Address, VehicleInfo] = {}
        self._same_ids: set[Address] = set()
        self._old_heartbeats: dict[Address, int] = {}

    @property
    def vehicles(self) -> tuple[VehicleInfo, ...]:
        """The vehicles heard, in the order of their first heartbeats."""
        return tuple(self._vehicles.values())

    @property
    def same_ids(self) -> frozenset[Address]:
        """Others that use our system id: our exact address, or another ground station."""
        return frozenset(self._same_ids)

    def speaks_only_1(self, address: Address) -> bool:
        """Whether a peer keeps to MAVLink 1 although we speak MAVLink 2."""
        return self._old_heartbeats.get(address, 0) >= CALLS.old_heartbeats

    def take(self, received: Received) -> VehicleInfo | None:
        """Process a message; returns the vehicle if it is a vehicle's heartbeat."""
        sender = received.sender
        if received.mavlink_version >= 2:
            self._old_heartbeats[sender] = 0
        elif isinstance(received.message, Heartbeat):
            self._old_heartbeats[sender] = self._old_heartbeats.get(sender, 0) + 1
        self._notice_same_ids(received, sender)
        vehicle = vehicle_of(received)
        if vehicle is not None:
            if self._vehicles and sender not in self._vehicles:
                _log.warning("vehicle %d (component %d) is also on this link; choose one by system ID", *sender)
            self._vehicles[sender] = vehicle
        return vehicle

    def _notice_same_ids(self, received: Received, sender: Address) -> None:
        if sender.system_id != self._local.system_id or sender in self._same_ids:
            return
        beat = received.message
        station = isinstance(beat, Heartbeat) and beat.vehicle_type == VehicleClass.GROUND_STATION
        if sender == self._local or station:
            self._same_ids.add(sender)
            _log.warning(
                "another sender on this link is system %d, component %d; this program is component %d of the same "
                "system; vehicles may confuse the two, so change the system ID of one of them",
                *sender,
                self._local.component_id,
            )


def vehicle_of(received: Received) -> VehicleInfo | None:
    """The vehicle whose heartbeat a message is; None for other messages and senders."""
    beat = received.message
    if (
        not isinstance(beat, Heartbeat)
        or beat.autopilot == AutopilotId.INVALID
        or kind_of(beat.vehicle_type) is VehicleKind.NO_VEHICLE
    ):
        return None
    return VehicleInfo(
        *received.sender, beat.autopilot, beat.vehicle_type, beat.armed, beat.custom_mode, beat.system_status
    )


AUTOPILOT_COMPONENT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1: chosen when several components of a system send autopilot heartbeats."""


class VehicleChoice:
    """Collects the vehicles heard, and chooses the requested one.

    Args:
        system_id: The requested system; None for any.
        component_id: The requested component; None for the autopilot.

    Attributes:
        others: Systems heard but not requested.
    """

    def __init__(self, *, system_id: int | None, component_id: int | None) -> None:
        self._system_id, self._component_id = system_id, component_id
        self._heard: dict[Address, VehicleInfo] = {}
        self._two_in_one: dict[Address, str] = {}
        self._decide_at: float | None = None
        self.others: set[int] = set()

    def take(self, vehicle: VehicleInfo, now: float) -> None:
        """Process a vehicle's heartbeat that arrived at ``now``."""
        if self._system_id not in (None, vehicle.system_id):
            self.others.add(vehicle.system_id)
            return
        if self._component_id not in (None, vehicle.component_id):
            return
        before = self._heard.get(vehicle.address)
        if before is not None and not before.may_become(vehicle):
            self._two_in_one[vehicle.address] = two_in_one(before, vehicle)
            return
        self._heard[vehicle.address] = vehicle
        if self._decide_at is None:
            self._decide_at = now + CALLS.listen_s
        if self._system_id is not None and AUTOPILOT_COMPONENT in (vehicle.component_id, self._component_id):
            self._decide_at = now  # no later one could be meant instead
        elif self._system_id is not None and self._component_id is not None:
            self._decide_at = now

    def decide_at(self, deadline: float) -> float:
        """The time to choose, at the latest ``deadline``."""
        return deadline if self._decide_at is None else min(deadline, self._decide_at)

    def silence(self, timeout_s: float, statistics: LinkStatistics) -> str:
        """The reason that no vehicle was found, as far as known."""
        system_id, component_id = self._system_id, self._component_id
        wanted = "no vehicle" if system_id is None else f"no vehicle with system ID {system_id}"
        if component_id is not None:
            wanted += f"{' with' if system_id is None else ' and'} component ID {component_id}"
        heard = f"; received heartbeats from {sorted(self.others)}" if self.others else ""
        advice = "is the vehicle switched on, and is the URL correct?"
        if statistics.refused and not self.others:
            heard = (
                f"; {counted(statistics.refused, 'frame was', 'frames were')} refused ({statistics.unsigned} unsigned, "
                f"{statistics.forged} signed with another key, {statistics.replayed} with an old timestamp)"
            )
            advice = "does the vehicle have the same signing key?"
        elif statistics.garbage_bytes and not statistics.frames_in:
            heard = f"; {counted(statistics.garbage_bytes, 'received byte is', 'received bytes are')} not MAVLink"
            advice = "is the baud rate correct?"
        return f"{wanted} sent a heartbeat within {timeout_s:g} s{heard}; {advice}"

    def chosen(self) -> VehicleInfo | None:
        """The chosen vehicle; None when none was heard.

        Raises:
            AmbiguousVehicleError: several could be.
            MisuseError: two vehicles of different types share its ids.
        """
        systems: dict[int, list[VehicleInfo]] = {}
        for vehicle in self._heard.values():
            systems.setdefault(vehicle.system_id, []).append(vehicle)
        left: list[VehicleInfo] = []
        for components in systems.values():
            autopilots = [vehicle for vehicle in components if vehicle.component_id == AUTOPILOT_COMPONENT]
            left.extend(autopilots or components)
        if not left:
            return None
        if len(left) == 1:
            if left[0].address in self._two_in_one:
                raise MisuseError(self._two_in_one[left[0].address])
            return left[0]
        listed = "; ".join(
            f"system {vehicle.system_id}, component {vehicle.component_id} ({vehicle.described})"
            for vehicle in sorted(left, key=lambda v: v.address)
        )
        by = "--system" if len(systems) > 1 else "--component"
        raise AmbiguousVehicleError(
            f"{len(left)} vehicles are on this link: {listed}; choose one by {by}", vehicles=tuple(left)
        )


def two_in_one(first: VehicleInfo, second: VehicleInfo) -> str:
    """The problem when heartbeats with the same ids describe two vehicles."""
    return (
        f"system {first.system_id}, component {first.component_id} reports both {first.described} and "
        f"{second.described}: two vehicles share these IDs; change the system ID of one of them"
    )
