"""Fly with random faults, a hundred times by seed, and look at how each flight ends and what is recorded of it.

Usage: .venv/bin/python scripts/fly_faults.py [-o docs/results/faulty_flights.md] [--flights 100] [--seed 0]

Everything happens in this process on simulated clocks: a mock vehicle (ArduPilot or PX4), a link that loses nothing or 5 % each
way, and ``uavcover.run.session.fly``, on two lines over the bundled scenario. Which faults come when, and whether the user stops
or pauses, is drawn from the flight's number and the seed. What is asked of each flight:

- it ends in an ending by name, good or bad, never in another error;
- every position that reached this side is in the track: pymavlink reads the same datagrams beside us and counts;
- the flight that goes on with it (``fly --resume``) ends in a named ending too: first as the vehicle is left; then, if that is
  not enough, with a sound vehicle at home, and that one lands;
- no thread, process, socket or file is open at the end that was not at the beginning.

Flights whose row is in the .csv beside the page already are not flown again. Exit 1 when something of this is not so.
"""

import argparse
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from mission_io.clock import Clock
from mission_io.links.simulated import Conditions, SimulatedLink
from scripts.faulty_flights import Row, kept_rows, summary, write_csv, write_page
from scripts.options import file_to_write
from uavcover.mock.behaviour import Settings
from uavcover.mock.dynamics import BatteryData
from uavcover.mock.faults import ARGUMENTS, FaultKind, parse_fault
from uavcover.mock.peer import InMemoryPeer
from uavcover.mock.vehicle import MockConfig, MockVehicle
from uavcover.model.route import Plan
from uavcover.model.vehicle import AutopilotName
from uavcover.planning.baselines.boustrophedon import fly_layout, regular_layout
from uavcover.routes.mission_compiler import AUTOPILOTS
from uavcover.routes.objectives import judge_member
from uavcover.run.folder import RunFolder
from uavcover.run.mission import compile_plan
from uavcover.run.plan_files import save_plan
from uavcover.run.planned import read_planned
from uavcover.run.resume import find_unfinished, save_rest
from uavcover.run.session import Connected, fly, fly_on, is_in_the_air, require_home
from uavcover.run.upload import upload
from uavcover.scenario.site import Site, load_site
from uavcover.sensing.coverage_map import judging_map
from uavcover.vehicle.flight_plan import FlightTimeouts
from uavcover.vehicle.fly import FlightOutcome, Orders
from uavcover.vehicle.monitor import open_vehicle
from uavcover.vehicle.outcome import FlightFailedError
from uavcover.vehicle.track_file import TrackWriter

SCENARIO, LINES, HEIGHT_AGL_M = "jacksboro", 2, 100.0
LONGEST_S = 300.0
TIMEOUTS = FlightTimeouts(override_s=60.0)
BATTERY = BatteryData(endurance_s=1500.0)
LOSS = 0.05


@dataclass(frozen=True, slots=True)
class Drawn:
    """What happens to a flight.

    Attributes:
        autopilot: whose behaviour the mock vehicle shows.
        faults: as ``parse_fault`` reads them.
        stops_s: vehicle times at which the user stops.
        pause_s: vehicle time at which the user pauses, and for how long; None for no pause.
        loss: share of the datagrams that the link loses, each way.
    """

    autopilot: AutopilotName
    faults: tuple[str, ...]
    stops_s: tuple[float, ...]
    pause_s: tuple[float, float] | None
    loss: float


class CountedLink:
    """A link that has pymavlink read what arrives, and keeps the times of the vehicle's positions."""

    def __init__(self, link: SimulatedLink) -> None:
        self._link = link
        self._parser = ardupilotmega.MAVLink(None)
        self._parser.robust_parsing = True
        self.position_times_ms: list[int] = []

    @property
    def clock(self) -> Clock:
        """Of the link inside."""
        return self._link.clock

    def send(self, data: bytes) -> None:
        """Send a datagram."""
        self._link.send(data)

    def receive(self, timeout_s: float) -> bytes | None:
        """The next datagram."""
        data = self._link.receive(timeout_s)
        for message in self._parser.parse_buffer(data) or () if data else ():
            if message.get_type() == "GLOBAL_POSITION_INT":
                self.position_times_ms.append(message.time_boot_ms)
        return data

    def close(self) -> None:
        """Close the link inside."""
        self._link.close()


def draw(flight: int, seed: int) -> Drawn:
    """What happens to a flight, by its number and the seed."""
    rng = np.random.default_rng([seed, flight])
    count = int(rng.choice([0, 1, 2], p=[0.08, 0.72, 0.2]))
    stopped, paused = rng.random() < 0.12, rng.random() < 0.12
    first_s = float(rng.uniform(10.0, LONGEST_S))
    stops = (first_s, first_s + float(rng.uniform(1.0, 20.0)))[: int(rng.integers(1, 3))] if stopped else ()
    return Drawn(
        autopilot="ardupilot" if rng.random() < 0.5 else "px4",
        faults=tuple(_draw_fault(rng) for _ in range(count)),
        stops_s=tuple(round(s, 1) for s in stops),
        pause_s=(round(float(rng.uniform(20.0, 200.0)), 1), round(float(rng.uniform(5.0, 60.0)), 1))
        if paused
        else None,
        loss=LOSS if rng.random() < 0.5 else 0.0,
    )


def _draw_fault(rng: np.random.Generator) -> str:
    kind = list(FaultKind)[int(rng.integers(len(FaultKind)))]
    moment = "" if kind is FaultKind.ARMING_REFUSED else f"@{rng.uniform(0.0, LONGEST_S):.1f}s"
    argument = ARGUMENTS.get(kind)
    if argument is None:
        return f"{kind.value}{moment}"
    if argument.modes:
        return f"{kind.value}:{argument.modes[int(rng.integers(len(argument.modes)))].value}{moment}"
    low, high = (
        (8.0, 30.0) if kind is FaultKind.STRONG_WIND else (1.0, 8.0) if kind is FaultKind.REBOOT else (1.0, 60.0)
    )
    lasts = rng.random() < 0.3 and argument.default == float("inf")
    return f"{kind.value}{'' if lasts else f':{rng.uniform(low, high):.1f}'}{moment}"


class Field:
    """A vehicle at home, and the ground stations that come and go, one after the other."""

    def __init__(self, site: Site, run: RunFolder, drawn: Drawn, flight: int) -> None:
        self._site, self._run, self._drawn, self._flight = site, run, drawn, flight
        self._switch_on(drawn.faults)

    def _switch_on(self, faults: Sequence[str]) -> None:
        """A vehicle at home, with a fresh battery."""
        self.vehicle = MockVehicle(
            AUTOPILOTS[self._drawn.autopilot],
            require_home(self._site),
            MockConfig(
                battery=BATTERY,
                settings=Settings.for_vehicle(self._site.scenario.vehicle),
                faults=[parse_fault(fault) for fault in faults],
            ),
            rng=np.random.default_rng(self._flight),
        )
        self._link = SimulatedLink(
            InMemoryPeer(self.vehicle), rng=Random(self._flight), conditions=Conditions(loss=self._drawn.loss)
        )

    def first_flight(self) -> tuple[str, FlightOutcome | None, int, int]:
        """The flight with everything that happens to it; see ``_recorded``."""
        drawn, vehicle = self._drawn, self.vehicle

        def paused() -> bool:
            begin_s, lasts_s = drawn.pause_s or (0.0, 0.0)
            return begin_s <= vehicle.powered_s < begin_s + lasts_s

        route = read_planned(self._run)[1].route
        compiled = compile_plan(self._site, route, autopilot=drawn.autopilot)

        def begin(station: Connected, orders: Orders) -> FlightOutcome:
            upload(station.client, compiled)
            return fly(station, self._site, compiled, orders)

        return self._recorded(
            self._run, begin, stop=lambda: sum(vehicle.powered_s >= s for s in drawn.stops_s), pause=paused
        )

    def go_on(self) -> list[str]:
        """The flights that go on with it, until nothing is left or a sound vehicle has flown: their endings."""
        endings: list[str] = []
        if not self._run.file("track.csv").is_file():
            return endings
        for attempt in range(2):
            if find_unfinished(self._run, self._site).complete:
                break
            in_the_air = self.vehicle.armed and not self.vehicle.body.on_ground
            if attempt == 1 or not in_the_air:
                self._switch_on(())
            else:
                self._wait(30.0)
            endings.append(self._resume())
            if endings[-1] == "landed" or not in_the_air:
                break
        return endings

    def _wait(self, seconds: float) -> None:
        until_s = self._link.clock.now() + seconds
        while self._link.clock.now() < until_s:
            self._link.receive(0.5)

    def _resume(self) -> str:
        unfinished = find_unfinished(self._run, self._site)
        unfinished.folder.path.mkdir(exist_ok=True)
        save_rest(unfinished, self._site, command=["fly_faults"])
        compiled = compile_plan(self._site, unfinished.route, autopilot=self._drawn.autopilot)

        def begin(station: Connected, orders: Orders) -> FlightOutcome:
            if is_in_the_air(station):
                return fly_on(station, self._site, unfinished, orders)
            upload(station.client, compiled)
            return fly(station, self._site, compiled, orders)

        return self._recorded(unfinished.folder, begin)[0]

    def _recorded(
        self, folder: RunFolder, begin: Callable[[Connected, Orders], FlightOutcome],
        *, stop: Callable[[], int] = lambda: 0, pause: Callable[[], bool] = lambda: False,
    ) -> tuple[str, FlightOutcome | None, int, int]:  # fmt: skip
        """The ending's name, the outcome, how many positions arrived while it was recorded, and how many were recorded."""
        link = CountedLink(self._link)
        client, monitor = open_vehicle(link)
        path = folder.file("track.csv")
        outcome: FlightOutcome | None = None
        first_ms: list[int] = []
        with TrackWriter(path, overwrite=True) as track:

            def take(sample: object) -> None:
                if not first_ms:
                    first_ms.append(len(link.position_times_ms))
                track.write(sample)  # type: ignore[arg-type]

            try:
                monitor.listen_to(client.wait_for_vehicle().address)
                station = Connected(client, monitor, self._drawn.autopilot)
                orders = Orders(on_sample=take, stop=stop, pause=pause, confirmed=True, timeouts=TIMEOUTS)
                outcome = begin(station, orders)
                ending = outcome.ending.key
            except FlightFailedError as error:
                outcome, ending = error.outcome, error.outcome.ending.key
            except Exception as error:
                ending = f"unnamed ({type(error).__name__}: {error})"
            count = track.count
        arrived = in_order(link.position_times_ms[first_ms[0] - 1 :]) if first_ms else 0
        if not count:
            path.unlink()
        return ending, outcome, arrived, count


def in_order(times_ms: Sequence[int]) -> int:
    """How many times are later than all before them: the vehicle's time goes on, until it is switched off and on."""
    latest, count = -1, 0
    for time_ms in times_ms:
        if time_ms > latest:
            latest, count = time_ms, count + 1
    return count


def save_lines(site: Site, run: RunFolder) -> None:
    """The plan that is flown: parallel lines over the area."""
    layout = regular_layout(angle_rad=0.0, lines=LINES, height_agl_m=HEIGHT_AGL_M, inset=0.1, tolerance_m=10.0)
    route = fly_layout(site, layout)
    member = judge_member(judging_map(site), route, "lines", margin_m=0.0)
    plan = Plan(
        chosen=member, members=(member,), baselines=(), rule="none", rule_met=True, algorithm="lines", evaluations=0,
        wall_s=0.0,
    )  # fmt: skip
    run.path.mkdir(parents=True)
    compiled = compile_plan(site, route)
    save_plan(run, site, plan, compiled=compiled, autopilot="ardupilot", seed=0, command=["fly_faults"])


def measure(site: Site, run: RunFolder, flight: int, seed: int) -> Row:
    """Fly once, and go on with it."""
    drawn = draw(flight, seed)
    field = Field(site, run, drawn, flight)
    ending, outcome, arrived, recorded = field.first_flight()
    total = len(read_planned(run)[1].route)
    user = [f"stop@{s:g}s" for s in drawn.stops_s]
    user += [] if drawn.pause_s is None else [f"pause:{drawn.pause_s[1]:g}@{drawn.pause_s[0]:g}s"]
    return Row(
        flight=flight,
        autopilot=drawn.autopilot,
        happens=" ".join([*drawn.faults, *user]) or "nothing",
        loss=drawn.loss,
        ending=ending,
        waypoints=f"{0 if outcome is None else outcome.waypoints_reached} of {total}",
        incidents=" ".join(i.kind.key for i in outcome.incidents) if outcome is not None else "",
        arrived=arrived,
        recorded=recorded,
        resumed=" ".join(field.go_on()),
    )


@dataclass(frozen=True, slots=True)
class Open:
    """What this process holds open."""

    threads: int
    children: int
    files: int

    @classmethod
    def now(cls) -> "Open":
        """At this moment; children and files where /proc tells."""
        children = [p.read_text().split() for p in Path("/proc/self/task").glob("*/children")]
        files = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").is_dir() else 0
        return cls(threading.active_count(), sum(map(len, children)), files)


def main() -> int:
    """Fly, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "-o", "--out", type=file_to_write, help="Markdown file to write; a .csv goes beside it, and is gone on with"
    )
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    site = load_site(SCENARIO)
    rows = [row for row in kept_rows(arguments.out) if row.flight < arguments.flights]
    there = {row.flight for row in rows}
    before = Open.now()
    with tempfile.TemporaryDirectory() as folder:
        planned = RunFolder(Path(folder) / "planned")
        save_lines(site, planned)
        for flight in sorted(set(range(arguments.flights)) - there):
            run = RunFolder(shutil.copytree(planned.path, Path(folder) / f"run_{flight}"))
            rows.append(measure(site, run, flight, arguments.seed))
            print(rows[-1], flush=True)
            if arguments.out is not None:
                write_csv(arguments.out, sorted(rows, key=lambda row: row.flight))
    after = Open.now()
    rows.sort(key=lambda row: row.flight)
    flown = len(rows) - len(there)
    left = f"After {flown} flights of one process nothing was left open." if flown else "None was flown just now."
    if after != before:
        left = f"LEFT OPEN by {flown} flights: {before} before, {after} after."
    words = summary(rows, left)
    print(words)
    if arguments.out is not None:
        write_page(arguments.out, rows, words, flights=arguments.flights, seed=arguments.seed)
    return 0 if all(row.good for row in rows) and after == before else 1


if __name__ == "__main__":
    sys.exit(main())
