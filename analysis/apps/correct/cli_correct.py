"""`rig correct RIG`: write the corrections that the effects in the rig file support."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from analysis.apps.makers import suffixes_in_words
from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json, say_written
from analysis.cli.options import Anyway, AsJson, Calibration, maker_option
from analysis.cli.several import end_with_errors, with_controller
from rigs.schema.vocabulary import DrivenTest, MakerName, maker_of
from rigs.text import as_argument

if TYPE_CHECKING:
    from collections.abc import Mapping

    from analysis.apps.correct.correct_rig import Corrections
    from analysis.apps.correct.corrected_program import CorrectedProgram
    from rigs.errors import FileError
    from rigs.rig import Rig

_FoundRig = Annotated[
    str,
    typer.Argument(
        metavar="RIG",
        autocompletion=completion.rig_files,
        help="Rig file with effects found by rig diagnose or rig calibrate.",
    ),
]
_Targets = Annotated[
    Path | None,
    typer.Option(
        help="CSV of targets to correct, with q1_deg … q6_deg, or with x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg "
        "(roll-pitch-yaw about fixed axes, in the world frame of the rig file); default: none."
    ),
]
_Maker = Annotated[
    MakerName | None,
    maker_option(
        "Maker of the controller whose parameters are written, or of the controller of the program with --program",
        "the maker in the rig file",
    ),
]
_Scale = Annotated[
    str | None,
    typer.Option(
        metavar="NUMBERS",
        help="Six numbers, separated by commas: signed counts per degree of each axis, or gear ratios, "
        "depending on the controller; default: changes in degrees of the reading.",
    ),
]
_Programs = Annotated[
    list[Path] | None,
    typer.Option(
        "--program",
        metavar="FILE",
        help=f"Robot program of yours whose targets are corrected in a copy: {suffixes_in_words()}, or a directory of "
        "programs; can be repeated; default: none.",
    ),
]
_Tools = Annotated[
    list[str] | None,
    typer.Option(
        "--tool",
        metavar="NAME=FRAME",
        help="Tool that a program only names or numbers (tcp in a script): X,Y,Z,RX,RY,RZ from the flange in mm and "
        "degrees about fixed axes, or rig, the tool of the rig file, or 0; can be repeated; default: none.",
    ),
]
_Frames = Annotated[
    list[str] | None,
    typer.Option(
        "--frame",
        metavar="NAME=FRAME",
        help="User frame, base or work object that a program refers to by name or number, in the robot's base, "
        "in the same form; repeatable; default: none.",
    ),
]
_Neutral = Annotated[
    list[str] | None,
    typer.Option(
        "--neutral",
        metavar="NAMES",
        help="Routines without a file, separated by commas, that neither move the arm nor change tools, frames, "
        "registers or offsets; repeatable; default: none.",
    ),
]
_Start = Annotated[
    str | None,
    typer.Option(
        "--start-joints",
        metavar="DEGREES",
        help="Six joint angles, separated by commas, at the start of each program of --program: the posture "
        "for a straight line before the first joint move; default: unknown.",
    ),
]


@command(app, "rig correct found/cell.yaml -o corrections")
def correct(
    rig_file: _FoundRig,
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for the corrections.")],
    path: _Targets = None,
    calibration: Calibration = None,
    maker: _Maker = None,
    scale: _Scale = None,
    entered: Annotated[
        bool,
        typer.Option(
            "--entered", help="The values are already entered at the controller: correct targets for this state."
        ),
    ] = False,
    programs: _Programs = None,
    tools: _Tools = None,
    frames: _Frames = None,
    start: _Start = None,
    neutral: _Neutral = None,
    anyway: Anyway = False,
    whole: Annotated[
        bool, typer.Option("--all-or-nothing", help="Write only programs with all targets corrected.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write joint zeros, link constants, corrected targets and programs, each only if the effects support it."""
    from analysis.apps.correct import correction_report
    from analysis.apps.correct.controller_entries import scale_of
    from analysis.apps.correct.correct_rig import correct_rig, target_errors
    from analysis.apps.correct.corrected_program import Programs
    from analysis.apps.correct.stated_frames import frames_of, start_of
    from analysis.apps.report.blocks import say_answer
    from analysis.cli.console import progress_of
    from analysis.correction.reasons import how_to_state_controller
    from analysis.correction.support import require_usable_model
    from rigs.errors import FileError, UseError
    from rigs.load import load, named_by

    needs_program = {
        "--tool, --frame": (tools or frames, "apply only to programs of --program"),
        "--neutral": (neutral, "names routines of programs"),
        "--start-joints": (start, "is the posture at the start of a program"),
    }
    for option, (given, problem) in needs_program.items():
        if given and not programs:
            raise UseError(option, problem, "give --program as well", code="program.option")
    rig, _ = load(with_controller(rig_file, calibration))
    require_usable_model(rig, rig_file, anyway=anyway)
    maker_asked, maker = maker, maker or maker_of(rig.feedback.interface)
    with named_by(rig_file, rig), progress_of("correcting"):
        stated = frames_of(rig.robot, tools or (), frames or (), neutral or ())
        asked = Programs(programs or (), stated, whole, start_of(start), anyway)
        corrections = correct_rig(rig, path, maker, scale_of(scale), entered=entered, programs=asked)
        in_vain = {} if anyway else corrections.in_vain
        kept = tuple(program for program in corrections.programs if program.path not in in_vain)
        corrections = replace(corrections, path=None if path in in_vain else corrections.path, programs=kept)
        written = correction_report.write(corrections, directory)
    if as_json:
        say_json(correction_report.as_object(corrections, written))
    else:
        say_answer(correction_report.answer_of(corrections))
    named = {name for program in corrections.programs for name in program.named} if corrections.programs else None
    for doubt in stated.doubts(named):
        say(f"doubt: {doubt}", err=True)
    say_written(written)
    corrected = next((file for file in written if path and file.name == f"corrected-{path.name}"), None)
    if anyway or not (in_vain or correction_report.why_not(corrections)):
        settled = bool(path or programs or correction_report.why_not(corrections))
        both = bool(corrections.at_controller and corrections.at_controller.entries) and not entered
        _say_next(rig_file, rig, maker, directory, corrected, settled=settled, both=both)
    for program in corrections.programs:
        if start and program.start is None:
            say(f"{program.path.name}: {_unused_start(program)}", err=True)
    if any(program.names and not program.held for program in corrections.programs):
        say("next: compare each program with the original line by line; rig did not send anything to a robot", err=True)
        say(
            "      first run the program at reduced speed with a hand on the stop button, and watch each target",
            err=True,
        )
    errors = target_errors(rig, *corrections.path) if corrections.path else []
    if maker_asked and rig.controller == "unknown" and not (path or programs):
        problem = "the constants of the controller are unknown, and values to enter are differences from them"
        errors.append(FileError(rig_file, problem, how_to_state_controller(rig), code="controller.unknown"))
    end_with_errors([*errors, *_not_written(corrections, in_vain)], ", all in corrections.yaml")


def _unused_start(program: CorrectedProgram) -> str:
    if any(left.reason == "no_posture" for left in program.left):
        return "--start-joints is not used, because the files do not show which routine starts first"
    return "--start-joints is not needed by any target"


def _not_written(corrections: Corrections, in_vain: Mapping[Path, str]) -> list[FileError]:
    from rigs.errors import FileError

    remedy = "keep the targets unchanged, or measure there; --anyway writes them"
    errors = [
        FileError(str(file), f"{why}, so no corrected targets were written", remedy, code="correct.no_gain")
        for file, why in in_vain.items()
    ]
    problem, remedy = "is not written: some places are uncorrected", "correct them, or remove --all-or-nothing"
    return errors + [
        FileError(str(program.path), problem, remedy, code="program.incomplete")
        for program in corrections.programs
        if program.held
    ]


def _say_next(
    rig_file: str, rig: Rig, maker: MakerName | None, directory: Path, table: Path | None, *, settled: bool, both: bool
) -> None:
    """Print the next steps after correcting a rig.

    table: table of the corrected targets. settled: True if a way of correction is already chosen, so no alternative is
    proposed. both: True if values for the controller were written together with targets, so the user has to choose.
    """
    axes, rail = len(rig.robot.axes), ", e1_mm" if rig.robot.rail else ""
    file = as_argument(rig_file)
    if maker is None and rig.takes_programs and rig.controller != "unknown" and not settled:
        likeliest, *others = rig.makers
        directory_for = as_argument(directory.with_name(f"{directory.name}-{likeliest}"))
        alternatives = "; or ".join(filter(None, ["the controller's own parameters", ", ".join(others)]))
        say(f"next: rig correct {file} --for {likeliest} -o {directory_for}  # {alternatives}", err=True)
        say("      or with --program FILE your own programs; never both", err=True)
    if table:
        either = "either enter the values, or " if both else ""
        say(f"next: {either}send the controller to q1_deg … q{axes}_deg{rail} of {table}", err=True)
        test = table.name.removeprefix("corrected-").removesuffix("-path.csv")
        if rig.takes_programs and test in get_args(DrivenTest):
            options = f"--for {maker or rig.makers[0]} --test {test} --path {as_argument(table)} -o {test}-programs"
            say(f"next: rig program {file} {options}", err=True)
