"""`rig simulate RIG`: what the gauges would read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.emulate import HiddenEffects
from analysis.cli.options import RigArgument, direction_option
from rigs.schema.vocabulary import CIRCLES, OF_ISO9283, Direction, SimulatedTest, TestName


@command(app, "rig simulate ur10e --test yaw --times 3 -o simulated")
def simulate(
    rig_file: RigArgument,
    test: Annotated[SimulatedTest, typer.Option(help="Test to simulate.")],
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory to write the runs to.")],
    direction: Annotated[Direction | None, direction_option("Direction of yaw and roll; default: both")] = None,
    times: Annotated[int, typer.Option(min=1, max=1000, help="Number of runs in each direction.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise of the first run; each further run adds 1.")] = 0,
    effects: HiddenEffects = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write CSV tables instead of run directories.")] = False,
) -> None:
    """Simulate runs of a test with the effects of a rig: noise of gauges and robot, scatter from run to run.

    iso9283 are two runs: the poses of the cube and the paths, as a tracker sees them.
    """
    from functools import partial
    from itertools import product

    import analysis
    from analysis.cli.progress import progress_of
    from analysis.files.write import write_csv, write_new

    directions: tuple[Direction | None, ...] = (direction,) if direction else ("acw", "cw")
    if test not in CIRCLES:
        if direction:
            raise typer.BadParameter(f"the {test} test has no direction", param_hint="--direction")
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
