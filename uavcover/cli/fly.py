"""``uavcover fly``: arm, start, follow, record, land; ``mock-vehicle``: a vehicle for any ground station."""

import atexit
import contextlib
import json
import math
import os
import select
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
    from mission_io.autopilots.autopilot import Autopilot
    from mission_io.model.items import GeoPoint
    from uavcover.cli.console import Console
    from uavcover.flight.orders import OnBreach, Precautions
    from uavcover.mock.vehicle import MockConfig
    from uavcover.model.vehicle import AutopilotName
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
    addresses = links_of_run(RunFolder(run), vehicle.addresses(to), sortie=sortie)
    links = [
        replace(link, mock_speed=vehicle.mock_speed) for link in vehicle.links_at(addresses, client=vehicle.client)
    ]
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
    requested = FlightOptions(
        confirmed=yes, force=older.force, viewer_url=viewer_url, timeouts=timeouts, precautions=precautions,
        upload_first=link.url.startswith("mock:"),  # a vehicle that begins with this process holds nothing yet
    )  # fmt: skip
    if len(links) > 1:
        from uavcover.planner.close_gaps import GapRequest, commands_after_gaps

        ended, document = load("uavcover.fleets", "vehicles").fly_fleet(
            folder, links, console, requested, on_loss=on_loss, command=sys.argv
        )
        gap_mission = (document["gaps"] or {}).get("mission")
        following = [] if gap_mission is None else commands_after_gaps(folder, GapRequest())
        console.suggest(to_paste("verify", run), *following)
        console.result(document)
        return INTERRUPTED if ended else int(bool(document["left"]))
    if older.resume:
        resumed, document = resume_run(folder, link, console, requested, command=sys.argv)
        if resumed is not None:
            console.suggest(*commands_after_flight(folder, resumed.ending, options.words_of(links)))
        console.result(document)
        return INTERRUPTED if resumed is not None and resumed.ending in ENDED_BY_USER else 0
    site, planned = read_planned(folder)
    outcome, document = fly_run(folder, site, planned.route, link, console, requested)
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


@dataclass(frozen=True, slots=True)
class Imitated:
    """Which vehicle is imitated, and where it stands."""

    autopilot: options.Autopilot = None
    vehicle_type: Annotated[
        str, option("--type", "Vehicle type to report: quadrotor, plane, rover, helicopter, vtol and others.", "NAME")
    ] = "quadrotor"
    system: Annotated[int, option("MAVLink system ID of the vehicle.", "N", min=1, max=255)] = 1
    scenario: Annotated[str, option("Scenario that defines the home and performance of the vehicle.")] = "jacksboro"
    home: Annotated[str | None, option("Home position, on flat ground.", "LAT,LON,ALT_AMSL")] = None

    def configured(self) -> "tuple[AutopilotName, GeoPoint, MockConfig]":
        """Its autopilot, its home, and what kind of vehicle it is.

        Raises:
            InputError: a type, a position or a scenario that cannot be used.
        """
        from mission_io.model.enums import parse_type
        from uavcover.errors import InputError
        from uavcover.flight.connect import home_of
        from uavcover.mock.behaviour import Settings
        from uavcover.mock.dynamics import BatteryData
        from uavcover.mock.vehicle import MockConfig
        from uavcover.model.vehicle import autopilot_name
        from uavcover.scenario.site import load_site

        config = MockConfig(system_id=self.system, vehicle_type=parse_type(self.vehicle_type))
        if self.home is not None:
            return autopilot_name(self.autopilot, "ardupilot"), _position(self.home), config
        site = load_site(self.scenario)
        position, vehicle = home_of(site), site.scenario.vehicle
        if position is None:
            raise InputError(f"scenario {self.scenario} defines no home on Earth; add --home LAT,LON,ALT_AMSL")
        name = autopilot_name(self.autopilot, vehicle.autopilot)
        settings = Settings.for_vehicle(vehicle, name)
        return name, position, replace(config, settings=settings, battery=BatteryData.for_vehicle(vehicle))


@dataclass(frozen=True, slots=True)
class FlightConditions:
    """Time factor, link loss, wind and performance of the mock vehicle."""

    speed: Annotated[float, option("Speed as a multiple of real time.")] = 1.0
    loss: Annotated[float, option("Fraction of datagrams lost in each direction.")] = 0.0
    wind_m_s: Annotated[float, option("--wind", "Speed of the steady wind, in m/s.")] = 0.0
    wind_from_deg: Annotated[float, option("--wind-from", "Direction from which the wind blows, in degrees.")] = 270.0
    gust_m_s: Annotated[float, option("--gust", "Standard deviation of the gusts, in m/s.")] = 0.0
    gps_noise_m: Annotated[float, option("--gps-noise", "Standard deviation of the position, in metres.")] = 0.0
    gps_latency_s: Annotated[float, option("--gps-latency", "Delay of the GNSS position, in seconds.")] = 0.0
    endurance_s: Annotated[float | None, option("--endurance", "Hover time on a full battery, in seconds.")] = None
    behaviour: Annotated[
        str, option("quick: the vehicle is ready after 2 s. observed: timing and messages match the real autopilots.")
    ] = "quick"

    def added_to(self, config: "MockConfig", autopilot: "Autopilot") -> "MockConfig":
        """A vehicle under these conditions. Raises InputError: a value is out of range."""
        from uavcover.errors import InputError
        from uavcover.mock.behaviour import OBSERVED, quick
        from uavcover.mock.body import GpsError
        from uavcover.mock.dynamics import BatteryData, WindModel

        if not 0.0 < self.speed < float("inf"):
            raise InputError(f"--speed: must be greater than 0, not {self.speed:g}")
        behaviours = {"quick": quick(), "observed": OBSERVED[autopilot.mav_autopilot]}
        if self.behaviour not in behaviours:
            raise InputError(f"--behaviour: must be quick or observed, not {self.behaviour!r}")
        try:
            return replace(
                config,
                speed=self.speed,
                behaviour=behaviours[self.behaviour],
                wind=WindModel(speed_m_s=self.wind_m_s, from_deg=self.wind_from_deg, gust_m_s=self.gust_m_s),
                gps=GpsError(
                    horizontal_m=self.gps_noise_m, vertical_m=1.5 * self.gps_noise_m, latency_s=self.gps_latency_s
                ),
                battery=config.battery if self.endurance_s is None else BatteryData(endurance_s=self.endurance_s),
            )
        except ValueError as error:
            raise InputError(str(error)) from error


def mock_vehicle(
    listen: Annotated[str, option("udpin://HOST:PORT or tcpin://HOST:PORT. Port 0 selects a free port.", "URL")],
    *,
    imitated: Imitated,
    conditions: FlightConditions,
    truth: Annotated[
        Path | None, option("CSV file to which to write the true positions.", "FILE.csv", show_default=False)
    ] = None,
    fault: Annotated[
        list[str] | None, option("Fault to simulate, as listed above. Can be repeated.", "NAME[:ARG][@MOMENT]")
    ] = None,
    until_eof: Annotated[bool, option("--until-eof", "Exit when standard input closes.")] = False,
    seed: options.Seed = None,
    output: options.Output,
) -> int:
    """Simulate a MAVLink vehicle on a port until Ctrl-C, and print the port.

    A fault is NAME[:ARGUMENT][@MOMENT]. Faults: heartbeat-loss[:S], gps-loss[:S], battery-failsafe[:return|land],
    pilot-mode[:MODE], reboot[:S], link-outage[:S], stuck[:S], arming-refused[:S], strong-wind[:M_S], mission-changed,
    mission-lowered[:M], force-disarm, motor-failure, gps-glitch[:M], speed-changed[:M_S], item-set-back,
    camera-stops[:N], camera-skips[:N], camera-silent.

    Moments: @40s is 40 s after take-off, @boot+40s is 40 s after the start, and @item5 is when the vehicle flies to item 5.
    """
    import numpy as np

    from uavcover.missions.mission_compiler import AUTOPILOTS
    from uavcover.mock.faults import parse_fault
    from uavcover.mock.server import run
    from uavcover.mock.telemetry import TruthFile
    from uavcover.mock.vehicle import MockVehicle

    console = output.console()
    name, position, config = imitated.configured()
    config = conditions.added_to(config, AUTOPILOTS[name])
    config = replace(config, faults=[parse_fault(text) for text in fault or ()])
    used_seed = 0 if seed is None else seed

    def tell(port: int) -> None:
        kind = imitated.vehicle_type
        what = "mock vehicle" if kind == "quadrotor" else f"mock {kind}"
        console.say(f"{name} {what} at {position.lat_deg:.6f}, {position.lon_deg:.6f}, listening on port {port}")
        console.result({"port": port, "autopilot": name, "type": kind, "lat_deg": position.lat_deg, "lon_deg": position.lon_deg,
                        "alt_amsl_m": position.alt_amsl_m})  # fmt: skip

    with contextlib.ExitStack() as stack:
        vehicle = MockVehicle(
            AUTOPILOTS[name],
            position,
            config,
            rng=np.random.default_rng(used_seed),
            on_truth=None if truth is None else stack.enter_context(TruthFile(truth)),
        )
        run(
            listen, vehicle, speed=conditions.speed, loss=conditions.loss, seed=used_seed, on_bound=tell,
            ended=_standard_input_ended if until_eof else lambda: False,
        )  # fmt: skip
    return 0


def _position(text: str) -> "GeoPoint":
    """A position given as ``LAT,LON,ALT_AMSL``."""
    from mission_io.model.items import GeoPoint
    from uavcover.errors import InputError

    try:
        lat_deg, lon_deg, alt_amsl_m = (float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(f"--home: expected LAT,LON,ALT_AMSL, not {text!r}") from error
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise InputError(f"--home: {text!r} is not on Earth; write latitude, longitude, altitude above sea level")
    return GeoPoint(lat_deg, lon_deg, alt_amsl_m)


def _standard_input_ended() -> bool:
    """Whether nothing comes any more; what comes is not looked at."""
    number = sys.stdin.fileno()
    return bool(select.select([number], [], [], 0.0)[0]) and not os.read(number, 4096)
