"""Missions over links that lose datagrams, three clients side by side: `python scripts/bench_clients.py -o FILE.csv [--seeds N]`.

Ours, MAVSDK, and a client on pymavlink that transfers as MAVProxy does: an upload answers requests and repeats nothing, a
download asks for up to five items at once and for missing ones again after 2 s; both give up after 10 s without anything new.
100 and 5,000 items, 0, 10, 20 and 30 % of the datagrams lost each way, to and from the package's own PX4 over UDP on 127.0.0.1,
which loses by seed. What is in the file already is not run again. Prints the table.
"""

import argparse
import csv
import multiprocessing
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from scripts.options import file_to_write
from uavcover.extras.benchmarks.link.peers import Transferred, outcome_of, run_real
from uavcover.extras.benchmarks.link.runs import Vehicles
from uavcover.extras.benchmarks.link.trials import COLUMNS, DIRECTIONS, TransferOutcome, Trial, items_on, mission_items

CLIENTS = {"native": "ours", "pymavlink": "pymavlink, as MAVProxy", "mavsdk": "MAVSDK"}
LOSSES = (0.0, 0.1, 0.2, 0.3)
COUNTS = (100, 5000)
GIVE_UP_S, AGAIN_S, AT_ONCE = 10.0, 2.0, 5


def connect(port: int) -> Any:
    """A MAVLink 2 connection of pymavlink that has heard the vehicle."""
    from pymavlink import mavutil
    from pymavlink.dialects.v20 import common

    mavutil.mavlink = common
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, dialect="common")
    link.mav = common.MAVLink(link, srcSystem=255, srcComponent=190)
    link.mav.robust_parsing = True
    for _ in range(600):
        link.mav.heartbeat_send(6, 8, 0, 0, 4)
        if link.recv_match(type="HEARTBEAT", blocking=True, timeout=0.1) is not None:
            return link
    raise TimeoutError("no vehicle")


def run_pymavlink(trial: Trial, port: int) -> Transferred:
    """A transfer as MAVProxy's mission module does it."""
    link = connect(port)
    start = time.perf_counter()
    if trial.direction == "upload":
        error = upload(link, trial.items)
        return Transferred(not error, time.perf_counter() - start, error=error)
    found, error = download(link)
    took_s = time.perf_counter() - start
    items = mission_items(trial.items)
    same = len(found) == len(items) and all(
        (m.x, m.y, m.z) == (round(i.lat_deg * 1e7), round(i.lon_deg * 1e7), i.alt_m)
        for m, i in zip((found[seq] for seq in sorted(found)), items, strict=True)
    )
    # Compared here, by the integers on the wire: the outcome wants items of our own.
    return Transferred(not error, took_s, items_on(trial.vehicle, trial.items) if same else (), error)


def upload(link: Any, count: int) -> str:
    """Empty when it was accepted, or why not."""
    items = mission_items(count)
    link.mav.mission_count_send(1, 1, count, 0)
    heard_at = time.monotonic()
    while time.monotonic() < heard_at + GIVE_UP_S:
        message = link.recv_match(
            type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=1.0
        )
        if message is None:
            continue
        heard_at = time.monotonic()
        if message.get_type() == "MISSION_ACK":
            return "" if message.type == 0 else f"result {message.type}"
        item = items[message.seq]
        link.mav.mission_item_int_send(
            1, 1, message.seq, item.frame.wire, item.command, 0, 1, *item.params, round(item.lat_deg * 1e7),
            round(item.lon_deg * 1e7), item.alt_m, 0,
        )  # fmt: skip
    return "timed out"


def download(link: Any) -> tuple[dict[int, Any], str]:
    """The items by number, and why they are not all here."""
    link.mav.mission_request_list_send(1, 1, 0)
    found: dict[int, Any] = {}
    asked: dict[int, float] = {}
    count: int | None = None
    heard_at = time.monotonic()
    while time.monotonic() < heard_at + GIVE_UP_S:
        message = link.recv_match(type=["MISSION_COUNT", "MISSION_ITEM_INT"], blocking=True, timeout=0.1)
        now = time.monotonic()
        if message is not None and message.get_type() == "MISSION_COUNT":
            count, heard_at = message.count, now
        elif message is not None and message.seq not in found:
            found[message.seq], heard_at = message, now
        if count is None:
            continue
        if len(found) == count:
            link.mav.mission_ack_send(1, 1, 0, 0)
            return found, ""
        waiting, seq = 0, 0
        while waiting < AT_ONCE and seq < count:
            if seq not in found:
                waiting += 1
                if now >= asked.get(seq, -1e9) + AGAIN_S:
                    asked[seq] = now
                    link.mav.mission_request_int_send(1, 1, seq, 0)
            seq += 1
    return found, "timed out"


def run_one(trial: Trial, port: int) -> Transferred:
    """One transfer in a process of its own."""
    try:
        return run_pymavlink(trial, port) if trial.client == "pymavlink" else run_real(trial, port)
    except Exception as error:
        return Transferred(False, 0.0, error=f"{type(error).__name__}: {error}")


def wanted(seeds: int) -> list[Trial]:
    """Every trial, first seeds first; a quarter of the seeds for the long lists."""
    return [
        Trial(client, "px4", direction, 0.0, loss, seed, count)
        for seed in range(seeds)
        for count in COUNTS
        if count < 1000 or seed < max(1, seeds // 4)
        for loss in LOSSES
        for direction in DIRECTIONS
        for client in CLIENTS
    ]


def main() -> int:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=file_to_write, required=True, help="outcomes, one line each")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--loss", type=float, action="append", choices=LOSSES, help="only this share; may be repeated")
    parser.add_argument("--at-a-time", type=int, default=8)
    parser.add_argument("--stop-after", type=float, default=3600.0, help="seconds; what is missing then is told")
    options = parser.parse_args()
    outcomes = read(options.output)
    done = {outcome.trial for outcome in outcomes}
    losses = options.loss or LOSSES
    missing = [trial for trial in wanted(options.seeds) if trial not in done and trial.loss in losses]
    end = time.monotonic() + options.stop_after
    if missing and not outcomes:
        options.output.write_text(",".join(COLUMNS) + "\n")
    with Vehicles() as vehicles, options.output.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)

        def note(trial: Trial, port: int, transferred: Transferred) -> None:
            outcome = outcome_of(trial, transferred, vehicles.close(port))
            outcomes.append(outcome)
            writer.writerow(outcome.row())
            file.flush()

        for lossy in (False, True):  # without loss the processor counts: one at a time
            pool = ProcessPoolExecutor(options.at_a_time if lossy else 1, multiprocessing.get_context("spawn"))
            todo = [trial for trial in missing if (trial.loss > 0.0) == lossy]
            step = options.at_a_time if lossy else 1
            for at in range(0, len(todo), step):
                if time.monotonic() > end:
                    print(f"{len(todo) - at} transfers were not run", file=sys.stderr)
                    break
                running = {}
                for trial in todo[at : at + step]:
                    port = vehicles.open(trial)
                    running[pool.submit(run_one, trial, port)] = (trial, port)
                for future in as_completed(running):
                    note(*running[future], future.result())
            for process in list(pool._processes.values()):
                process.kill()  # MAVSDK's threads do not always end by themselves
    print("\n".join(table(outcomes)))
    return 0


def read(path: Path) -> list[TransferOutcome]:
    """The outcomes so far."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [TransferOutcome.of_row(row) for row in csv.DictReader(file)]


def table(outcomes: list[TransferOutcome]) -> list[str]:
    """A row for each length, direction and loss."""
    lines = [
        "| items | transfer | loss | " + " | ".join(f"{name}: worked | median" for name in CLIENTS.values()) + " |"
    ]
    lines.append("|---|---|---|" + "---|---|" * len(CLIENTS))
    for count in COUNTS:
        for direction in DIRECTIONS:
            for loss in LOSSES:
                cells = []
                for client in CLIENTS:
                    here = [
                        one
                        for one in outcomes
                        if (one.trial.items, one.trial.direction, one.trial.loss, one.trial.client)
                        == (count, direction, loss, client)
                    ]
                    times = [one.time_s for one in here if one.claimed and one.correct]
                    median = "-" if not times else seconds(statistics.median(times))
                    cells.append(f"{len(times)}/{len(here)} | {median}")
                lines.append(f"| {count:,} | {direction} | {loss:.0%} | {' | '.join(cells)} |")
    return lines


def seconds(time_s: float) -> str:
    """A time with three digits."""
    return f"{time_s * 1e3:.1f} ms" if time_s < 0.1 else f"{time_s:.2f} s" if time_s < 10.0 else f"{time_s:.0f} s"


if __name__ == "__main__":
    sys.exit(main())
