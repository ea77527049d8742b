"""`rig calibrate RUN…`: known effects estimated, and a rig file that has them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app


@app.command()
def calibrate(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run directories of one robot.")],
    fit: Annotated[
        str,
        typer.Option(
            help="Effects with commas between, as NAME:AXIS (others: docs/simulation.md); a name alone is all axes."
        ),
    ],
    rig_file: Annotated[
        str | None, typer.Option("--rig", help="The model to begin with; without it, the first run's rig file.")
    ] = None,
    hold_out: Annotated[list[Path] | None, typer.Option(help="A run to judge by, not used in the fit.")] = None,
    share: Annotated[float, typer.Option(min=0, max=0.9, help="Of each run's readings, left out to judge.")] = 0.0,
    groups: Annotated[
        bool, typer.Option(help="Leave out whole neighbourhoods of joint space, not single poses.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the choice of what is left out.")] = 0,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="The extended rig file to write.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Estimate known effects by least squares on the simulator, set-up terms always with them."""
    import json  # noqa: PLC0415

    from rich.console import Console  # noqa: PLC0415

    import analysis  # noqa: PLC0415
    from analysis.cli.run_paths import distinct, load_runs  # noqa: PLC0415
    from analysis.reporting import calibration_report  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    if output and output.exists():
        raise FileError(str(output), "is there already", "give another --output, or remove it first")
    aside = distinct(hold_out or ())
    used = [path for path in distinct(runs) if path not in aside]
    if not used:
        raise FileError("--hold-out", "leaves no run to fit", "hold out fewer")
    measured, judges = load_runs(used), load_runs(aside)
    rig, text = load(rig_file) if rig_file else (measured[0].rig, measured[0].run.manifest.rig_text)
    found = analysis.calibrate(measured, fit, rig=rig, hold_out=judges, share=share, groups=groups, seed=seed)
    if output:
        calibration_report.write_rig(found, text, [path.name for path in used], output)
    if as_json:
        typer.echo(json.dumps(found.to_dict(), indent=2))
    else:
        Console().print(calibration_report.as_table(found))
    if output:
        typer.echo(f"wrote {output}", err=True)
