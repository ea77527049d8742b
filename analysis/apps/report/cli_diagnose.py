"""`rig diagnose RUN…`: disagreement of simulation and measurement, and the effects missing in the model.

`rig calibrate RUN…`: the calibrated model of a robot as a rig file and a calibration file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import progress_of, say, say_json, say_written
from analysis.cli.options import (
    AsJson,
    Calibration,
    ModelRig,
    ReadingJobs,
    RobotRunsBelow,
    RunsElsewhere,
    Scheduler,
    location,
)
from analysis.cli.several import (
    end_with,
    is_table,
    load_runs,
    runs_below,
    with_controller,
    with_recorded_controller,
    with_tables,
    worst_code,
)
from rigs.errors import RigError, UseError
from rigs.text import as_argument

if TYPE_CHECKING:
    from analysis import Measured
    from analysis.diagnosis.judge.result import Diagnosis
    from rigs.rig import Rig


@command(app, "rig diagnose runs/* -o found")
def diagnose(
    runs: RobotRunsBelow,
    rig_file: ModelRig = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(
            parser=location,
            autocompletion=completion.runs,
            help="Run directory or URL to judge by, not used to find effects; repeatable; default: none.",
        ),
    ] = None,
    unseen: RunsElsewhere = None,
    calibration: Calibration = None,
    tolerance_um: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1e6,
            help="Largest error of the readings that is accepted, in µm rms; default: the limits of the rig file.",
        ),
    ] = None,
    second: Annotated[
        str | None,
        typer.Option(
            metavar="RIG",
            autocompletion=completion.rig_files,
            help="For touches of two arms: rig file of the arm with the socket; --rig is the arm with the ball; "
            "default: none.",
        ),
    ] = None,
    as_json: AsJson = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR|FILE.html",
            help="Directory for the extended rig file, JSON and picture, or the page of rig report; default: none.",
        ),
    ] = None,
    jobs: ReadingJobs = 1,
    scheduler: Scheduler = None,
) -> None:
    """Find the causes of the error: compare runs with the model, name the missing effects, and verify them."""
    if is_two_arm_table(runs, second):
        two_arms_diagnosed(runs[0], rig_file, second, output, is_alone=not (hold_out or unseen), as_json=as_json)
        return
    import analysis

    # check before any computation; the import of the picture module takes half a second and happens only here
    if output:
        from analysis.apps.report.diagnosis_report import require_empty
        from analysis.apps.report.html_page import is_page

        if not is_page(output):
            require_empty(output)
    uses, rig, text, errors = load_uses(
        (runs, hold_out or (), unseen or ()), rig_file, calibration, jobs=jobs, scheduler=scheduler
    )
    measured, judges, elsewhere = uses
    with progress_of() as progress:
        diagnosis = analysis.diagnose(
            measured, rig=rig, hold_out=judges, unseen=elsewhere, tolerance_um=tolerance_um, progress=progress
        )
    say_diagnosis(diagnosis, output, as_json=as_json)
    if output:
        _write(diagnosis, uses, text, output, errors)
    end_with(worst_code(errors))


def say_diagnosis(diagnosis: Diagnosis, output: Path | None, to: str = "found", *, as_json: bool) -> None:
    """output, to: see `with_commands_here`."""
    from analysis.apps.report.blocks import say_answer
    from analysis.apps.report.diagnosis_answer import diagnosis_answer, plain_object

    if as_json:
        say_json(plain_object(diagnosis))
    else:
        say_answer(diagnosis_answer(with_commands_here(diagnosis, output, to=to)))


def is_two_arm_table(runs: Sequence[Path], second: str | None) -> bool:
    """True for a single table with the joints of two arms. Raises UseError if a second arm is given for other data."""
    has_both = False
    if len(runs) == 1 and is_table(runs[0]):
        from analysis.intake.imports import has_two_arms

        has_both = has_two_arms(runs[0])
    if second and not has_both:
        problem = "is for one table of touches with the joints of a second arm, p1_deg …"
        raise UseError("--second", problem, "leave it out")
    return has_both


def two_arms_diagnosed(
    table: Path, first: str | None, second: str | None, output: Path | None, *, is_alone: bool, as_json: bool
) -> None:
    """Calibrate both arms of a table, as `rig pair` does."""
    from analysis.cli.commands import import_command

    if first is None or second is None or not is_alone:
        problem = "has p1_deg …, the joints of a second arm, which holds the socket"
        remedy = "give the rig files of both arms, and no further runs: --rig FIRST (ball) --second SECOND (socket)"
        raise UseError(str(table), problem, remedy)
    say(f"{table}: touches of two arms, according to the columns; the result is that of rig pair", err=True)
    pair = cast("Callable[..., None]", import_command("pair").callback)
    pair(first_file=first, second_file=second, table=table, output=output, as_json=as_json)


def load_uses(
    paths: Sequence[Sequence[Path]],
    rig_file: str | None,
    calibration: str | None,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
) -> tuple[list[list[Measured]], Rig, str, list[RigError]]:
    """Runs used, held out and elsewhere, the rig file with its text, and errors of unreadable runs.

    Raises UseError if no run is used, and ends the command if none can be read.
    """
    from rigs.load import load

    rig_file = with_controller(rig_file, calibration)
    rig_and_text = load(rig_file) if rig_file else None
    every, judges, elsewhere = ([run.resolve() for run in runs_below(with_tables(given, rig_file))] for given in paths)
    used = [path for path in every if path not in {*judges, *elsewhere}]
    if not used:
        problem = "exclude every run"
        raise UseError("--hold-out and --unseen", problem, "give fewer runs to these options", code="usage")
    loaded = [load_runs(group, jobs=jobs, scheduler=scheduler) for group in (used, judges, elsewhere)]
    uses, errors = [runs for runs, _ in loaded], [error for _, bad in loaded for error in bad]
    if not uses[0]:
        end_with(worst_code(errors))
    rig, text = rig_and_text or (uses[0][0].rig, uses[0][0].run.manifest.rig_text)
    return uses, *with_recorded_controller(rig, text, uses[0]), errors


def with_commands_here(
    diagnosis: Diagnosis, output: Path | None, again: tuple[str, ...] = (), to: str = "found"
) -> Diagnosis:
    """Acts with commands that refer to the written model: `output`, or the rig file in that directory.

    If no output was requested, they refer to a new file named after `to`, which the command `again` or the present one
    would write.
    """
    from analysis.diagnosis.judge.acts import acts_with

    model = ""
    if output and output.suffix != ".html":
        model = as_argument(output if output.suffix == ".yaml" else output / f"{diagnosis.rig.name}.yaml")
    new = next(name for k in count(1) if not (name := Path(to).with_stem(Path(to).stem + f"-{k}" * (k > 1))).exists())
    words = iter(map(as_argument, sys.argv[1:]))
    again = again or tuple(word for word in words if word not in ("-o", "--output") or not next(words, ""))
    again = (*again, "-o", str(new))
    return replace(diagnosis, acts=acts_with(diagnosis.acts, model, again))


def _write(
    diagnosis: Diagnosis, by_use: Sequence[list[Measured]], text: str, output: Path, errors: Sequence[RigError]
) -> None:
    """by_use: the runs used, held out, and unseen."""
    from analysis.apps.report.html_page import is_page

    if is_page(output):
        from analysis import evaluate_runs
        from analysis.apps.report.page.write_page import gather, write_page

        with progress_of() as progress:
            results = evaluate_runs(by_use[0])
            diagnosed = with_commands_here(diagnosis, output)
            report = gather(results, diagnosis.rig, diagnosis=diagnosed, left_out=errors, progress=progress)
            written = [write_page(report, output)]
    else:
        from analysis.apps.report.diagnosis_report import write

        written = write(diagnosis, text, output)
    say_written(written)
    if written[-1].suffix == ".yaml":
        model = written[-1]
        runs = _as_arguments(*([run.run.path for run in runs] for runs in by_use))
        say(f"next: rig diagnose {runs} --rig {as_argument(model)}  # verify that the model is complete", err=True)
        say_correct(diagnosis, model)


def _as_arguments(used: Sequence[Path], held_out: Sequence[Path], unseen: Sequence[Path]) -> str:
    """Runs as command-line arguments, or their directory if all runs in it are used."""

    directory, current = used[0].parent, Path.cwd()
    is_whole = (
        len(used) > 1
        and not any(path.is_file() for path in used)
        and {path.resolve() for path in runs_below([directory])} <= {*used, *held_out, *unseen}
    )
    uses = ([directory] if is_whole else used, held_out, unseen)
    return " ".join(
        f"{option}{as_argument(path.relative_to(current) if path.is_relative_to(current) else path)}"
        for option, paths in zip(("", "--hold-out ", "--unseen "), uses, strict=True)
        for path in paths
    )


def say_correct(diagnosis: Diagnosis, model: Path) -> None:
    from rigs.calibration import verdict_of

    calibrated, first = diagnosis.calibrated, diagnosis.next_act
    if calibrated and first and first.why in ("elsewhere", "few_runs") and diagnosis.rig.robot.rail is None:
        say(f"next: rig plan {as_argument(model)} --next  # the reading that helps most", err=True)
    kinds = [act.kind for act in diagnosis.acts if act.kind in ("check", "load")]
    is_correctable = kinds[:1] == ["load"]  # a wrong parameter is checked before a correction hides it
    holds_some = is_correctable and bool(diagnosis.written or (calibrated and calibrated.effects))
    if holds_some and (calibrated is None or verdict_of(calibrated) == "correct"):
        say(f"next: rig correct {as_argument(model)} -o corrections", err=True)


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
    fix: Annotated[
        str | None,
        typer.Option(help="Effects of --fit that are not fitted, in the same notation; default: none."),
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
    from analysis.correction.model_files import refuse_existing_rig, write_model

    if output:
        refuse_existing_rig(output)
    (measured, judges, elsewhere), rig, text, errors = load_uses(
        (runs, hold_out or (), unseen or ()), rig_file, calibration
    )
    end_with(worst_code(errors))
    with progress_of() as progress:
        diagnosis = analysis.calibrate(
            measured, fit, fix=fix, rig=rig, hold_out=judges, unseen=elsewhere, progress=progress
        )
    say_diagnosis(diagnosis, output, "calibrated.yaml", as_json=as_json)
    if output:
        say_written(write_model(diagnosis, text, output))
        say_correct(diagnosis, output)
