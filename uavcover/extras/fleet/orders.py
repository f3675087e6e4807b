"""What the user wants of the flight of a fleet."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from uavcover.extras.fleet.clock import FleetClock
from uavcover.extras.fleet.jobs import OnLoss
from uavcover.flight.command import FlightOptions
from uavcover.flight.connect import Connected, VehicleLink
from uavcover.scenario.site import Site

Opening = Callable[[VehicleLink, Site], AbstractContextManager[Connected]]


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetOrders:
    """What the user wants of the fleet.

    Attributes:
        links: where each vehicle is, vehicle 1 first.
        flight: what is asked of each flight.
        on_loss: what becomes of what a lost vehicle was to see.
        opening: opens the link to a vehicle.
        clocks: of each vehicle.
        stops: how often the user has asked to stop.
        paused: whether the user wants all to hold their places.
    """

    links: Sequence[VehicleLink]
    flight: FlightOptions
    on_loss: OnLoss
    opening: Opening
    clocks: Sequence[FleetClock]
    stops: Callable[[], int]
    paused: Callable[[], bool]
