"""Several vehicles at the same time: jobs, traffic between them, losses, one recording of all.

In: a run folder planned for several vehicles, their links. Out: a track for each sortie, a board of their states.
Begin with ``command.py``; ``flight.py`` flies one vehicle's sorties. How work is divided is the planner's.
It is found through the group ``uavcover.fleets``; its modules are loaded when they are used.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uavcover.flight.command import FlightOptions
    from uavcover.flight.connect import VehicleLink
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import User


def check_on_loss(text: str) -> None:
    """Refuse another way to go on without a lost vehicle than share and gaps.

    Raises:
        InputError: it is neither.
    """
    from uavcover.errors import InputError
    from uavcover.extras.fleet.jobs import OnLoss

    try:
        OnLoss(text)
    except ValueError:
        raise InputError(f"--on-loss: must be share or gaps, not {text!r}") from None


def fly_fleet(
    folder: "RunFolder",
    links: "Sequence[VehicleLink]",
    user: "User",
    flight: "FlightOptions",
    *,
    on_loss: str,
    command: Sequence[str],
) -> tuple[bool, dict[str, Any]]:
    """Fly all vehicles of a plan at once: see :func:`uavcover.extras.fleet.command.fly_fleet`."""
    from uavcover.extras.fleet.command import FleetOptions
    from uavcover.extras.fleet.command import fly_fleet as fly
    from uavcover.extras.fleet.jobs import OnLoss

    return fly(folder, links, user, FleetOptions(flight=flight, on_loss=OnLoss(on_loss)), command=command)


def upload_fleet(
    run: "RunFolder", links: "Sequence[VehicleLink]", user: "User", *, in_flight: bool
) -> list[dict[str, Any]]:
    """Upload its own mission to each vehicle: see :func:`uavcover.extras.fleet.command.upload_fleet`."""
    from uavcover.extras.fleet import command

    return command.upload_fleet(run, links, user, in_flight=in_flight)


def links_that_fly(run: "RunFolder", links: "list[VehicleLink]", user: "User") -> "list[VehicleLink]":
    """The links of vehicles that have a sortie: see :func:`uavcover.extras.fleet.command.links_that_fly`."""
    from uavcover.extras.fleet import command

    return command.links_that_fly(run, links, user)
