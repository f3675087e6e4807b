"""Two engines: good files mutated blindly, and atheris, which coverage leads to new inputs."""

import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from types import FrameType

from scripts.fuzzing.target import Target

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
