"""Arguments and options shared by several commands, with common help text and completion."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from analysis.cli import completion
from rigs.makers import MAKERS, maker_named
from rigs.schema.vocabulary import Direction, MakerName, direction_of
from rigs.text import enumerated


def location(text: str | Path) -> Path:
    from analysis.runs import copied_runs

    return copied_runs.location(str(text))


def operator_or_user(operator: str) -> str:
    import getpass

    with suppress(KeyError, OSError, ImportError):
        return operator or getpass.getuser()
    return ""


Runs = Annotated[list[Path], typer.Argument(metavar="RUN…", autocompletion=completion.runs, help="Run directories.")]


def _runs_below(what: str) -> Any:
    words = f"{what}; a directory or URL with runs selects all runs."
    return typer.Argument(metavar="RUN…", parser=location, autocompletion=completion.runs, help=words)


RunsBelow = Annotated[list[Path], _runs_below("Run directories or URLs")]
RobotRunsBelow = Annotated[list[Path], _runs_below("Run directories or URLs of one robot")]
RunsElsewhere = Annotated[
    list[Path] | None,
    typer.Option(
        parser=location,
        autocompletion=completion.runs,
        help="Run directory or URL at a different place or radius, for validation; repeatable; default: none.",
    ),
]


def _processes(text: str | int) -> int:
    """Number of processes; 0 means the number of cores."""
    if text == "auto":
        return 0
    if str(text).isdecimal():
        return int(text)
    raise typer.BadParameter(f"{text!r} is not a number of processes; give 1 or more, or auto")


_ON_EACH = "0 or auto: one per core."
Jobs = Annotated[
    int, typer.Option(metavar="N", parser=_processes, help=f"Processes that read and evaluate the runs; {_ON_EACH}")
]
ReadingJobs = Annotated[
    int, typer.Option("--jobs", metavar="N", parser=_processes, help=f"Processes that read the runs; {_ON_EACH}")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler with workers for this; default: this computer.")
]


def _direction(text: str) -> Direction:
    direction = direction_of(text)
    if direction is None:
        raise typer.BadParameter(f"{text!r} is not a direction; give acw (ccw) or cw")
    return direction


def direction_option(meaning: str) -> Any:
    return typer.Option(
        "--direction",
        metavar="<acw|cw>",
        parser=_direction,
        autocompletion=lambda: ["acw", "cw"],
        help=f"{meaning}; ccw is acw.",
    )


def _maker(text: str) -> MakerName:
    maker = maker_named(text)
    if maker is None:
        raise typer.BadParameter(f"{text!r} is not a known maker of controllers; give {enumerated(list(MAKERS), 'or')}")
    return maker


def maker_option(meaning: str, default: str = "") -> Any:
    help_text = f"{meaning}: {enumerated(list(MAKERS), 'or')}" + (f"; default: {default}." if default else ".")
    return typer.Option("--for", metavar="MAKER", parser=_maker, autocompletion=lambda: list(MAKERS), help=help_text)


RigArgument = Annotated[
    str,
    typer.Argument(metavar="RIG", autocompletion=completion.rig_files, help="Rig file, or the name of a shipped rig."),
]


def rig_option(meaning: str) -> Any:
    return typer.Option("--rig", "--arm", autocompletion=completion.rigs_and_arms, help=meaning)


ModelRig = Annotated[
    str | None, rig_option("Rig file of the model, or an arm of the library; default: that of the first run.")
]
Calibration = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Constants of this robot in its controller: calibration.conf, the YAML of ur_calibration (ROS), the INI "
        "file of LinuxCNC, or a table of joints and flange poses from the pendant; data_sheet if it has none; default: "
        "as in the rig file.",
    ),
]
Anyway = Annotated[
    bool,
    typer.Option(
        "--anyway", help="Write the files although the diagnosis advises against a correction; the files mention this."
    ),
]
Language = Annotated[Literal["en", "de", "ko"], typer.Option("--lang", help="Language of the text.")]
Operator = Annotated[str, typer.Option("--operator", help="Name of the operator; default: the user.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
