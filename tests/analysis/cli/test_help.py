"""The help of every command: flags that are plain flags, and an example that the command would take."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.core import TyperOption
from typer.testing import CliRunner

from analysis.cli import app

ROOT = typer.main.get_command(app)


def _walk(group: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Each command and group with the words that call it."""
    yield above, group
    for name, below in getattr(group, "commands", {}).items():
        yield from _walk(below, (*above, name))


WALKED = dict(_walk(ROOT))
COMMANDS = {words: command for words, command in WALKED.items() if not hasattr(command, "commands")}


@pytest.mark.parametrize("words", WALKED, ids=lambda words: " ".join(("rig", *words)))
def test_a_flag_shows_no_type_in_the_help(words: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, [*words, "--help"], env={"COLUMNS": "200"})
    assert done.exit_code == 0
    assert "--help" in done.stdout and "bool" not in done.stdout


def test_the_walk_meets_flags() -> None:
    flags = [
        one for command in WALKED.values() for one in command.params if isinstance(one, TyperOption) if one.is_flag
    ]
    assert len(WALKED) > 25 and len(flags) > 20


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_the_example_of_a_command_is_one_that_it_takes(words: tuple[str, ...]) -> None:
    command = COMMANDS[words]
    assert command.epilog, "no example"
    label, _, example = command.epilog.partition(": ")
    typed = shlex.split(example)
    assert label == "Example" and typed[: len(words) + 1] == ["rig", *words]
    assert len(example) < 72, "does not fit on a line of 80 columns"
    until = typed.index(">>") if ">>" in typed else None
    command.make_context("rig", typed[len(words) + 1 : until])  # raises where an option is unknown or missing
