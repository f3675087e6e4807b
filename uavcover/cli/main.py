"""``uavcover``: the commands in groups, and how each ends: errors become one line on stderr and an exit code."""

import functools
import inspect
import itertools
import os
import re
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from importlib import import_module, metadata
from types import MappingProxyType
from typing import Any

import typer

from mission_io.data_tables import read_document
from mission_io.model.plain_text import plain_lines, plain_text, plain_values
from uavcover.cli.console import stop_signals
from uavcover.cli.options import Overview, one_by_one
from uavcover.errors import INTERRUPTED, UavcoverError
from uavcover.plugins import loaded
from uavcover.run.folder import json_line

# Commands that are loaded when they are requested: the overview of all of them loads none.

Entry = tuple[str, str, tuple[str, ...]]
"""The module with the command under its name, its line in the overview, and examples for its help text."""
Groups = Mapping[str, Mapping[str, Entry]]
"""Entries by the group and the name of their commands."""


def overview_of(groups: Groups) -> type[Overview]:
    """The kind of click group that shows these commands, and loads the one that is called."""

    class OnDemand(Overview):
        def __init__(self, **attributes: Any) -> None:
            super().__init__(**attributes)
            self.commands = LoadedCommands(groups)

        def rows(self, ctx: Any) -> Iterator[tuple[str, str, str]]:
            del ctx
            for title, entries in groups.items():
                for name, (_, short, _) in entries.items():
                    yield title, name, short

    return OnDemand


class LoadedCommands(MutableMapping[str, Any]):
    """Commands by name, each loaded when it is looked up first."""

    def __init__(self, groups: Groups) -> None:
        self._titles = {name: title for title, entries in groups.items() for name in entries}
        self._entries = {name: entry for entries in groups.values() for name, entry in entries.items()}
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            try:
                self._loaded[name] = _load(name, self._titles[name], self._entries[name])
            except KeyboardInterrupt:  # of which typer would make an end without a word
                raise typer.Abort from None
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        return name in self._titles or name in self._loaded

    def __setitem__(self, name: str, command: Any) -> None:
        self._loaded[name] = command

    def __delitem__(self, name: str) -> None:
        raise TypeError(f"{name}: the commands are defined in their table")

    def __iter__(self) -> Iterator[str]:
        return iter({**self._titles, **self._loaded})

    def __len__(self) -> int:
        return len({**self._titles, **self._loaded})


def _load(name: str, title: str, entry: Entry) -> Any:
    """The command as click wants it."""
    module, short, examples = entry
    found = getattr(import_module(module), name.replace("-", "_"))
    holder = typer.Typer(rich_markup_mode=None, add_completion=False, callback=lambda: None)
    if isinstance(found, typer.Typer):
        holder.add_typer(found, name=name, short_help=short, rich_help_panel=title)
    else:
        epilog = "\b\nExamples:\n" + "\n".join(f"  {example}" for example in examples)
        holder.command(name, short_help=short, rich_help_panel=title, epilog=epilog)(ending_well(one_by_one(found)))
    group: Any = typer.main.get_command(holder)
    return group.commands[name]


def _core_commands() -> Groups:
    """The core's own commands."""
    return {
        title: {name: (row["module"], row["short"], tuple(row["examples"])) for name, row in rows.items()}
        for title, rows in read_document("uavcover/data/commands.toml").items()
    }


def _with_extras(core: Groups) -> Groups:
    """The commands of the core and of every installed extra; an extra cannot take a name of the core."""
    groups = {title: dict(entries) for title, entries in core.items()}
    own = {name for entries in core.values() for name in entries}
    for added in loaded("uavcover.commands").values():
        for title, entries in added.items():
            groups.setdefault(title, {}).update({name: entry for name, entry in entries.items() if name not in own})
    return groups


_GROUPS: Groups = _with_extras(_core_commands())

app = typer.Typer(
    name="uavcover",
    cls=overview_of(_GROUPS),
    help="Plan flights that cover rugged terrain, fly them, and verify the coverage.",
    add_completion=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"uavcover {metadata.version('uavcover')}")
        raise typer.Exit


@app.callback()
def _root(
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
    _: bool = typer.Option(
        False, "--version", help="Show the version.", callback=_tell_version, is_eager=True, expose_value=False
    ),
) -> None:
    """Every command reads ``--debug`` from its context; see :func:`ending_well`."""
    del debug


def run() -> None:
    """Entry point of the ``uavcover`` command."""
    # numpy's threads would fight the planner's own for the cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(run_app(app, sys.argv[1:] or ["--help"]))


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
    for name, value in itertools.pairwise(arguments):
        if name in {"-o", "--out"} and value.strip() in {"", "-"}:
            # As a path the first would be the current folder, the second a file that few programs can name.
            what = "standard output is not supported" if value.strip() else "the name is empty"
            return _fail(f"-o: {what}; name the folder or file to write", BAD_USAGE, as_json=as_json)
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
    text = str(shown)
    if isinstance(shown, OSError) and shown.filename is not None and shown.strerror:
        text = f"{shown.filename}: cannot be used ({shown.strerror}); check its name and permissions"
    return _fail(text, code, as_json=as_json, details=details)


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
