"""Trigger failsafes in flight, at seeded moments over ridged terrain, and compare the flown return with the predicted one.

Usage: .venv/bin/python -m scripts.attack.fly_failsafes FOLDER [--mock 100] [--arducopter 20] [--px4 20] [--first 0] [--ways]

Leaves FOLDER/SIMULATOR-SEED.json and the track (.npz) of each flight and goes on where it was interrupted; without the .json a
track is compared again, and not flown again. Then writes FOLDER/returns.csv and
prints the table. Simulators fly over flat ground (docs/how-to/sitl.md names their variables): the path is compared there, and
the flown track is held against the case's terrain as well. On the mock the terrain is real: it crashes where it hits it.
"""

import argparse
import csv
import json
import math
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from mission_io.autopilots.autopilot import Mode
from mission_io.client.commands import mode_params
from mission_io.errors import CommandRefusedError
from mission_io.model.items import Command
from mission_io.wire import messages as m
from sitl_tests.case import Case, Station
from sitl_tests.compared_returns import WITHIN_M, compare
from sitl_tests.flying import Path as FlownPath
from sitl_tests.flying import take_off
from sitl_tests.returns import (
    HOME,
    FailsafeCase,
    Flown,
    first_seq_of,
    fly_on_mock,
    leg_of,
    make_case,
    make_return_case,
    mission_of,
    rally_of,
)
from sitl_tests.simulators import ardupilot, px4
from sitl_tests.simulators.running import Start, StartRequest
from uavcover.flight.orders import custom_mode
from uavcover.model.vehicle import AutopilotName

_SPEEDS: Final = MappingProxyType({"arducopter": 8.0, "px4": 4.0})
_LINK_SPEED: Final = 4.0
"""Where the ground station's silence is the trigger: its heartbeats come once a second of the wall clock."""
_TRIGGERS: Final[Mapping[str, Sequence[str]]] = MappingProxyType(
    {
        "mock": ("commanded", "ground station", "fence", "battery"),
        "arducopter": ("commanded", "ground station", "fence", "battery"),
        "px4": ("commanded", "fence", "battery"),
    }
)
_PX4_KEEPS: Final = MappingProxyType({("RTL_RETURN_ALT", 60.0): 30.0, ("RTL_DESCEND_ALT", 30.0): 10.0})
"""A value that equals the firmware's own default is no change to PX4's ``param set``: then rc.mc_defaults holds."""
_POSITION_S = 0.1
_STILL_S, _STILL_M = 20.0, 0.5
_FLIGHT_S = 500.0
_WHOLE_PX4 = ("RTL_CONE_ANG", "RTL_TYPE", "NAV_DLL_ACT", "GF_ACTION", "COM_LOW_BAT_ACT")


def fly_in_simulator(name: str, case: FailsafeCase, folder: Path) -> Flown:
    """Fly a case on ArduCopter or PX4."""
    folder.mkdir(parents=True)
    start: Start = ardupilot.starter(ardupilot.COPTER) if name == "arducopter" else px4.start
    speed = _LINK_SPEED if case.trigger == "ground station" else _SPEEDS[name]
    with start(StartRequest(folder, HOME, speed, case.parameters)) as vehicle:
        run = Case(
            vehicle=vehicle, autopilot=case.autopilot, client="native", folder=folder, seed=case.seed, speed=speed
        )  # fmt: skip
        if case.trigger != "ground station":
            with run.station() as station:
                return _fly(run, station, case, vehicle.version, trigger=lambda: _trigger(station, case))
        with run.second_station() as observer, run.station() as station:
            return _fly(run, observer, case, vehicle.version, trigger=lambda: None, pilot=station)


def _fly(
    run: Case, station: Station, case: FailsafeCase, version: str, *, trigger: Callable[[], None],
    pilot: Station | None = None,
) -> Flown:  # fmt: skip
    starter = pilot or station
    starter.client.upload_and_verify(rally_of(case))
    path = take_off(run, starter, mission_of(case))
    if pilot is not None:
        path = FlownPath(HOME)
        station.monitor.on_position = path.take
        for kind in (m.GlobalPositionInt, m.MissionCurrent):
            station.client.request_message_interval(kind, _POSITION_S)
    else:
        station.client.request_message_interval(m.GlobalPositionInt, _POSITION_S)
    with suppress(CommandRefusedError):  # PX4 sends it once a second, whatever is asked
        station.client.request_message_interval(m.Heartbeat, _POSITION_S)
    seq, auto = first_seq_of(case, case.leg), custom_mode(station.client.vehicle.autopilot, Mode.MISSION)

    def flies_there() -> bool:
        if pilot is not None:
            pilot.client.poll(0.0)  # its heartbeats are sent while it listens
        return station.monitor.current_seq >= seq

    station.wait(flies_there, within_s=300.0, what=f"does not fly to item {seq}")
    since_s = path.times_s[-1]
    station.wait(
        lambda: flies_there() and path.times_s[-1] >= since_s + case.after_s,
        within_s=60.0,
        what="its clock stands still",
    )
    heard = len(station.monitor.texts)
    trigger()
    station.wait(
        lambda: station.client.vehicle.custom_mode != auto or _speaks(station, heard), within_s=60.0,
        what="no failsafe comes",
    )  # fmt: skip
    begun, leg = len(path.enu_m) - 1, leg_of(case, station.monitor.current_seq)
    velocity = np.diff(path.enu_m[begun - 2 : begun + 1 : 2], axis=0)[0] / (
        path.times_s[begun] - path.times_s[begun - 2]
    )
    end_s = path.times_s[begun] + _FLIGHT_S

    def is_over() -> bool:
        if not station.client.vehicle.armed or path.times_s[-1] > end_s:
            return True
        since = [
            enu for time_s, enu in zip(path.times_s, path.enu_m, strict=True) if time_s >= path.times_s[-1] - _STILL_S
        ]
        has_waited = path.times_s[-1] - path.times_s[begun] > _STILL_S + 5.0
        return has_waited and float(np.ptp(np.array(since), axis=0).max()) < _STILL_M

    station.wait(is_over, within_s=2.0 * _FLIGHT_S, what="it does not come to an end")
    return Flown(
        path.enu_m[begun],
        (float(velocity[0]), float(velocity[1])),
        leg,
        np.array(path.enu_m[begun:]),
        version=version,
    )


def _speaks(station: Station, heard: int) -> bool:
    texts = list(station.monitor.texts)[heard:]
    words = ("failsafe", "geofence", "fence breached", "rtl: start")
    return any(word in text.text.lower() for text in texts for word in words)


def _trigger(station: Station, case: FailsafeCase) -> None:
    for name, value in case.in_flight.items():
        station.client.set_parameter(name, value)
    if case.trigger == "commanded":
        vehicle = station.client.vehicle
        # Not set_mode, which waits for the next heartbeat: PX4's come once a second.
        station.client.command(Command.DO_SET_MODE, *mode_params(vehicle, custom_mode(vehicle.autopilot, Mode.RETURN)))


def _case(name: str, seed: int, autopilot: AutopilotName, *, paths: bool) -> FailsafeCase:
    if not paths:
        return make_case(seed, autopilot, triggers=_TRIGGERS[name])
    kinds = (1.0, 2.0, 3.0, 4.0) if autopilot == "px4" else (1.0, 2.0)
    case = make_return_case(seed, autopilot, kind=kinds[seed // 2 % len(kinds)])
    while case.trigger not in _TRIGGERS[name]:
        seed += 1001
        case = make_return_case(seed, autopilot, kind=kinds[seed // 2 % len(kinds)])
    return case


def flown_row(name: str, seed: int, folder: Path, *, paths: bool) -> dict[str, Any]:
    """One flight's row: from its file, or flown now."""
    what = f"{name}-{'way-' if paths else ''}{seed:03d}"
    file = folder / f"{what}.json"
    if file.exists():
        known: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return known
    autopilot: AutopilotName = (
        ("ardupilot", "px4")[seed % 2] if name == "mock" else "px4" if name == "px4" else "ardupilot"
    )
    case = _case(name, seed, autopilot, paths=paths)
    if name == "px4":
        held = {key: _PX4_KEEPS.get((key, value), value) for key, value in case.parameters.items()}
        case = replace(case, parameters=held)
    kept_track = folder / f"{what}.npz"
    if kept_track.exists():
        with np.load(kept_track) as kept:
            east, north, up, v_east, v_north = (float(value) for value in kept["start"])
            track, leg = kept["track"], int(kept["leg"])
            flown = Flown((east, north, up), (v_east, v_north), leg, track, bool(kept["crashed"]), str(kept["version"]))
    else:
        logs = folder / "logs" / what
        shutil.rmtree(logs, ignore_errors=True)  # of a flight that was interrupted
        flown = fly_on_mock(case) if name == "mock" else fly_in_simulator(name, case, logs)
        start = [*flown.position_m, *flown.velocity_m_s]
        np.savez_compressed(
            kept_track,
            track=flown.track_m,
            start=start,
            leg=flown.leg,
            crashed=flown.crashed,
            version=flown.version,
        )
    compared = compare(case, flown, flat=name != "mock")
    row = {
        "simulator": name, "seed": seed, "autopilot": autopilot, "trigger": case.trigger, "rally_points": len(case.rally),
        **{key: round(value, 2) if isinstance(value, float) else value for key, value in asdict(compared).items()},
        "crashed": flown.crashed, "within_10_m": compared.is_near, "foretold": compared.is_foretold, "version": flown.version,
    }  # fmt: skip
    row = {key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in row.items()}
    file.write_text(json.dumps(row) + "\n", encoding="utf-8")
    return row


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The summary in Markdown."""
    lines = [
        f"| vehicle | triggers | within {WITHIN_M:g} m | farthest | contacts | not foretold |", "|---|---|---|---|---|---|"
    ]  # fmt: skip
    for name in dict.fromkeys((row["simulator"], row["autopilot"]) for row in rows):
        own = [row for row in rows if (row["simulator"], row["autopilot"]) == name]
        worst = max(max(row["off_m"], row["left_out_m"]) for row in own)
        contacts = [row for row in own if row["flown_clearance_m"] is not None and row["flown_clearance_m"] <= 0.0]
        what = name[0] if name[0] != "mock" else f"mock as {name[1]}"
        near, unforeseen = sum(row["within_10_m"] for row in own), sum(not row["foretold"] for row in own)
        lines.append(f"| {what} | {len(own)} | {near} | {worst:.1f} m | {len(contacts)} | {unforeseen} |")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Fly what is missing and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    for name, count in (("mock", 100), ("arducopter", 20), ("px4", 20)):
        parser.add_argument(f"--{name}", type=int, default=count, help=f"flights on {name}")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--ways", action="store_true", help="PX4's RTL_TYPE 1 to 4 and ArduCopter's SmartRTL")
    options = parser.parse_args(arguments)
    options.folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in ("mock", "arducopter", "px4"):
        for seed in range(options.first, options.first + getattr(options, name)):
            row = flown_row(name, seed, options.folder, paths=options.paths)
            rows.append(row)
            if not (row["within_10_m"] and row["foretold"]) or name != "mock":
                print(json.dumps(row), file=sys.stderr, flush=True)
    with (options.folder / "returns.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(table(rows))
    return 0 if all(row["within_10_m"] and row["foretold"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
