"""Fuzz the readers of files and of the wire: nothing but a refusal, no hang, and what was read survives writing.

Usage: python scripts/attack/fuzz_formats.py --seconds 60 --seed 1 [--target plan] [--engine atheris|mutations] [--keep DIR]

With ``atheris`` installed (``pip install atheris``) coverage leads the way to new inputs; without it, seeded files are
mutated blindly. A finding is printed with the file that causes it, and the exit code is 1. Each target has its own process.
What is tried is in ``fuzz_files.py`` and ``fuzz_readers.py``.
"""

import argparse
import importlib.util
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from contextlib import nullcontext
from pathlib import Path
from types import FrameType
from typing import Any

_ATHERIS = importlib.util.find_spec("atheris") is not None
_WATCHED = ["mission_io", "uavcover.scenario.airspace", "uavcover.extras.photos", "uavcover.new"]
"""Packages whose branches lead the way; they have to be imported for the first time under atheris' eyes."""

if "--child" in sys.argv and "atheris" in sys.argv:
    import atheris

    _watching: Any = atheris.instrument_imports(include=_WATCHED)
else:
    _watching = nullcontext()

with _watching:
    from scripts.attack import fuzz_files, fuzz_readers
    from scripts.attack.fuzz_files import Target

TARGETS: dict[str, Target] = {**fuzz_files.targets(), **fuzz_readers.targets()}

HANG_S = 10
_LARGEST = 20_000
WORDS = [
    b"nan", b"inf", b"1e308", b"1e999", b"-0", b"-1", b"1_0", b"99999", b"9" * 400, b"null", b"[", b"]", b"{", b"}", b'"',
    b"\t", b"\n", b"\r\n", b",", b"#", b"\0", b"\xef\xbb\xbf", b"\xff\xfe", b"\xe9", b"\\ud800", b"<!DOCTYPE a>",
    b"&amp;", b"<name>",
]  # fmt: skip


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Some bytes changed, moved, doubled, left out or replaced by words that programs stumble over."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 3, 8))):
        a, b = sorted(rng.randrange(len(result) + 1) for _ in range(2))
        b = min(b, a + rng.choice((1, 4, 40, 400)))
        match rng.randrange(6):
            case 0:
                result[a:b] = rng.choice(WORDS)
            case 1:
                del result[a:b]
            case 2:
                result[a:a] = result[a:b] * rng.choice((1, 2, 50))
            case 3:
                result[a:b] = rng.randbytes(min(b - a, 4))
            case 4:
                result[a:a] = rng.choice(WORDS) * rng.choice((1, 1, 3000))
            case _ if a < len(result):
                result[a] ^= 1 << rng.randrange(8)
        del result[_LARGEST:]
    return bytes(result)


def fuzz_by_mutations(target: Target, seconds: float, seed: int, finding: Path) -> int:
    """The number of inputs tried; raises what an input raised, which is in ``finding``."""

    def too_long(_: int, __: FrameType | None) -> None:
        raise TimeoutError(f"no answer for {HANG_S} s")

    signal.signal(signal.SIGALRM, too_long)
    rng, good = random.Random(seed), target.seeds
    runs, end = 0, time.process_time() + seconds
    while time.process_time() < end:
        data = mutated(rng.choice(good), rng)
        signal.alarm(HANG_S)
        try:
            target.attempt(data)
        except BaseException:
            finding.write_bytes(data)
            raise
        finally:
            signal.alarm(0)
        runs += 1
    return runs


def fuzz_by_coverage(target: Target, seconds: float, seed: int, finding: Path) -> None:
    """Never returns: atheris ends the process."""
    import atheris  # only where it is installed

    corpus = Path(tempfile.mkdtemp(prefix=f"corpus-{finding.stem}-"))
    for number, data in enumerate(target.seeds):
        (corpus / f"seed{number}").write_bytes(data)
    words = corpus.parent / f"{corpus.name}.dict"
    words.write_text("".join('"' + "".join(f"\\x{byte:02x}" for byte in word[:60]) + '"\n' for word in WORDS))
    options = [f"-seed={seed}", f"-timeout={HANG_S}", f"-max_len={_LARGEST}", f"-dict={words}",
               f"-exact_artifact_path={finding}", str(corpus)]  # fmt: skip
    runs, end = 0, time.process_time() + seconds

    def try_next(data: bytes) -> None:
        nonlocal runs
        if time.process_time() >= end:
            print("executed_units:", runs, flush=True)
            os._exit(0)
        runs += 1
        target.attempt(data)

    atheris.Setup([sys.argv[0], *options], try_next)
    atheris.Fuzz()


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
