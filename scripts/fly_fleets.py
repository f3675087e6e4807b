"""Seeded flights of mock vehicles at once, with wind and delays: separation, coverage and reserve of each flight.

``lost``: four vehicles, one of which falls, or is not heard any more, half-way. ``twelve``: three vehicles fly twelve sorties,
and none is lost. Separation is measured on the mocks' true positions, which nothing else here sees, beside what ``verify`` says
of the tracks. Begun again, it goes on with the flights that are not in OUT.csv; flights of another commit are refused.

Usage: .venv/bin/python scripts/fly_fleets.py OUT.csv [--mission lost|twelve] [--flights 100] [--first 1]
"""

import argparse
import csv
import dataclasses
import itertools
import json
import math
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import uavcover.run.fly
from mission_io.autopilots.autopilot import ARDUPILOT, PX4
from scripts.options import file_to_write
from tests.cli.conftest import corner_of_the_demo
from tests.run.lockstep import Hangar
from uavcover.mock.behaviour import Settings, quick
from uavcover.mock.dynamics import BatteryData, WindModel
from uavcover.mock.faults import Fault, FaultKind, FaultTrigger, Since
from uavcover.mock.positioning import TruthSample
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.fleet import Fleet
from uavcover.model.route import Plan, Route, RouteMember
from uavcover.model.vehicle import Wind
from uavcover.planning.terrain_following import lay_over_terrain
from uavcover.routes.flights import compile_flights
from uavcover.routes.objectives import judge
from uavcover.run.fleet import fleet_document
from uavcover.run.fleet_jobs import planned_jobs
from uavcover.run.fly import FlightOptions
from uavcover.run.fly_fleet import FleetFailedError, FleetOptions, fly_fleet
from uavcover.run.folder import RunFolder
from uavcover.run.judge import verify_run
from uavcover.run.plan_files import save_plan
from uavcover.run.session import home_of
from uavcover.run.user import Unattended
from uavcover.scenario.scenario_file import load_scenario
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import judging_map

COLUMNS = (
    "seed", "mission", "lost", "wind_m_s", "planned_sorties", "flown_sorties", "reserve_kept", "left_as_gap", "truly_apart_m",
    "told_apart_m", "coverage", "planned_coverage", "least_battery", "late_s", "done_s", "took_s", "commit",
)  # fmt: skip
_LOOK_S = 0.2
_MOST_WIND_M_S, _MOST_GUST_M_S = 7.0, 1.0
"""That batteries are planned for, and that blow at most."""


@dataclass(frozen=True, slots=True)
class Flown:
    """What is flown.

    Attributes:
        vehicles: how many fly.
        endurance_s: of each; the reserve is a fifth of it.
        rows: how many lines the area gets.
        north_lat_deg: where the area ends.
        one_is_lost: whether one vehicle is lost half-way.
    """

    vehicles: int
    endurance_s: float
    rows: int
    north_lat_deg: float
    one_is_lost: bool


MISSIONS = {
    "lost": Flown(4, 215.0, 5, 36.4775, one_is_lost=True),
    "twelve": Flown(3, 250.0, 20, 36.47891, one_is_lost=False),
}


def main() -> None:
    """Fly, and add one row for each flight as soon as it is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=file_to_write)
    parser.add_argument("--mission", choices=sorted(MISSIONS), default="lost")
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--first", type=int, default=1)
    arguments = parser.parse_args()
    uavcover.run.fly.live_recording = lambda *_, **__: None  # the recordings of single flights are not looked at here
    uavcover.run.fly._keep_recording = lambda *_: None
    commit = subprocess.run(
        ["git", "rev-parse", "--short=9", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()
    done: set[int] = set()
    if arguments.out.exists():
        with arguments.out.open(newline="") as file:
            rows = list(csv.DictReader(file))
        if any((row["commit"], row["mission"]) != (commit, arguments.mission) for row in rows):
            parser.error(
                f"{arguments.out}: has flights of another commit than {commit}, or of another mission; name another file"
            )
        done = {int(row["seed"]) for row in rows}
    with arguments.out.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if file.tell() == 0:
            writer.writeheader()
        for seed in range(arguments.first, arguments.first + arguments.flights):
            if seed in done:
                continue
            with tempfile.TemporaryDirectory() as folder:
                row = fly_one(seed, arguments.mission, Path(folder))
            writer.writerow({**row, "commit": commit})
            file.flush()
            print(row, flush=True)


def planned(mission: Flown, folder: Path) -> RunFolder:
    """A corner of the demo in lines over its ground, for several vehicles."""
    scenario = load_scenario(corner_of_the_demo(folder))
    corners_deg = scenario.area.polygon_lon_lat_deg or ()
    site = load_site(
        dataclasses.replace(
            scenario,
            vehicle=dataclasses.replace(scenario.vehicle, endurance_s=mission.endurance_s, max_airspeed_m_s=18.0),
            wind=Wind(most_m_s=_MOST_WIND_M_S, gust_m_s=_MOST_GUST_M_S),
            fleet=Fleet(
                vehicles=mission.vehicles, turnaround_s=60.0, start_error_s=1.0, timing_error_fraction=0.02, pad_s=5.0
            ),
            area=dataclasses.replace(
                scenario.area, cell_size_m=10.0,
                polygon_lon_lat_deg=tuple((lon, min(lat, mission.north_lat_deg)) for lon, lat in corners_deg),
            ),
        )
    )  # fmt: skip
    west, south, east, north = site.area.bounds
    rows = np.linspace(south + 20.0, north - 20.0, mission.rows)
    corners = [(e, n) for k, n in enumerate(rows) for e in ((east, west), (west, east))[k % 2]]
    route = Route(lay_over_terrain(site, np.array(corners), np.full(len(corners), 60.0), tolerance_m=8.0))
    flights = compile_flights(site, route)
    member = RouteMember(route, judge(judging_map(site), route), 0.0, "test")
    run = RunFolder(folder / "run")
    save_plan(
        run, site, Plan(member, (member,), (), "knee", True, "lines", 1, 0.0), compiled=None, autopilot="ardupilot",
        seed=1, command=["fly_fleets"], sorties=flights, fleet=fleet_document(site, flights),
    )  # fmt: skip
    return run


def fly_one(seed: int, name: str, folder: Path) -> dict[str, object]:
    """One flight of all vehicles."""
    started = time.process_time()
    mission = MISSIONS[name]
    run = planned(mission, folder)
    rng = np.random.default_rng(seed)
    jobs = planned_jobs(run, len({row["vehicle"] for row in json.loads(run.file("plan.json").read_text())["sorties"]}))
    vehicles = max(job.vehicle for job in jobs)
    lost = int(rng.integers(1, vehicles + 1))
    first = next(job for job in jobs if job.vehicle == lost)
    kind = FaultKind.FORCE_DISARM if seed % 2 else FaultKind.LINK_OUTAGE
    faults = [Fault(kind, FaultTrigger(Since.TAKE_OFF, 0.5 * first.timeline.duration_s))]
    wind = WindModel(
        speed_m_s=rng.uniform(0.0, _MOST_WIND_M_S),
        from_deg=rng.uniform(0.0, 360.0),
        gust_m_s=rng.uniform(0.2, _MOST_GUST_M_S),
    )
    truth: list[tuple[list[float], list[tuple[float, float, float]]]] = []

    def make(number: int, sortie: int, site: Site) -> MockVehicle:
        times: list[float] = []
        places: list[tuple[float, float, float]] = []
        truth.append((times, places))
        begin_s = hangar.clocks[number - 1].now()

        def keep(sample: TruthSample) -> None:
            times.append(begin_s + sample.time_s)
            assert site.frame is not None
            e, n, u = site.frame.enu_from_geodetic(sample.lat_deg, sample.lon_deg, sample.alt_amsl_m)[0]
            places.append((float(e), float(n), float(u)))

        settings = Settings.for_vehicle(site.scenario.vehicle)
        config = MockConfig(
            settings=settings, battery=BatteryData.for_vehicle(site.scenario.vehicle), system_id=number, wind=wind,
            behaviour=quick(float(rng_of(seed, number, sortie).uniform(1.0, 40.0))),
            faults=faults if mission.one_is_lost and (number, sortie) == (lost, 0) else [],
        )  # fmt: skip
        autopilot = PX4 if site.scenario.vehicle.autopilot == "px4" else ARDUPILOT
        return MockVehicle(autopilot, home_of(site), config, rng=rng_of(seed, number, sortie), on_truth=keep)

    hangar = Hangar(vehicles, make, seed=seed, delay_s=float(rng.uniform(0.01, 0.3)))
    options = FleetOptions(flight=FlightOptions(utc_offset_s=0.0), opening=hangar.open, clocks=hangar.clocks)
    try:
        told = fly_fleet(run, hangar.links(), Unattended(), options, command=["fly_fleets"])[1]
    except FleetFailedError as error:
        told = error.details()
    rows, left = told["sorties"], told["left"]
    document = verify_run(run, Unattended(), command=["fly_fleets"])[1]
    lost_one = hangar.flown[lost][0] if mission.one_is_lost else None
    kept = [v.body.battery.remaining for v in flown_ones(hangar) if v is not lost_one]
    begun = [row for row in rows if row["began_s"] is not None]
    late_s = max((row["began_s"] - row["planned_s"] for row in begun), default=0.0)
    return {
        "seed": seed, "mission": name, "lost": f"vehicle {lost}, {kind.value}" if mission.one_is_lost else "",
        "wind_m_s": round(float(wind.speed_m_s), 1), "planned_sorties": len(jobs), "flown_sorties": len(begun),
        "reserve_kept": sum(row["ending"] == "reserve_kept" for row in begun), "left_as_gap": " ".join(left),
        "truly_apart_m": round(truly_apart_m(truth), 1),
        "told_apart_m": round(min((pair["least_m"] for pair in document["separation"]), default=math.inf), 1),
        "coverage": document["coverage_fraction"], "planned_coverage": document["planned_coverage_fraction"],
        "least_battery": min(kept, default=1.0), "late_s": round(late_s, 1),
        "done_s": round(max((row["began_s"] + row.get("duration_s", 0.0) for row in begun), default=0.0)),
        "took_s": round(time.process_time() - started, 1),
    }  # fmt: skip


def flown_ones(hangar: Hangar) -> list[MockVehicle]:
    """The vehicles that took off."""
    return [v for flown in hangar.flown.values() for v in flown if v.took_off_at_s is not None]


def rng_of(seed: int, number: int, sortie: int) -> np.random.Generator:
    """Of one vehicle on one sortie."""
    return np.random.default_rng([seed, number, sortie])


def truly_apart_m(truth: list[tuple[list[float], list[tuple[float, float, float]]]]) -> float:
    """Least true distance of two vehicles that are both more than 2 m above where they stood."""
    best = math.inf
    for one, other in itertools.combinations([(np.array(t), np.array(p)) for t, p in truth if len(t) > 1], 2):
        moments = np.arange(max(one[0][0], other[0][0]), min(one[0][-1], other[0][-1]), _LOOK_S)
        a, b = (
            np.column_stack([np.interp(moments, times, axis) for axis in places.T]) for times, places in (one, other)
        )
        aloft = (a[:, 2] > one[1][0, 2] + 2.0) & (b[:, 2] > other[1][0, 2] + 2.0)
        best = min(best, float(np.linalg.norm(a - b, axis=1)[aloft].min(initial=math.inf)))
    return best


if __name__ == "__main__":
    main()
