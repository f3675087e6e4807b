"""Uploading a fleet's first sorties: all vehicles are found and checked before anything is sent to one."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from uavcover.errors import InputError, VehicleError
from uavcover.flight.connect import Connected, VehicleLink, check_home, connect, require_home
from uavcover.flight.modes import require_multirotor
from uavcover.flight.upload import send_and_compare
from uavcover.missions.mission_files import compile_plan
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.run.user import User


@dataclass(frozen=True, slots=True)
class FirstSortie:
    """First flight of a vehicle of a fleet."""

    vehicle: int  # its number, from 1
    sortie: int  # the number of the sortie
    takeoff_s: float  # since the first take-off of all
    folder: RunFolder  # the sortie's run folder


def first_sorties(run: RunFolder, count: int) -> tuple[FirstSortie, ...]:
    """The first sorties of the first vehicles of a planned run.

    Args:
        run: with a plan.
        count: number of vehicles.

    Raises:
        InputError: the plan is for fewer vehicles, or cannot be read.
    """
    document = run.read_json("plan.json", made_by="uavcover plan")
    fleet, folders = document.get("fleet"), run.sorties()
    rows = fleet.get("by_vehicle", []) if isinstance(fleet, dict) else []
    require_at_once(fleet, run)
    if isinstance(fleet, dict) and not fleet.get("alike", True) and fleet.get("vehicles") != count:
        raise InputError(
            f"{run}: the {fleet.get('vehicles')} vehicles differ, but --to is given {count} times; specify a link for "
            "each vehicle, vehicle 1 first"
        )
    unlike = isinstance(fleet, dict) and not fleet.get("alike", True)
    if count == len(rows) == 1 and not folders:
        return (FirstSortie(1, 1, 0.0, run),)
    if (len(rows) < count and not unlike) or not folders:
        flying = len(rows) if folders else 1
        if isinstance(fleet, dict) and fleet.get("vehicles", 0) >= count:
            why = f"more vehicles would not finish sooner; use --to {'once' if flying == 1 else f'{flying} times'}"
        else:
            why = f"plan again with: uavcover plan SCENARIO --vehicles {count}"
        planned = "one vehicle" if flying <= 1 else f"{flying} vehicles"
        raise InputError(f"{run}: the plan is for {planned}, but --to is given {count} times; {why}")
    try:
        return tuple(
            FirstSortie(
                int(row["vehicle"]),
                int(row["sorties"][0]),
                float(row["takeoffs_s"][0]),
                run.flight(int(row["sorties"][0])),
            )
            for row in rows[:count]
        )
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(
            f"{run.file('plan.json')}: cannot read the key fleet ({type(error).__name__}: {error}); create the plan "
            "again with: uavcover plan"
        ) from error


def links_that_fly(run: RunFolder, links: Sequence[VehicleLink], user: User) -> list[VehicleLink]:
    """The links of the vehicles that a plan uses; messages name the others, which stay on the ground.

    Args:
        run: planned for the vehicles at these links.
        links: vehicle 1 first.
        user: receives messages.
    """
    fleet = run.read_json("plan.json", made_by="uavcover plan").get("fleet")
    rows = fleet.get("by_vehicle", []) if isinstance(fleet, dict) and fleet.get("alike", True) else []
    flying = len(rows) or len(links)
    if flying < len(links):
        user.warn(f"the plan does not use {', '.join(link.url for link in links[flying:])}; uploading nothing there")
    return list(links[:flying])


def require_at_once(fleet: object, run: RunFolder) -> None:
    """Refuse several vehicles for flights that are planned one at a time.

    Args:
        fleet: of ``plan.json``.
        run: its folder.

    Raises:
        InputError: they are.
    """
    if isinstance(fleet, dict) and fleet.get("one_at_a_time", False):
        raise InputError(f"{run}: this plan flies one sortie at a time; use one --to, and --sortie N in this order")


def upload_fleet(
    run: RunFolder, links: Sequence[VehicleLink], user: User, *, in_flight: bool = False
) -> list[dict[str, Any]]:
    """Upload its first sortie to each vehicle, read back, compare; vehicle k is at link k.

    Nothing is sent before every vehicle was found, has accepted kind and home, and every leg of its sortie is checked.

    Returns:
        what ``upload.json`` of each sortie says, with its vehicle, sortie and folder.

    Raises:
        InputError: the plan is for another number of vehicles.
        VehicleError: one is not a multirotor, is armed, or stands elsewhere; nothing was sent to any.
        MissionIoError: one does not answer, or an upload failed; messages name the vehicles that hold their sorties.
    """
    sorties = first_sorties(run, len(links))
    links = [links[sortie.vehicle - 1] for sortie in sorties]
    plans = [read_planned(sortie.folder) for sortie in sorties]
    for site, planned in plans:
        require_home(site)
        compile_plan(site, planned.route)
    documents: list[dict[str, Any]] = []
    with ExitStack() as opened:
        vehicles: list[Connected] = []
        for sortie, link, (site, planned) in zip(sorties, links, plans, strict=True):
            try:
                opened.enter_context(sortie.folder.reserved((), force=True))
                vehicle = opened.enter_context(connect(link, site))
                require_multirotor(vehicle.client)
                if vehicle.client.vehicle.armed and not in_flight:
                    raise VehicleError("the vehicle is armed; uploading to an armed vehicle requires --in-flight")
                check_home(vehicle, site, compile_plan(site, planned.route, autopilot=vehicle.autopilot))
            except Exception:
                user.warn(
                    f"vehicle {sortie.vehicle} at {link.url} is not ready; no mission was uploaded to any vehicle"
                )
                raise
            vehicles.append(vehicle)
        for sortie, vehicle, (site, planned) in zip(sorties, vehicles, plans, strict=True):
            user.say(f"uploading sortie {sortie.sortie} to vehicle {sortie.vehicle}")
            try:
                sent = send_and_compare(sortie.folder, site, planned.route, vehicle, user, in_flight=in_flight)
            except BaseException:
                held = ", ".join(str(document["vehicle"]) for document in documents) or "none"
                user.warn(f"vehicle {sortie.vehicle}: the upload failed; vehicles that have their sortie: {held}")
                raise
            documents.append(
                {"vehicle": sortie.vehicle, "sortie": sortie.sortie, "takeoff_s": sortie.takeoff_s}
                | {"run": str(sortie.folder), **sent}
            )
    for document in documents:
        verdict = "verified" if document["passed"] else "READ BACK DIFFERS"
        user.say(
            f"vehicle {document['vehicle']:<2} sortie {document['sortie']:<3} take-off at {document['takeoff_s']:.0f} s  "
            f"{document['url']}  {verdict}"
        )
    return documents
