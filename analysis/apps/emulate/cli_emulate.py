"""`rig emulate`, `rig replay` and `rig simulate`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import RigArgument, direction_option, maker_option
from rigs.schema.vocabulary import CIRCLES, OF_ISO9283, Direction, MakerName, SimulatedTest, TestName

HiddenEffects = Annotated[
    str | None,
    typer.Option(
        "--effects",
        metavar="FILE",
        help="YAML file of hidden effects, or the name of a shipped rig; default: the effects of RIG.",
    ),
]


@command(app, "rig emulate ur10e-cell -o cell")
def emulate(
    rig_file: RigArgument,
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for rig.yaml and truth.json.")] = Path(
        "cell"
    ),
    effects: HiddenEffects = None,
    programs: Annotated[
        Path | None,
        typer.Option(help="Directory of robot programs that can be started by name; default: none."),
    ] = None,
    maker: Annotated[
        MakerName | None,
        maker_option(
            "Maker of the emulated controller for --programs",
            "the maker of the robot feedback, or of the first program",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the gauge noise.")] = 1,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print each line as a JSON object: event, name, text.")
    ] = False,
) -> None:
    """Start the gauges and the robot of RIG on ptys and local ports, and serve until stopped.

    Writes rig.yaml, the rig file with these ports for rigd, and truth.json, the
    result of a perfect measurement. Type acw, cw, roll acw, roll cw, radial or
    repeatability to start a built-in program, or run NAME to start one of
    --programs. Type stop, pause or go on to control the program; enter FILE to
    enter the values of rig correct into the emulated controller; quit to end.
    Type show speed_percent 40, for example, to change the reported condition of
    the robot; the motion stays the same.
    """
    from analysis.apps.emulate.served_cell import CellEvent, serve_emulated

    def report(event: CellEvent) -> None:
        say(event.as_line if as_json else event.text)

    raise typer.Exit(
        serve_emulated(rig_file, directory, report, effects=effects, programs=programs, maker=maker, seed=seed)
    )


@command(app, "rig replay cell.log cell.yaml -o replayed")
def replay(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="File written by `rigd --capture`.")],
    rig_file: Annotated[
        str,
        typer.Argument(metavar="RIG", autocompletion=completion.rig_files, help="Rig file used for the capture."),
    ],
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for rig.yaml.")] = Path("replayed"),
) -> None:
    """Serve the instruments of a capture on ptys and local ports, at the times of the capture, until its end.

    Writes rig.yaml, the rig file with these ports for rigd. The replay of all
    instruments starts with the first request of the daemon. A run recorded while
    an instrument is out of step is marked, and rig analyse rejects it.
    """
    from analysis.apps.emulate.served_cell import MARKS, locked_cell, rig_file_of_cell, serve
    from daq.emulators.replay import Replay
    from daq.store import durable
    from daq.wire.capture import read_capture
    from rigs.errors import FileError
    from rigs.load import load

    rig, text = load(rig_file)
    path = rig_file_of_cell(directory)
    capture = read_capture(log)
    lock = locked_cell(directory)
    try:
        played = Replay(rig, capture, directory / MARKS)
        for name, content in rig.companion_files.items():
            durable.replace(directory / name, content)
        durable.replace(path, played.rig_text(text).encode())
    except OSError as error:
        raise FileError.of_os(directory, error, "choose a different --output", code="output.not_writable") from None

    def attend(ends: SimpleQueue[int]) -> int:
        for name, port in played.cell.ports.items():
            say(f"{name}: {port}")
        if capture.cut:
            say(f"{log}: the last line is incomplete and was ignored", err=True)
        say(f"ready; next: rigd {path}")
        while not played.is_finished:
            with suppress(Empty):
                return ends.get(timeout=0.1)
        return 0

    exit_code, sent = serve(played.cell, lock, attend)
    for name, count in sent.items():
        say(f"{name}: {count} pieces sent, {played.steps[name].words()}")
    if played.restarts:
        say(f"restarts from the beginning, because the host left a connection before the end: {played.restarts}")
    if played.unmarked:
        raise FileError(
            str(directory),
            f"cannot mark the runs that are out of step: {played.unmarked}",
            "choose a different --output",
            code="output.not_writable",
        )
    doubt = "; was it captured with a different rig file?" if played.otherwise else ""
    say(f"{played.otherwise} pieces from the host differ from the capture{doubt}")
    raise typer.Exit(exit_code)


@command(app, "rig simulate ur10e-cell --test yaw --times 3 -o simulated")
def simulate(
    rig_file: RigArgument,
    test: Annotated[SimulatedTest, typer.Option(help="Test to simulate.")],
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for the runs.")],
    direction: Annotated[Direction | None, direction_option("Direction of yaw and roll; default: both")] = None,
    times: Annotated[int, typer.Option(min=1, max=1000, help="Number of runs per direction.")] = 1,
    seed: Annotated[
        int, typer.Option(min=0, help="Seed of the noise of the first run; increases by 1 for each further run.")
    ] = 0,
    effects: HiddenEffects = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV tables, not run directories.")] = False,
) -> None:
    """Simulate runs of a test with the effects of a rig: noise of gauges and robot, scatter from run to run.

    --test iso9283 writes two runs as measured by a tracker: the poses of the
    cube, and the paths.
    """
    from functools import partial
    from itertools import product

    import analysis
    from analysis.cli.console import progress_of
    from analysis.runs.written_files import write_csv, write_new

    directions: tuple[Direction | None, ...] = (direction,) if direction else ("acw", "cw")
    if test not in CIRCLES:
        if direction:
            raise typer.BadParameter(f"the {test} test does not have a direction", param_hint="--direction")
        directions = (None,)
    tests: tuple[TestName, ...] = OF_ISO9283 if test == "iso9283" else (test,)
    for number, way, kind in product(range(seed, seed + times), directions, tests):
        with progress_of(f"simulating {test}, seed {number}"):
            run = analysis.simulate(rig_file, kind, way, seed=number, effects=effects)
            path = directory / run.path
            if csv:
                path = path.with_suffix(".csv")
                directory.mkdir(parents=True, exist_ok=True)
                write_new(path, partial(write_csv, run.to_table()))
            else:
                analysis.save_run(run, path)
        say(path)
