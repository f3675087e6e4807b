"""``uavcover --help``: every command on one line, on one screen."""

from typing import Any

from typer.core import TyperGroup

_GROUP_WIDTH = 10
_NAME_WIDTH = 14


class Overview(TyperGroup):
    """The commands with the group they belong to in front; a group is what typer calls a help panel."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the whole help text."""
        formatter.write(f"Usage: {ctx.command_path} [--debug] COMMAND ...\n\n{self.help}\n\n")
        group = None
        for name in self.list_commands(ctx):
            command: Any = self.get_command(ctx, name)
            title = "" if command.rich_help_panel == group else command.rich_help_panel
            group = command.rich_help_panel
            formatter.write(f"{title:{_GROUP_WIDTH}}{name:{_NAME_WIDTH}}{command.short_help}\n")
        formatter.write(
            "\nCOMMAND --help tells its options. All take --json, -q and -v; --debug shows the\n"
            "trace of an error. --version; --install-completion for bash, zsh, fish.\n"
        )
