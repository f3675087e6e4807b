"""Kill a worker, the scheduler or the command at random moments of a plan by parts, and compare the plan with an undisturbed one.

Usage: .venv/bin/python scripts/kill_cluster.py [-o docs/results/kills.md] [--trials 20] [--seed 1]

A Dask scheduler and two workers of this machine plan a square of 2.5 km of the bundled heights in four parts. In turn the
scheduler, the command and a worker get SIGKILL, at a moment that the seed draws from the time that an undisturbed plan
takes. The scheduler is started again, with its workers; the same command is given again until it ends well. A plan is the
same when plan.json is equal byte for byte but for the line of wall_s, and pareto.csv, pareto_routes.csv and every sortie's
mission.plan byte for byte. The undisturbed plan is made by threads, without Dask. Rows are kept beside the page, in .csv;
run again after a stop, it goes on.
"""

import argparse
import datetime
import hashlib
import os
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from importlib import metadata
from pathlib import Path

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from scripts.bench_planner import window
from scripts.kept_rows import Row, read_rows, write_rows
from scripts.options import file_to_write
from uavcover.scenario.scenario_file import dump_scenario

SIDE_M, CELL_M, PARTS, EVALUATIONS = 2500.0, 20.0, 4, 1500
COLUMNS = ("trial", "killed", "at_s", "kept", "exit_code", "attempts", "lasted_s", "same", "date")
VICTIMS = ("worker", "scheduler", "command")


class Cluster:
    """A scheduler and two workers on 127.0.0.1, each a process with its children in a session of its own."""

    def __init__(self, logs: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self._logs = logs
        self._started: list[subprocess.Popen[bytes]] = []
        self.start()

    def start(self) -> None:
        """Start what is not running."""
        self.end()
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard"]
        worker = ["worker", self.address, "--host", "127.0.0.1", "--nthreads", "1", "--no-dashboard"]
        for number, words in enumerate((scheduler, worker, worker)):
            with (self._logs / f"{number}.log").open("ab") as log:
                command = [sys.executable, "-m", "dask", *words]
                self._started.append(subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True))

    def start_again_if_gone(self) -> None:
        """Start all of it when one of its processes has ended."""
        if any(process.poll() is not None for process in self._started):
            self.start()

    def kill_scheduler(self) -> None:
        """SIGKILL."""
        self._started[0].kill()

    def kill_worker(self, which: int) -> None:
        """SIGKILL for the process that computes; its nanny starts another one."""
        nanny = self._started[1 + which].pid
        children = subprocess.run(
            ["pgrep", "-P", str(nanny)], capture_output=True, text=True, check=False
        ).stdout.split()
        for child in children:
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                os.kill(int(child), signal.SIGKILL)

    def end(self) -> None:
        """End all of them."""
        for process in self._started:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self._started.clear()


def plan(scenario: Path, run: Path, *scheduler: str) -> subprocess.Popen[bytes]:
    """The command, begun."""
    command = [sys.executable, "-m", "uavcover", "plan", str(scenario), "-o", str(run), "--parts", str(PARTS), "-q"]
    command += ["--evaluations", str(EVALUATIONS), "--select", "coverage>=0.95", *scheduler]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def digest(run: Path) -> str:
    """Hash of what a plan is."""
    found = hashlib.sha256()
    for name in ("plan.json", "pareto.csv", "pareto_routes.csv", *sorted(
        path.relative_to(run).as_posix() for path in run.glob("sortie-*/mission.plan")
    )):  # fmt: skip
        content = (run / name).read_bytes()
        found.update(name.encode() + re.sub(rb'"wall_s": [^\n]*', b"", content))
    return found.hexdigest()


def trial(
    number: int, rng: random.Random, cluster: Cluster, scenario: Path, folder: Path, takes_s: float
) -> tuple[Row, str]:
    """One plan with one kill."""
    cluster.start_again_if_gone()
    victim, at_s, which = VICTIMS[number % len(VICTIMS)], rng.uniform(0.0, takes_s), rng.randrange(2)
    run, begin = folder / f"run-{number}", time.monotonic()
    process, attempts, killed, first_code = plan(scenario, run, "--scheduler", cluster.address), 1, False, None
    kept = 0
    while True:
        code = process.poll()
        if not killed and time.monotonic() - begin >= at_s and code is None:
            killed, kept = True, len(list(run.glob("parts/*.route")))
            match victim:
                case "worker":
                    cluster.kill_worker(which)
                case "scheduler":
                    cluster.kill_scheduler()
                case _:
                    process.kill()
        if code is not None:
            first_code = code if first_code is None else first_code
            if code == 0 or attempts == 5:
                break
            cluster.start_again_if_gone()
            process, attempts = plan(scenario, run, "--scheduler", cluster.address), attempts + 1
        time.sleep(0.1)
    lasted_s = time.monotonic() - begin
    values = {
        "trial": number, "killed": victim if killed else "nobody", "at_s": f"{at_s:.1f}", "kept": kept,
        "exit_code": first_code, "attempts": attempts, "lasted_s": f"{lasted_s:.1f}",
    }  # fmt: skip
    return {key: str(value) for key, value in values.items()}, digest(run) if code == 0 else ""


def page(rows: list[Row]) -> str:
    """The table."""
    lines = [
        "# Workers, schedulers and commands that are killed",
        "",
        f"Command: `.venv/bin/python scripts/kill_cluster.py`, {max(row['date'] for row in rows)}, uavcover "
        f"{metadata.version('uavcover')}, Dask {metadata.version('distributed')}. What is killed and compared is said at the top "
        "of the script; times are of a machine with other work.",
        "",
        f"{sum(row['same'] == 'yes' for row in rows)} of {len(rows)} plans are the same, byte for byte, as the undisturbed one "
        "by threads.",
        "",
        "| | killed | after | parts kept by then | exit code of that command | commands given | all took | same plan |",
        "|---:|---|---:|---:|---:|---:|---:|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row['trial']} | {row['killed']} | {row['at_s']} s | {row['kept']} | {row['exit_code']} | {row['attempts']} "
            f"| {row['lasted_s']} s | {row['same']} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Make the trials that are missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=file_to_write, default=Path("docs/results/kills.md"))
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    table = arguments.out.with_suffix(".csv")
    rows = read_rows(table)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        scenario = folder / "scenario.toml"
        scenario.write_text(dump_scenario(window(SIDE_M, CELL_M)), encoding="utf-8")
        if plan(scenario, folder / "alone").wait() != 0:
            raise SystemExit("the undisturbed plan failed")
        wanted = digest(folder / "alone")
        cluster = Cluster(folder)
        stack.callback(cluster.end)
        begin = time.monotonic()
        if plan(scenario, folder / "by-dask", "--scheduler", cluster.address).wait() != 0:
            raise SystemExit("the undisturbed plan by Dask failed")
        takes_s = time.monotonic() - begin
        if digest(folder / "by-dask") != wanted:
            raise SystemExit("threads and Dask do not agree")
        print(f"undisturbed, by Dask: {takes_s:.1f} s")
        for number in range(1 + len(rows), 1 + arguments.trials):
            rng = random.Random(arguments.seed * 1000 + number)
            row, found = trial(number, rng, cluster, scenario, folder, takes_s)
            rows.append({**row, "same": "yes" if found == wanted else "NO", "date": datetime.date.today().isoformat()})
            print(rows[-1], flush=True)
            write_rows(table, COLUMNS, rows)
            arguments.out.write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
