"""Fuzz the readers of files and of the wire: nothing but a refusal, no hang, and what was read survives writing.

Usage: python scripts/fuzz_formats.py --seconds 60 --seed 1 [--target plan] [--engine atheris|mutations] [--keep DIR]

With ``atheris`` installed (``pip install atheris``) coverage leads the way to new inputs; without it, seeded files are
mutated blindly. A finding is printed with the file that causes it, and the exit code is 1. Each target has its own process.
What is tried is in ``scripts/fuzzing``.
"""

import argparse
import importlib.util
import resource
import subprocess
import sys
import time
import traceback
from contextlib import nullcontext
from pathlib import Path
from typing import Any

_ATHERIS = importlib.util.find_spec("atheris") is not None
_WATCHED = ["mission_io", "uavcover.scenario.airspace", "uavcover.judging.photos", "uavcover.intake"]
"""Packages whose branches lead the way; they have to be imported for the first time under atheris' eyes."""

if "--child" in sys.argv and "atheris" in sys.argv:
    import atheris

    _watching: Any = atheris.instrument_imports(include=_WATCHED)
else:
    _watching = nullcontext()

with _watching:
    from scripts.fuzzing.engines import fuzz_by_coverage, fuzz_by_mutations
    from scripts.fuzzing.targets import TARGETS


def run_child(target: str, engine: str, seconds: float, seed: int, finding: Path) -> tuple[int, str]:
    """How many inputs a target's own process tried, and what it found: empty for nothing."""
    command = [
        sys.executable,
        __file__,
        "--child",
        engine,
        "--target",
        target,
        "--seconds",
        str(seconds),
        "--seed",
        str(seed),
    ]
    done = subprocess.run(
        [*command, "--keep", str(finding)], capture_output=True, text=True, errors="replace", check=False
    )
    output = done.stdout + done.stderr
    units = [line.split()[-1] for line in output.splitlines() if "executed_units" in line]
    return int(units[-1]) if units else 0, "" if done.returncode == 0 else output[-3000:]


def _processor_s() -> float:
    """Processor time of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Run every target for the given time each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time, for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", choices=sorted(TARGETS), action="append")
    parser.add_argument("--engine", choices=["atheris", "mutations"], default="atheris" if _ATHERIS else "mutations")
    parser.add_argument("--keep", type=Path, default=Path("findings"), help="folder for inputs that break something")
    parser.add_argument("--child", choices=["atheris", "mutations"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.engine == "atheris" and not _ATHERIS:
        parser.error("--engine atheris: the package is not here; pip install atheris, or take --engine mutations")
    if options.child:
        if options.child == "atheris":
            fuzz_by_coverage(TARGETS[options.target[0]], options.seconds, options.seed, options.keep)
        try:
            runs = fuzz_by_mutations(TARGETS[options.target[0]], options.seconds, options.seed, options.keep)
        except BaseException:
            traceback.print_exc()
            return 1
        print("executed_units:", runs)
        return 0
    options.keep.mkdir(parents=True, exist_ok=True)
    found = 0
    print("| target | engine | seconds | processor s | inputs | finding |\n|---|---|---|---|---|---|")
    for target in options.target or TARGETS:
        finding = options.keep / f"{target}.bin"
        start, before_s = time.monotonic(), _processor_s()
        runs, problem = run_child(target, options.engine, options.seconds, options.seed, finding)
        times = f"{time.monotonic() - start:.0f} | {_processor_s() - before_s:.0f}"
        print(f"| {target} | {options.engine} | {times} | {runs} | {finding if problem else 'none'} |", flush=True)
        if problem:
            found += 1
            print(problem, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
