"""`rig circle fit` and `rig ball fit`: circle and ball of a rig file, found from the motion of the robot."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from analysis.cli import completion
from analysis.cli.commands import CommandGroup, app, command
from analysis.cli.console import say
from analysis.cli.options import AsJson
from rigs.errors import FileError, RigPlace, UseError

if TYPE_CHECKING:
    from analysis.apps.commission.cli_fitted_test import FittedTest, RigFile
    from analysis.runs.loading import RobotMotion
    from daq.store import Run
    from rigs.edit import Values
    from rigs.rig import Rig

circle = typer.Typer(
    cls=CommandGroup, no_args_is_help=True, help="Fit the circle of a rig file to recorded robot motion."
)
app.add_typer(circle, name="circle")
ball = typer.Typer(
    cls=CommandGroup, no_args_is_help=True, help="Fit the ball position of the hemisphere test to recorded robot poses."
)
app.add_typer(ball, name="ball")

RigToWrite = Annotated[
    str | None,
    typer.Option(
        "--rig",
        autocompletion=completion.rig_files,
        help="Rig file to complete; default: the rig file of the first run.",
    ),
]
Write = Annotated[bool, typer.Option("--write", help="Write the result to the rig file and keep the old file.")]


@command(circle, "rig circle fit runs/lap-acw --rig cell.yaml --write")
def fit(
    runs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RUN…", autocompletion=completion.runs, help="Run directories of one circle."),
    ] = None,
    rig_file: RigToWrite = None,
    live: Annotated[bool, typer.Option("--live", help="Use the running daemon instead, until Ctrl-C.")] = False,
    write: Write = False,
    as_json: AsJson = False,
) -> None:
    """Find centre, normal, radius, start and posture of a circle, each with its uncertainty.

    The robot drove the circle, whole or in part, or stood at three or more points
    of it for a second each. Gauges need not be connected. With --live, jog or
    lead the robot while rigd runs, and press Ctrl-C at the end.
    """
    import numpy as np

    from analysis.apps.commission.cli_fitted_test import FittedTest, print_or_write, rig_file_to_write
    from analysis.apps.commission.driven_circle import driven_circle
    from analysis.runs.batch import distinct
    from analysis.runs.loading import motion_in

    if bool(runs) == live:
        problem = "recorded runs and --live cannot be combined" if live else "runs to fit are missing"
        raise UseError("rig circle fit", problem, "give run directories or --live", code="usage")
    named = rig_file_to_write(rig_file, write)
    if live:
        motions, to = _watched(named)
    else:
        recorded, to = _of_one_robot(distinct(runs or []), named)
        motions = [motion_in(run) for run in recorded]
    driven = driven_circle(motions, to.rig)
    u = {
        "centre_mm": driven.u_centre_mm.tolist(),
        "normal": [float(np.degrees(np.sqrt(np.linalg.eigvalsh(driven.normal_cov)[-1])))],
        "radius_mm": [driven.u_radius_mm],
        "zero": [float(np.degrees(driven.u_zero))],
    }
    fitted = FittedTest("circle", driven.values(), u, driven.used, driven.doubts)
    print_or_write(fitted, to, write=write, as_json=as_json)


@command(ball, "rig ball fit runs/hemisphere --rig cell.yaml --write", name="fit")
def fit_ball(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN…", autocompletion=completion.runs, help="Radial runs about the ball, or runs of the circle."
        ),
    ],
    rig_file: RigToWrite = None,
    write: Write = False,
    as_json: AsJson = False,
) -> None:
    """Find the centre of the hemisphere, which is the ball's, with its uncertainty.

    In a radial run the robot stood at four or more places on a sphere about the
    ball: held by the link, or touching the ball. A yaw or roll run shows the same
    ball as the centre of its circle.
    """
    from analysis.apps.commission.cli_fitted_test import FittedTest, print_or_write, rig_file_to_write
    from analysis.apps.commission.touched_ball import touched_ball
    from analysis.runs.batch import distinct
    from rigs.schema.vocabulary import CIRCLES

    recorded, to = _of_one_robot(distinct(runs), rig_file_to_write(rig_file, write))
    circles = [run.manifest.test in CIRCLES for run in recorded]
    if any(circles) != all(circles):
        where = ", ".join(str(run.path) for run in recorded)
        problem = "circle runs and hemisphere runs are mixed"
        raise FileError(where, problem, "give runs of the same kind", code="readings.unsuitable")
    if all(circles):
        fitted = _ball_of_circle(recorded, to.rig)
    else:
        ball = touched_ball(recorded, to.rig)
        fitted = FittedTest("hemisphere", ball.values, {"centre_mm": ball.u_centre_mm.tolist()}, ball.used, ball.doubts)
    print_or_write(fitted, to, write=write, as_json=as_json)


def _ball_of_circle(runs: Iterable[Run], rig: Rig) -> FittedTest:
    from analysis.apps.commission.cli_fitted_test import FittedTest
    from analysis.apps.commission.driven_circle import driven_circle
    from analysis.runs.loading import motion_in

    driven = driven_circle([motion_in(run) for run in runs], rig)
    if rig.tests.hemisphere is None:
        problem = "the rig file lacks tests.hemisphere, and a circle does not show the posture at the pole"
        remedy = "add tests.hemisphere with posture_deg, or give a radial run"
        raise FileError(RigPlace.of(rig.name), problem, remedy, code="rig_file.invalid")
    values: Values = {"centre_mm": [round(float(x), 3) for x in driven.circle.centre]}
    u, used = {"centre_mm": driven.u_centre_mm.tolist()}, f"the circle's centre: {driven.used}"
    return FittedTest("hemisphere", values, u, used, driven.doubts)


def _of_one_robot(paths: Iterable[Path], named: RigFile | None) -> tuple[list[Run], RigFile]:
    from analysis.apps.commission.cli_fitted_test import RigFile
    from daq.store import read_run

    runs = [read_run(path) for path in paths]
    to = named or RigFile(_rig_in(runs[0]), runs[0].manifest.rig_text, None)
    for run in runs:
        _check_same_robot(str(run.path), _rig_in(run), to.rig)
    return runs, to


def _rig_in(run: Run) -> Rig:
    from rigs.load import parse

    return parse(run.manifest.rig_text, f"{run.path}, rig file")


def _check_same_robot(where: str, run_rig: Rig, rig: Rig) -> None:
    from analysis.diagnosis.evidence.placements import same_arm
    from analysis.robot.kinematics.arm import arm_of

    if not same_arm(arm_of(run_rig.robot), arm_of(rig.robot)):
        problem = f"belongs to a different robot than {rig.name}: the link constants differ"
        raise FileError(where, problem, "use a rig file and a motion of the same robot", code="robot.other")


def _watched(named: RigFile | None) -> tuple[list[RobotMotion], RigFile]:
    """Motion until Ctrl-C, and the named rig or else that of the daemon."""
    from analysis.apps.commission.cli_fitted_test import RigFile, u_written
    from analysis.apps.commission.driven_circle import driven_circle
    from analysis.apps.commission.joint_samples import served_rig, watched_motion
    from daq.service.client import Client, find_socket

    with Client(find_socket(named.rig.name if named else None)) as client:
        served = RigFile(*served_rig(client), None)
        to = named or served
        rig = to.rig
        _check_same_robot("the running daemon", served.rig, rig)

        def show(motion: RobotMotion) -> None:
            try:
                driven = driven_circle([motion], rig)
                u, centre = u_written([driven.u_centre_mm.max()], " mm"), driven.circle.centre.round(2).tolist()
                state = f"{driven.used}: radius {driven.circle.radius:.2f} mm about {centre}, u {u}"
            except FileError as error:
                state = error.what
            say(f"{motion.t_s[-1]:.0f} s: {state}", err=True)

        say("jog or guide the robot now, and rest for a second at each point; Ctrl-C ends", err=True)
        return [watched_motion(client, "the robot", show)], to
