"""Of all commands only the one that is asked for is made ready."""

from __future__ import annotations

import pytest

from analysis.cli import app
from analysis.cli.commands import with_the_command_of


@pytest.mark.parametrize(
    ("words", "commands", "groups"),
    [
        (["analyse", "runs/one"], ["analyse"], []),
        (["import-urdf", "arm.urdf"], ["import_urdf"], []),
        (["circle", "fit"], [], ["circle"]),
    ],
)
def test_only_the_command_that_is_named(words: list[str], commands: list[str], groups: list[str]) -> None:
    narrow = with_the_command_of(app, words)
    assert [one.callback.__name__ for one in narrow.registered_commands if one.callback] == commands
    assert [one.name for one in narrow.registered_groups] == groups


@pytest.mark.parametrize("words", [[], ["--help"], ["--version"], ["analise", "runs/one"], ["circle-fit"]])
def test_all_of_them_where_none_is_named(words: list[str]) -> None:
    assert with_the_command_of(app, words) is app, "help lists them all, and an error the nearest"
