"""How commands end: every error becomes one line on stderr and an exit code."""

import functools
import os
import sys
import traceback
from collections.abc import Callable
from typing import Any

import typer

from mission_io.errors import FormatError, MissionIoError, MisuseError
from uavcover.errors import UavcoverError

INTERRUPTED = 130

_settings = {"traces": False}


def ending_well(command: Callable[..., Any]) -> Callable[..., None]:
    """A command that returns its exit code, as typer wants it: ending in ``typer.Exit``.

    Exit codes: 0 done; 1 done, and the answer is no; 2 bad usage or bad input; 3 the vehicle or the link failed; 4 no
    feasible plan; 130 interrupted.
    """

    @functools.wraps(command)
    def wrapped(*args: object, **kwargs: object) -> None:
        raise typer.Exit(_code(lambda: int(command(*args, **kwargs))))

    return wrapped


def _code(call: Callable[[], int]) -> int:
    try:
        return call()
    except UavcoverError as error:
        return _fail(error, error.exit_code)
    except MissionIoError as error:
        return _fail(error, 2 if isinstance(error, FormatError | MisuseError) else 3)
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has gone, as in `uavcover ... | head`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _fail(error: Exception, code: int) -> int:
    if _settings["traces"]:
        traceback.print_exception(error)
    sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
    return code


def show_traces(wanted: bool) -> None:
    """Whether errors come with their trace from here on."""
    _settings["traces"] = wanted
