"""How each command is declared: with an example below its help, and with flags that show no `<bool>`.

typer writes the type of every option into its help. For a flag that is `<bool>`, which reads as if a value followed.
It also makes much ready that the command at hand does not need, which is half of the time of its help.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_command_name
from typer.models import CommandInfo

HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
"""The names of the help of every command."""
F = TypeVar("F", bound=Callable[..., Any])


def _with_plain_flags(parameters: list[Any]) -> list[Any]:
    for one in parameters:
        if isinstance(one, TyperOption) and one.is_flag:
            one.metavar = ""
            if one.name == "help":
                one.default = False  # typer's is None, and to make a bool of that it would import pydantic
    return parameters


_OLD_OPTIONS = {
    "correct": {"--controller": "--for"},
    "history": {"--data": "--runs"},
    "simulate": {"--runs": "--times"},
}
"""Options as earlier versions spelled them, by command: they are understood, and no help shows them."""


class Command(TyperCommand):
    """A command whose flags are plain, and which understands options as they were spelled before."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_plain_flags(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        new_names = _OLD_OPTIONS.get(self.name or "", {})
        spelled = [word.partition("=") for word in args]
        return super().parse_args(ctx, ["".join((new_names.get(name, name), *rest)) for name, *rest in spelled])


JOBS = {
    "Set up": ("example", "init", "check", "doctor", "interfaces", "arms", "import-urdf", "circle", "ball"),
    "Measure": ("session", "plan", "program", "record", "automatic", "live", "window", "status", "emulate", "replay"),
    "Understand": ("analyse", "report", "diagnose", "compare", "simulate", "history", "fleet", "paper"),
    "Correct": ("calibrate", "correct"),
    "Look after runs and daemon": ("runs", "verify", "recover", "relabel", "keep", "logs", "metrics"),
    "Exchange": ("import", "export", "export-urdf"),
}
"""The commands by what a person wants to do, in the order of the work."""
_JOB_OF = {name: job for job, names in JOBS.items() for name in names}


class Group(TyperGroup):
    """A group of commands whose own flags are plain, and whose messages have no colours where NO_COLOR is set; the
    commands of `rig` are listed by job.

    rich respects that variable for tables and help; typer's own `echo` does not, but asks the context.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        order = list(_JOB_OF)
        return sorted(super().list_commands(ctx), key=lambda name: order.index(name) if name in order else len(order))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        found = super().get_command(ctx, cmd_name)
        if found is not None and ctx.parent is None and cmd_name in _JOB_OF:
            found.rich_help_panel = _JOB_OF[cmd_name]  # type: ignore[attr-defined]  # of typer's commands
        return found

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if os.environ.get("NO_COLOR"):
            ctx.color = False
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_plain_flags(super().get_params(ctx))


def command(
    group: typer.Typer, example: str, *, name: str | None = None, cls: type[Command] = Command
) -> Callable[[F], F]:
    """Declare a function as a command of a group, with one line that a person could type."""
    return group.command(name, cls=cls, epilog=f"Example: {example}")


def with_the_command_of(app: typer.Typer, words: Sequence[str]) -> typer.Typer:
    """The program with no command but the one that the first word names, as it is where that names none.

    typer makes all commands ready before it looks which is meant, and reads the signature of each: a sixteenth of a
    small run. Its own options that install completion stand before a command; to find them empty it imports pydantic, a
    third of the time that the help of a command takes.
    """
    first = words[0] if words else ""
    narrow = typer.Typer(cls=Group, add_completion=False, pretty_exceptions_enable=False, context_settings=HELP)
    narrow.registered_callback = app.registered_callback
    narrow.registered_commands = [one for one in app.registered_commands if _name(one) == first]
    narrow.registered_groups = [one for one in app.registered_groups if one.name == first]
    return narrow if narrow.registered_commands or narrow.registered_groups else app


def _name(command: CommandInfo) -> str | None:
    return command.name or (get_command_name(command.callback.__name__) if command.callback else None)
