"""The end of a command: every error becomes one line on stderr and an exit code."""

import functools
import inspect
import logging
import re
import signal
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import typer

from mission_io.model.plain_text import plain_lines, plain_text, plain_values
from uavcover.errors import INTERRUPTED, UavcoverError
from uavcover.run.folder import json_line

BAD_USAGE = 2
FAULT = 70
"""A fault of uavcover itself; 70 is what sysexits.h calls it, so that no script takes it for an answer."""


_LONGEST_WORD = 400


def ending_well(command: Callable[..., int]) -> Callable[..., None]:
    """Turn a command that returns its exit code into a typer command, which raises ``typer.Exit``.

    Exit codes: 0 done; 1 done, and the answer is no; 2 bad usage or bad input; 3 the vehicle or the link failed; 4 no
    feasible plan; 130 interrupted. Under --json an error is also an object on stdout: ``error``, ``exit_code``, and
    what the error has for programs.
    """

    @functools.wraps(command)
    def wrapped(context: typer.Context, **values: Any) -> None:
        traces = bool(context.find_root().params["debug"])
        raise typer.Exit(_code(lambda: command(**values), as_json=values.get("as_json", False), traces=traces))

    signature = inspect.signature(command)
    context = inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
    parameters = [context, *signature.parameters.values()]
    wrapped.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return wrapped


def run_app(app: Callable[..., Any], arguments: Sequence[str]) -> int:
    """Run the commands on ``arguments``; bad usage becomes one line, too. Returns the exit code."""
    for number in stop_signals():  # all end in as good an order as Ctrl-C
        signal.signal(number, signal.default_int_handler)
    as_json = "--json" in arguments
    try:
        return int(app([_with_sign(argument) for argument in arguments], standalone_mode=False) or 0)
    except _UsageError as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "uavcover"
        format_message = getattr(error, "format_message", None)
        text = (str(error) if format_message is None else str(format_message())).rstrip(".")
        return _fail(f"{text}; see: {command} --help", BAD_USAGE, as_json=as_json)
    except (KeyboardInterrupt, typer.Abort):
        return _fail("interrupted", INTERRUPTED, as_json=as_json)


def _with_sign(argument: str) -> str:
    """Keep a list of numbers that begins with a minus, such as a box in America, from being an option."""
    return f" {argument}" if re.fullmatch(r"-[\d.][-+\d.,eE ]*,[-+\d.,eEkm ]*", argument) else argument


_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""The root of what typer raises for bad usage; it has no public name in every version."""


def _code(call: Callable[[], int], *, as_json: bool, traces: bool) -> int:
    try:
        return call()
    except UavcoverError as error:
        code, shown = error.exit_code, error
    except OSError as error:
        code, shown = BAD_USAGE, error  # type: ignore[assignment]
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED, as_json=as_json)
    except Exception as error:
        from mission_io.errors import FormatError, MissionIoError, MisuseError  # loads what --help has no use for

        if isinstance(error, MissionIoError):
            code, shown = BAD_USAGE if isinstance(error, FormatError | MisuseError) else 3, error  # type: ignore[assignment]
        else:
            _print_trace(error)
            return _fail(f"internal error of uavcover: {type(error).__name__}: {error}", FAULT, as_json=as_json)
    if traces:
        _print_trace(shown)
    details = shown.details() if isinstance(shown, UavcoverError) else {}
    return _fail(str(shown), code, as_json=as_json, details=details)


def _fail(text: str, code: int, *, as_json: bool, details: Mapping[str, Any] = MappingProxyType({})) -> int:
    line = _one_line(text)
    sys.stderr.write(f"error: {line}\n" if code != INTERRUPTED else f"{line}\n")
    if as_json:
        sys.stdout.write(json_line(plain_values({"error": line, "exit_code": code, **details})) + "\n")
    return code


def _one_line(text: str) -> str:
    """Text as one line for a terminal: without control characters, and with very long words shortened."""
    words = plain_text(text).split()
    return " ".join(
        word if len(word) <= _LONGEST_WORD else f"{word[: _LONGEST_WORD // 2]}...{word[-_LONGEST_WORD // 4 :]}"
        for word in words
    )


def _print_trace(error: BaseException) -> None:
    sys.stderr.write(plain_lines("".join(traceback.format_exception(error))))


class PlainFormatter(logging.Formatter):
    """Log lines that a terminal shows as they are: one line for each record, besides its traces."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """The line of a record."""
        return plain_text(super().formatMessage(record))

    def formatException(self, ei: Any) -> str:  # noqa: N802 - logging's name
        """The trace of a record."""
        return plain_lines(super().formatException(ei))


def stop_signals() -> list[signal.Signals]:
    """The signals that ask to stop: Ctrl-C, SIGTERM, and SIGHUP unless it is ignored (nohup)."""
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers
