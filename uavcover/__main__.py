"""The ``uavcover`` command, and ``python -m uavcover``: what begins before anything else is loaded."""

import contextlib
import gc
import os
import sys

from uavcover.errors import INTERRUPTED


def main() -> None:
    """Run a command; Ctrl-C while it still loads is one line, and a reader that has gone is none."""
    code: object = 0
    gc.set_threshold(
        700, 10, 100
    )  # collections of all objects while modules load take a tenth of a small plan, and free nothing
    try:
        from uavcover.cli.main import run

        run()
    except SystemExit as end:
        code = end.code
    except KeyboardInterrupt:
        code = INTERRUPTED
        _tell("interrupted")
    except BrokenPipeError:
        code = 1
    except OSError as error:
        code = 2
        _tell(f"error: standard output: cannot be written ({error.strerror})")
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:  # None: closed by whoever started us
                stream.flush()
        except (OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)  # type: ignore[arg-type]


def _tell(line: str) -> None:
    if sys.stderr is not None:
        with contextlib.suppress(OSError):
            sys.stderr.write(f"{line}\n")


if __name__ == "__main__":
    main()
