"""`rig calibrate RUN…`: the calibrated model of a robot, as a rig file with its calibration beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, ModelRig, RobotRunsBelow, RunsElsewhere, location


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
            help="Run directory or URL to judge by, not used to fit; repeatable; default: a fifth of the poses.",
        ),
    ] = None,
    unseen: RunsElsewhere = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Rig file to write; NAME.calibration.json comes beside it; default: none."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate the model of the robot from runs, judge it where it had no part, and write it as a rig file."""
    import analysis
    from analysis.cli.diagnose import by_use, say_correct, with_commands_here
    from analysis.cli.progress import progress_of
    from analysis.cli.run_paths import load_runs
    from analysis.cli.several import end_with, worst
    from analysis.reporting.diagnosis_report import hold_new, write_model
    from analysis.reporting.diagnosis_screen import as_screen
    from analysis.reporting.plain_console import PlainConsole
    from rigs.load import load

    if output:
        hold_new(output)
    parts = [load_runs(paths) for paths in by_use(runs, hold_out or (), unseen or ())]
    end_with(worst([error for _, errors in parts for error in errors]))
    measured, judges, elsewhere = (runs_of_use for runs_of_use, _ in parts)
    rig, text = load(rig_file) if rig_file else (measured[0].rig, measured[0].run.manifest.rig_text)
    with progress_of() as progress:
        diagnosis = analysis.calibrate(measured, fit, rig=rig, hold_out=judges, unseen=elsewhere, progress=progress)
    if as_json:
        say_json(diagnosis.to_dict())
    else:
        PlainConsole().print(as_screen(with_commands_here(diagnosis, output, to="calibrated.yaml")))
    for path in write_model(diagnosis, text, output) if output else ():
        say(f"wrote {path}", err=True)
    if output:
        say_correct(diagnosis, output)
