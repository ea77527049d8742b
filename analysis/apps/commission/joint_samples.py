"""Joint angles that a running daemon receives from the robot, as they arrive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import RobotMotion
from analysis.runs.tables import joint_columns
from daq import clock
from rigs.errors import CellError
from rigs.load import parse
from rigs.rig import Rig

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
