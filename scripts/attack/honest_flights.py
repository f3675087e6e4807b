"""Fly 200 honest flights, each drawn by its number and the seed, and see that `uavcover verify` passes every one.

Usage: .venv/bin/python scripts/attack/honest_flights.py [-o docs/results/evidence.md] [--flights 200] [--seed 0] [--runs DIR]
       [--workers 2]

Everything happens in this process on simulated clocks: a mock vehicle (ArduPilot or PX4) in wind with gusts, whose receiver is
off by metres, behind a link that loses up to 15 % each way, flies a small area by another speed, camera and height each time.
Its positions come 6 to 50 times a second; some records are thinned to 1 to 5 samples a second afterwards and judged as foreign
logs, some flights are judged by their telemetry log. Faults are ridden out, the user pauses, or stops and goes on with the
flight later. A third of the flights are surveys by a camera that is triggered by distance: with reported photos, with
--require-photos, or with a camera that reports none.

With --runs the run folders are kept, and flights that are there already are judged again but not flown again. Exit 1 when one
does not pass.
"""

import argparse
import csv
import dataclasses
import datetime
import json
import os
import platform
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])

from importlib import metadata

from mission_io.wire import messages as m
from scripts.options import file_to_write, put_section
from tests.falsify import command, commit
from tests.falsifying.flown import read_flown
from tests.falsifying.honest_run import NADIR, STABILISED, SURVEY, WIDE_PHOTO, Base, Field, make_site, save_lines
from tests.falsifying.of_time import thinned
from uavcover.flight.resume import find_unfinished, save_rest
from uavcover.mock.body import GpsError
from uavcover.mock.dynamics import WindModel
from uavcover.mock.faults import parse_fault
from uavcover.mock.vehicle import MockVehicle
from uavcover.model.track import FlightFailedError
from uavcover.run.folder import RunFolder
from uavcover.scenario.site import Site

SENSORS = {"nadir": NADIR, "stabilised": STABILISED, "wide picture": WIDE_PHOTO}
SURVEYED = "survey"
Photos = Literal["none", "reported", "required", "silent"]
"""Whether single photos are taken, and what is known of them: reported; reported and required; taken without a word."""
TRACK, THINNED, TELEMETRY = "track.csv", "thinned.csv", "flight.tlog"


@dataclass(frozen=True, slots=True)
class Drawn:
    """What a flight is like.

    Attributes:
        autopilot: whose behaviour the mock vehicle shows.
        sensor: a name of ``SENSORS``, or ``SURVEYED``.
        cruise_m_s: speed over ground.
        climb_m_s: upward and downward speed.
        height_agl_m: of the lines.
        wind_m_s: steady wind.
        wind_from_deg: where it comes from.
        gust_m_s: standard deviation of the gusts.
        gps_m: standard deviation of the receiver's error, horizontally and in height.
        position_hz: how often positions come.
        attitude_hz: how often attitudes come.
        record_hz: how often the record that is judged has samples; None as they came.
        loss: share of the datagrams that the link loses, each way.
        faults: as ``parse_fault`` reads them.
        pause_s: vehicle time after take-off at which the user pauses, and for how long; None for no pause.
        stop_s: vehicle time after take-off at which the user stops; the flight is gone on with later. None for no stop.
        judged_by: the file that is judged.
        photos: what is known of them.
    """

    autopilot: str
    sensor: str
    cruise_m_s: float
    climb_m_s: float
    height_agl_m: float
    wind_m_s: float
    wind_from_deg: float
    gust_m_s: float
    gps_m: tuple[float, float]
    position_hz: float
    attitude_hz: float
    record_hz: float | None
    loss: float
    faults: tuple[str, ...]
    pause_s: tuple[float, float] | None
    stop_s: float | None
    judged_by: str
    photos: Photos

    @property
    def happens(self) -> str:
        """Faults and what the user does."""
        user = [] if self.pause_s is None else [f"pause:{self.pause_s[1]:g}@{self.pause_s[0]:g}s"]
        user += [] if self.stop_s is None else [f"stop@{self.stop_s:g}s"]
        return " ".join([*self.faults, *user]) or "nothing"


@dataclass(frozen=True, slots=True)
class Row:
    """One flight of the table.

    Attributes:
        flight: its number.
        autopilot: whose behaviour.
        sensor: which camera.
        cruise_m_s: speed.
        wind: steady speed and gusts.
        gps: errors of the receiver.
        rates: positions, attitudes and recorded samples a second.
        loss: of the link.
        photos: what is known of them.
        happens: faults, pauses, stops.
        endings: of the flight and of those that went on with it.
        samples: of all its tracks.
        judged_by: which file.
        verdict: of the judge.
        reasons: why it did not pass.
    """

    flight: int
    autopilot: str
    sensor: str
    cruise_m_s: float
    wind: str
    gps: str
    rates: str
    loss: float
    photos: str
    happens: str
    endings: str
    samples: int
    judged_by: str
    verdict: str
    reasons: str


_TRIES = 4
_SURVEYS = 1.0 / 3.0


class TellingVehicle(MockVehicle):
    """A mock vehicle that sends positions and attitudes as often as it likes, whatever it is asked for."""

    own_interval_s: dict[type[m.Message], float] = {}  # noqa: RUF012  (each flight makes a class of its own)

    def set_interval(self, kind: type[m.Message], interval_s: float | None) -> None:
        """Send a kind of message at the vehicle's own rate, where it has one."""
        super().set_interval(kind, self.own_interval_s.get(kind, interval_s))


def draw(flight: int, seed: int) -> Drawn:
    """What a flight is like, by its number and the seed."""
    rng = np.random.default_rng([seed, flight, 20])
    happens = str(rng.choice(["nothing", "fault", "pause", "stop"], p=[0.35, 0.35, 0.15, 0.15]))
    autopilot = str(rng.choice(["ardupilot", "px4"]))
    judged_by = str(rng.choice([TRACK, THINNED, TELEMETRY], p=[0.7, 0.2, 0.1])) if happens != "stop" else TRACK
    windy = rng.random() < 0.7
    rough = rng.random() < 0.6
    cruise = float(np.round(rng.uniform(5.0, 14.0), 1))
    sensor = str(rng.choice(list(SENSORS)))
    own = np.random.default_rng([seed, flight, 21])
    photos: Photos = "none"
    if own.random() < _SURVEYS:
        sensor, photos = SURVEYED, ("reported", "required", "silent")[int(own.integers(3))]
    return Drawn(
        autopilot=autopilot,
        photos=photos,
        sensor=sensor,
        cruise_m_s=cruise,
        climb_m_s=float(np.round(rng.uniform(2.5, 5.0), 1)),
        height_agl_m=float(np.round(rng.uniform(70.0, 90.0))),
        wind_m_s=float(np.round(rng.uniform(0.0, 10.0), 1)) if windy else 0.0,
        wind_from_deg=float(np.round(rng.uniform(0.0, 360.0))),
        gust_m_s=float(np.round(rng.uniform(0.0, 2.0), 1)) if windy else 0.0,
        gps_m=(float(np.round(rng.uniform(0.3, 2.0), 1)), float(np.round(rng.uniform(0.3, 1.0), 1))) if rough else (0.0, 0.0),
        position_hz=float(rng.choice([6.25, 10.0, 25.0, 50.0], p=[0.25, 0.55, 0.14, 0.06])),
        attitude_hz=float(rng.choice([4.0, 10.0, 25.0, 50.0], p=[0.3, 0.5, 0.14, 0.06])),
        record_hz=float(rng.choice([1.0, 2.0, 5.0])) if judged_by == THINNED else None,
        loss=float(rng.choice([0.0, 0.0, 0.05, 0.15])),
        faults=(_draw_fault(rng, autopilot),) if happens == "fault" else (),
        pause_s=_draw_pause(rng) if happens == "pause" else None,
        stop_s=float(np.round(rng.uniform(40.0, 90.0))) if happens == "stop" else None,
        judged_by=judged_by,
    )  # fmt: skip


def _draw_pause(rng: np.random.Generator) -> tuple[float, float]:
    return float(np.round(rng.uniform(20.0, 90.0))), float(np.round(rng.uniform(5.0, 40.0)))


def _draw_fault(rng: np.random.Generator, autopilot: str) -> str:
    """One that does not keep the vehicle from flying to the end, and takes no more of the record than a judge forgives."""
    kind, low, high = (
        ("heartbeat-loss", 1.0, 8.0), ("link-outage", 0.5, 1.6), ("stuck", 3.0, 20.0), ("strong-wind", 8.0, 13.0),
        ("gps-loss", 0.3, 0.8 if autopilot == "px4" else 3.0),
    )[int(rng.integers(5))]  # fmt: skip
    return f"{kind}:{rng.uniform(low, high):.1f}@{rng.uniform(20.0, 100.0):.0f}s"


def base_of(drawn: Drawn) -> Base:
    """The scenario that is flown."""
    vehicle = (
        f"cruise_speed_m_s = {drawn.cruise_m_s}\nmax_climb_m_s = {drawn.climb_m_s}\nmax_descent_m_s = {drawn.climb_m_s}\n"
        f'acceptance_radius_m = 3.0\nautopilot = "{drawn.autopilot}"'
    )
    kind = SURVEY if drawn.sensor == SURVEYED else Base(name="honest", sensor=SENSORS[drawn.sensor])
    return dataclasses.replace(
        kind, name="honest", vehicle=vehicle, height_agl_m=drawn.height_agl_m,
        autopilot="px4" if drawn.autopilot == "px4" else "ardupilot",
    )  # fmt: skip


def field_of(site: Site, drawn: Drawn, flight: int, *, faults: Sequence[str]) -> Field:
    """The vehicle, at home."""
    own = {m.GlobalPositionInt: 1.0 / drawn.position_hz, m.Attitude: 1.0 / drawn.attitude_hz}
    field = Field(
        site=site, autopilot="px4" if drawn.autopilot == "px4" else "ardupilot", seed=flight, loss=drawn.loss,
        vehicle_class=type("Vehicle", (TellingVehicle,), {"own_interval_s": own}),
        options={
            "wind": WindModel(speed_m_s=drawn.wind_m_s, from_deg=drawn.wind_from_deg, gust_m_s=drawn.gust_m_s),
            "gps": GpsError(horizontal_m=drawn.gps_m[0], vertical_m=drawn.gps_m[1]),
            "faults": [parse_fault(fault) for fault in faults],
        },
    )  # fmt: skip
    field.vehicle.camera.reports = drawn.photos != "silent"
    return field


def fly(folder: Path, drawn: Drawn, flight: int) -> list[str]:
    """Plan, fly, and go on with what is left until nothing is; returns the endings. The record is in ``folder``."""
    base = base_of(drawn)
    site = make_site(folder / "scenario", base)
    run = RunFolder(folder / "run")
    save_lines(run, site, base)
    field = field_of(site, drawn, flight, faults=drawn.faults)

    def stop() -> int:
        return int(drawn.stop_s is not None and field.flown_s >= drawn.stop_s)

    def pause() -> bool:
        begin_s, lasts_s = drawn.pause_s or (0.0, 0.0)
        return begin_s <= field.flown_s < begin_s + lasts_s

    def fly_it() -> str:
        return str(field.fly(run, stop=stop, pause=pause).ending.key)

    endings = [_ending(fly_it)]
    for again in range(1, _TRIES):
        if endings != ["not_ready"]:
            break
        # Too little of the telemetry came through just then: who flies begins again.
        field = field_of(site, drawn, flight + 2_000_000 * again, faults=drawn.faults)
        endings = [_ending(fly_it)]
    if endings[0] != "landed" and run.file(TRACK).is_file():
        unfinished = find_unfinished(run, site)
        if not unfinished.complete:
            unfinished.folder.path.mkdir(exist_ok=True)
            save_rest(unfinished, site, command=["fly"])
            sound = field_of(site, drawn, flight + 1_000_000, faults=())
            endings.append(_ending(lambda: sound.fly(unfinished.folder).ending.key))
    return endings


def _ending(flight: Any) -> str:
    try:
        return str(flight())
    except FlightFailedError as error:
        return str(error.outcome.ending.key)


def judged(folder: Path, drawn: Drawn) -> tuple[str, str, int]:
    """The verdict on a flight, why, and how many samples it has."""
    run = folder / "run"
    log: list[object] = []
    if drawn.judged_by == THINNED and drawn.record_hz is not None:
        path = folder / THINNED
        path.write_text(thinned(drawn.record_hz)(read_flown(run)).text())
        log = ["--log", path]
    elif drawn.judged_by == TELEMETRY:
        log = ["--log", run / TELEMETRY]
    required = ["--require-photos"] if drawn.photos == "required" else []
    code, out, err = command("verify", run, "--json", *required, *log)
    said = json.loads(out.splitlines()[-1]) if out.strip() else {}
    passed = code == 0 and bool(said.get("passed"))
    reasons = "; ".join(said.get("reasons", ())) or str(said.get("error", err[-300:] if code else ""))
    verdict = "passed" if passed else "refused" if code not in (0, 1) else str(said.get("verdict", "failed"))
    return verdict, " ".join(reasons.replace(str(folder), "").split()), int(said.get("samples", 0))


def measure(folder: Path, flight: int, seed: int) -> Row:
    """Fly once, unless it was flown already, and have it judged."""
    drawn = draw(flight, seed)
    noted = folder / "endings.json"
    if not noted.is_file():
        shutil.rmtree(folder, ignore_errors=True)  # of a run that was broken off
        noted.parent.mkdir(parents=True)
        noted.write_text(json.dumps(fly(folder, drawn, flight)))
    endings = json.loads(noted.read_text())
    if len(endings) > 1:  # both records together are the flight
        drawn = dataclasses.replace(drawn, judged_by=TRACK)
    verdict, reasons, samples = judged(folder, drawn)
    recorded = "" if drawn.record_hz is None else f", recorded {drawn.record_hz:g}"
    return Row(
        flight=flight,
        autopilot=drawn.autopilot,
        sensor=drawn.sensor,
        cruise_m_s=drawn.cruise_m_s,
        wind=f"{drawn.wind_m_s:g} +- {drawn.gust_m_s:g} m/s",
        gps=f"{drawn.gps_m[0]:g} and {drawn.gps_m[1]:g} m",
        rates=f"{drawn.position_hz:g}, {drawn.attitude_hz:g}{recorded}",
        loss=drawn.loss,
        photos=drawn.photos,
        happens=drawn.happens,
        endings=" ".join(endings),
        samples=samples,
        judged_by=drawn.judged_by,
        verdict=verdict,
        reasons=reasons,
    )


def summary(rows: Sequence[Row]) -> str:
    """The result in words."""
    verdicts = Counter(row.verdict for row in rows)
    others = "".join(f", {count} {name}" for name, count in verdicts.items() if name != "passed")
    return f"{verdicts['passed']} of {len(rows)} honest flights passed{others}."


def write(out: Path, rows: Sequence[Row], *, flights: int, seed: int) -> None:
    """The section of the Markdown page, and every flight in honest_flights.csv beside it."""
    lines = [
        f"Command: `.venv/bin/python scripts/attack/honest_flights.py --flights {flights} --seed {seed}`, "
        f"{datetime.date.today().isoformat()}, uavcover {metadata.version('uavcover')}, Python "
        f"{platform.python_version()}, {os.cpu_count()} cores ({platform.machine()}), commit {commit()}. What is flown is "
        "said at the top of the script. Every flight: [honest_flights.csv](honest_flights.csv).",
        "",
        summary(rows),
    ]
    others = [row for row in rows if row.verdict != "passed"]
    lines += ["", *(f"- flight {row.flight}: {row.verdict}: {row.reasons}" for row in others)] if others else []
    put_section(out, "Honest flights", "\n".join(lines))
    with out.with_name("honest_flights.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [field.name for field in fields(Row)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(row) for row in rows)


def _measured(runs: Path, seed: int, flight: int) -> Row:
    return measure(runs / f"flight_{flight}", flight, seed)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fly, judge, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "-o",
        "--out",
        type=file_to_write,
        help="page whose section is renewed; honest_flights.csv goes beside it",
    )
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--runs", type=Path, metavar="DIR", help="keep the run folders here, and fly none that is there"
    )
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that fly and judge; default 1")
    chosen = parser.parse_args(arguments)
    print(f"commit {commit()}", file=sys.stderr, flush=True)
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as temporary:
        fly_and_judge = partial(_measured, chosen.runs or Path(temporary), chosen.seed)
        # Flights of the standard library's default, fork, would share locks of threads.
        with ProcessPoolExecutor(chosen.workers, mp_context=get_context("spawn")) as pool:
            each = pool.map if chosen.workers > 1 else map
            for row in each(fly_and_judge, range(chosen.flights)):
                rows.append(row)
                print(dataclasses.astuple(row), flush=True)
    print(summary(rows))
    if chosen.out is not None:
        write(chosen.out, rows, flights=chosen.flights, seed=chosen.seed)
    return 0 if all(row.verdict == "passed" for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
