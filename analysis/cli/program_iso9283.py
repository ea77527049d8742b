"""`rig program RIG --test iso9283`: the poses and the paths of ISO 9283, and the table that a tracker's rows join."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.cli.console import say
from rigs.schema.vocabulary import MakerName
from rigs.text import as_argument

if TYPE_CHECKING:
    from rigs.rig import Rig


def program_iso9283(rig: Rig, rig_file: str, maker: MakerName, directory: Path, dwell_s: float) -> None:
    """Write the programs, say what the arm does in them, and how what the tracker wrote is imported."""
    from analysis.cli.progress import progress_of
    from analysis.geometry.iso_cube import cube_of
    from analysis.makers.writing import programs_of, write_programs
    from analysis.robot_programs.examine import demand_lines, demand_of, seconds_of
    from analysis.robot_programs.planned import PERCENTS, cube_plan, path_plan
    from rigs.load import named_by

    with named_by(rig_file, rig), progress_of("looking for room and checking the programs"):
        cube = cube_of(rig)
        plans = [cube_plan(rig, dwell_s), *(path_plan(rig, percent) for percent in PERCENTS)]
        demands = [demand_of(plan) for plan in plans]
    paths = write_programs(maker, programs_of(maker, list(zip(plans, demands, strict=True))), directory)
    # Where the cube is, as a rig file states it
    x, y, z = cube.centre_mm
    posture = ", ".join(f"{angle:.4f}" for angle in np.degrees(cube.q[0]))
    stated = f"{{centre_mm: [{x:.6g}, {y:.6g}, {z:.6g}], side_mm: {cube.side_mm:g}, posture_deg: [{posture}]}}"
    keep = "; write it into the rig file, so that every run has the same" if cube.found else ""
    say(f"tests.iso9283: {stated}{keep}", err=True)
    names = [rig.robot.axis_words(axis) for axis in range(1, len(rig.robot.axes) + 1)]
    for plan, demand in zip(plans, demands, strict=True):
        say(f"{plan.name}: {seconds_of(plan) / 60:.0f} min", err=True)
        for line in demand_lines(plan, demand, names):
            say(f"{plan.name}: {line}", err=True)
    for written in paths:
        say(written)
    say(
        "next: a place of the tracker at each stop of the cube; time and place all along each program of paths",
        err=True,
    )
    say(f"  rig import STOPS.csv --rig {as_argument(rig_file)} --test pose -o runs/cube", err=True)
    say(f"  rig import PATH.csv --rig {as_argument(rig_file)} --test path -o runs/path-{PERCENTS[0]}", err=True)
