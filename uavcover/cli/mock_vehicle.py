"""``uavcover mock-vehicle``: a MAVLink vehicle for any ground station."""

import contextlib
import os
import select
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from uavcover.cli import options
from uavcover.cli.options import option

if TYPE_CHECKING:
    from mission_io.autopilots.autopilot import Autopilot
    from mission_io.model.items import GeoPoint
    from uavcover.mock.vehicle import MockConfig
    from uavcover.model.vehicle import AutopilotName


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
            InputError: a type, a place or a scenario that cannot be used.
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
            return autopilot_name(self.autopilot, "ardupilot"), _place(self.home), config
        site = load_site(self.scenario)
        place, vehicle = home_of(site), site.scenario.vehicle
        if place is None:
            raise InputError(f"scenario {self.scenario} defines no home on Earth; add --home LAT,LON,ALT_AMSL")
        name = autopilot_name(self.autopilot, vehicle.autopilot)
        settings = Settings.for_vehicle(vehicle, name)
        return name, place, replace(config, settings=settings, battery=BatteryData.for_vehicle(vehicle))


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
        ways = {"quick": quick(), "observed": OBSERVED[autopilot.mav_autopilot]}
        if self.behaviour not in ways:
            raise InputError(f"--behaviour: must be quick or observed, not {self.behaviour!r}")
        try:
            return replace(
                config,
                speed=self.speed,
                behaviour=ways[self.behaviour],
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
    name, place, config = imitated.configured()
    config = conditions.added_to(config, AUTOPILOTS[name])
    config = replace(config, faults=[parse_fault(text) for text in fault or ()])
    used_seed = 0 if seed is None else seed

    def tell(port: int) -> None:
        kind = imitated.vehicle_type
        what = "mock vehicle" if kind == "quadrotor" else f"mock {kind}"
        console.say(f"{name} {what} at {place.lat_deg:.6f}, {place.lon_deg:.6f}, listening on port {port}")
        console.result({"port": port, "autopilot": name, "type": kind, "lat_deg": place.lat_deg, "lon_deg": place.lon_deg,
                        "alt_amsl_m": place.alt_amsl_m})  # fmt: skip

    with contextlib.ExitStack() as stack:
        vehicle = MockVehicle(
            AUTOPILOTS[name],
            place,
            config,
            rng=np.random.default_rng(used_seed),
            on_truth=None if truth is None else stack.enter_context(TruthFile(truth)),
        )
        run(
            listen, vehicle, speed=conditions.speed, loss=conditions.loss, seed=used_seed, on_bound=tell,
            ended=_standard_input_ended if until_eof else lambda: False,
        )  # fmt: skip
    return 0


def _place(text: str) -> "GeoPoint":
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
