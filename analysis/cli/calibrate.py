"""`rig calibrate RUN…`: the calibrated model of a robot as a rig file and a calibration file; `rig versions RIG`:
list and restore calibrations of a robot.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say, say_json, say_written
from analysis.cli.options import AsJson, ModelRig, RobotRunsBelow, RunsElsewhere, location
from rigs.text import as_argument


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
    from analysis.cli.console import progress_of
    from analysis.cli.diagnose import say_correct, split_by_role, with_commands_here
    from analysis.cli.several import end_with, load_runs, with_tables, worst
    from analysis.report.diagnosis_report import refuse_existing_rig, write_model
    from analysis.report.diagnosis_screen import as_screen
    from analysis.report.plain_console import PlainConsole
    from rigs.load import load

    if output:
        refuse_existing_rig(output)
    runs, hold_out, unseen = (with_tables(paths or (), rig_file) for paths in (runs, hold_out, unseen))
    parts = [load_runs(paths) for paths in split_by_role(runs, hold_out or (), unseen or ())]
    end_with(worst([error for _, errors in parts for error in errors]))
    measured, judges, elsewhere = (runs_of_use for runs_of_use, _ in parts)
    rig, text = load(rig_file) if rig_file else (measured[0].rig, measured[0].run.manifest.rig_text)
    with progress_of() as progress:
        diagnosis = analysis.calibrate(measured, fit, rig=rig, hold_out=judges, unseen=elsewhere, progress=progress)
    if as_json:
        say_json(diagnosis.to_dict())
    else:
        PlainConsole().print(as_screen(with_commands_here(diagnosis, output, to="calibrated.yaml")))
    say_written(write_model(diagnosis, text, output) if output else ())
    if output:
        say_correct(diagnosis, output)


@command(app, "rig versions cell.yaml --back-to found-march/cell.yaml")
def versions(
    rig_file: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file that is in use.")],
    folder: Annotated[
        Path | None,
        typer.Option("--in", metavar="FOLDER", help="Folder of the versions; default: the folder of the rig file."),
    ] = None,
    back_to: Annotated[
        Path | None,
        typer.Option(
            metavar="RIG", help="Version that replaces the rig file; the old rig file is kept; default: none."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the calibrations of a robot, newest first, or restore an earlier one.

    Use rig compare to see the differences between two calibrations.
    """
    from analysis.correction.versions import roll_back
    from analysis.correction.versions import versions as versions_in
    from analysis.report.listings import version_object, versions_table
    from analysis.report.plain_console import PlainConsole

    if back_to is not None:
        done = roll_back(rig_file, back_to, dt.datetime.now(dt.UTC))
        say(f"{rig_file} now contains {back_to}; the previous file is kept as {done.kept}")
        if done.differing:
            which = f"this also changed other keys of the rig file: {', '.join(done.differing)}"
            say(f"{which}; compare with {done.kept.name}", err=True, mark="note: ")
        say("next: repeat the correction of targets and programs: rig correct", err=True)
        return
    versions_here = versions_in(rig_file, folder or rig_file.parent)
    if as_json:
        say_json({"versions": [version_object(version) for version in versions_here]})
        return
    PlainConsole().print(versions_table(versions_here))
    if others := [version for version in versions_here if not version.in_use]:
        say(f"next: rig compare {as_argument(rig_file)} {as_argument(others[0].path)}", err=True)
