"""Touches taken while the user seats the ball, and the joint angles that a running daemon delivers for them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

from analysis.apps.commission.joint_samples import SampleSource, joint_samples, served_rig
from analysis.apps.commission.touched_ball import RestDetector, Touching
from analysis.procedures.simulate import touch_of, with_ball
from analysis.robot.kinematics.arm import Array, arm_of
from analysis.runs.tables import TouchTable, columns_of
from analysis.runs.written_files import refuse_existing
from daq.store import table_run, write_table_run
from rigs.errors import FileError, RigError, RigPlace
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
