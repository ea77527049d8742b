"""`rig record touch`: the user seats the ball, the daemon delivers the joint angles, and a tone confirms each touch."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from analysis.apps.commission.touched_ball import Touching
from analysis.procedures.shared.simulated_touches import touch_of
from analysis.robot.geometry.pose_setup import moved_by
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.csv_tables import columns_of
from analysis.runs.table_layout import joint_columns
from analysis.runs.written_files import refuse_existing
from daq import clock
from daq.store import table_run, write_table_run
from rigs.errors import CellError, FileError, RigError, RigPlace
from rigs.load import parse
from rigs.rig import Rig

_POLL_S = 0.1
_SILENT_S = 5.0
"""Time without a new joint angle after which the robot is silent."""
_FEWEST = 6
"""Minimum number of touches worth keeping."""
TONE = "\a"
"""The terminal bell."""


class SampleSource(Protocol):
    """Source of samples."""

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Send a request and return the response. Raises RigError."""


def record_touches(
    daemon: SampleSource,
    name: str,
    output: Path,
    operator: str,
    placement: str,
    touches: int | None,
    say: Callable[[str], None],
) -> Path:
    """Guide the user through the touches, write a run to `output` and return the path.

    Raises FileError if the rig file has no tests.touch, if `output` exists, or after fewer than six touches. Raises
    CellError if the robot is silent.
    """
    refuse_existing(output)
    answer = daemon.ask("samples", after={}, rig=True)
    text = "\n".join(answer["rig_lines"]) + "\n"
    rig = parse(text, "the rig file of rigd")
    touch = touch_of(rig)
    if rig.robot.rail:
        problem = "is on a rail, and rigd does not read the position of the rail"
        raise FileError(
            RigPlace.of(rig.name), problem, "remove robot.rail if the rail does not move, or import touches as a table"
        )
    ball = moved_by(np.eye(4), np.array(touch.ball_mm), np.zeros(3))
    arm = arm_of(rig.robot)
    arm = replace(arm, T_flange_tool=arm.T_flange_tool @ ball)
    guide = Touching(arm, touch.sockets, touches or touch.touches)
    try:
        with suppress(KeyboardInterrupt):
            _follow(daemon, rig, guide, say)
    except RigError:
        if guide.count >= _FEWEST:  # the robot became silent: keep the completed touches
            say(f"{_written(guide, name, output, rig, text, operator, placement)}: {guide.count} touches were saved")
        raise
    if guide.count < _FEWEST:
        problem = f"only {guide.count} touches were made; at least {_FEWEST} are needed"
        raise FileError(str(output), problem, "touch each socket in many postures")
    return _written(guide, name, output, rig, text, operator, placement)


def _written(guide: Touching, name: str, output: Path, rig: Rig, text: str, operator: str, placement: str) -> Path:
    table = columns_of(guide.table)
    digest = hashlib.sha256(repr(table.to_pydict()).encode()).hexdigest()
    run = table_run(
        output, table, test="touch", direction=None, rig_name=rig.name, rig_text=text, operator=operator,
        source=f"touches of {name}", source_sha256=digest, placement=placement,
    )  # fmt: skip
    write_table_run(run, output, {})
    return output


def joint_samples(daemon: SampleSource, axes: int) -> Iterator[tuple[float, list[float]]]:
    """Yield time in s and joint angles in degrees of each new sample of the robot, without end.

    Raises CellError if the robot is silent.
    """
    names = joint_columns(axes)
    after: dict[str, int] = {}
    heard_s = clock.now_s()
    while True:
        robot = daemon.ask("samples", after=after)["streams"].get("robot")
        rows = robot["rows"] if robot else []
        if robot and rows:
            after, heard_s = {"robot": robot["newest"]}, clock.now_s()
            places = [1 + robot["columns"].index(name) for name in names]
            for row in rows:
                angles = [row[place] for place in places]
                if all(angle is not None for angle in angles):
                    yield row[0] / 1e9, angles
        elif clock.now_s() - heard_s > _SILENT_S:
            raise CellError(
                "robot", f"joint angles missing for {_SILENT_S:.0f} s", "run rig doctor, then repeat the command"
            )
        clock.sleep(_POLL_S)


def _follow(daemon: SampleSource, rig: Rig, guide: Touching, say: Callable[[str], None]) -> None:
    """Poll the joint angles until every socket has enough touches."""
    say(f"socket {guide.socket}: seat the ball, let go, and wait for the tone; then change elbow and wrist")
    for t_s, angles in joint_samples(daemon, len(rig.robot.axes)):
        _tell(guide, t_s, angles, say)
        if not guide.socket:
            return


def _tell(guide: Touching, t_s: float, angles: list[float], say: Callable[[str], None]) -> None:
    socket, number = guide.socket, guide.number
    match guide.feed(t_s, angles):
        case "seated":
            say(f"{TONE}socket {socket}: touch {number} of {guide.each}")
            if guide.socket and guide.socket != socket:
                say(f"now socket {guide.socket}: place the ball in that socket")
        case "elsewhere":
            say(f"the robot is at rest, but by the arm the ball is not in socket {socket}: seat the ball, or continue")
        case "same posture":
            say("the posture is that of the previous touch: turn elbow or wrist and keep the ball in the socket")
        case "nothing":
            pass
