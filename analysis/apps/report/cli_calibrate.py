"""`rig calibrate RUN…`: the calibrated model of a robot as a rig file and a calibration file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import progress_of, say_written
from analysis.cli.options import AsJson, Calibration, ModelRig, RobotRunsBelow, RunsElsewhere, location
from analysis.cli.several import end_with, worst_code


@command(app, "rig calibrate runs/* -o better.yaml")
def calibrate(
    runs: RobotRunsBelow,
    fit: Annotated[
        str | None,
        typer.Option(
            help="Effects to fit, separated by commas: NAME for all axes, NAME:AXIS for one (docs/simulation.md); "
            "default: those that the runs show."
        ),
    ] = None,
    rig_file: ModelRig = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(
            parser=location,
            autocompletion=completion.runs,
            help="Run directory or URL to judge by, not used to fit; repeatable; default: a fifth of 60 or more.",
        ),
    ] = None,
    unseen: RunsElsewhere = None,
    calibration: Calibration = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Rig file to write; NAME.calibration.json is written to the same directory; default: none.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate the model of a robot, validate it on data not used for the fit, and write a rig file."""
    import analysis
    from analysis.apps.report.cli_diagnose import load_uses, say_correct, say_diagnosis
    from analysis.apps.report.diagnosis_report import refuse_existing_rig, write_model

    if output:
        refuse_existing_rig(output)
    (measured, judges, elsewhere), rig, text, errors = load_uses(
        (runs, hold_out or (), unseen or ()), rig_file, calibration
    )
    end_with(worst_code(errors))
    with progress_of() as progress:
        diagnosis = analysis.calibrate(measured, fit, rig=rig, hold_out=judges, unseen=elsewhere, progress=progress)
    say_diagnosis(diagnosis, output, "calibrated.yaml", as_json=as_json)
    if output:
        say_written(write_model(diagnosis, text, output))
        say_correct(diagnosis, output)
