"""The joints that a running daemon reads, gathered until Ctrl-C, while a person jogs the robot or leads it around.

Only the daemon speaks to the robot; here its latest samples are asked for, as `rig live` does.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from analysis.kinematics.arm import Array
from analysis.live.daemon_source import tracks_of
from analysis.live.rows import ROBOT
from analysis.traces.robot_motion import RobotMotion
from daq.service.client import Client
from rigs.errors import CellError

_ASK_S = 0.1
_SHOW_S = 2.0
_SILENT_S = 5.0


def watched_motion(client: Client, where: str, show: Callable[[RobotMotion], None]) -> RobotMotion:
    """The motion of the robot from now until Ctrl-C; show: called every two seconds with what there is.

    Raises CellError where the daemon goes, or the robot sends no joints."""
    times: list[Array] = []
    angles: list[Array] = []
    after: dict[str, int] = {name: stream["newest"] for name, stream in _samples(client, {}).items()}
    begun_s = heard_s = shown_s = time.monotonic()
    try:
        while True:
            time.sleep(_ASK_S)
            streams = _samples(client, after)
            after = {name: stream["newest"] for name, stream in streams.items()}
            now_s = time.monotonic()
            if track := tracks_of(streams).get(ROBOT):
                times.append(track.t_s)
                angles.append(track.values)
                heard_s = now_s
            if now_s - heard_s > _SILENT_S:
                problem = f"the robot has sent no joints for {now_s - heard_s:.0f} s"
                raise CellError(where, problem, "check its connection with rig status, and begin again")
            if now_s - shown_s > _SHOW_S and times:
                shown_s = now_s
                show(_motion(times, angles, where))
    except KeyboardInterrupt:
        if not times:
            problem = f"no joints came within {time.monotonic() - begun_s:.0f} s"
            raise CellError(where, problem, "check the robot's connection with rig status") from None
        return _motion(times, angles, where)


def _samples(client: Client, after: dict[str, int]) -> dict[str, Any]:
    streams: dict[str, Any] = client.ask("samples", after=after, rig=False)["streams"]
    return streams


def _motion(times: list[Array], angles: list[Array], where: str) -> RobotMotion:
    t_s, first = np.unique(np.concatenate(times), return_index=True)
    return RobotMotion(where, t_s - t_s[0], np.concatenate(angles)[first])
