"""`rig program RIG`: write the robot programs of a test, which the operator loads on the controller."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli.commands import app, command
from analysis.cli.console import say
from analysis.cli.options import Anyway, RigArgument, maker_option
from rigs.schema.vocabulary import CIRCLES, MakerName, ProgramTest
from rigs.text import as_argument

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analysis.apps.makers.motion_plan import MotionPlan
    from rigs.rig import Rig


_DWELL_S = 3.0
"""Default standstill at each target, in s. Arms settle within a second, and slow gauges deliver several readings."""


@command(app, "rig program paper-fanuc --for fanuc --test yaw -o programs")
def program(
    rig_file: RigArgument,
    maker: Annotated[MakerName, maker_option("Maker of the controller")],
    test: Annotated[
        ProgramTest,
        typer.Option(
            help="Test to run. yaw and roll use the same circle with differently mounted gauges; iso9283: the "
            "poses and paths of ISO 9283, for a tracker."
        ),
    ],
    directory: Annotated[Path, typer.Option("--output", "-o", help="Directory for the programs.")],
    dwell_s: Annotated[
        float | None,
        typer.Option(
            min=0.5, max=600, help="Seconds at rest at each target of radial, repeatability and iso9283; default: 3."
        ),
    ] = None,
    arc_deg: Annotated[
        float | None,
        typer.Option(
            min=1.0,
            max=90.0,
            help="Longest arc of a circle in degrees, shorter where the targets are to be corrected; default: 90.",
        ),
    ] = None,
    outputs: Annotated[
        str,
        typer.Option(
            help="Digital outputs for the signal of automatic runs, least significant first, separated by "
            "commas; default: the outputs in the rig file."
        ),
    ] = "",
    targets: Annotated[
        bool,
        typer.Option("--targets", help="Also write the targets, TEST-path.csv, as a table for rig correct --path."),
    ] = False,
    path: Annotated[
        Path | None,
        typer.Option(help="Table of the targets corrected by rig correct --path; default: the nominal targets."),
    ] = None,
    anyway: Anyway = False,
) -> None:
    """Write the robot programs of a test, after a check of limits, singularities and turns; the robot is not moved."""
    from analysis.apps.makers.writing import feedback_note
    from analysis.apps.programs.compensated import table_of
    from analysis.apps.programs.planned import LONGEST_ARC_DEG, plans_of
    from analysis.apps.programs.target_path import compensated_plans
    from analysis.cli.console import progress_of
    from rigs.errors import UseError
    from rigs.load import load, named_by
    from rigs.readiness import missing_gauges

    if dwell_s is not None and test in CIRCLES:
        raise typer.BadParameter(f"the {test} program has no targets to rest at", param_hint="--dwell-s")
    if arc_deg is not None and test not in CIRCLES:
        raise typer.BadParameter(f"the {test} program does not drive a circle", param_hint="--arc-deg")
    rig, _ = load(rig_file)
    dwell_s = dwell_s or _DWELL_S
    if test == "iso9283":
        if path or targets or outputs:
            problem = "applies only to tests with the ball link; correct planned poses with rig correct --path"
            raise UseError("--path, --targets and --outputs", problem, "remove it")
        _of_iso9283(rig, rig_file, maker, directory, dwell_s)
        return
    with named_by(rig_file, rig), progress_of("checking the programs"):
        nominal = plans_of(rig, test, dwell_s, _numbers(outputs), LONGEST_ARC_DEG if arc_deg is None else arc_deg)
        plans = compensated_plans(nominal, path, rig, rig_file, anyway=anyway) if path else nominal
    paths = _write(rig, maker, plans, directory, {f"{test}-path.csv": table_of(nominal)} if targets else {})
    for missing in missing_gauges(rig, test):
        say(f"the rig file {missing.problem}, so this test is not possible yet; {missing.remedy}", err=True)
    if rig.gauges.recorded:
        say(feedback_note(maker, rig.feedback), err=True)
    for written in paths:
        say(written)


def _of_iso9283(rig: Rig, rig_file: str, maker: MakerName, directory: Path, dwell_s: float) -> None:
    """Write the programs, and print the cube found and the commands for importing the tracker data."""
    import numpy as np

    from analysis.apps.makers.motion_plan import seconds_of
    from analysis.apps.programs.planned import PERCENTS, cube_plan, path_plan
    from analysis.cli.console import progress_of
    from analysis.robot.geometry.iso_cube import cube_of
    from rigs.load import named_by

    with named_by(rig_file, rig), progress_of("searching for a suitable cube and checking the programs"):
        cube = cube_of(rig)
        plans = [cube_plan(rig, dwell_s), *(path_plan(rig, percent) for percent in PERCENTS)]
    paths = _write(rig, maker, plans, directory)
    # Position of the cube in the notation of a rig file
    x, y, z = cube.centre_mm
    posture = ", ".join(f"{angle:.4f}" for angle in np.degrees(cube.q[0]))
    stated = f"{{centre_mm: [{x:.6g}, {y:.6g}, {z:.6g}], side_mm: {cube.side_mm:g}, posture_deg: [{posture}]}}"
    keep = "; to use it for every run, write it into the rig file" if cube.found else ""
    say(f"tests.iso9283: {stated}{keep}", err=True)
    for plan in plans:
        say(f"{plan.name}: {seconds_of(plan) / 60:.0f} min", err=True)
    for written in paths:
        say(written)
    measure = "the tracker position at each stop of the cube; and time and position along each path program"
    say(f"next: measure {measure}", err=True)
    say(f"  rig import STOPS.csv --rig {as_argument(rig_file)} --test pose -o runs/cube", err=True)
    say(f"  rig import PATH.csv --rig {as_argument(rig_file)} --test path -o runs/path-{PERCENTS[0]}", err=True)


def _write(
    rig: Rig, maker: MakerName, plans: Sequence[MotionPlan], directory: Path, tables: dict[str, str] | None = None
) -> list[Path]:
    """Write the programs and tables, and print the demand of each plan on the arm."""
    from analysis.apps.makers.motion_plan import demand_lines, demand_of
    from analysis.apps.makers.writing import programs_of, write_programs

    demands = [(plan, demand_of(plan)) for plan in plans]
    paths = write_programs(maker, programs_of(maker, demands) | (tables or {}), directory)
    names = [rig.robot.axis_words(axis) for axis in range(1, len(rig.robot.axes) + 1)]
    for plan, demand in demands:
        for line in demand_lines(plan, demand, names):
            say(f"{plan.name}: {line}", err=True)
    return paths


def _numbers(text: str) -> tuple[int, ...]:
    try:
        numbers = tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a list of numbers", param_hint="--outputs") from None
    if len(set(numbers)) < len(numbers) or any(number < 0 for number in numbers):
        raise typer.BadParameter(f"{text!r} is not a list of different outputs", param_hint="--outputs")
    return numbers
