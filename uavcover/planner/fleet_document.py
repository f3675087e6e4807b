"""A fleet's plan: its flights with their vehicles and take-off times, and what it says of them."""

import math
from collections.abc import Sequence
from typing import Any

from uavcover.missions.fleet_cuts import share_out
from uavcover.missions.flights import makespan_s
from uavcover.missions.sorties import Sortie
from uavcover.run.user import User
from uavcover.scenario.site import Site
from uavcover.scenario.vehicles import groups_of, vehicle_sites


def fleet_document(site: Site, flights: Sequence[Sortie]) -> dict[str, Any] | None:
    """``fleet`` of ``plan.json``; none for one vehicle.

    Args:
        site: the scenario on its ground.
        flights: as :func:`uavcover.missions.flights.compile_flights`; none when there is no mission.
    """
    fleet = site.scenario.fleet
    if fleet.vehicles == 1:
        return None
    alike = not site.scenario.vehicles
    document: dict[str, Any] = {"vehicles": fleet.vehicles, "alike": alike, "separation_m": fleet.separation_m}
    document |= {"one_at_a_time": fleet.one_at_a_time, "launch_points": site.scenario.has_launch_points}
    if not flights:
        return document
    times_s = [flight.compiled.flight_time_s for flight in flights]
    done_s = makespan_s(site, flights)
    one_s = math.fsum(times_s) + fleet.turnaround_s * _landings_of_one(site, flights)
    if fleet.one_at_a_time:
        together_s = done_s
    elif alike:
        together_s = share_out(times_s, fleet.vehicles, fleet.turnaround_s).makespan_s
    else:
        together_s = _at_once_s(site, flights)
    return document | {
        "makespan_s": done_s,
        "one_vehicle_s": one_s,
        "of_one_vehicle": done_s / one_s,
        "kept_apart_s": max(0.0, done_s - together_s),
        "by_vehicle": [_row(number, flights) for number in sorted({flight.vehicle for flight in flights})],
        "homes": _homes(site),
        **_parts(site, flights),
    }


def _landings_of_one(site: Site, flights: Sequence[Sortie]) -> int:
    """Number of landings of one vehicle between these sorties.

    It lands after each; where they are parts of the area, only for a new battery.
    """
    longest_s = site.scenario.vehicle.longest_flight_s
    if not groups_of(site.scenario):
        return len(flights) - 1
    if longest_s is None:
        return 0
    return math.ceil(math.fsum(flight.compiled.flight_time_s for flight in flights) / longest_s) - 1


def _parts(site: Site, flights: Sequence[Sortie]) -> dict[str, Any]:
    """Waypoints of each part of the area, and its vehicles; nothing where all cover the whole area together."""
    rows = []
    for group in groups_of(site.scenario):
        own = [flight for flight in flights if flight.vehicle in group]
        first, last = min(flight.first for flight in own), max(flight.last for flight in own)
        rows.append({"vehicles": list(group), "first_waypoint": first, "last_waypoint": last})
    return {"parts": rows} if rows else {}


def _at_once_s(site: Site, flights: Sequence[Sortie]) -> float:
    """Time at which vehicles that differ would be done if they need not keep apart."""
    each_s = {
        number: [f.compiled.flight_time_s for f in flights if f.vehicle == number]
        for number in {flight.vehicle for flight in flights}
    }
    pause_s = site.scenario.fleet.turnaround_s
    return max(math.fsum(times_s) + pause_s * (len(times_s) - 1) for times_s in each_s.values())


def _homes(site: Site) -> list[dict[str, float]] | None:
    """Home of each vehicle, vehicle 1 first; none where all start at [home]."""
    homes = []
    for own in vehicle_sites(site):
        if own.frame is not None and own.home_m is not None:
            lat, lon, alt = own.frame.geodetic_from_enu(own.home_m)
            homes.append({"lat_deg": float(lat[0]), "lon_deg": float(lon[0]), "alt_amsl_m": float(alt[0])})
    return homes or None


def _row(vehicle: int, flights: Sequence[Sortie]) -> dict[str, Any]:
    own = sorted((k for k, f in enumerate(flights) if f.vehicle == vehicle), key=lambda k: _start_s(flights[k]))
    times_s = [flights[k].compiled.flight_time_s for k in own]
    used = [share for k in own if (share := flights[k].compiled.battery_used) is not None]
    return {
        "vehicle": vehicle,
        "sorties": [k + 1 for k in own],
        "takeoffs_s": [_start_s(flights[k]) for k in own],
        "landed_s": max(_start_s(flights[k]) + time_s for k, time_s in zip(own, times_s, strict=True)),
        "flight_time_s": math.fsum(times_s),
        "least_battery_left": 1.0 - max(used) if used else None,
    }


def _start_s(flight: Sortie) -> float:
    return 0.0 if flight.start_s is None else flight.start_s


def say_fleet(user: User, document: dict[str, Any] | None) -> None:
    """The table of the vehicles, and what they gain."""
    if document is None or "by_vehicle" not in document:
        return
    for number, pad in enumerate([] if document["launch_points"] else document["homes"] or [], start=1):
        user.say(
            f"vehicle {number:<2} take-off and landing at latitude {pad['lat_deg']:.7f}, longitude {pad['lon_deg']:.7f}"
        )
    for row in document["by_vehicle"]:
        each = ", ".join(
            f"{number} at {start_s:.0f} s" for number, start_s in zip(row["sorties"], row["takeoffs_s"], strict=True)
        )
        left = row["least_battery_left"]
        battery = "" if left is None else f", battery left at least {100.0 * left:.0f} %"
        user.say(
            f"{_whose(document, row['vehicle'])} sorties {each}; flight time {row['flight_time_s']:.0f} s, last "
            f"landing at {row['landed_s']:.0f} s{battery}"
        )
    flying = {row["vehicle"] for row in document["by_vehicle"]}
    idle = [] if document["alike"] else [k for k in range(1, document["vehicles"] + 1) if k not in flying]
    for number in idle:
        if document["launch_points"]:
            user.say(f"{_whose(document, number)} no sorties, because no flight from there is possible or shorter")
            continue
        user.say(f"vehicle {number:<2} stays on the ground, because it would not shorten the mission")
    if document["one_at_a_time"]:
        user.say(f"one sortie at a time: mission completed after {document['makespan_s']:.0f} s")
        return
    waits = document["kept_apart_s"]
    apart = (
        f" (including {waits:.0f} s of waiting to keep {document['separation_m']:g} m of separation)"
        if waits >= 1.0
        else ""
    )
    used = len(document["by_vehicle"])
    what = f"{used} vehicles" if used == document["vehicles"] else f"{used} of {document['vehicles']} vehicles"
    user.say(
        f"{what}: mission completed after {document['makespan_s']:.0f} s{apart}; with one vehicle and the same "
        f"sorties: {document['one_vehicle_s']:.0f} s (x {document['of_one_vehicle']:.2f})"
    )
    if used < document["vehicles"] and document["alike"]:
        user.warn("more vehicles would not shorten the mission, because transits and separation take too long")


def _whose(document: dict[str, Any], vehicle: int) -> str:
    """Vehicle or home of a document's entry."""
    if not document["launch_points"]:
        return f"vehicle {vehicle:<2}"
    return "from home          " if vehicle == 1 else f"from launch point {vehicle - 1:<2}"
