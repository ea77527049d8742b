"""`rig calibrate RUN…`: known effects estimated, and a rig file that has them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app, completion
from analysis.cli.commands import command
from analysis.cli.console import say, say_json
from analysis.cli.options import AsJson, ModelRig, RobotRuns


@command(app, "rig calibrate runs/* --fit EFFECT -o fitted.yaml")
def calibrate(
    runs: RobotRuns,
    fit: Annotated[
        str,
        typer.Option(
            help="Effects to fit, separated by commas: NAME for all axes, NAME:AXIS for one; see docs/simulation.md."
        ),
    ],
    rig_file: ModelRig = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(
            autocompletion=completion.runs,
            help="Run directory to judge the fit by, not used in it; repeatable; default: none.",
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(min=0, max=0.9, help="Share of the readings of each run to judge the fit by, not used in it."),
    ] = 0.0,
    groups: Annotated[bool, typer.Option(help="Make --share leave out whole neighbourhoods of joint space.")] = False,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random choice that --share makes.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Rig file to write, extended by the fitted effects; default: none."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Estimate the sizes of chosen effects by least squares on the simulator; the set-up is always fitted as well."""

    import analysis  # noqa: PLC0415
    from analysis.cli.progress import progress_of  # noqa: PLC0415
    from analysis.cli.run_paths import distinct, load_runs  # noqa: PLC0415
    from analysis.cli.several import end_with, worst  # noqa: PLC0415
    from analysis.reporting import calibration_report  # noqa: PLC0415
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415
    from rigs.errors import FileError, UseError  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    if groups and not share:
        raise UseError("--groups", "says how --share chooses, and is allowed only with it", "add --share 0.3, say")
    if output and output.exists():
        raise FileError(str(output), "exists already", "give another --output, or remove it first")
    aside = distinct(hold_out or ())
    used = [path for path in distinct(runs) if path not in aside]
    if not used:
        raise UseError("--hold-out", "holds out every run, and a fit needs one", "hold out fewer")
    (measured, bad), (judges, worse) = load_runs(used), load_runs(aside)
    end_with(worst([*bad, *worse]))
    rig, text = load(rig_file) if rig_file else (measured[0].rig, measured[0].run.manifest.rig_text)
    with progress_of(f"fitting {fit} to {len(measured)} runs"):
        found = analysis.calibrate(measured, fit, rig=rig, hold_out=judges, share=share, groups=groups, seed=seed)
    if output:
        calibration_report.write_rig(found, text, [path.name for path in used], output)
    if as_json:
        say_json(found.to_dict())
    else:
        PlainConsole().print(calibration_report.as_table(found))
    if output:
        say(f"wrote {output}", err=True)
