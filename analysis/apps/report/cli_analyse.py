"""`rig analyse RUN…`: figures of recorded runs as a table, as JSON or as pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import progress_of, say, say_json, say_written
from analysis.cli.options import AsJson, Calibration, Jobs, RunsBelow, Scheduler, rig_option
from analysis.cli.several import (
    end_with,
    evaluate_paths,
    is_table,
    over_runs,
    runs_below,
    with_controller,
    with_tables,
    worst_code,
)
from rigs.errors import UseError


@command(app, "rig analyse runs/lap-acw runs/lap-cw --plot pictures")
def analyse(
    runs: RunsBelow,
    rig_file: Annotated[
        str | None, rig_option("Rig file, or an arm of the library, of tables in the place of runs; default: none.")
    ] = None,
    calibration: Calibration = None,
    as_json: AsJson = False,
    as_lines: Annotated[
        bool,
        typer.Option(
            "--lines", help="Print one line of JSON per run as soon as the run is evaluated; default: a table."
        ),
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Directory for pictures; default: write none. A page: rig report.")
    ] = None,
    each: Annotated[
        bool, typer.Option("--each", help="Show each run and the mean of repeated runs; default: the means.")
    ] = False,
    truth: Annotated[
        Path | None, typer.Option(help="File truth.json of an emulated cell, shown with the figures; default: none.")
    ] = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
) -> None:
    """Evaluate runs of any test (gauges, poses, touches, paths); every figure has its uncertainty."""

    if (rig_file or calibration) and not any(map(is_table, runs)):
        say("note: --rig and --calibration are for tables; a run contains the rig file of its recording", err=True)
    paths = runs_below(with_tables(runs, with_controller(rig_file, calibration)), scheduler)
    if as_lines:
        if as_json or plot or each or truth:
            problem = "prints a line for each run, and cannot be combined with --json, --plot, --each or --truth"
            raise UseError("--lines", problem, "leave those options out")
        end_with(worst_code(over_runs(_as_line, paths, say, doing="evaluating", jobs=jobs, scheduler=scheduler)))
        return
    drawn = plot is not None or truth is not None
    results, errors = evaluate_paths(paths, jobs=jobs, scheduler=scheduler, with_rows=drawn)
    if not results:
        end_with(worst_code(errors))
        return
    from analysis.apps.report.blocks import say_answer
    from analysis.apps.report.run_answer import as_object, compare, runs_answer

    truths = compare(results, truth) if truth else []
    if plot:
        from analysis.apps.report.picture_files import save_all_pictures

        with progress_of("drawing the pictures"):
            pictures = save_all_pictures(results, plot)
        say_written(pictures)
    if as_json:
        say_json(as_object(results, truths))
    else:
        say_answer(runs_answer(results, truths, each=each))
    end_with(worst_code(errors))


def _as_line(run: Path) -> str:
    from analysis.procedures.results import evaluate_path

    return json.dumps(evaluate_path(run, with_rows=False).to_dict())
