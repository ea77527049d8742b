"""`rig certify PROGRAM --rig RIG`: which features of a program hold their tolerance, before and after a correction."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say, say_error, say_json, say_written
from analysis.cli.options import AsJson, Calibration, rig_option
from rigs.text import as_argument, counted, first_of

if TYPE_CHECKING:
    from analysis.apps.certify.certificate import Certified
    from analysis.apps.certify.drift import Drift
    from analysis.apps.certify.program import Listed
    from rigs.errors import RigError
    from rigs.rig import Rig

_MOST_NOTES = 20


@command(app, "rig certify part.script --rig found/cell.yaml --tolerance hole1=0.4mm")
def certify(
    program: Annotated[
        Path,
        typer.Argument(
            metavar="PROGRAM", help="Robot program, directory of programs, or CSV of targets as for rig correct --path."
        ),
    ],
    rig_file: Annotated[str, rig_option("Calibrated rig file of the robot.")],
    tolerances: Annotated[
        list[str] | None,
        typer.Option(
            "--tolerance",
            metavar="FEATURE=MM",
            help="Tolerance with unit of a target (hole1=0.3mm), all targets (position:all), a distance (distance:A,B; "
            "to a line or plane distance:A,B,C), flatness:A..D or straightness:A,B; repeatable; default: none.",
        ),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option("--features", help="CSV of features: name, kind, targets (A;B), tolerance_mm; default: none."),
    ] = None,
    tools: Annotated[
        list[str] | None, typer.Option("--tool", metavar="NAME=FRAME", help="As for rig correct; default: none.")
    ] = None,
    frames: Annotated[
        list[str] | None, typer.Option("--frame", metavar="NAME=FRAME", help="As for rig correct; default: none.")
    ] = None,
    start: Annotated[
        str | None, typer.Option("--start-joints", metavar="DEGREES", help="As for rig correct; default: unknown.")
    ] = None,
    near: Annotated[
        str | None,
        typer.Option(
            metavar="DEGREES",
            help="Joint angles q1,…,q6 at one of the targets, as for rig correct; default: unknown, for a table of "
            "poses robot.posture_deg of the rig file.",
        ),
    ] = None,
    neutral: Annotated[
        list[str] | None, typer.Option("--neutral", metavar="NAMES", help="As for rig correct; default: none.")
    ] = None,
    scale: Annotated[
        str | None,
        typer.Option(metavar="NUMBERS", help="Counts per degree of each axis, as for rig correct; default: none."),
    ] = None,
    load_kg: Annotated[
        float | None, typer.Option("--load", min=0.0, max=1e4, help="Payload in kg; default: that of the rig file.")
    ] = None,
    rp_mm: Annotated[
        float | None,
        typer.Option(
            "--repeatability",
            min=0.0,
            max=10.0,
            help="Pose repeatability RP (ISO 9283) in mm; default: as in the rig file.",
        ),
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(
            "--history",
            metavar="DIR",
            help="Runs of the robot: also state the day on which growing errors take a feature out; default: none.",
        ),
    ] = None,
    calibration: Calibration = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Page to write, FILE.html; default: none.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Judge whether features of a program hold their tolerance: accept, reject or undecided at 5 % risk.

    The exit code is 1 if a feature is not accepted."""
    from analysis.apps.certify.certificate import certify as certified
    from analysis.apps.certify.certificate_report import write_page
    from analysis.apps.certify.features import features_of
    from analysis.apps.certify.program import programmed_places, targets_of, with_lines
    from analysis.apps.correct.controller_entries import scale_of
    from analysis.apps.correct.stated_frames import frames_of
    from analysis.apps.report.html_page import check_page_file
    from analysis.cli.console import progress_of
    from analysis.cli.several import end_with, with_controller, worst_code
    from rigs.load import load, named_by

    if output:
        check_page_file(output)
    rig, _ = load(with_controller(rig_file, calibration))
    with named_by(rig_file, rig), progress_of("judging the features"):
        of_user = frames_of(rig.robot, tools or (), frames or (), neutral or ())
        listed = targets_of(
            program, rig, of_user, near=near, start=start, load_kg=load_kg, scale=scale_of(scale) if scale else None
        )
        places = programmed_places(listed)
        features, errors = features_of(tolerances or (), table, listed.names, listed.lines, places)
        listed, features, not_driven = with_lines(rig, listed, features)
        drifts = _drifts(history, rig) if history else ()
        judged = certified(rig, listed, features, rp_mm=rp_mm, drifts=drifts)
    errors += not_driven
    _show(program, rig, listed, judged, errors, as_json=as_json)
    if output:
        write_page(judged, listed, output, program.name, rig.name)
        say_written([output])
    given = {"--tool": tools, "--frame": frames, "--neutral": neutral, "--scale": scale, "--start-joints": start,
             "--near": near}  # fmt: skip
    _say_next(rig, rig_file, program, _as_options(given), listed, judged)
    for error in errors:
        say_error(error)
    end_with(worst_code(errors) or int(any(one.now.verdict != "accept" for one in judged)))


def _as_options(given: Mapping[str, Sequence[str] | str | None]) -> str:
    """Options as on the command line, each after a space."""
    values = {option: [value] if isinstance(value, str) else value or () for option, value in given.items()}
    return "".join(f" {option} {shlex.quote(value)}" for option, each in values.items() for value in each)


def _drifts(runs: Path, rig: Rig) -> Sequence[Drift]:
    from analysis.apps.certify.drift import drifts_of
    from analysis.apps.plant.collect import Workers, collect
    from analysis.apps.plant.history import history_of

    return drifts_of(history_of(collect(runs, rig.name, Workers(), lambda *_: None)))


def _show(
    program: Path, rig: Rig, listed: Listed, judged: Sequence[Certified], errors: Sequence[RigError], *, as_json: bool
) -> None:
    from analysis.apps.certify.certificate_report import certificate_answer
    from analysis.apps.report.blocks import say_answer

    # Points between the ends of a line have no line in the file.
    unknown = [(row, why) for row, why in sorted(listed.unknown.items()) if row < len(listed.lines)]
    notes = [f"line {listed.lines[row]}: {listed.names[row]} {why}" for row, why in unknown]
    if as_json:
        counts = Counter(one.now.verdict for one in judged)
        say_json({
            "program": str(program), "rig": rig.name, "is_corrected": listed.is_corrected, **counts,
            "posture": listed.postures and listed.postures.to_dict(),
            "posture_by_near": [listed.lines[row] for row in listed.by_near],
            "features": [one.to_dict() for one in judged], "not_understood": notes,
            "errors": [error.to_dict() for error in errors],
        })  # fmt: skip
    elif judged:
        say_answer(certificate_answer(judged))
    if listed.postures and (stated := listed.postures.stated):
        source = "posture_deg in the rig file" if stated.source == "rig_file" else stated.source
        say(f"{program}: targets in the posture {stated.words} ({source})", err=True, mark="note: ")
    if listed.by_near:
        lines = first_of(sorted({listed.lines[row] for row in listed.by_near}), _MOST_NOTES)
        say(f"{program}: only --near states the posture of the targets in lines {lines}", err=True, mark="note: ")
    for note in notes[:_MOST_NOTES]:
        say(f"{program}: {note}", err=True, mark="note: ")


def _say_next(rig: Rig, rig_file: str, program: Path, given: str, listed: Listed, judged: Sequence[Certified]) -> None:
    """Print the next calls. given: the options of this call that rig correct takes as well."""
    from analysis.apps.makers import maker_of_file
    from analysis.correction.reasons import POSE_OF_UNKNOWN_CONTROLLER

    if gains := sum(one.corrected.verdict == "accept" and one.now.verdict != "accept" for one in judged):
        is_program = program.is_dir() or maker_of_file(program)
        targets = (
            f"--program {as_argument(program)} --points computed" if is_program else f"--path {as_argument(program)}"
        )
        line = f"rig correct {as_argument(rig_file)} {targets}{given} -o corrected"
        say(f"next: {line}  # then {counted(gains, 'more feature')} within tolerance", err=True)
    if listed.is_open or (listed.postures and listed.postures.several):
        say("next: add --near q1,…,q6  # joint angles at one of the targets, which state the posture", err=True)
    undecided = [(one, one.next) for one in judged if one.next and one.corrected.verdict == "undecided"]
    for one, proposed in undecided[:1]:
        gain = f"{one.feature.name} is outside the measured region"
        if proposed.u_mm is not None:
            gain = f"u of {one.feature.name} falls from {proposed.u_mm:.3f} to {proposed.after_mm:.3f} mm"
        say(f"next: {proposed.reading.words}  # {gain}", err=True)
    if any(one.why == POSE_OF_UNKNOWN_CONTROLLER for one in judged):
        say("next: add --calibration FILE  # constants of this controller; data_sheet if it has none", err=True)
    asks_first = rig.calibrated and rig.calibrated.judged and rig.calibrated.judged.measure_first
    if (rig.calibrated is None or asks_first) and any(one.why for one in judged):
        say(f"next: rig plan {as_argument(rig_file)} --next  # the next reading of this arm", err=True)
