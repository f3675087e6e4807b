"""``uavcover fly``: arm, start, follow, record, land."""

import atexit
import contextlib
import json
import math
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from uavcover.cli.console import Console
    from uavcover.flight.orders import OnBreach, Precautions
    from uavcover.run.folder import RunFolder


OLD_LIMITS = "limits_before.json"
"""There while a flight has changed parameters: after a kill the next flight finds it."""


@dataclass(frozen=True, slots=True)
class FlyingVehicle(options.EachVehicleOptions):
    """Which vehicles fly."""

    client: options.ClientKind = "native"
    mock_speed: Annotated[float, option("Speed of the mock: vehicle, as a multiple of real time.", "X")] = 20.0


@dataclass(frozen=True, slots=True)
class FlightWatch:
    """Supervision of the flight, and the reaction to a breach."""

    live: Annotated[bool, option("--live", "Show the flight in the rerun viewer.")] = False
    web: Annotated[bool, option("--web", "Show the flight live on a map in the browser; see uavcover serve.")] = False
    deadman_s: Annotated[
        float, option("--deadman", "Warn after this many seconds without a vehicle position.", "S")
    ] = 3.0
    link_lost_s: Annotated[
        float, option("--link-lost", "Stop after this many seconds without a vehicle message.", "S")
    ] = 30.0
    on_breach: options.OnBreachAction = None
    require_photos: options.RequirePhotos = False
    apply_limits: Annotated[
        bool,
        option(
            "--apply-limits",
            "Set the parameters that the plan requires, and restore the old values after the flight. Asks for "
            "confirmation unless --yes is given.",
        ),
    ] = False


@dataclass(frozen=True, slots=True)
class OlderFlight:
    """Treatment of an older flight of the run."""

    resume: Annotated[bool, option("--resume", "Continue an unfinished flight, on the ground or in the air.")] = False
    force: Annotated[bool, option("--force", "Replace the track, recording and verdict of the previous flight.")] = (
        False
    )


def fly(
    run: Annotated[Path, typer.Argument(help="Run folder with the mission that is on the vehicle.")],
    to: options.ToEach = None,
    *,
    sortie: options.Sortie = None,
    on_loss: Annotated[
        str,
        option(
            "--on-loss",
            "Action if one of several vehicles is lost: share (others fly its remaining route) or gaps (plan a "
            "gap mission).",
            "share|gaps",
        ),
    ] = "share",
    yes: Annotated[bool, option("--yes", "Allow arming a real vehicle.")] = False,
    vehicle: FlyingVehicle,
    watch: FlightWatch,
    older: OlderFlight,
    output: options.Output,
) -> int:
    """Wait until the vehicle is ready, arm it, fly the mission, record the flight and land.

    With several --to, all vehicles of the plan fly at the same time.

    Press Ctrl-C to hold, return along checked legs and land. Press it twice to keep holding. Both exit with 130. Press
    p to pause or continue; without a terminal, send SIGUSR1. --resume continues a flight that ended early. The new
    track is in its own folder inside RUN, and verify judges both tracks together.
    """
    from uavcover.errors import INTERRUPTED, InputError
    from uavcover.flight.command import ENDED_BY_USER, FlightOptions, commands_after_flight, fly_run, resume_run
    from uavcover.flight.connect import links_of_run
    from uavcover.flight.orders import FlightTimeouts
    from uavcover.model.track import Ending
    from uavcover.plugins import load
    from uavcover.run.documents import read_planned
    from uavcover.run.folder import RunFolder
    from uavcover.run.user import to_paste

    if older.resume and not to and sortie is None and RunFolder(run).sorties():
        RunFolder(run).flight(sortie)  # one of several sorties: refuses, as --sortie is missing
    places = links_of_run(RunFolder(run), vehicle.places(to), sortie=sortie)
    links = [replace(link, mock_speed=vehicle.mock_speed) for link in vehicle.links_at(places, client=vehicle.client)]
    link = links[0]
    console = output.console()
    if len(links) > 1 and (sortie is not None or older.resume):
        raise InputError(
            f"{'--resume' if older.resume else '--sortie'}: this option supports only one vehicle; specify --to "
            "once, or omit this option"
        )
    if len(links) > 1 and watch.apply_limits:
        raise InputError("--apply-limits supports only one vehicle; set each vehicle's parameters beforehand")
    if len(links) > 1 or on_loss != "share":
        load("uavcover.fleets", "vehicles").check_on_loss(on_loss)
    folder = RunFolder(run) if len(links) > 1 else RunFolder(run).flight(sortie)
    precautions = precautions_for(
        folder, console, on_breach=options.on_breach(watch.on_breach), apply_limits=watch.apply_limits, agreed=yes
    )
    precautions = replace(precautions, photos_required=watch.require_photos)
    timeouts = FlightTimeouts(deadman_s=watch.deadman_s, link_lost_s=watch.link_lost_s)
    if watch.web:
        show_page(run)
    viewer_url = None
    if watch.live:
        from uavcover.recording.viewer import open_live_viewer

        viewer_url = open_live_viewer()
    asked = FlightOptions(
        confirmed=yes, force=older.force, viewer_url=viewer_url, timeouts=timeouts, precautions=precautions,
        upload_first=link.url.startswith("mock:"),  # a vehicle that begins with this process holds nothing yet
    )  # fmt: skip
    if len(links) > 1:
        from uavcover.planner.close_gaps import GapRequest, commands_after_gaps

        ended, document = load("uavcover.fleets", "vehicles").fly_fleet(
            folder, links, console, asked, on_loss=on_loss, command=sys.argv
        )
        gap_mission = (document["gaps"] or {}).get("mission")
        following = [] if gap_mission is None else commands_after_gaps(folder, GapRequest())
        console.suggest(to_paste("verify", run), *following)
        console.result(document)
        return INTERRUPTED if ended else int(bool(document["left"]))
    if older.resume:
        resumed, document = resume_run(folder, link, console, asked, command=sys.argv)
        if resumed is not None:
            console.suggest(*commands_after_flight(folder, resumed.ending, options.words_of(links)))
        console.result(document)
        return INTERRUPTED if resumed is not None and resumed.ending in ENDED_BY_USER else 0
    site, planned = read_planned(folder)
    outcome, document = fly_run(folder, site, planned.route, link, console, asked)
    if outcome.ending is Ending.RETURNED and outcome.waypoints_reached < len(planned.route):
        console.say("the vehicle now contains the return mission; use --resume to fly the remaining route")
    console.suggest(*commands_after_flight(folder, outcome.ending, options.words_of(links)))
    console.result(document)
    return INTERRUPTED if outcome.ending in ENDED_BY_USER else 0


def show_page(run: Path) -> None:
    """Start ``uavcover serve`` for a run as a process of its own, which ends with this one. It cannot delay the flight."""
    page = subprocess.Popen(
        [sys.executable, "-m", "uavcover", "serve", str(run), "--port", "0"],
        stdin=subprocess.DEVNULL, stdout=sys.stderr, start_new_session=True,
    )  # fmt: skip

    def end() -> None:
        page.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            page.wait(5.0)

    atexit.register(end)


def precautions_for(
    run: "RunFolder", console: "Console", *, on_breach: "OnBreach | None", apply_limits: bool, agreed: bool
) -> "Precautions":
    """The precautions of a flight of this run.

    Args:
        run: where old parameters are kept.
        console: shows the questions.
        on_breach: what to do on a breach; None is the vehicle's default.
        apply_limits: whether to set what the plan needs.
        agreed: whether the user has agreed beforehand.

    Raises:
        InputError: what an earlier flight left is no list of parameters.
    """
    from uavcover.flight.orders import Precautions

    def keep(values: Mapping[str, float]) -> None:
        if values:
            run.write_json(OLD_LIMITS, dict(values))
        else:
            run.remove([OLD_LIMITS])

    def agree(text: str) -> bool:
        console.say(text)
        if agreed:
            return True
        if not sys.stdin.isatty():
            console.warn("--apply-limits needs a terminal to ask for confirmation: add --yes")
            return False
        sys.stderr.write("Set these parameters? [y/N] ")
        sys.stderr.flush()
        return sys.stdin.readline().strip().lower() in ("y", "yes")

    return Precautions(
        on_breach=on_breach, apply_limits=apply_limits, agree=agree, keep=keep, left_changed=_left_changed(run)
    )


def _left_changed(run: "RunFolder") -> dict[str, float]:
    from uavcover.errors import InputError

    file = run.file(OLD_LIMITS)
    if not file.exists():
        return {}
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
        found = {str(name): float(value) for name, value in values.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        found = {"": math.nan}
    if not all(name and math.isfinite(value) for name, value in found.items()):
        raise InputError(
            f"{file}: cannot read this list of parameters that an earlier flight changed on the vehicle; restore "
            "them manually, then delete the file"
        )
    return found
