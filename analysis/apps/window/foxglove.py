"""Live data over the WebSocket protocol of Foxglove: joints with the URDF of the arm, gauges, angle.

Only this computer is served, and every client there: the data are not secret, and a client can change nothing.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from analysis.apps.interchange.mcap_export import (
    DESCRIPTION,
    DESCRIPTION_TOPIC,
    JOINT_STATES,
    JOINTS_TOPIC,
    SCHEMAS,
    joint_states,
    urdf_of,
)
from analysis.apps.live.view import LiveView
from analysis.robot.geometry.circle import link_angle
from rigs.distribution import to_install
from rigs.errors import CellError
from rigs.rig import Rig

_GAUGES = {
    "type": "object",
    "title": "rig.gauges",
    "properties": {name: {"type": "number"} for name in ("g1_mm", "g2_mm", "angle_deg", "phi_deg")},
}


class Foxglove:
    def __init__(self, port: int, rig: Rig | None) -> None:
        """Listen on a port, 0 for a free one. rig: rig with the displayed arm."""
        try:
            import foxglove  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            problem = "needs the Python package foxglove-sdk, which is not installed"
            raise CellError("--foxglove", problem, to_install("foxglove-sdk"), code="window.not_installed") from None
        context = self._context = foxglove.Context()  # the channels live as long as the context

        def channel(topic: str, schema: dict[str, Any]) -> Any:
            return foxglove.Channel(topic, schema=schema, message_encoding="json", context=context)

        self._joints = channel(JOINTS_TOPIC, SCHEMAS[JOINT_STATES])
        self._gauges = channel("/gauges", _GAUGES)
        self._described = channel(DESCRIPTION_TOPIC, SCHEMAS[DESCRIPTION])
        self._urdf = urdf_of(rig) if rig else ""
        self._until_s, self._described_s = -math.inf, -math.inf
        try:
            self._server = foxglove.start_server(name="rig", host="127.0.0.1", port=port, context=context)
        except RuntimeError as error:
            problem = f"cannot be used for listening: {error}"
            raise CellError(f"127.0.0.1:{port}", problem, "choose a different port", code="window.port") from None

    @property
    def port(self) -> int:
        return int(self._server.port)

    def show(self, view: LiveView) -> None:
        now_s = time.monotonic()
        if self._urdf and now_s - self._described_s > 1.0:  # new clients receive the arm within a second
            self._described_s = now_s
            self._described.log({"data": self._urdf})
        cell, new = view.cell, np.flatnonzero(view.rows.t_s > self._until_s)
        if cell is None or not len(new):
            return
        self._until_s = float(view.rows.t_s[-1])
        # Times of the daemon count from the start of its computer, like the monotonic clock of this process.
        since_1970_ns = time.time_ns() - time.monotonic_ns()
        for k in new.tolist():
            at_ns = int(view.rows.t_s[k] * 1e9) + since_1970_ns
            g1, g2 = view.rows.g_mm[k]
            degrees = float(np.degrees(link_angle(g1, g2, cell.baseline_mm))) if cell.has_angle else math.nan
            values = {"g1_mm": g1, "g2_mm": g2, "angle_deg": degrees, "phi_deg": math.degrees(view.phi[k])}
            finite = {name: float(value) for name, value in values.items() if math.isfinite(value)}
            self._gauges.log(finite, log_time=at_ns)
            message = joint_states(cell.axes, np.degrees(view.rows.q[k]).tolist(), at_ns)
            if message["joints"]:
                self._joints.log(message, log_time=at_ns)

    def close(self) -> None:
        for channel in (self._joints, self._gauges, self._described):
            channel.close()
        self._server.stop()
