"""Planned against flown batteries of mock vehicles, in wind of 0 to 8 m/s from all sides, with gusts and payload.

Planned is what ``plan`` counts for the wind that blows, without its uncertainty; flown is what the mock's battery, which sums up
its power 50 times a second, has lost from before the take-off until after the landing.

Usage: .venv/bin/python scripts/bench_energy.py OUT.md
"""

import argparse
import dataclasses
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

from mission_io.links.simulated import Conditions, SimulatedLink
from scripts.options import file_to_write
from tests.cli.conftest import corner_of_the_demo
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData, WindModel
from uavcover.mock.peer import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.power import PowerModel
from uavcover.model.route import Route
from uavcover.model.vehicle import AutopilotName, Wind
from uavcover.planning.terrain_following import lay_over_terrain
from uavcover.routes.mission_compiler import AUTOPILOTS
from uavcover.run.mission import compile_plan
from uavcover.run.session import Connected, fly, home_of
from uavcover.run.upload import upload
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.vehicle.fly import Orders
from uavcover.vehicle.monitor import open_vehicle

ENDURANCE_S = 1500.0
PLAIN = PowerModel()


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A flight."""

    wind: Wind
    autopilot: AutopilotName = "ardupilot"
    cruise_m_s: float = 10.0
    power: PowerModel = PLAIN
    lines: int = 5


LOADED = PowerModel(mass_kg=3.0, payload_kg=0.6, rotor_area_m2=0.45, body_drag_area_m2=0.03)
ZENG = PowerModel(
    mass_kg=2.04,
    hover_induced_m_s=4.03,
    profile_share=0.474,
    rotor_drag_1_s=0.0,
    body_drag_area_m2=0.0151,
    idle_share=0.0,
)
CASES = (
    Case(wind=Wind()),
    Case(wind=Wind(), autopilot="px4"),
    Case(wind=Wind(), cruise_m_s=5.0),
    Case(wind=Wind(), cruise_m_s=15.0),
    Case(wind=Wind(speed_m_s=2.0, from_deg=45.0, gust_m_s=0.5)),
    Case(wind=Wind(speed_m_s=4.0, from_deg=180.0, gust_m_s=0.5), autopilot="px4"),
    Case(wind=Wind(speed_m_s=5.0, from_deg=90.0, gust_m_s=1.0)),
    Case(wind=Wind(speed_m_s=6.0, from_deg=300.0, gust_m_s=1.0), cruise_m_s=8.0),
    Case(wind=Wind(speed_m_s=7.0, from_deg=0.0, gust_m_s=1.0), autopilot="px4"),
    Case(wind=Wind(speed_m_s=8.0, from_deg=90.0, gust_m_s=1.5)),
    Case(wind=Wind(speed_m_s=8.0, from_deg=225.0, gust_m_s=1.5), cruise_m_s=6.0, autopilot="px4"),
    Case(wind=Wind(speed_m_s=6.0, from_deg=135.0, gust_m_s=1.0), power=LOADED),
    Case(wind=Wind(speed_m_s=6.0, from_deg=135.0, gust_m_s=1.0), power=ZENG),
)


def site_of(case: Case, folder: Path) -> Site:
    """A corner of the demo with the vehicle and the wind of a case."""
    scenario = load_scenario(corner_of_the_demo(folder))
    vehicle = dataclasses.replace(
        scenario.vehicle, endurance_s=ENDURANCE_S, max_airspeed_m_s=18.0, cruise_speed_m_s=case.cruise_m_s,
        power=case.power, autopilot=case.autopilot,
    )  # fmt: skip
    return load_site(dataclasses.replace(scenario, vehicle=vehicle, wind=case.wind))


def route_of(site: Site, lines: int) -> Route:
    """Lines over the area, over its ground."""
    west, south, east, north = site.area.bounds
    rows = np.linspace(south + 20.0, north - 20.0, lines)
    corners = [(e, n) for k, n in enumerate(rows) for e in ((east, west), (west, east))[k % 2]]
    return Route(lay_over_terrain(site, np.array(corners), np.full(len(corners), 60.0), tolerance_m=8.0))


def flown(site: Site, route: Route, *, seed: int) -> tuple[float, float, float]:
    """Share of the battery that is planned, that a mock has used at its landing, and seconds in the air as planned."""
    vehicle, wind, home = site.scenario.vehicle, site.scenario.wind, home_of(site)
    assert home is not None
    mock = MockVehicle(
        AUTOPILOTS[vehicle.autopilot],
        home,
        MockConfig(
            settings=Settings.for_vehicle(vehicle),
            battery=BatteryData.for_vehicle(vehicle),
            wind=WindModel(speed_m_s=wind.speed_m_s, from_deg=wind.from_deg, gust_m_s=wind.gust_m_s),
        ),
        rng=np.random.default_rng(seed),
    )
    link = SimulatedLink(InMemoryPeer(mock), rng=Random(seed), conditions=Conditions(delay_s=0.002))
    client, monitor = open_vehicle(link)
    monitor.listen_to(client.wait_for_vehicle().address)
    compiled = compile_plan(site, route)
    upload(client, compiled)
    before = mock.body.battery.remaining
    station = Connected(client, monitor, vehicle.autopilot)
    fly(station, site, compiled, Orders(on_sample=lambda _: None, on_event=lambda _: None, stop=lambda: 0))
    assert compiled.battery_used is not None
    return compiled.battery_used, before - mock.body.battery.remaining, compiled.flight_time_s


def rows() -> Iterator[str]:
    """The table, a row as soon as its flight is over."""
    yield (
        "| wind, m/s | from | gusts, m/s | autopilot | cruise, m/s | in the air, s | hovering as long, % | planned, % | flown, % "
        "| difference, % of flown |"
    )
    yield "|" + "---|" * 10
    for seed, case in enumerate(CASES, start=1):
        with tempfile.TemporaryDirectory() as folder:
            site = site_of(case, Path(folder))
            planned, used, seconds = flown(site, route_of(site, case.lines), seed=seed)
        wind, hover_s = case.wind, site.scenario.vehicle.hover_s or math.inf
        of_vehicle = {LOADED: ", payload", ZENG: ", Zeng et al."}.get(case.power, "")
        yield (
            f"| {wind.speed_m_s:g} | {wind.from_deg:g} | {wind.gust_m_s:g} | {case.autopilot}{of_vehicle} | {case.cruise_m_s:g} "
            f"| {seconds:.0f} | {100 * seconds / hover_s:.1f} | {100 * planned:.1f} | {100 * used:.1f} "
            f"| {100 * (planned / used - 1.0):+.1f} |"
        )


def main() -> None:
    """Fly all, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=file_to_write)
    out = parser.parse_args().out
    lines = []
    for row in rows():
        lines.append(row)
        print(row, flush=True)
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
