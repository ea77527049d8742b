"""The movement check of a window: a reference, one touch after the other, and the touches saved as a run."""

from __future__ import annotations

import re
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.apps.commission.cell_references import CellReference, references_of
from analysis.apps.commission.guided_touches import GuidedCheck
from analysis.apps.window.watcher import Watcher
from analysis.robot.kinematics.arm import Array
from analysis.runs.loading import load_measured
from analysis.runs.stands import FLICKER_DEG
from analysis.runs.tables import joint_columns
from daq import clock
from rigs.errors import CellError, FileError, UseError

_REST_S = 0.5
"""Time over which the joints must be at rest when a touch is taken."""
_MOST_DEG = 1e4
"""Largest angle that is plausible, in degrees."""


def touchable(runs: Path) -> list[CellReference]:
    return [reference for reference in references_of([runs]) if reference.can_be_touched]


class WindowCheck:
    """The check in progress. Requests of several browsers are handled one after the other."""

    def __init__(self, watcher: Watcher, runs: Path) -> None:
        """runs: directory of the runs, which also receives the saved touches."""
        self._watcher, self._runs = watcher, runs
        self._lock = threading.Lock()
        self.check: GuidedCheck | None = None

    def do(self, action: str, form: Mapping[str, str]) -> str | None:
        """Execute `begin`, `touch`, `undo`, `save` or `cancel`. Gives a message; None for an unknown action."""
        with self._lock:
            if action == "begin":
                self.check = self._begun(form.get("run", ""))
            elif action == "cancel":
                self.check = None
            elif action not in ("touch", "undo", "save"):
                return None
            elif self.check is None:
                remedy = "choose a reference first"
                raise UseError("movement check", "has not started", remedy, code="session.missing")
            elif action == "touch":
                check = self.check.with_touch(self._joints(form.get("joints", ""), len(self.check.rig.robot.axes)))
                check.result  # noqa: B018 - computed here, not when the page is shown
                self.check = check
            elif action == "undo":
                self.check = replace(self.check, touches=self.check.touches[:-1])
            else:
                place = self._runs / f"moved-{clock.wall_time().astimezone():%Y%m%d-%H%M%S}"
                self.check.save(place, "")
                self.check = None
                return str(place)
        return ""

    def _begun(self, name: str) -> GuidedCheck:
        chosen = next((reference for reference in touchable(self._runs) if reference.runs[0].name == name), None)
        if chosen is None:
            problem = f"{name!r} is not a known reference"
            raise UseError("reference", problem, "choose one of the list", code="request.invalid")
        return GuidedCheck.of_runs([load_measured(chosen.runs[0])])

    def _joints(self, typed: str, axes: int) -> Array:
        """Joint angles (axes,) rad that were typed in degrees, or those of the resting robot."""
        if not typed.strip():
            return self._resting_joints(axes)
        numbers = re.split(r"[;\s]+|,\s+|,(?!\d)", typed.strip().strip("[]()"))
        try:
            q = np.array([float(number.replace(",", ".")) for number in numbers if number])
        except ValueError:
            q = np.empty(0)
        if q.shape != (axes,) or not np.isfinite(q).all() or np.abs(q).max() > _MOST_DEG:
            problem = f"{typed[:80]!r} are not {axes} angles in degrees"
            remedy = "separate them by spaces, as 10.5 -90 120 0 45 0"
            raise UseError("joint angles", problem, remedy, code="request.invalid")
        return np.asarray(np.radians(q))

    def _resting_joints(self, axes: int) -> Array:
        """Mean joint angles (axes,) rad of the last half second. Refuses a moving or silent robot."""
        robot = self._watcher.ask("samples", after={})["streams"].get("robot")
        rows = robot["rows"] if robot else []
        if not rows:
            remedy = "type the angles that the controller shows"
            raise CellError("robot", "reports no joint angles", remedy, code="robot.silent")
        places = [1 + robot["columns"].index(name) for name in joint_columns(axes)]
        newest_ns = rows[-1][0]
        recent = [[row[place] for place in places] for row in rows if newest_ns - row[0] <= 1e9 * _REST_S]
        if any(angle is None for angles in recent for angle in angles):
            raise FileError("robot", "did not report all joint angles", "repeat the touch", code="robot.silent")
        q_deg = np.array(recent, dtype=float)
        if np.ptp(q_deg, axis=0).max() > FLICKER_DEG:
            raise CellError("robot", "is moving", "let it come to rest, then take the touch", code="robot.moving")
        return np.asarray(np.radians(q_deg.mean(axis=0)))
