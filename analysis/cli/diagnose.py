"""`rig diagnose RUN…`: where simulation and measurement disagree, and which effect is missing in the model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from analysis.cli import app
from analysis.cli.console import say, say_json


@app.command()
def diagnose(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN…", help="Run directories of one robot.")],
    rig_file: Annotated[
        str | None, typer.Option("--rig", help="Rig file of the model to start from; default: that of the first run.")
    ] = None,
    hold_out: Annotated[
        list[Path] | None,
        typer.Option(help="Run directory to judge by, not used to find effects; repeatable; default: none."),
    ] = None,
    unseen: Annotated[
        list[Path] | None,
        typer.Option(help="Run directory at another place or radius, to judge by; repeatable; default: none."),
    ] = None,
    tolerance_um: Annotated[
        float | None,
        typer.Option(
            min=0.0, help="Smallest change of readings, in µm, worth a name; default: the scatter of one run."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Directory for the extended rig file, JSON and picture; default: write none.",
        ),
    ] = None,
) -> None:
    """Find where simulation and measurement differ, name the missing effects, and verify that they close the gap."""

    import analysis  # noqa: PLC0415
    from analysis.cli.run_paths import distinct, load_runs  # noqa: PLC0415
    from analysis.reporting import diagnosis_report  # noqa: PLC0415
    from analysis.reporting.diagnosis_screen import as_screen  # noqa: PLC0415
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415
    from rigs.errors import FileError  # noqa: PLC0415
    from rigs.load import load  # noqa: PLC0415

    if output:
        diagnosis_report.hold_empty(output)
    held, other = distinct(hold_out or ()), distinct(unseen or ())
    used = [path for path in distinct(runs) if path not in held | other]
    if not used:
        raise FileError(
            "RUN…", "is held out or unseen, like every other run, and a diagnosis needs at least one", "hold out fewer"
        )
    measured, judges, elsewhere = (load_runs(paths) for paths in (used, held, other))
    rig, text = load(rig_file) if rig_file else (measured[0].rig, measured[0].run.manifest.rig_text)
    with _progress(quiet=as_json) as progress:
        found = analysis.diagnose(
            measured, rig=rig, hold_out=judges, unseen=elsewhere, tolerance_um=tolerance_um, progress=progress
        )
    if as_json:
        say_json(found.to_dict())
    else:
        PlainConsole().print(as_screen(found))
    written = diagnosis_report.write(found, text, output) if output else []
    for path in written:
        say(f"wrote {path}", err=True)
    if written and written[-1].suffix == ".yaml":
        model = written[-1]
        say(f"next: rig diagnose RUN… --rig {model}, or rig correct {model} -o corrections", err=True)


@contextmanager
def _progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """What to call with what is being done: shown on a terminal and nowhere else."""
    from analysis.reporting.plain_console import PlainConsole  # noqa: PLC0415

    console = PlainConsole(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda doing: None
        return
    with console.status("reading the runs") as status:
        yield status.update
