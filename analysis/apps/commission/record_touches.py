"""Touches taken while the user seats the ball, and the joint angles that a running daemon delivers for them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from analysis.apps.commission.touched_ball import RestDetector, Touching
from analysis.procedures.simulate import touch_of, with_ball
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.runs.loading import RobotMotion
from analysis.runs.tables import TouchTable, columns_of, joint_columns
from analysis.runs.written_files import refuse_existing
from daq import clock
from daq.store import table_run, write_table_run
from rigs.errors import CellError, FileError, RigError, RigPlace
from rigs.load import parse
from rigs.rig import Rig

_FEWEST = 6
"""Minimum number of touches worth keeping."""
TONE = "\a"
"""The terminal bell."""


def record_touches(
    daemon: SampleSource,
    name: str,
    output: Path,
    operator: str,
    placement: str,
    touches: int | None,
    say: Callable[[str], None],
) -> Path:
    """Guide the user through the touches and write a run. If the robot falls silent, six or more touches are saved."""
    refuse_existing(output)
    rig, text = served_rig(daemon)
    touch = touch_of(rig)
    if rig.robot.rail:
        problem = "is on a rail, and rigd does not read the position of the rail"
        remedy = "remove robot.rail if the rail does not move, or import touches as a table"
        raise FileError(RigPlace.of(rig.name), problem, remedy, code="arm.invalid")
    guide = Touching(with_ball(arm_of(rig.robot), touch), touch.sockets, touches or touch.touches)

    def save() -> Path:
        return write_touches(output, guide.table, rig, text, operator, f"touches of {name}", placement)

    say(f"socket {guide.socket}: seat the ball, let go, and wait for the tone; then change elbow and wrist")
    try:
        with suppress(KeyboardInterrupt):
            for q_deg, came_deg in guided_joints(daemon, len(rig.robot.axes)):
                if came_deg is not None:
                    _handle_standstill(rig, guide, q_deg, came_deg, say)
                if not guide.socket:
                    break
    except RigError:
        if guide.count >= _FEWEST:
            say(f"{save()}: {guide.count} touches were saved")
        raise
    if guide.count < _FEWEST:
        problem = f"only {guide.count} touches were made; at least {_FEWEST} are needed"
        raise FileError(str(output), problem, "touch each socket in many postures", code="readings.too_few")
    return save()


def _handle_standstill(rig: Rig, guide: Touching, q_deg: Array, came_deg: Array, say: Callable[[str], None]) -> None:
    """Take a touch, and say the next posture, or that further touches are not worth their time."""
    socket, number = guide.socket, guide.number
    match guide.take(q_deg, came_deg):
        case "seated":
            say(f"{TONE}socket {socket}: touch {number} of {guide.each}")
            if guide.socket and guide.socket != socket:
                say(f"now socket {guide.socket}: place the ball in that socket")
            if guide.number > 1:
                from analysis.apps.planning.next_reading import next_touch  # noqa: PLC0415 - takes a second

                if step := next_touch(rig, guide.table, guide.socket):
                    say(step.words)
        case "elsewhere":
            say(f"the robot is at rest, but by the arm the ball is not in socket {socket}: seat the ball, or continue")
        case "same posture":
            say("the posture is that of the previous touch: turn elbow or wrist and keep the ball in the socket")


def guided_joints(daemon: SampleSource, axes: int) -> Iterator[tuple[Array, Array | None]]:
    """Joint angles (axes,) in degrees of each new sample and, once at each standstill, those that each joint came
    from."""
    detector = RestDetector()
    for times_s, rows_deg in joint_samples(daemon, axes, {}):
        for t_s, q_deg in zip(times_s.tolist(), rows_deg, strict=True):
            is_at_rest = detector.feed(t_s, q_deg)
            yield q_deg, detector.came_deg.copy() if is_at_rest else None


def write_touches(directory: Path, table: TouchTable, rig: Rig, rig_text: str, *labels: str) -> Path:
    """Write touches as a run. rig_text: rig file of the robot. labels: operator, source and placement."""
    columns = columns_of(table)
    digest = hashlib.sha256(repr(columns.to_pydict()).encode()).hexdigest()
    operator, source, placement = labels
    run = table_run(
        directory, columns, test="touch", direction=None, rig_name=rig.name, rig_text=rig_text, operator=operator,
        source=source, source_sha256=digest, placement=placement,
    )  # fmt: skip
    write_table_run(run, directory, rig.companion_files)
    return directory


# ----------------------------------------------------------------------------------------------------------------------
# Joint angles that a running daemon receives from the robot, as they arrive.

_POLL_S = 0.1
_SILENT_S = 5.0
"""Time without a new joint angle after which the robot is silent."""
_SHOW_S = 2.0


class SampleSource(Protocol):
    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """A daemon that answers requests."""


def served_rig(daemon: SampleSource) -> tuple[Rig, str]:
    """Rig that a daemon serves, and the text of its file."""
    text = "\n".join(daemon.ask("samples", after={}, rig=True)["rig_lines"]) + "\n"
    return parse(text, "the rig file of rigd"), text


def joint_samples(daemon: SampleSource, axes: int, after: Mapping[str, int]) -> Iterator[tuple[Array, Array]]:
    """Timestamps (n,) in s and joint angles (n, axes) in degrees of new complete samples after those known by
    stream."""
    names, heard_s = joint_columns(axes), clock.now_s()
    while True:
        robot = daemon.ask("samples", after=after)["streams"].get("robot")
        if robot and robot["rows"]:
            after, heard_s = {"robot": robot["newest"]}, clock.now_s()
            places = [0, *(1 + robot["columns"].index(name) for name in names)]
            rows = np.array([[row[place] for place in places] for row in robot["rows"]], dtype=float)
            rows = rows[np.isfinite(rows).all(axis=1)]
            if len(rows):
                yield rows[:, 0] / 1e9, rows[:, 1:]
        elif clock.now_s() - heard_s > _SILENT_S:
            problem = f"joint angles missing for {_SILENT_S:.0f} s"
            raise CellError("robot", problem, "run rig doctor, then repeat the command", code="robot.silent")
        clock.sleep(_POLL_S)


def watched_motion(daemon: SampleSource, where: str, show: Callable[[RobotMotion], None]) -> RobotMotion:
    """Motion of a robot of six axes from now until Ctrl-C, shown every two seconds."""
    streams = daemon.ask("samples", after={})["streams"]
    after = {name: stream["newest"] for name, stream in streams.items()}
    times: list[Array] = []
    angles: list[Array] = []

    def motion() -> RobotMotion:
        t_s, first = np.unique(np.concatenate(times), return_index=True)
        return RobotMotion(where, t_s - t_s[0], np.concatenate(angles)[first])

    begun_s = shown_s = clock.now_s()
    try:
        for t_s, q_deg in joint_samples(daemon, 6, after):
            times.append(t_s)
            angles.append(np.radians(q_deg))
            if clock.now_s() - shown_s > _SHOW_S:
                shown_s = clock.now_s()
                show(motion())
    except KeyboardInterrupt:
        pass
    if not times:
        problem = f"joint angles did not arrive within {clock.now_s() - begun_s:.0f} s"
        raise CellError(where, problem, "check the robot's connection with rig status", code="robot.silent")
    return motion()
