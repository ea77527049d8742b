"""The commands of `rig`: listed here with a line each, imported when one is named.

How each is declared: with an example below its help, and with flags that show no `<bool>`. typer writes the type of
every option into its help; for a flag that is `<bool>`, which reads as if a value followed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_command_name, get_group

from rigs.distribution import version

JOBS = {
    "Set up": {
        "example": "Write the shipped rig files, and what their emulated cells hide, into a directory: copies to start "
        "from.",
        "init": "Look for gauges and robot, ask which is which, and write a checked rig file.",
        "check": "Check a rig file: report every mistake with its line, and whether the robot can drive the tests. Of "
        "runs, check whether units, joints, gauges, times and places are meant as labelled.",
        "doctor": "Report what is wrong with a cell: ports, line settings, rates, clocks, disk, service.",
        "interfaces": "List the gauge and robot interfaces: instruments, line settings, source of the protocol, and "
        "what is in doubt.",
        "arms": "List the arm library, or show one arm as the robot section of a rig file.",
        "import-urdf": "Turn a URDF into the robot section of a rig file, equal to it within 1e-9 mm and rad.",
        "parts": "Write the parts of touches and of the link as STL, with a drawing and a list of what to buy.",
        "circle": "Find the circle of a rig file from the robot's motion.",
        "ball": "Find the ball of the hemisphere from the robot's stands.",
    },
    "Measure": {
        "session": "Measure, understand, correct and verify a robot, one program after the other.",
        "plan": "Report which effects the tests can detect and distinguish, from which size on, and which test adds "
        "the most.",
        "program": "Write the robot programs of a test, after a check of limits, singularities and turns; the robot is "
        "not moved.",
        "record": "Start and stop a recording of the running daemon.",
        "automatic": "Print the section `automatic` of a rig file, by which the robot's signal or motion starts runs "
        "like these.",
        "live": "Show gauges, angle, lap, joints, faults and recording until q or Ctrl-C.",
        "window": "Serve the live cell, its session, runs, reports and history to browsers, until Ctrl-C.",
        "status": "Show what the daemon reads and records now.",
        "emulate": "Start the gauges and the robot of RIG on ptys and local ports, and serve until stopped.",
        "replay": "Serve the instruments of a capture on ptys and local ports, at the times of the capture, until its "
        "end.",
    },
    "Understand": {
        "analyse": "Evaluate runs of any test (gauges, poses, touches, paths); every figure has its uncertainty.",
        "report": "Write one page: the verdict against the limits, what is wrong and what to do, then every test with "
        "pictures.",
        "diagnose": "Find where simulation and measurement differ, name the missing effects, and verify that they "
        "close the gap.",
        "moved": "Report what moved since a reference: base, socket, tool, a joint's zero, nothing, or something else.",
        "compare": "Simulate each run from its own feedback, fit the set-up, and show measured and simulated side by "
        "side.",
        "simulate": "Simulate runs of a test with the effects of a rig: noise of gauges and robot, scatter from run to "
        "run.",
        "history": "Show each figure of a robot over time, and report what changed by more than the scatter between "
        "its runs.",
        "fleet": "List the robots of a plant: state against limits, what changed and since when, runs and doubts.",
        "paper": "Simulate and evaluate the tests of the paper, and show its figures beside those computed here.",
    },
    "Correct": {
        "calibrate": "Calibrate the model of the robot from runs, judge it where it had no part, and write it as a rig "
        "file.",
        "correct": "Write joint zeros, link constants, corrected targets and programs, each only where the effects "
        "support it.",
        "postures": "Rank all postures that reach each target by their expected error, and choose the best sequence.",
        "versions": "List the calibrations of a robot, the newest first, or go back to one; rig compare shows how two "
        "differ.",
    },
    "Look after runs and daemon": {
        "runs": "List runs with size and age, whether they were exported, and whether they are kept.",
        "verify": "Report which runs are whole, recovered or not whole; the exit code is 3 if anything is wrong or "
        "missing.",
        "recover": "Recover runs that were cut off: keep every verified batch, and report what is lost.",
        "relabel": "Correct the labels of runs; their ledgers keep the old labels.",
        "keep": "Mark runs as kept: rigd never deletes them, whatever the rig file says of retention.",
        "logs": "Show what the services rigd@NAME have logged, and when systemd started and stopped them.",
        "metrics": "Print the daemon's rates, faults, queues, disk and clocks in the text format of Prometheus.",
    },
    "Exchange": {
        "import": "Create a run from each table of measurements; every bad row is reported with its line and the "
        "reason.",
        "export": "Write the table of each run as CSV, Parquet or a workbook, its raw streams as MCAP, or the map of "
        "its import.",
        "export-urdf": "Write the arm of a rig file for other programs, with the joint zeros and link constants that "
        "were found.",
    },
}
"""The commands by what a person wants to do, in the order of the work, each with the first paragraph of its help."""

_FILES = {
    **dict.fromkeys(("status", "metrics", "automatic"), "record"),
    **dict.fromkeys(("keep", "relabel", "verify", "recover"), "runs"),
    **dict.fromkeys(("example", "interfaces"), "check"),
    **dict.fromkeys(("import-urdf", "export-urdf"), "arms"),
    **dict.fromkeys(("replay", "simulate"), "emulate"),
    "ball": "circle",
    "import": "import_",
    "logs": "doctor",
    "versions": "calibrate",
}
"""The file of a command that is not called like it."""

_APPS = {
    **dict.fromkeys(("arms", "export"), "interchange"),
    **dict.fromkeys(("circle", "doctor", "init"), "commission"),
    **dict.fromkeys(("compare", "fleet", "history"), "plant"),
    **dict.fromkeys(("correct", "plan", "postures", "program"), "makers"),
    **{name: name for name in ("emulate", "live", "paper", "parts", "session", "window")},
}
"""The app that has a file of commands, as cli_FILE; the others are next to this file."""

_ADDED = {"record": "analysis.apps.commission.cli_touch"}
"""The file of an app that adds a command to a group."""

_HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"]}
"""The names of the help of every command."""
_OF_TYPER = ("help", "install_completion", "show_completion")
"""The flags that typer adds."""
_NEVER_SHOWN = {"rich.markdown": "Markdown", "rich.traceback": "Traceback"}
"""Modules that typer imports to lay out help, which none of rig's has: more than half of the time that help took."""

F = TypeVar("F", bound=Callable[..., Any])


@contextmanager
def _without_what_is_never_shown() -> Iterator[None]:
    """Let a class without content stand for each of those modules while typer's pages are imported."""
    absent = [name for name in _NEVER_SHOWN if name not in sys.modules]
    for name in absent:
        sys.modules[name] = ModuleType(name)
        setattr(sys.modules[name], _NEVER_SHOWN[name], type(_NEVER_SHOWN[name], (), {}))
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]


def _with_plain_flags(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if isinstance(parameter, TyperOption) and parameter.is_flag:
            parameter.metavar = ""
            if parameter.name in _OF_TYPER:
                parameter.default = False  # typer's is None, and to make a bool of that it would import pydantic
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
        return super().parse_args(ctx, ["".join((new_names.get(name, name), *value)) for name, *value in spelled])

    def format_help(self, ctx: Any, formatter: Any) -> None:
        with _without_what_is_never_shown():
            super().format_help(ctx, formatter)


def taking_all(option: str) -> type[Command]:
    """Return a command whose `option` takes all arguments up to the next option, as a shell's wildcard gives them."""

    class TakingAll(Command):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            words, follows = [], False
            for argument in args:
                if argument.startswith("-"):
                    follows = argument == option
                    words += [] if follows else [argument]
                else:
                    words += [option, argument] if follows else [argument]
            # An option without an argument stays, so that the parser names it.
            return super().parse_args(ctx, [*words, option] if args and args[-1] == option else words)

    return TakingAll


class Group(TyperGroup):
    """A group of commands whose own flags are plain, and whose messages have no colours where NO_COLOR is set.

    rich respects that variable for tables and help; typer's own `echo` does not, but asks the context.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if os.environ.get("NO_COLOR"):
            ctx.color = False
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_plain_flags(super().get_params(ctx))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        with _without_what_is_never_shown():
            super().format_help(ctx, formatter)


class _Program(Group):
    """The commands of `rig`, as they are listed; the one that is called is imported then."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {
            name: Command(name, help=summary, rich_help_panel=job)
            for job, summaries in JOBS.items()
            for name, summary in summaries.items()
        }

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, listed, remaining = super().resolve_command(ctx, args)
        return name, listed and imported(str(name)), remaining


app = typer.Typer(
    cls=_Program,
    context_settings=_HELP,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Robot metrology with a ball link and two digital probes: record, analyse, compare.",
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"rig {version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Robot metrology with a ball link and two digital probes: record, analyse, compare."""


def imported(name: str) -> TyperCommand | TyperGroup:
    """Return a command of `rig`, or a group of them, as its file declares it. name: one that is listed above."""
    file = _FILES.get(name, name.replace("-", "_"))
    import_module(f"analysis.apps.{_APPS[file]}.cli_{file}" if file in _APPS else f"analysis.cli.{file}")
    if name in _ADDED:
        import_module(_ADDED[name])
    narrow = typer.Typer(cls=Group, context_settings=_HELP)
    narrow.registered_commands = [
        info
        for info in app.registered_commands
        if name == (info.name or get_command_name(info.callback.__name__ if info.callback else ""))
    ]
    narrow.registered_groups = [info for info in app.registered_groups if info.name == name]
    return get_group(narrow).commands[name]  # type: ignore[return-value]  # commands are typer's


def all_imported() -> TyperGroup:
    """Return the group `rig` with every command and group as its file declares it."""
    program = get_group(app)
    program.commands = {name: imported(name) for name in program.commands}
    return program


def command(
    group: typer.Typer, example: str, *, name: str | None = None, cls: type[Command] = Command
) -> Callable[[F], F]:
    """Declare a function as a command of a group, with one line that a person could type."""
    return group.command(name, cls=cls, epilog=f"Example: {example}")
