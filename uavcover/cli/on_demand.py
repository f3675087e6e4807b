"""Commands that are loaded when they are asked for: the overview of all of them loads none."""

from collections.abc import Iterator, Mapping, MutableMapping
from importlib import import_module
from typing import Any

import typer

from uavcover.cli.ending import ending_well
from uavcover.cli.options import Overview, one_by_one

Entry = tuple[str, str, tuple[str, ...]]
"""The module that has the command under its name, what the overview says of it, and examples for its help text."""
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
    """Commands by name, each loaded when it is looked up first.

    Args:
        groups: what there is, and where.
    """

    def __init__(self, groups: Groups) -> None:
        self._titles = {name: title for title, entries in groups.items() for name in entries}
        self._entries = {name: entry for entries in groups.values() for name, entry in entries.items()}
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            self._loaded[name] = _load(name, self._titles[name], self._entries[name])
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
