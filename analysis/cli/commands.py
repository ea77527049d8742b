"""The commands of `rig`, listed with a summary and imported on demand.

The type `<bool>`, which typer prints for flags, is hidden, since it suggests a value after the flag.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib import import_module
from itertools import groupby, pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption
from typer.main import get_command_name, get_group

from analysis.cli.console import INTERRUPTED, say_interrupted
from rigs.distribution import version
from rigs.errors import UseError

JOBS = {
    "Set up": {
        "example": "Copy the shipped rig files, and the hidden effects of their emulated cells, to a directory.",
        "init": "Find gauges and robot, identify each, and write a checked rig file.",
        "check": "Check a rig file, or the labels of runs.",
        "doctor": "Report what is wrong with a cell: ports, line settings, rates, clocks, disk, service.",
        "interfaces": "List the gauge and robot interfaces with instruments, line settings, protocol source and open "
        "questions.",
        "arms": "List the arm library, or show one arm as the robot section of a rig file.",
        "import-urdf": "Convert a URDF to the robot section of a rig file, accurate to 1e-9 mm and rad.",
        "circle": "Fit the circle of a rig file to recorded robot motion.",
        "ball": "Fit the ball position of the hemisphere test to recorded robot poses.",
    },
    "Measure": {
        "session": "Measure, understand, correct and verify a robot, one program after the other.",
        "plan": "Report which effects the tests can detect and distinguish, from which size on, and which test adds "
        "the most.",
        "program": "Write the robot programs of a test, after a check of limits, singularities and turns; the robot is "
        "not moved.",
        "record": "Start and stop a recording of the running daemon.",
        "automatic": "Print the section `automatic` of a rig file, which starts runs like these on a robot signal or "
        "motion.",
        "live": "Show gauges, angle, lap, joints, faults and recording until Ctrl-C.",
        "window": "Serve the live cell, its session, runs, reports and history to browsers, until Ctrl-C.",
        "status": "Show the current readings and recording of the daemon.",
        "emulate": "Start the gauges and the robot of RIG on ptys and local ports, and serve until stopped.",
        "replay": "Serve the instruments of a capture on ptys and local ports, at the times of the capture, until its "
        "end.",
    },
    "Understand": {
        "analyse": "Evaluate runs of any test (gauges, poses, touches, paths); every figure has its uncertainty.",
        "report": "Write a report page: verdict against the limits, causes and remedies, and every test with pictures.",
        "diagnose": "Find the causes of the error: compare runs with the model, name the missing effects, and verify "
        "them.",
        "moved": "Report what moved since a reference: base, socket, tool, a joint's zero, nothing, or something else.",
        "compare": "Simulate each run from its own feedback, fit the set-up, and show measured and simulated side by "
        "side.",
        "simulate": "Simulate runs of a test with the effects of a rig: noise of gauges and robot, scatter from run to "
        "run.",
        "history": "Show each figure of a robot over time, and report what changed by more than the scatter between "
        "its runs.",
        "fleet": "List the robots of a plant: state against limits, what changed and since when, runs and doubts.",
        "paper": "Simulate and evaluate the tests of the paper, and compare the figures with the published ones.",
    },
    "Correct": {
        "calibrate": "Calibrate the model of a robot, validate it on data not used for the fit, and write a rig file.",
        "correct": "Write joint zeros, link constants, corrected targets and programs, each only if the effects "
        "support it.",
        "pair": "Calibrate two arms by each other: a ball on the flange of one, a socket on the flange of the other.",
        "certify": "Judge whether features of a program hold their tolerance: accept, reject or undecided at 5 % risk.",
        "versions": "List the calibrations of a robot, newest first, or restore an earlier one.",
    },
    "Look after runs and daemon": {
        "runs": "List runs with size, age, date of export and keep mark.",
        "verify": "Check that runs are complete and unchanged; the exit code is 3 if anything is wrong or missing.",
        "recover": "Recover interrupted runs: keep every verified batch, and report the losses.",
        "relabel": "Correct the labels of runs; the ledgers keep the old labels.",
        "keep": "Mark runs as kept: rigd never deletes them, regardless of the retention settings.",
        "logs": "Show what the services rigd@NAME have logged, and when systemd started and stopped them.",
        "metrics": "Print rates, faults, queues, disk and clocks of the daemon in the text format of Prometheus.",
    },
    "Exchange": {
        "import": "Create a run from each table of measurements; report every bad row with its line and the reason.",
        "export": "Write the table of each run as CSV, Parquet or a workbook, its raw streams as MCAP, or the map of "
        "its import.",
        "export-urdf": "Write the arm of a rig file for other programs, with the joint zeros and link constants that "
        "were found.",
    },
}
"""Commands by purpose in the order of the work, each with the first paragraph of the help text."""

_FILES = {
    **dict.fromkeys(("status", "metrics", "automatic"), "record"),
    **dict.fromkeys(("keep", "relabel", "verify", "recover"), "runs"),
    **dict.fromkeys(("example", "interfaces"), "check"),
    **dict.fromkeys(("import-urdf", "export-urdf"), "arms"),
    **dict.fromkeys(("replay", "simulate"), "emulate"),
    "ball": "circle",
    "calibrate": "diagnose",
    "import": "import_",
    "logs": "doctor",
}
"""Module of a command if the names differ."""

_APPS = {
    **dict.fromkeys(("arms", "export"), "interchange"),
    **dict.fromkeys(("circle", "doctor", "init", "moved"), "commission"),
    **dict.fromkeys(("compare", "fleet", "history", "versions"), "plant"),
    **dict.fromkeys(("analyse", "diagnose", "report"), "report"),
    **{name: name for name in ("certify", "correct", "emulate", "live", "pair", "paper", "session", "window")},
    "plan": "planning",
    "program": "programs",
}
"""App that contains a module of commands, as cli_FILE; all other modules are in this package."""

_FOLDER_OF_APPS = Path(__file__).parents[1] / "apps"
_ADDED = {"record": "analysis.apps.commission.cli_touch"}
"""Module of an app that adds a command to a group."""

_REMOVED = {
    "parts": (
        "was removed, because the parts are files",
        "print the files in docs/parts, with the sizes in docs/parts.md",
    ),
    "postures": (
        "was removed, because rig does not plan paths",
        "compare possible postures with rig certify, from a table of their joint angles (q1_deg …)",
    ),
}
"""Problem and remedy for commands of the previous version. Each entry stays for one version."""

_HELP: dict[str, Any] = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
"""Names of the help option of every command, and the largest width of the help text."""
_PLAIN_HELP = {"rich_markup_mode": None}
"""Help without frames. Half of the time of `rig --help` was the layout by rich (import of 130 modules)."""
_OF_TYPER = ("help", "install_completion", "show_completion")
"""Flags added by typer."""

F = TypeVar("F", bound=Callable[..., Any])


def _with_plain_flags(parameters: list[Any]) -> list[Any]:
    for parameter in parameters:
        if isinstance(parameter, TyperOption) and parameter.is_flag:
            parameter.metavar = ""
            if parameter.name in _OF_TYPER:
                parameter.default = False  # the default None of typer would import pydantic for the conversion to bool
    return parameters


_OLD_OPTIONS = {
    "correct": {"--controller": "--for"},
    "history": {"--data": "--runs"},
    "simulate": {"--runs": "--times"},
}
"""Former names of options by command. They are accepted but not shown in the help."""


class Command(TyperCommand):
    """Command with plain flags and help that accepts former names of options."""

    def __init__(self, name: str | None, **attributes: Any) -> None:
        super().__init__(name, **attributes | _PLAIN_HELP)

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_plain_flags(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        new_names = _OLD_OPTIONS.get(self.name or "", {})
        spelled = [word.partition("=") for word in args]
        words = ["".join((new_names.get(name, name), *value)) for name, *value in spelled]
        self._refuse_cell_as_arm(words)
        return super().parse_args(ctx, words)

    def _refuse_cell_as_arm(self, words: list[str]) -> None:
        """Refuse `--arm CELL`: the tool, payload and gauges of a shipped cell are not those of the user."""
        given = [word.removeprefix("--arm=") for word in words if word.startswith("--arm=")]
        given += [name for option, name in pairwise(words) if option == "--arm"]
        if not given:
            return
        from rigs.load import names_a_cell

        for name in filter(names_a_cell, given):
            takes_cells = any("--rig" in parameter.opts for parameter in self.params)
            cell = f", or --rig {name} for the cell with its tool and gauges" if takes_cells else ""
            problem = f"{name} is a shipped cell, not an arm of the library"
            raise UseError("--arm", problem, f"give an arm that rig arms lists{cell}", code="arm.unknown")


def taking_all(option: str) -> type[Command]:
    """Command class with an `option` that takes all arguments up to the next option, as a shell expands wildcards."""

    class TakingAll(Command):
        def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
            words, follows = [], False
            for argument in args:
                if argument.startswith("-"):
                    follows = argument == option
                    words += [] if follows else [argument]
                else:
                    words += [option, argument] if follows else [argument]
            # An option with no argument stays, so that the parser reports it.
            return super().parse_args(ctx, [*words, option] if args and args[-1] == option else words)

    return TakingAll


class CommandGroup(TyperGroup):
    """Group of commands with plain flags and help. rich respects NO_COLOR; `echo` of typer follows the context
    instead."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes | _PLAIN_HELP)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if os.environ.get("NO_COLOR"):
            ctx.color = False
        return super().parse_args(ctx, args)

    def get_params(self, ctx: Any) -> list[Any]:
        return _with_plain_flags(super().get_params(ctx))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands by purpose. typer lists them in one section and truncates their summaries."""
        commands = [(name, self.commands[name]) for name in self.list_commands(ctx)]
        indent = max(len(name) for name, _ in commands)
        for purpose, listed in groupby(
            commands, key=lambda row: getattr(row[1], "rich_help_panel", None) or "Commands"
        ):
            with formatter.section(purpose):
                formatter.write_dl(
                    [(name.ljust(indent), (command.help or "").split("\n\n")[0]) for name, command in listed]
                )


_MALLOC = {-3: 8 << 20, -1: 128 << 20}
"""Settings of glibc (mallopt(3)): size from which freed blocks are returned, and freed memory that is kept. Chosen: a
run of a million rows takes a tenth less time than with 32 MB, and the same memory at its peak.
"""


def keep_freed_memory() -> None:
    """Reuse freed memory, which glibc and Arrow's own allocator return: a sixth of the time of forty small runs, and a
    seventh of a run of a million rows.
    """
    import ctypes

    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    if sys.platform == "linux" and (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)):
        for parameter, size_bytes in _MALLOC.items():
            mallopt(parameter, size_bytes)


def _is_installed(command: str) -> bool:
    """False for a command whose app was removed from the installation."""
    app_folder = _APPS.get(_FILES.get(command, command))
    return app_folder is None or (_FOLDER_OF_APPS / app_folder).is_dir()


class _RigCommands(CommandGroup):
    """The commands of `rig` as listed; only the called command is imported."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = {
            name: Command(name, help=summary, rich_help_panel=job)
            for job, summaries in JOBS.items()
            for name, summary in summaries.items()
            if _is_installed(name)
        }

    def invoke(self, ctx: Any) -> Any:
        keep_freed_memory()
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            say_interrupted()
            raise typer.Exit(INTERRUPTED) from None

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        if args and args[0] in _REMOVED:
            raise UseError(f"rig {args[0]}", *_REMOVED[args[0]])
        name, listed, remaining = super().resolve_command(ctx, args)
        return name, listed and import_command(str(name)), remaining


app = typer.Typer(
    cls=_RigCommands,
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


def import_command(name: str) -> TyperCommand | TyperGroup:
    file = _FILES.get(name, name.replace("-", "_"))
    import_module(f"analysis.apps.{_APPS[file]}.cli_{file}" if file in _APPS else f"analysis.cli.{file}")
    if name in _ADDED:
        import_module(_ADDED[name])
    narrow = typer.Typer(cls=CommandGroup, context_settings=_HELP)
    narrow.registered_commands = [
        info
        for info in app.registered_commands
        if name == (info.name or get_command_name(info.callback.__name__ if info.callback else ""))
    ]
    narrow.registered_groups = [info for info in app.registered_groups if info.name == name]
    return get_group(narrow).commands[name]  # type: ignore[return-value]  # commands are typer's


def command(
    group: typer.Typer, example: str, *, name: str | None = None, cls: type[Command] = Command
) -> Callable[[F], F]:
    """Declare a function as a command of a group, with an example of a command line."""
    return group.command(name, cls=cls, epilog=f"Example: {example}")
