"""How each command is declared: with an example below its help, and with flags that show no `<bool>`.

typer writes the type of every option into its help. For a flag that is `<bool>`, which reads as if a value followed.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

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
