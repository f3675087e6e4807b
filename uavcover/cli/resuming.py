"""Going on with a flight, as ``fly --resume`` does it."""

from collections.abc import Sequence
from typing import Any

from mission_io import SigningKey
from uavcover.cli.console import Console
from uavcover.cli.flying import record_flight
from uavcover.errors import InputError
from uavcover.run.folder import RunFolder
from uavcover.run.mission import compile_plan
from uavcover.run.plan_files import read_planned
from uavcover.run.provenance import note_files
from uavcover.run.resume import TRACK, Unfinished, find_unfinished, save_rest, took_off_s
from uavcover.run.session import (
    ClientName,
    check_home,
    connect,
    fly,
    fly_from_the_air,
    fly_on,
    is_in_the_air,
    require_home,
)
from uavcover.run.upload import upload, upload_document
from uavcover.vehicle.flight_plan import Patience
from uavcover.vehicle.fly import FlightOutcome
from uavcover.vehicle.precautions import USUAL, Precautions


def resume_run(
    run: RunFolder, url: str, console: Console,
    *, timeout_s: float, confirmed: bool, command: Sequence[str], mock_speed: float = 20.0, viewer_url: str | None = None,
    signing_key: SigningKey | None = None, client_name: ClientName = "native", patience: Patience | None = None,
    precautions: Precautions = USUAL,
    system_id: int | None = None, component_id: int | None = None,
) -> tuple[FlightOutcome | None, dict[str, Any]]:  # fmt: skip
    """Fly what the latest flight of a run has left, from the ground or from where the vehicle is in the air.

    It has a folder of its own inside the run's, with its plan, mission, track and recording. A run of which nothing was flown,
    such as the one that closes the gaps of another, is flown from where the vehicle is in the air.

    Returns:
        The outcome, none when there was nothing left to fly; and what to tell programs.

    Raises:
        InputError: nothing was flown yet, and the vehicle is on the ground.
        InfeasibleError: there is no checked way to what is left.
        FlightFailedError: the flight did not end as it should.
    """
    with run.reserved((), force=True):
        site, planned = read_planned(run)
        require_home(site)
        if not run.file(TRACK).exists():
            with connect(
                url, site, timeout_s=timeout_s, mock_speed=mock_speed, signing_key=signing_key, client_name=client_name,
                system_id=system_id, component_id=component_id,
            ) as vehicle:  # fmt: skip
                if not is_in_the_air(vehicle):
                    raise InputError(
                        f"{run}: nothing of it was flown, and the vehicle is on the ground; fly it without --resume"
                    )
                console.say("the vehicle is in the air: it flies all of this run from where it is")
                return record_flight(
                    run, site, planned.route, console, vehicle,
                    lambda orders: fly_from_the_air(vehicle, site, planned.route, orders, up_since_s=took_off_s(run)),
                    confirmed=confirmed, force=False, viewer_url=viewer_url, patience=patience, precautions=precautions,
                )  # fmt: skip
        unfinished = find_unfinished(run, site)
        _say(unfinished, console)
        if unfinished.complete:
            return None, {"run": str(run), "ending": None, "waypoints_left": 0}
        folder, route = unfinished.folder, unfinished.route
        with folder.reserved((), force=True):
            save_rest(unfinished, site, command=command)
            with connect(
                url, site, timeout_s=timeout_s, mock_speed=mock_speed, signing_key=signing_key, client_name=client_name,
                system_id=system_id, component_id=component_id,
            ) as vehicle:  # fmt: skip
                if is_in_the_air(vehicle):
                    console.say("the vehicle is in the air: it goes on from where it is")
                    begin = lambda orders: fly_on(vehicle, site, unfinished, orders)  # noqa: E731
                else:
                    compiled = compile_plan(site, route, autopilot=vehicle.autopilot)
                    check_home(vehicle, site, compiled)
                    results = upload(vehicle.client, compiled)
                    folder.write_json("upload.json", upload_document(site, compiled, url, results))
                    note_files(folder, "upload", ["upload.json"], command=command)
                    begin = lambda orders: fly(vehicle, site, compiled, orders)  # noqa: E731
                try:
                    outcome, document = record_flight(
                        folder, site, route, console, vehicle, begin,
                        confirmed=confirmed, force=True, viewer_url=viewer_url, patience=patience, precautions=precautions,
                    )  # fmt: skip
                finally:
                    if folder.file(TRACK).exists():  # the run knows its flights: one that is taken away later is missed
                        note_files(run, "fly --resume", [f"{folder.path.name}/{TRACK}"], command=command)
    return outcome, {**document, "resumed_at_waypoint": unfinished.broken.waypoint}


def _say(unfinished: Unfinished, console: Console) -> None:
    count, number = len(unfinished.planned.route), unfinished.broken.waypoint
    if unfinished.complete:
        console.say(f"all {count} waypoints of {unfinished.flown} are flown; there is nothing to resume")
        return
    where = f", {unfinished.broken.flown_m:.0f} m along the leg to it" if unfinished.broken.flown_m > 0.0 else ""
    console.say(f"{unfinished.flown}: waypoint {number} of {count} is the first that was not flown{where}")
    console.say(f"the rest is kept in {unfinished.folder}")
