"""Lap in progress: sense, share, number, joint reversals and error curve.

A lap starts at the start angle after the lead-in, as in `analysis.runs.laps`. Few wrists have two spare turns, so a
motion back over a complete lap is a return.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.apps.live.live_rows import LiveRows
from analysis.procedures.circle import fit_sine
from analysis.procedures.shared.joint_reversals import PROMINENCE_RAD
from analysis.procedures.shared.lap_curve import PHI, at_resolution
from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.noise.spectrum import NODES

_TURNS_BACK_RAD = math.radians(2.0)
"""Motion after which its sense is known, more than the noise of any feedback."""
_EARLY_RAD = math.radians(20.0)
"""Allowed start of a program before the lead-in, as in `analysis.runs.laps`."""
_TURN = 2 * math.pi
_WHOLE_RAD = _TURN - math.radians(2.0)
"""Minimum angle of a complete lap: the last row may be missing."""


@dataclass(frozen=True)
class LapProgress:
    """Progress of the laps. A sense is 1 for acw, -1 for cw, 0 if unknown."""

    phi_rad: float = math.nan
    """Unwrapped circle angle of the last row; nan off the circle."""
    sense: int = 0
    extreme_rad: float = math.nan
    """Furthest angle in this sense."""
    from_rad: float = math.nan
    acw: int = 0
    cw: int = 0
    forward: int = 0
    """Sense of the first complete lap since the tool reached the circle; 0 before."""
    origin_rad: float = math.nan

    @property
    def goes_back(self) -> bool:
        """True if the tool returns along the laps."""
        unwinds = self.forward != 0 and self.sense == -self.forward
        return unwinds and self.forward * (self.phi_rad - self.origin_rad) > 0

    def after(self, phi: Array, start_rad: float, lead_rad: float) -> tuple[LapProgress, Array, Array]:
        """Progress after rows at circle angles phi (n,), with the sense (n,) and the completed share (n,) of the lap,
        nan without motion along the circle."""
        state, senses, shares = self, [], []
        for angle in phi.tolist():
            state = state._moved(angle)
            share = state.share(start_rad, lead_rad)
            senses.append(state.sense)
            shares.append(math.nan if share is None else share)
        return state, np.array(senses, dtype=float), np.array(shares)

    def share(self, start_rad: float, lead_rad: float) -> float | None:
        """Completed share of the current lap, below 0 in the lead-in and above 1 after it; None during a return, or
        without motion along the circle."""
        if self.sense == 0 or math.isnan(self.phi_rad) or self.goes_back:
            return None
        ahead = self.sense * (self.phi_rad - start_rad)
        begun = self.sense * (self._begun_rad - start_rad)
        # A motion starts at the lead-in, or anywhere in the lap if the view was started late.
        return (ahead - _TURN * math.floor((begun + lead_rad + _EARLY_RAD) / _TURN)) / _TURN

    def _moved(self, phi: float) -> LapProgress:
        if math.isnan(phi):
            return self.ended()
        if math.isnan(self.phi_rad):
            return replace(self, phi_rad=phi, sense=0, extreme_rad=phi, from_rad=phi)
        turned_to = self.phi_rad + math.remainder(phi - self.phi_rad, _TURN)
        away = turned_to - self.extreme_rad
        moved = replace(self, phi_rad=turned_to)
        if self.sense * away > 0:
            return replace(moved, extreme_rad=turned_to)
        if abs(away) <= _TURNS_BACK_RAD:
            return moved
        from_rad = self.extreme_rad if self.sense else self.from_rad
        return replace(moved.counted(), sense=1 if away > 0 else -1, extreme_rad=turned_to, from_rad=from_rad)

    @property
    def _begun_rad(self) -> float:
        """Start of a lap in the current sense: of the motion, or the end of the return."""
        return self.origin_rad if self.forward and self.sense == -self.forward else self.from_rad

    def counted(self) -> LapProgress:
        driven_rad = max(0.0, self.sense * (self.extreme_rad - self._begun_rad)) if self.sense else 0.0
        laps = int((driven_rad + _TURN - _WHOLE_RAD) / _TURN)
        counted = replace(self, acw=self.acw + laps * (self.sense > 0), cw=self.cw + laps * (self.sense < 0))
        if laps and not self.forward:
            return replace(counted, forward=self.sense, origin_rad=self.from_rad)
        return counted

    def ended(self) -> LapProgress:
        off = replace(self.counted(), phi_rad=math.nan, sense=0, extreme_rad=math.nan, from_rad=math.nan)
        return replace(off, forward=0, origin_rad=math.nan)


_MOVES_RAD_S = float(np.radians(0.05))
"""Minimum speed of a moving joint: feedback noise of 0.01° over a third of a second."""
_SPEED_S = 0.35
"""Time span for measuring a speed."""


@dataclass(frozen=True)
class LiveReversal:
    axis: int
    t_s: float
    phi_rad: float
    """Circle angle; nan off the circle."""
    upper: bool
    """True from rising to falling."""
    sense: int
    """Sense of the lap: 1 acw, -1 cw, 0 unknown."""


@dataclass(frozen=True)
class JointMotion:
    """Sense (6,) of each joint, 0 if unknown, and its furthest angle in that sense, with time and circle angle."""

    sense: Array = field(default_factory=lambda: np.zeros(6))
    extreme: Array = field(default_factory=lambda: np.full(6, np.nan))
    extreme_t_s: Array = field(default_factory=lambda: np.full(6, np.nan))
    extreme_phi: Array = field(default_factory=lambda: np.full(6, np.nan))

    def after(self, rows: LiveRows, phi: Array, senses: Array) -> tuple[JointMotion, list[LiveReversal]]:
        """Motion after rows at circle angles phi (n,) and lap senses (n,), and the reversals in them."""
        sense, extreme = self.sense.copy(), self.extreme.copy()
        at_t_s, at_phi = self.extreme_t_s.copy(), self.extreme_phi.copy()
        reversals: list[LiveReversal] = []
        for t_s, q, angle, lap_sense in zip(rows.t_s.tolist(), rows.q, phi.tolist(), senses.tolist(), strict=True):
            if not math.isfinite(q.sum()):
                continue
            away = q - extreme
            turned = (sense != 0) & (-sense * away > PROMINENCE_RAD)
            for axis in np.flatnonzero(turned).tolist():
                upper = bool(sense[axis] > 0)
                reversals.append(
                    LiveReversal(axis + 1, float(at_t_s[axis]), float(at_phi[axis]), upper, int(lap_sense))
                )
            begins = (sense == 0) & (np.abs(away) > PROMINENCE_RAD)
            sense = np.where(turned, -sense, np.where(begins, np.sign(away), sense))
            further = np.isnan(extreme) | turned | begins | (sense * away > 0)
            extreme, at_t_s = np.where(further, q, extreme), np.where(further, t_s, at_t_s)
            at_phi = np.where(further, angle, at_phi)
        return JointMotion(sense, extreme, at_t_s, at_phi), reversals


def speeds(rows: LiveRows) -> Array:
    """Speed (6,) of each joint in rad/s over the last rows; nan if unknown."""
    if not len(rows):
        return np.full(6, np.nan)
    recent = rows.select_rows(slice(int(np.searchsorted(rows.t_s, rows.t_s[-1] - _SPEED_S)) - 1, None))
    if len(recent) < 2 or recent.t_s[-1] <= recent.t_s[0]:
        return np.full(6, np.nan)
    speed: Array = (recent.q[-1] - recent.q[0]) / (recent.t_s[-1] - recent.t_s[0])
    return speed


def motion_sense(speed_rad_s: float) -> int:
    """1 for a rising joint, -1 for a falling joint, 0 at rest."""
    return 0 if not abs(speed_rad_s) > _MOVES_RAD_S else int(math.copysign(1, speed_rad_s))


_WIDEST_RAD = float(np.radians(10.0))
"""Widest gap bridged in a curve, as in `rig analyse`."""
_HALF = np.pi


@dataclass(frozen=True)
class ErrorCurve:
    """Error (n,) in rad or mm over circle angles phi (n,) in rad."""

    phi: Array
    error: Array
    is_full_lap: bool
    """True if the curve covers a complete lap at the specified resolution."""
    less_sine: bool
    """True if the sine is removed; otherwise only the mean."""
    band: float
    """Largest minus smallest error; 0 if empty."""


NO_CURVE = ErrorCurve(np.empty(0), np.empty(0), False, False, 0.0)


@dataclass(frozen=True)
class Sweep:
    """Latest measurement (NODES,) at each circle angle; nan if missing."""

    last: Array = field(default_factory=lambda: np.full(NODES, np.nan))

    def after(self, phi: Array, values: Array) -> Sweep:
        """Replace older values by those (n,) at circle angles phi (n,)."""
        good: Mask = np.isfinite(phi) & np.isfinite(values)
        if not good.any():
            return self
        last = self.last.copy()
        last[(phi[good] / (2 * np.pi) * NODES).astype(np.int64) % NODES] = values[good]
        return replace(self, last=last)

    def curve(self) -> ErrorCurve:
        """Values minus a least-squares sine, below half a lap minus their mean: a sine would absorb the error."""
        measured = np.isfinite(self.last)
        if measured.sum() < 2:
            return NO_CURVE
        phi, values = PHI[measured] + np.pi / NODES, self.last[measured]
        gaps = np.diff(phi, append=phi[0] + 2 * np.pi)
        if gaps.max() <= _WIDEST_RAD:
            nodes = np.interp(PHI, phi, values, period=2 * np.pi)
            sine = fit_sine(nodes)
            error = at_resolution(nodes - sine(PHI))
            return ErrorCurve(PHI, error, True, True, float(np.ptp(error)))
        less_sine = bool(gaps[gaps <= _WIDEST_RAD].sum() > _HALF)
        design = np.stack([np.ones_like(phi), np.sin(phi), np.cos(phi)], axis=1)[:, : 3 if less_sine else 1]
        error = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        return ErrorCurve(phi, error, False, less_sine, float(np.ptp(error)))


def pieces(curve: ErrorCurve) -> list[slice]:
    """Continuous sections of a curve; one across phi = 0 is split."""
    ends = [*(np.flatnonzero(np.diff(curve.phi) > _WIDEST_RAD) + 1).tolist(), len(curve.phi)]
    begins = [0, *ends[:-1]]
    return [slice(begin, end) for begin, end in zip(begins, ends, strict=True) if end - begin > 1]
