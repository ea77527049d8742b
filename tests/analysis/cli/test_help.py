import importlib
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from analysis import cli
from analysis.cli import app
from analysis.cli.commands import JOBS
from tests.support.command_line import all_imported, separately, succeeded

BIN = Path(sys.executable).parent
ROOT = all_imported()


def _walk(group: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    yield above, group
    for name, below in getattr(group, "commands", {}).items():
        yield from _walk(below, (*above, name))


WALKED = dict(_walk(ROOT))
COMMANDS = {words: command for words, command in WALKED.items() if not hasattr(command, "commands")}


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_the_example_of_a_command_is_one_that_it_takes(words):
    command = COMMANDS[words]
    assert command.epilog  # no example
    label, _, example = command.epilog.partition(": ")
    typed = shlex.split(example)
    assert label == "Example" and typed[: len(words) + 1] == ["rig", *words]
    assert len(example) < 72  # does not fit on a line of 80 columns
    until = typed.index(">>") if ">>" in typed else None
    command.make_context("rig", typed[len(words) + 1 : until])  # raises where an option is unknown or missing


LISTED = [(name, summary) for summaries in JOBS.values() for name, summary in summaries.items()]


def test_the_help_lists_every_command_in_the_order_of_the_work():
    root = Path(cli.__file__).parents[2]
    for file in (*root.glob("analysis/cli/*.py"), *root.glob("analysis/apps/*/cli_*.py")):
        if "@command(" in file.read_text():
            importlib.import_module(".".join(file.relative_to(root).with_suffix("").parts))
    declared = {
        info.name or str(info.callback and info.callback.__name__).replace("_", "-") for info in app.registered_commands
    }
    declared |= {str(group.name) for group in app.registered_groups}
    names = [name for name, _ in LISTED]
    assert declared == set(names) and len(names) == len(set(names))
    shown = CliRunner().invoke(app, ["-h"]).output
    assert [line[:-1] for line in shown.splitlines() if line[:-1] in JOBS and line.endswith(":")] == list(JOBS)
    words = " ".join(shown.split())
    assert all(f" {name} {summary}" in words for name, summary in LISTED)  # none truncated


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("", "error: rigd: Missing argument 'RIG'; see rigd --help"),
        ("a b", "error: rigd: Got unexpected extra argument(s) (b); see rigd --help"),
        ("--nope", "error: rigd: No such option: --nope; see rigd --help"),
    ],
)
def test_a_wrong_call_of_rigd_is_one_line(words, line):
    done = separately(BIN / "rigd", *words.split())
    assert (done.returncode, done.stderr) == (2, f"{line}\n")


@pytest.mark.parametrize("word", ["ccw", "CCW", "anticlockwise", "acw"])
def test_ccw_is_accepted(word, tmp_path):
    words = ["simulate", "paper-fanuc", "--test", "yaw", "--direction", word, "-o", str(tmp_path)]
    succeeded(*words)
    assert [run.name for run in tmp_path.iterdir()] == ["yaw-acw-000"]
