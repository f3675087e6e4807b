"""``uavcover mock-vehicle``: a MAVLink vehicle for any ground station."""

import contextlib
import os
import select
import sys
from pathlib import Path
from typing import Annotated

import typer

from uavcover.cli import options


def mock_vehicle(
    listen: Annotated[
        str, typer.Option("--listen", help="udpin:// or tcpin://HOST:PORT; port 0 is any free one.", metavar="URL")
    ],
    autopilot: options.Autopilot = None,
    vehicle_type: Annotated[
        str,
        typer.Option(
            "--type", help="What it says it is: quadrotor, plane, rover, helicopter, vtol, ...", metavar="NAME"
        ),
    ] = "quadrotor",
    system: Annotated[int, typer.Option("--system", help="Its MAVLink system id.", metavar="N", min=1, max=255)] = 1,
    scenario: Annotated[
        str, typer.Option(help="Stands at this scenario's home and flies like its vehicle.")
    ] = "jacksboro",
    home: Annotated[
        str | None, typer.Option(help="Stands here instead, on flat ground.", metavar="LAT,LON,ALT_AMSL")
    ] = None,
    speed: Annotated[float, typer.Option(help="Vehicle seconds per second.")] = 1.0,
    loss: Annotated[float, typer.Option(help="Share of the datagrams that get lost, each way.")] = 0.0,
    wind_m_s: Annotated[float, typer.Option("--wind", help="Steady wind, m/s.")] = 0.0,
    wind_from_deg: Annotated[float, typer.Option("--wind-from", help="Where it comes from, degrees.")] = 270.0,
    gust_m_s: Annotated[float, typer.Option("--gust", help="Standard deviation of the gusts, m/s.")] = 0.0,
    gps_noise_m: Annotated[float, typer.Option("--gps-noise", help="Standard deviation of its position, m.")] = 0.0,
    gps_latency_s: Annotated[float, typer.Option("--gps-latency", help="Age of its satellite positions, s.")] = 0.0,
    endurance_s: Annotated[
        float | None, typer.Option("--endurance", help="For how long its full battery hovers, s.")
    ] = None,
    behaviour: Annotated[
        str, typer.Option(help="quick: ready in 2 s. observed: as the real autopilots start up, talk and wait.")
    ] = "quick",
    truth: Annotated[
        Path | None, typer.Option(help="Where it really is, as CSV.", metavar="FILE.csv", show_default=False)
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(help="What goes wrong, and when; repeatable. See below.", metavar="NAME[:ARG][@MOMENT]"),
    ] = None,
    until_eof: Annotated[
        bool,
        typer.Option("--until-eof", help="End when standard input ends, as it does with the program that holds it."),
    ] = False,
    seed: options.Seed = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = 0,
) -> int:
    """Be a vehicle on a port until Ctrl-C; prints the port it bound.

    Faults: heartbeat-loss[:S], gps-loss[:S], battery-failsafe[:return|land], pilot-mode[:MODE], reboot[:S],
    link-outage[:S], stuck[:S], arming-refused[:S], strong-wind[:M_S], mission-changed, force-disarm. Moments: @40s after
    take-off, @boot+40s after it was switched on, @item5 when it flies to that item.
    """
    import numpy as np

    from mission_io.autopilots.vehicle_types import parse_type
    from mission_io.model.items import GeoPoint
    from uavcover.cli.console import Console
    from uavcover.errors import InputError
    from uavcover.mock.behaviour import OBSERVED, Settings, quick
    from uavcover.mock.dynamics import BatteryData, WindModel
    from uavcover.mock.faults import parse_fault
    from uavcover.mock.positioning import GpsError, TruthFile
    from uavcover.mock.server import run
    from uavcover.mock.vehicle import MockConfig, MockVehicle
    from uavcover.model.vehicle import AutopilotName, autopilot_name
    from uavcover.routes.mission_compiler import AUTOPILOTS
    from uavcover.run.session import home_of
    from uavcover.scenario.site import load_site

    console = Console(as_json=as_json, verbosity=options.verbosity(quiet, verbose))
    mav_type = parse_type(vehicle_type)
    if not 0.0 < speed < float("inf"):
        raise InputError(f"--speed: {speed:g} is not a number above 0")
    used_seed = 0 if seed is None else seed
    if home is not None:
        try:
            lat, lon, alt = (float(part) for part in home.split(","))
        except ValueError as error:
            raise InputError(f"--home: {home!r} is not LAT,LON,ALT_AMSL") from error
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):
            raise InputError(
                f"--home: {home!r} is no place on Earth; write latitude, longitude, height above sea level"
            )
        place, settings, battery = GeoPoint(lat, lon, alt), Settings(), BatteryData()
        default: AutopilotName = "ardupilot"
    else:
        site = load_site(scenario)
        at_home = home_of(site)
        if at_home is None:
            raise InputError(f"scenario {scenario}: has no place on Earth or no home; give --home LAT,LON,ALT_AMSL")
        place = at_home
        settings, default = Settings.for_vehicle(site.scenario.vehicle), site.scenario.vehicle.autopilot
        battery = BatteryData.for_vehicle(site.scenario.vehicle)
    name = autopilot_name(autopilot, default)
    ways = {"quick": quick(), "observed": OBSERVED[AUTOPILOTS[name].mav_autopilot]}
    if behaviour not in ways:
        raise InputError(f"--behaviour: {behaviour!r} is not quick or observed")
    try:
        wind = WindModel(speed_m_s=wind_m_s, from_deg=wind_from_deg, gust_m_s=gust_m_s)
        gps = GpsError(horizontal_m=gps_noise_m, vertical_m=1.5 * gps_noise_m, latency_s=gps_latency_s)
        battery = battery if endurance_s is None else BatteryData(endurance_s=endurance_s)
    except ValueError as error:
        raise InputError(str(error)) from error

    def tell(port: int) -> None:
        kind = "mock vehicle" if vehicle_type == "quadrotor" else f"mock {vehicle_type}"
        console.say(f"{name} {kind} at {place.lat_deg:.6f}, {place.lon_deg:.6f}, listening on port {port}")
        console.result({"port": port, "autopilot": name, "type": vehicle_type, "lat_deg": place.lat_deg, "lon_deg": place.lon_deg,
                        "alt_amsl_m": place.alt_amsl_m})  # fmt: skip

    with contextlib.ExitStack() as stack:
        vehicle = MockVehicle(
            AUTOPILOTS[name],
            place,
            MockConfig(
                settings=settings,
                wind=wind,
                gps=gps,
                battery=battery,
                speed=speed,
                system_id=system,
                vehicle_type=mav_type,
                behaviour=ways[behaviour],
                faults=[parse_fault(text) for text in fault or ()],
            ),
            rng=np.random.default_rng(used_seed),
            on_truth=None if truth is None else stack.enter_context(TruthFile(truth)),
        )
        run(
            listen, vehicle, speed=speed, loss=loss, seed=used_seed, on_bound=tell,
            ended=_standard_input_ended if until_eof else lambda: False,
        )  # fmt: skip
    return 0


def _standard_input_ended() -> bool:
    """Whether nothing comes any more; what comes is not looked at."""
    number = sys.stdin.fileno()
    return bool(select.select([number], [], [], 0.0)[0]) and not os.read(number, 4096)
