"""Fly with two disturbances each, by seed, and prove from the .tlog that nothing was commanded against a failsafe or a pilot.

Usage: .venv/bin/python scripts/attack/disturbed_flights.py [-o PAGE.md] [--flights 300] [--seed 0] [--tlogs FOLDER]

Everything happens in this process on simulated clocks: a mock vehicle (ArduPilot or PX4), a link, and
``uavcover.flight.connect`` over the bundled scenario. Two disturbances of different kinds are drawn for each flight, each with
its moment, the failsafes that are enabled, and ``--on-breach``. What is required of each flight:

- it ends in a name that one of its disturbances, or a good flight, may have; never in another error;
- pymavlink alone reads the .tlog of the flight: every command of ours that steers the vehicle follows heartbeats that show it in
  a mode that we commanded, with no gap of 2 s between them and the command;
- the true mode of the vehicle, noted beside, is never a failsafe's or a pilot's when such a command is sent, but for the second
  and a half that a heartbeat and its way may take (and two more where the link falls behind without a gap).

Flights whose row is in the .csv already are not flown again. Exit 1 when something of this is not so.
"""

import argparse
import csv
import datetime
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from random import Random

import numpy as np
from pymavlink import mavutil

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from mission_io.autopilots.autopilot import Mode
from mission_io.links.datagrams import Clock
from mission_io.links.opening import TelemetryLogWriter
from mission_io.links.simulated import Conditions
from scripts.options import file_to_write
from tests.disturbances import ALWAYS, GOOD, KINDS, Act, DisturbedLink
from uavcover.flight.compiled_flight import fly, upload
from uavcover.flight.connect import Connected, require_home
from uavcover.flight.monitor import open_vehicle
from uavcover.flight.orders import FlightTimeouts, OnBreach, Orders, Precautions, custom_mode
from uavcover.missions.mission_compiler import AUTOPILOTS, compile_mission
from uavcover.missions.objectives import judge_member
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.server import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Plan
from uavcover.model.track import Ending, FlightFailedError
from uavcover.model.vehicle import AutopilotName
from uavcover.planner.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.planner.plan_files import save_plan
from uavcover.run.documents import read_planned
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.site_maps import judging_map

SCENARIO = "jacksboro"
FIRST_S, LAST_S = 30.0, 260.0
TIMEOUTS = FlightTimeouts(override_s=60.0, held_s=60.0, link_lost_s=90.0)
STEERING_IDS = frozenset({176, 300, 224, 400})
"""DO_SET_MODE, MISSION_START, DO_SET_MISSION_CURRENT, COMPONENT_ARM_DISARM."""
GAP_S, BEAT_OLD_S, RACE_S, BEHIND_S = 2.0, 3.5, 1.5, 2.0


@dataclass(frozen=True, slots=True)
class Row:
    """One flight of the table.

    Attributes:
        flight: its number.
        autopilot: whose behaviour.
        happens: the disturbances, each with its vehicle time, and the policy.
        failsafe: what the vehicle does when it hears no ground station.
        ending: its name.
        named: whether one of its disturbances may have that name.
        incidents: what was reported, in order.
        commands: the steering commands in its .tlog.
        unproved: those that followed no current heartbeat in a mode of ours, by pymavlink's reading of the .tlog.
        against: those that were sent while a failsafe or a pilot had the vehicle, by its true mode.
    """

    flight: int
    autopilot: str
    happens: str
    failsafe: str
    ending: str
    named: bool
    incidents: str
    commands: int
    unproved: int
    against: int

    @property
    def good(self) -> bool:
        """Whether it is as required."""
        return str(self.named) == "True" and int(self.unproved) == 0 and int(self.against) == 0


class _LinkTime:
    """The simulated clock as a time of day."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def unix_s(self) -> float:
        """Seconds since 1970."""
        return 1.7e9 + self._clock.now()


class WitnessedLink:
    """A link that keeps a .tlog, acts on the vehicle when it is time, and notes the vehicle's true mode.

    Args:
        link: carries the datagrams.
        vehicle: at its other end.
        log: takes what goes through.
        due: vehicle times after take-off, each with what happens then.
    """

    def __init__(
        self, link: DisturbedLink, vehicle: MockVehicle, log: TelemetryLogWriter, due: Sequence[tuple[float, Act]]
    ) -> None:
        self._link, self._vehicle, self._log = link, vehicle, log
        self._due = sorted(due, key=lambda one: one[0])
        self.modes: list[tuple[float, Mode, bool]] = []

    @property
    def clock(self) -> Clock:
        """Of the link inside."""
        return self._link.clock

    def send(self, data: bytes) -> None:
        """Send a datagram."""
        self._note()
        self._log.write(data)
        self._link.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram."""
        took_off_s = self._vehicle.took_off_at_s
        while self._due and took_off_s is not None and self._vehicle.powered_s >= took_off_s + self._due[0][0]:
            self._due.pop(0)[1](self._vehicle, self._link)
        data = self._link.receive(timeout_s)
        self._note()
        if data is not None:
            self._log.write(data)
        return data

    def close(self) -> None:
        """Close the link inside."""
        self._link.close()

    def _note(self) -> None:
        now = self._link.clock.now(), self._vehicle.mode, self._vehicle.flying
        if not self.modes or self.modes[-1][1:] != now[1:]:
            self.modes.append(now)


@dataclass(frozen=True, slots=True)
class Steered:
    """A steering command in a .tlog, as pymavlink reads it.

    Attributes:
        at_s: when, on the link's clock.
        proved: whether heartbeats that were current then show the vehicle in a mode of ours.
    """

    at_s: float
    proved: bool


def steering_commands(tlog: Path, ours: frozenset[int]) -> list[Steered]:
    """Read a .tlog by pymavlink alone; ``ours`` are the ``custom_mode`` of the modes that we command."""
    reader = mavutil.mavlink_connection(str(tlog), dialect="ardupilotmega")
    beat: tuple[float, int, bool] | None = None
    heard_s = gap_ended_s = -1e9
    found: list[Steered] = []
    while (message := reader.recv_match()) is not None:
        now = float(message._timestamp) - 1.7e9
        if message.get_srcSystem() == 1:
            if now - heard_s > GAP_S:
                gap_ended_s = now
            heard_s = now
            if message.get_type() == "HEARTBEAT":
                beat = now, message.custom_mode, bool(message.base_mode & 128)
            continue
        steers = message.get_type() == "COMMAND_LONG" and message.command in STEERING_IDS
        if not steers or beat is None or not beat[2]:  # on the ground, disarmed, everything is ours to command
            continue
        at_s, mode, _ = beat
        current = now - at_s <= BEAT_OLD_S and now - heard_s <= GAP_S and at_s >= gap_ended_s
        found.append(Steered(now, current and mode in ours))
    reader.close()
    return found


def against(
    commands: Sequence[Steered], modes: Sequence[tuple[float, Mode, bool]], ours: frozenset[Mode], race_s: float
) -> int:
    """How many commands were sent while the vehicle was, for longer than the race lasts, in the air in another mode."""
    count = 0
    for command in commands:
        before = [row for row in modes if row[0] <= command.at_s]
        if before:
            since_s, mode, flying = before[-1]
            count += flying and mode not in ours and command.at_s - since_s > race_s
    return count


def measure(site: Site, run: RunFolder, flight: int, seed: int, tlogs: Path) -> Row:
    """Fly once."""
    rng = np.random.default_rng([seed, flight])
    autopilot: AutopilotName = "ardupilot" if flight % 2 == 0 else "px4"
    names = [list(KINDS)[k] for k in rng.choice(len(KINDS), size=2, replace=False)]
    drawn = [(round(float(rng.uniform(FIRST_S, LAST_S)), 1), name, KINDS[name].draw(rng)) for name in names]
    on_breach = [None, *OnBreach][int(rng.integers(5))]
    failsafe = bool(rng.random() < 0.7)
    vehicle = MockVehicle(
        AUTOPILOTS[autopilot], require_home(site),
        MockConfig(
            battery=BatteryData(endurance_s=1500.0), settings=Settings.for_vehicle(site.scenario.vehicle),
        ),
        rng=np.random.default_rng(flight),
    )  # fmt: skip
    vehicle.parameters.put(
        "FS_GCS_ENABLE" if autopilot == "ardupilot" else "NAV_DLL_ACT", (1.0, 2.0)[autopilot == "px4"] * failsafe
    )
    loss = float(rng.choice([0.0, 0.05]))
    link = DisturbedLink(InMemoryPeer(vehicle), rng=Random(flight), conditions=Conditions(loss=loss))
    tlog = tlogs / f"flight-{flight:03d}.tlog"
    compiled = compile_mission(site, read_planned(run)[1].route, autopilot=autopilot)
    with TelemetryLogWriter(tlog, clock=_LinkTime(link.clock), flush_clock=link.clock) as log:
        witness = WitnessedLink(link, vehicle, log, [(at_s, act) for at_s, _, (_, act) in drawn])
        client, monitor = open_vehicle(witness)
        monitor.listen_to(client.wait_for_vehicle().address)
        upload(client, compiled)
        orders = Orders(
            on_sample=lambda _: None, confirmed=True, timeouts=TIMEOUTS, precautions=Precautions(on_breach=on_breach)
        )
        try:
            outcome = fly(Connected(client, monitor, autopilot), site, compiled, orders)
            ending = outcome.ending
        except FlightFailedError as error:
            outcome, ending = error.outcome, error.outcome.ending
    ours = [Mode.MISSION, Mode.GUIDED if autopilot == "ardupilot" else Mode.HOLD]
    if on_breach is OnBreach.LAND:
        ours.append(Mode.LAND)
    commands = steering_commands(tlog, frozenset(custom_mode(AUTOPILOTS[autopilot], mode) for mode in ours))
    allowed = GOOD | ALWAYS | frozenset().union(*(KINDS[name].endings for name in names))
    if loss and failsafe:  # four heartbeats in a row are lost once in some hundred flights, and ArduCopter waits 5 s
        allowed |= {Ending.LINK_LOST}
    return Row(
        flight=flight,
        autopilot=autopilot,
        happens=" ".join(f"{words}@{at_s:g}s" for at_s, _, (words, _) in sorted(drawn, key=lambda one: one[0]))
        + f" on-breach={'default' if on_breach is None else on_breach.value}",
        failsafe="return" if failsafe else "none",
        ending=ending.key,
        named=ending in allowed,
        incidents=" ".join(incident.kind.key for incident in outcome.incidents),
        commands=len(commands),
        unproved=sum(not command.proved for command in commands),
        against=against(commands, witness.modes, frozenset(ours), RACE_S + BEHIND_S * ("behind" in names)),
    )


def save_lines(site: Site, run: RunFolder) -> None:
    """The plan that is flown: parallel lines over the area."""
    layout = regular_layout(angle_rad=0.0, lines=2, height_agl_m=100.0, inset=0.1, tolerance_m=10.0)
    route = fly_layout(site, layout)
    member = judge_member(judging_map(site), route, "lines", margin_m=0.0)
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="none", rule_met=True, algorithm="lines", evaluations=0,
        wall_s=0.0,
    )  # fmt: skip
    run.path.mkdir(parents=True)
    compiled = compile_mission(site, route)
    save_plan(run, site, plan, compiled=compiled, autopilot="ardupilot", seed=0, command=["disturbed_flights"])


def kept_rows(path: Path) -> list[Row]:
    """The rows that are there already."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [
            Row(**{**row, "flight": int(row["flight"]), "named": row["named"] == "True",
                   **{name: int(row[name]) for name in ("commands", "unproved", "against")}})
            for row in csv.DictReader(file)
        ]  # fmt: skip


def main() -> int:
    """Fly, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=file_to_write, default=None, help="the page; the CSV lands beside it")
    parser.add_argument("--flights", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tlogs", type=Path, default=None, help="folder that keeps the telemetry logs")
    options = parser.parse_args()
    rows = [] if options.output is None else kept_rows(options.output.with_suffix(".csv"))
    site = load_site(SCENARIO)
    with tempfile.TemporaryDirectory() as scratch:
        run, tlogs = RunFolder(Path(scratch) / "run"), options.tlogs or Path(scratch)
        tlogs.mkdir(parents=True, exist_ok=True)
        save_lines(site, run)
        for flight in range(options.flights):
            if any(row.flight == flight for row in rows):
                continue
            row = measure(site, run, flight, options.seed, tlogs)
            rows = sorted([*rows, row], key=lambda one: one.flight)
            print(f"{'  ' if row.good else '! '}{row}", flush=True)
            if options.output is not None:
                write(options.output, rows, options)
    bad = [row for row in rows if not row.good]
    print(summary(rows))
    return 1 if bad else 0


def summary(rows: Sequence[Row]) -> str:
    """The result in words."""
    endings = Counter(row.ending for row in rows)
    return (
        f"{len(rows)} flights with two disturbances each: {sum(not row.named for row in rows)} ended in a name that none of "
        f"their disturbances may have; {sum(row.commands for row in rows)} steering commands in the air, "
        f"{sum(row.unproved for row in rows)} without current evidence in the .tlog, {sum(row.against for row in rows)} "
        f"against a failsafe or a pilot. Endings: {', '.join(f'{name} {count}' for name, count in endings.most_common())}."
    )


def write(output: Path, rows: Sequence[Row], options: argparse.Namespace) -> None:
    """The table, as CSV and as a page."""
    with output.with_suffix(".csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerows([[field.name for field in fields(Row)], *(astuple(row) for row in rows)])
    commit = subprocess.run(
        ["git", "rev-parse", "--short=9", "HEAD"], capture_output=True, text=True, check=True
    ).stdout.strip()
    command = f"scripts/attack/disturbed_flights.py --flights {options.flights} --seed {options.seed}"
    lines = [
        "# Disturbed flights, measured",
        "",
        f"Command: `.venv/bin/python {command}`, commit {commit}, {datetime.date.today().isoformat()}.",
        "",
        f"What is required of each flight stands at the top of the script. Every flight: {output.with_suffix('.csv').name}.",
        "",
        summary(rows),
    ]
    output.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    sys.exit(main())
