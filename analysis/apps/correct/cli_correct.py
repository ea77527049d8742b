"""`rig correct RIG`: write the corrections that the effects in the rig file support."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from analysis.apps.makers import suffixes_in_words
from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json, say_written
from analysis.cli.options import Anyway, AsJson, Calibration, maker_option
from analysis.cli.several import end_with_errors, with_controller
from rigs.makers import maker_of
from rigs.schema.vocabulary import DrivenTest, MakerName
from rigs.text import as_argument

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analysis.apps.correct.correct_rig import Corrections
    from analysis.apps.correct.stated_frames import Frames
    from analysis.correction.point_origins import PointKind
    from rigs.errors import FileError

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
        help="Six joint angles, separated by commas, at the start of each program of --program, or of a table "
        "of poses; default: unknown.",
    ),
]
_Near = Annotated[
    str | None,
    typer.Option(
        metavar="DEGREES",
        help="Joint angles q1,…,q6 at one of the poses of --path, or of those of --program whose posture the program "
        "does not determine; all of them are reached in this posture; default: unknown, for --path robot.posture_deg "
        "of the rig file.",
    ),
]
_Points = Annotated[
    Literal["computed", "taught"] | None,
    typer.Option(
        help="Origin of the points of --program, required: computed (CAD, offline programming, a vision system) or "
        "taught (the arm was jogged until the tool was right); default: asked at a terminal.",
    ),
]
_Since = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Change since the points were taught: corrections.yaml with the values entered at the controller since "
        "or from now on, the rig file of a calibration from that time, or the JSON of rig moved; default: no change.",
    ),
]


def _exceptions(kind: str, other: str) -> Any:
    about = f"Names of {kind} points, separated by commas, with * and ? as wildcards, also FILE:NAME"
    return typer.Option(f"--{kind}", metavar="NAMES", help=f"{about}, if the others are {other}; default: none.")


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
    near: _Near = None,
    neutral: _Neutral = None,
    points: _Points = None,
    since: _Since = None,
    computed_names: Annotated[list[str] | None, _exceptions("computed", "taught")] = None,
    taught_names: Annotated[list[str] | None, _exceptions("taught", "computed")] = None,
    anyway: Anyway = False,
    whole: Annotated[
        bool, typer.Option("--all-or-nothing", help="Write only programs with all targets corrected.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Write joint zeros, link constants, corrected targets and programs, each only if the effects support it."""
    from analysis.apps.correct import correction_report
    from analysis.apps.correct.controller_entries import scale_of
    from analysis.apps.correct.correct_rig import correct_rig
    from analysis.apps.correct.corrected_program import Programs
    from analysis.apps.correct.postures import UNSTATED
    from analysis.apps.correct.stated_frames import frames_of, postures_of
    from analysis.apps.correct.stated_points import points_of
    from analysis.cli.console import progress_of
    from analysis.correction.foreign_constants import refuse_constants_of_another
    from analysis.correction.support import require_usable_model
    from analysis.correction.table_postures import stated_posture
    from rigs.load import load, named_by

    _check_options(
        {
            "--tool, --frame": tools or frames, "--neutral": neutral, "--points": points, "--since": since,
            "--computed, --taught": computed_names or taught_names,
        },
        near, start, has_programs=bool(programs), has_path=path is not None,
    )  # fmt: skip
    rig, _ = load(with_controller(rig_file, calibration))
    if programs and points is None:
        points, since = _asked_points(programs, since)
    with named_by(rig_file, rig):
        origins = points_of(rig, points, since, computed_names or (), taught_names or ()) if points else None
    if path or origins is None or origins.uses_model:
        require_usable_model(rig, rig_file, anyway=anyway)
        refuse_constants_of_another(rig, calibration or rig_file, anyway=anyway)
    controller = maker or maker_of(rig.feedback.interface)
    with named_by(rig_file, rig), progress_of("correcting"):
        stated = frames_of(rig.robot, tools or (), frames or (), neutral or ())
        postures = postures_of(rig, near, start) if programs else UNSTATED
        asked = Programs(programs or (), stated, whole, postures, anyway, origins)
        posture = stated_posture(rig, near, start) if path else None
        corrections = correct_rig(
            rig, path, controller, scale_of(scale), entered=entered, programs=asked, posture=posture
        )
        in_vain = {} if anyway else corrections.in_vain
        corrections = corrections.without(in_vain)
        written = correction_report.write(corrections, directory)
    _say_corrections(corrections, stated, written, as_json=as_json)
    why_not = correction_report.why_not(corrections)
    if anyway or not (in_vain or why_not):
        _say_next(rig_file, controller, directory, corrections, settled=bool(path or programs or why_not))
    _say_about_programs(corrections, start)
    is_for_maker = maker is not None and not (path or programs)
    end_with_errors(_errors(rig_file, corrections, in_vain, for_maker=is_for_maker), ", all in corrections.yaml")


def _check_options(
    of_programs: Mapping[str, object], near: str | None, start: str | None, *, has_programs: bool, has_path: bool
) -> None:
    """Raise UseError for options without the programs or the table that they concern."""
    from rigs.errors import UseError

    for option, given in of_programs.items():
        if given and not has_programs:
            raise UseError(option, "concerns programs only", "give --program as well")
    for option, given in {"--near": near, "--start-joints": start}.items():
        if given and not (has_programs or has_path):
            problem, remedy = "concerns programs and tables of poses", "give --program or --path as well"
            raise UseError(option, problem, remedy)


def _asked_points(programs: Sequence[Path], since: Path | None) -> tuple[PointKind, Path | None]:
    """Ask for the origin of the points at a terminal. Raises UseError without one."""
    from analysis.apps.correct.point_question import ask_points, hints_in, refuse_unstated
    from analysis.cli.console import progress_of
    from analysis.cli.dialogue import Dialogue, has_person

    hints = hints_in(programs)
    if not has_person():
        raise refuse_unstated(sys.argv[1:], hints)
    dialogue = Dialogue(lambda line: say(line, err=True), progress_of, True, sys.stdin, sys.stderr)
    kind, file = ask_points(dialogue, hints)
    return kind, file or since


def _say_corrections(corrections: Corrections, stated: Frames, written: Sequence[Path], *, as_json: bool) -> None:
    """Print the answer, the doubts about the controller and the stated frames, and the written files."""
    from analysis.apps.correct import correction_report
    from analysis.apps.report.blocks import say_answer

    if as_json:
        say_json(correction_report.as_object(corrections, written))
    else:
        say_answer(correction_report.correction_answer(corrections))
    rig, programs = corrections.rig, corrections.programs
    named = {name for program in programs for name in program.named} if programs else None
    for doubt in [*filter(None, [rig.controller_doubt]), *stated.doubts(named, rig.length_unit)]:
        say(f"doubt: {doubt}", err=True)
    say_written(written)


def _say_next(
    rig_file: str, maker: MakerName | None, directory: Path, corrections: Corrections, *, settled: bool
) -> None:
    """Print the next steps after correcting a rig.

    settled: True if a way of correction is already chosen, so no alternative is proposed.
    """
    rig, file = corrections.rig, as_argument(rig_file)
    if maker is None and rig.takes_programs and rig.controller != "unknown" and not settled:
        first, *others = rig.makers
        directory_for = as_argument(directory.with_name(f"{directory.name}-{first}"))
        alternatives = "; or ".join(filter(None, ["the controller's own parameters", ", ".join(others)]))
        say(f"next: rig correct {file} --for {first} -o {directory_for}  # {alternatives}", err=True)
        say("      or with --program FILE --points computed your own programs; never both", err=True)
    if corrections.path:
        given = corrections.path[0].name
        table, test = directory / f"corrected-{given}", given.removesuffix("-path.csv")
        axes, rail = len(rig.robot.axes), ", e1_mm" if rig.robot.rail else ""
        both = corrections.at_controller and corrections.at_controller.entries and not corrections.entered
        either = "either enter the values, or " if both else ""
        say(f"next: {either}send the controller to q1_deg … q{axes}_deg{rail} of {table}", err=True)
        if rig.takes_programs and test in get_args(DrivenTest):
            options = f"--for {maker or rig.makers[0]} --test {test} --path {as_argument(table)} -o {test}-programs"
            say(f"next: rig program {file} {options}", err=True)


def _say_about_programs(corrections: Corrections, start: str | None) -> None:
    for program in corrections.programs:
        if start and program.start is None:
            unused = "is not needed by any target"
            if any(left.reason == "no_posture" for left in program.left):
                unused = "is not used, because the files do not show which routine starts first"
            say(f"{program.path.name}: --start-joints {unused}", err=True)
    if any(program.names and not program.held for program in corrections.programs):
        say("next: compare each program with the original line by line; rig did not send anything to a robot", err=True)
        slowly = "first run the program at reduced speed with a hand on the stop button, and watch each target"
        say(f"      {slowly}", err=True)


def _errors(
    rig_file: str, corrections: Corrections, in_vain: Mapping[Path, str], *, for_maker: bool
) -> list[FileError]:
    """Errors for targets, programs and values that could not be written. for_maker: --for was given without targets."""
    from analysis.apps.correct.correct_rig import target_errors
    from analysis.correction.reasons import how_to_state_controller
    from rigs.errors import FileError

    rig = corrections.rig
    errors = target_errors(rig, *corrections.path) if corrections.path else []
    if for_maker and rig.controller == "unknown":
        problem = "the constants of the controller are unknown, and values to enter are differences from them"
        errors.append(FileError(rig_file, problem, how_to_state_controller(rig), code="controller.invalid"))
    for file, why in in_vain.items():
        problem = f"{why}, so no corrected targets were written"
        remedy = "keep the targets unchanged, or measure there; --anyway writes them"
        errors.append(FileError(str(file), problem, remedy, code="correction.impossible"))
    for program in corrections.programs:
        if program.held:
            problem, remedy = "is not written: some places are uncorrected", "correct them, or remove --all-or-nothing"
            errors.append(FileError(str(program.path), problem, remedy, code="correction.impossible"))
    return errors
