"""What commands cost before and beside their work: `python scripts/bench_start.py [--before CHECKOUT] [--repeat 5]`.

Processor seconds of a whole process, the least of so many; with another checkout the two take turns. docs/results/start.md
has the table.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from scripts.options import existing_folder

COMMANDS = (
    "--version",
    "--help",
    "plan --help",
    "new --camera list",
    "inspect RUN --text",
    "pareto RUN",
    "export RUN --format gpx -o OUT.gpx --force",
    "verify RUN",
    "report RUN --force",
)


def processor_s(command: str, checkout: Path, run: Path, out: Path) -> float:
    """Of one process from its start to its end."""
    arguments = [
        str(run) if part == "RUN" else str(out / part) if part.startswith("OUT") else part for part in command.split()
    ]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "uavcover", *arguments], cwd=out, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(checkout)},
    )  # fmt: skip
    if done.returncode != 0:
        sys.exit(f"uavcover {command}: exit code {done.returncode}: {done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=existing_folder, help="a flown run folder, as uavcover demo makes it")
    parser.add_argument("--before", type=existing_folder, help="another checkout, with its kernels compiled")
    parser.add_argument("--repeat", type=int, default=5)
    arguments = parser.parse_args()
    here = Path(__file__).resolve().parents[1]
    checkouts = [here] if arguments.before is None else [arguments.before.resolve(), here]
    print("| command | " + ("before, s | " if len(checkouts) == 2 else "") + "now, s |")
    print("|---|" + "---:|" * len(checkouts))
    with tempfile.TemporaryDirectory() as folder:
        for command in COMMANDS:
            times: list[list[float]] = [[] for _ in checkouts]
            for _ in range(arguments.repeat):
                for each, checkout in zip(times, checkouts, strict=True):
                    each.append(processor_s(command, checkout, arguments.run.resolve(), Path(folder)))
            print(f"| `{command}` | " + " | ".join(f"{min(each):.2f}" for each in times) + " |", flush=True)


if __name__ == "__main__":
    main()
