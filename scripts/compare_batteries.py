"""What the plan says that each sortie uses of its battery, and what the battery of the simulated vehicle told in flight.

The plan counts seconds of hovering. A battery that tells current and voltage is counted in the same: its energy from arming to
disarming, divided by the power of its kind in hover, which is the median where the vehicles hardly moved. One that tells no
current is given as what it told: its percent, and how long it took to its lowest.

Usage: .venv/bin/python scripts/compare_batteries.py RUN
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink import mavutil

from scripts.options import run_folder
from uavcover.scenario.scenario_file import load_scenario

_SLOW_M_S, _LEVEL_M_S, _ALOFT_M = 1.0, 0.4, 5.0
"""Slower than this over ground and vertically, and higher above home, a vehicle hovers."""
_MAV_TYPE_GCS = 6


@dataclass(frozen=True, slots=True)
class Told:
    """What a vehicle told while armed: (n,) seconds of its own clock, percent, watts, and where it hovered."""

    time_s: np.ndarray
    percent: np.ndarray
    power_w: np.ndarray
    hovers: np.ndarray

    @property
    def energy_j(self) -> float:
        """From arming to disarming."""
        return float(np.trapezoid(self.power_w, self.time_s))


def main() -> None:
    """Print a table in Markdown, a row for each sortie that was flown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=run_folder, help="of a plan with several sorties, flown")
    run = parser.parse_args().run
    sorties = json.loads((run / "plan.json").read_text()).get("sorties")
    if not sorties:
        parser.error(f"{run}: its plan has no sorties; name one with several that were flown")
    rows = [row for row in sorties if row["battery_used"] is not None]
    vehicles = {row["folder"]: load_scenario(run / row["folder"] / "scenario.toml").vehicle for row in rows}
    told = {row["folder"]: read(run / row["folder"] / "flight.tlog") for row in rows}
    kinds = {name: vehicle.autopilot for name, vehicle in vehicles.items()}
    hover_w = {
        kind: hovering_w([told[name] for name, its in kinds.items() if its == kind]) for kind in set(kinds.values())
    }
    print("| vehicle | autopilot | planned flight, s | armed, s ", end="")
    print("| planned, s of hovering | flown, s of hovering | difference | told |")
    print("|---|---|---|---|---|---|---|---|")
    for row in rows:
        name = row["folder"]
        its, power_w = told[name], hover_w[kinds[name]]
        planned_s = row["battery_used"] * (vehicles[name].hover_s or 0.0)
        flown = difference = "-"
        if power_w > 0.0:
            flown_s = its.energy_j / power_w
            flown, difference = f"{flown_s:.1f}", f"{100.0 * (planned_s / flown_s - 1.0):+.1f} %"
        lowest_s = its.time_s[np.argmin(its.percent)] - its.time_s[0]
        print(
            f"| {row['vehicle']} | {kinds[name]} | {row['flight_time_s']:.0f} | {its.time_s[-1] - its.time_s[0]:.0f} "
            f"| {planned_s:.1f} | {flown} | {difference} "
            f"| {its.percent[0]:.0f} % to {its.percent.min():.0f} % in {lowest_s:.0f} s |"
        )
    for kind, power_w in sorted(hover_w.items()):
        count = sum(int(told[name].hovers.sum()) for name, its in kinds.items() if its == kind)
        print(
            f"\n{kind}: {power_w:.0f} W in hover, the median of {count} messages"
            if power_w > 0.0
            else f"\n{kind}: tells no current"
        )


def hovering_w(flights: list[Told]) -> float:
    """Median power where the vehicles of one kind hovered; not above 0 where they tell no current."""
    return float(np.median(np.concatenate([told.power_w[told.hovers] for told in flights])))


def read(path: Path) -> Told:
    """The battery of a telemetry log, on the vehicle's clock."""
    log = mavutil.mavlink_connection(str(path))
    battery: list[tuple[float, ...]] = []
    motion: list[tuple[float, ...]] = []
    armed_s: list[float] = []
    while (message := log.recv_match(type=["SYS_STATUS", "GLOBAL_POSITION_INT", "HEARTBEAT"])) is not None:
        told: Any = message
        arrived_s = float(told._timestamp)
        match told.get_type():
            case "SYS_STATUS":
                watts = 1e-5 * told.current_battery * told.voltage_battery
                battery.append((arrived_s, float(told.battery_remaining), watts))
            case "GLOBAL_POSITION_INT":
                over_m_s, down_m_s = 0.01 * float(np.hypot(told.vx, told.vy)), 0.01 * told.vz
                motion.append((arrived_s, 1e-3 * told.time_boot_ms, over_m_s, down_m_s, 1e-3 * told.relative_alt))
            case _ if told.type != _MAV_TYPE_GCS and told.base_mode & 128:
                armed_s.append(arrived_s)
    states, moves = np.array(battery), np.array(motion)
    states = states[(states[:, 0] >= armed_s[0] - 1.0) & (states[:, 0] <= armed_s[-1] + 1.0)]
    time_s, over, down, high = (np.interp(states[:, 0], moves[:, 0], column) for column in moves[:, 1:].T)
    hovers = (over < _SLOW_M_S) & (np.abs(down) < _LEVEL_M_S) & (high > _ALOFT_M)
    return Told(time_s, states[:, 1], states[:, 2], hovers)


if __name__ == "__main__":
    main()
