"""Time to the end with several vehicles, of the plain boustrophedon over a bundled scenario: no search, so equal every time.

Usage: .venv/bin/python scripts/bench/fleet.py [SCENARIO] [--vehicles 1,2,4,8] [--pads]
"""

import argparse
import math
import time

from scripts.options import scenario_name, whole_numbers
from uavcover.missions.flights import compile_flights
from uavcover.planner.baselines.boustrophedon import fly_layout, plain_boustrophedon
from uavcover.planner.plan_files import fleet_document
from uavcover.scenario.site import load_site
from uavcover.scenario.vehicles import on_pads


def main() -> None:
    """Print a table in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", type=scenario_name, default="ridge-25km2")
    parser.add_argument("--vehicles", type=whole_numbers, default="1,2,4,8")
    parser.add_argument("--pads", action="store_true", help="from pads, as plan places them, and not from one home")
    arguments = parser.parse_args()
    alone = load_site(arguments.scenario)
    route = fly_layout(alone, plain_boustrophedon(alone))
    print(f"{arguments.scenario}: {len(route)} waypoints, {route.length_m / 1000.0:.1f} km\n")
    print(
        "| vehicles | sorties | in the air, s | done after, s | one vehicle, s | share of it | keeping apart, s | took, s |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for vehicles in arguments.vehicles:
        site = on_pads(alone.flown_by(vehicles)) if arguments.pads else alone.flown_by(vehicles)
        started = time.perf_counter()
        flights = compile_flights(site, route)
        took_s = time.perf_counter() - started
        air_s = math.fsum(flight.compiled.flight_time_s for flight in flights)
        done = fleet_document(site, flights)
        one_s = air_s + site.scenario.fleet.turnaround_s * (len(flights) - 1)
        makespan_s, one_s, fraction, apart_s = (
            (one_s, one_s, 1.0, 0.0)
            if done is None
            else (done["makespan_s"], done["one_vehicle_s"], done["of_one_vehicle"], done["kept_apart_s"])
        )
        print(
            f"| {vehicles} | {len(flights)} | {air_s:.0f} | {makespan_s:.0f} | {one_s:.0f} | {fraction:.3f} | {apart_s:.0f} "
            f"| {took_s:.1f} |"
        )


if __name__ == "__main__":
    main()
