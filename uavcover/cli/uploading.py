"""Uploading a run's mission, as ``plan-upload`` and ``demo`` do it."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mission_io import SigningKey
from mission_io.autopilots.comparison import faults
from mission_io.client.commands import name_of
from mission_io.client.read_back import ReadBack
from mission_io.errors import TransferError, TransferInterrupted
from mission_io.links.presets import link_preset
from uavcover.cli.console import Console
from uavcover.model.route import Route
from uavcover.run.folder import RunFolder
from uavcover.run.mission import compile_plan
from uavcover.run.provenance import note_files
from uavcover.run.session import ClientName, check_home, connect, require_home
from uavcover.run.upload import upload, upload_document
from uavcover.scenario.site import Site

UPLOAD_FILE = "upload.json"
_SHOWN_ITEMS = 20


def upload_run(
    run: RunFolder,
    site: Site,
    route: Route,
    url: str,
    console: Console,
    *,
    timeout_s: float,
    link: str = "default",
    in_flight: bool = False,
    signing_key: SigningKey | None = None,
    client_name: ClientName = "native",
    system_id: int | None = None,
    component_id: int | None = None,
) -> dict[str, Any]:
    """Check every leg and the vehicle's home, upload, read back, compare; writes ``upload.json`` and returns it.

    The file tells of the last upload only: it is gone from the moment at which something is sent.
    """
    timing = link_preset(link).timing
    require_home(site)
    compile_plan(site, route)  # a bad leg is known before anybody is asked
    with (
        run.reserved((), force=True),
        connect(
            url, site, timeout_s=timeout_s, timing=timing, signing_key=signing_key, client_name=client_name,
            system_id=system_id, component_id=component_id,
        ) as vehicle,
    ):  # fmt: skip
        console.say(f"vehicle {vehicle.client.vehicle.system_id} at {url}: {vehicle.client.vehicle.described}")
        compiled = compile_plan(site, route, autopilot=vehicle.autopilot)
        check_home(vehicle, site, compiled)
        run.remove([UPLOAD_FILE])
        with telling_what_is_held(console), console.progress("uploading") as bar:
            results = upload(
                vehicle.client,
                compiled,
                progress=lambda name, done, total: bar.update(done, total=total, note=name),
                in_flight=in_flight,
            )
        document = upload_document(site, compiled, url, results)
        run.write_json(UPLOAD_FILE, document)
        note_files(run, "upload", [UPLOAD_FILE], command=sys.argv)
    for result in results:
        say_comparison(console, result)
    console.say(
        f"set the autopilot's maximum height to at least {document['autopilot_max_height_above_home_m']:.0f} m above home "
        "(fence items carry no height)"
    )
    return document


@contextmanager
def telling_what_is_held(console: Console) -> Iterator[None]:
    """When an upload fails or is interrupted, say what the vehicle holds now, with the list unless it is the old one."""
    try:
        yield
    except TransferInterrupted as interrupted:
        console.warn(str(interrupted.outcome))
        _say_items(interrupted.outcome, console)
        raise
    except TransferError as error:
        _say_items(error, console)
        raise


def _say_items(error: TransferError, console: Console) -> None:
    if error.vehicle_holds == "unchanged" or not error.held_items:
        return
    for number, item in enumerate(error.held_items[:_SHOWN_ITEMS]):
        place = (
            f" at {item.lat_deg:.7f}, {item.lon_deg:.7f}, {item.alt_m:g} m {item.frame.name}"
            if item.has_position
            else ""
        )
        console.warn(f"held now: {number}: {name_of(item.command)}{place}")
    if len(error.held_items) > _SHOWN_ITEMS:
        console.warn(f"held now: {len(error.held_items) - _SHOWN_ITEMS} more; see: uavcover download")


def say_comparison(console: Console, result: ReadBack) -> None:
    """Say what came back differently, and warn of what should not have."""
    name = result.mission_type.name.lower()
    if not result.differences:
        console.say(f"{name}: {len(result.sent)} items sent, read back equal")
        return
    wrong = faults(result.differences)
    console.say(
        f"{name}: {len(result.sent)} items sent, {len(result.differences)} fields came back changed, "
        f"{len(result.differences) - len(wrong)} of them without another meaning"
    )
    for fault in wrong[:5]:
        console.warn(f"{name}: {fault}")
