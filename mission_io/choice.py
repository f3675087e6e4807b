"""Which of the vehicles on a link is meant, and which component of it is the autopilot."""

from typing import Final

from mission_io.errors import AmbiguousVehicleError, MisuseError
from mission_io.neighbours import VehicleInfo
from mission_io.protocol.exchange import Address

AUTOPILOT_COMPONENT: Final = 1
"""MAV_COMP_ID_AUTOPILOT1: where several components of a system speak as autopilots, this one is it."""

LISTEN_S: Final = 1.2
"""After the first vehicle others are listened for so long: heartbeats come once a second."""


class Choice:
    """Collects the vehicles that are heard, and chooses the one that was asked for.

    Args:
        system_id: Which system is meant; None for any.
        component_id: Which of its components; None for its autopilot.

    Attributes:
        others: The systems that were heard and not asked for.
    """

    def __init__(self, *, system_id: int | None, component_id: int | None) -> None:
        self._system_id, self._component_id = system_id, component_id
        self._heard: dict[Address, VehicleInfo] = {}
        self._two_in_one: dict[Address, str] = {}
        self._decide_at: float | None = None
        self.others: set[int] = set()

    def take(self, vehicle: VehicleInfo, now: float) -> None:
        """Take a vehicle's heartbeat that arrived at ``now``."""
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
            self._decide_at = now + LISTEN_S
        if self._system_id is not None and AUTOPILOT_COMPONENT in (vehicle.component_id, self._component_id):
            self._decide_at = now  # nobody can come that would be meant instead
        elif self._system_id is not None and self._component_id is not None:
            self._decide_at = now

    def decide_at(self, deadline: float) -> float:
        """When to choose, at the latest at ``deadline``."""
        return deadline if self._decide_at is None else min(deadline, self._decide_at)

    def chosen(self) -> VehicleInfo | None:
        """The vehicle that is meant; None when none was heard.

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
            for vehicle in sorted(left, key=lambda v: (v.system_id, v.component_id))
        )
        by = "--system" if len(systems) > 1 else "--component"
        raise AmbiguousVehicleError(
            f"{len(left)} vehicles are on this link: {listed}; choose one by {by}", vehicles=tuple(left)
        )


def two_in_one(first: VehicleInfo, second: VehicleInfo) -> str:
    """What is wrong when heartbeats with the same ids tell of two vehicles."""
    return (
        f"system {first.system_id}, component {first.component_id} says that it is {first.described}, and that it is "
        f"{second.described}: two vehicles share these ids; give one of them another system id"
    )
