"""The live cell by Foxglove's WebSocket protocol: joint angles with the arm's URDF, gauges and angle, as rows come.

Only programs of this computer reach it, and of pages those that the window's gate lets in (`foxglove_door`); its
library bounds what waits for each client.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from analysis.files.mcap_export import (
    DESCRIPTION,
    DESCRIPTION_TOPIC,
    JOINT_STATES,
    JOINTS_TOPIC,
    SCHEMAS,
    joint_states,
    urdf_of,
)
from analysis.geometry.circle import link_angle
from analysis.live.view import LiveView
from analysis.window.foxglove_door import Door, hidden_address
from analysis.window.guard import Gate
from rigs.distribution import to_install
from rigs.errors import CellError
from rigs.rig import Rig

_GAUGES = {
    "type": "object",
    "title": "rig.gauges",
    "properties": {name: {"type": "number"} for name in ("g1_mm", "g2_mm", "angle_deg", "phi_deg")},
}


class Foxglove:
    """A server of what a view shows, from when it is made until it is closed."""

    def __init__(self, port: int, rig: Rig | None, gate: Gate) -> None:
        """rig: whose arm is shown; gate: who is let in. Raises CellError where the library is missing or the port is
        taken."""
        try:
            import foxglove  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            problem = "needs foxglove-sdk, which is not installed"
            raise CellError("--foxglove", problem, to_install("foxglove-sdk")) from None
        context = self._context = foxglove.Context()  # its channels live as long as it does

        def channel(topic: str, schema: dict[str, Any]) -> Any:
            named = {**schema, "title": schema["title"]}
            return foxglove.Channel(topic, schema=named, message_encoding="json", context=context)

        self._joints = channel(JOINTS_TOPIC, SCHEMAS[JOINT_STATES])
        self._gauges = channel("/gauges", _GAUGES)
        self._described = channel(DESCRIPTION_TOPIC, SCHEMAS[DESCRIPTION])
        self._urdf = urdf_of(rig) if rig else ""
        self._until_s, self._described_s = -math.inf, -math.inf
        inner = hidden_address()
        try:
            self._server = foxglove.start_server(name="rig", host=inner, port=0, context=context)
        except RuntimeError as error:
            raise CellError(f"{inner}:0", f"cannot be listened on: {error}", "leave --foxglove out") from None
        try:
            self._door = Door.opened(port, (inner, int(self._server.port)), gate)
        except OSError as error:
            self._server.stop()
            problem = f"cannot be listened on: {error.strerror or error}"
            raise CellError(f"127.0.0.1:{port}", problem, "give another port") from None

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._door.port

    def show(self, view: LiveView) -> None:
        """Send the rows of a view that are newer than those sent before."""
        now_s = time.monotonic()
        if self._urdf and now_s - self._described_s > 1.0:  # who comes later has it after a second
            self._described_s = now_s
            self._described.log({"data": self._urdf})
        cell, new = view.cell, np.flatnonzero(view.rows.t_s > self._until_s)
        if cell is None or not len(new):
            return
        self._until_s = float(view.rows.t_s[-1])
        # The daemon's times count from the start of its computer, as this process's monotonic clock does.
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
        """End it."""
        self._door.close()
        for channel in (self._joints, self._gauges, self._described):
            channel.close()
        self._server.stop()
