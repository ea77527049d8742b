"""How each command is declared: with an example below its help, and with flags that show no `<bool>`.

typer writes the type of every option into its help. For a flag that is `<bool>`, which reads as if a value followed.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_command_name
from typer.models import CommandInfo

F = TypeVar("F", bound=Callable[..., Any])


def _without_types_of_flags(parameters: list[Any]) -> list[Any]:
    for one in parameters:
        if isinstance(one, TyperOption) and one.is_flag:
            one.metavar = ""
    return parameters


class Command(TyperCommand):
    """A command whose flags are plain."""

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_flags(super().get_params(ctx))


class Group(TyperGroup):
    """A group of commands whose own flags are plain, and whose messages have no colours where NO_COLOR is set.

    rich respects that variable for tables and help; typer's own `echo` does not, but asks the context.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if os.environ.get("NO_COLOR"):
            ctx.color = False
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        return _without_types_of_flags(super().get_params(ctx))


def command(
    group: typer.Typer, example: str, *, name: str | None = None, cls: type[Command] = Command
) -> Callable[[F], F]:
    """Declare a function as a command of a group, with one line that a person could type."""
    return group.command(name, cls=cls, epilog=f"Example: {example}")


def with_the_command_of(app: typer.Typer, words: Sequence[str]) -> typer.Typer:
    """The program with no command but the one that the first word names, as it is where that names none.

    typer makes all commands ready before it looks which is meant, and reads the signature of each: a fourteenth of the
    time of a small run, all of it for the commands that nobody asked for.
    """
    first = words[0] if words else ""
    narrow = copy.copy(app)
    narrow.registered_commands = [one for one in app.registered_commands if _name(one) == first]
    narrow.registered_groups = [one for one in app.registered_groups if one.name == first]
    return narrow if narrow.registered_commands or narrow.registered_groups else app


def _name(command: CommandInfo) -> str | None:
    return command.name or (get_command_name(command.callback.__name__) if command.callback else None)
