"""Kinematics of five arms beside Pinocchio and py-opw-kinematics, at 10 000 random postures each.

Pinocchio's model is built joint by joint from the modified Denavit-Hartenberg placements; our inverse is
judged by its forward kinematics. The two shipped arms come a second time, calibrated: all constants a
little off, Hayati angles included. Exit code 1 where a goal is missed.
"""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from analysis.robot.kinematics.arm import Arm, forward, forward_and_jacobian
from analysis.robot.kinematics.inverse import inverse
from tests.support.five_arms import ARMS, OPW, Array, PeerArm, apart, calibrated, pose_apart
from tests.support.trial import Trial, main

POSES = 10_000
GOAL_MM, GOAL_RAD = 1e-8, 1e-10
SAME_RAD = 1e-6
"""Two solutions are one branch."""
CALIBRATED = ("paper-fanuc", "ur10e")
CALIBRATED_MISSES = 1e-3
"""Share of planted postures that Newton may miss: those near a singularity."""


class Pinocchio:
    """The arm as a Pinocchio model of six revolute joints, its tool a frame on the last."""

    def __init__(self, arm: Arm) -> None:
        self.arm, self.model = arm, pin.Model()
        placement, joint = pin.SE3(arm.T_world_base), 0
        for axis in range(6):
            placement = placement * pin.SE3(pin.utils.rotate("x", arm.alpha[axis]), np.zeros(3))
            placement = placement * pin.SE3(pin.utils.rotate("y", arm.beta[axis]), np.array([arm.a[axis], 0, 0]))
            joint = self.model.addJoint(joint, pin.JointModelRZ(), placement, f"J{axis + 1}")
            placement = pin.SE3(np.eye(3), np.array([0, 0, arm.d[axis]]))
        tool = pin.Frame("tool", joint, 0, placement * pin.SE3(arm.T_flange_tool), pin.FrameType.OP_FRAME)
        self.tool = self.model.addFrame(tool)
        self.data = self.model.createData()

    def forward(self, q: Array) -> Array:
        """T_world_tool (n, 4, 4)."""
        T = np.empty((len(q), 4, 4))
        for row, theta in enumerate(self._theta(q)):
            pin.forwardKinematics(self.model, self.data, theta)
            T[row] = pin.updateFramePlacement(self.model, self.data, self.tool).homogeneous
        return T

    def forward_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """T_world_tool (n, 4, 4) and the tool's Jacobian (n, 6, 6) in the axes of the world."""
        T, J = np.empty((len(q), 4, 4)), np.empty((len(q), 6, 6))
        for row, theta in enumerate(self._theta(q)):
            J[row] = pin.computeFrameJacobian(self.model, self.data, theta, self.tool, pin.LOCAL_WORLD_ALIGNED)
            T[row] = pin.updateFramePlacement(self.model, self.data, self.tool).homogeneous
        return T, J @ self.arm.coupling

    def _theta(self, q: Array) -> Array:
        return np.asarray(q @ self.arm.coupling.T + self.arm.offset)


@dataclass
class Row:
    """One arm's line of the table; nan where there is no peer."""

    arm: str
    fk_mm: float
    fk_rad: float
    jacobian_mm: float
    jacobian_rad: float
    opw_mm: float
    opw_rad: float
    ik_mm: float
    ik_rad: float
    branches: int
    peers: int
    missed: int
    unplanted: int
    pace_jacobian: float
    pace_forward: float
    pace_inverse: float

    def failures(self) -> list[str]:
        """The goals that this arm misses; a calibrated one may miss a few of its planted postures."""
        share = CALIBRATED_MISSES if self.arm.endswith(" calibrated") else 0.0
        mm = {name: getattr(self, name) for name in ("fk_mm", "jacobian_mm", "opw_mm", "ik_mm")}
        rad = {name: getattr(self, name) for name in ("fk_rad", "jacobian_rad", "opw_rad", "ik_rad")}
        missed = [f"{name} {value:.1e}" for name, value in mm.items() if value >= GOAL_MM]
        missed += [f"{name} {value:.1e}" for name, value in rad.items() if value >= GOAL_RAD]
        missed += [f"{self.missed} branches of the peer"] * (self.missed > 0)
        missed += [f"{self.unplanted} planted postures"] * (self.unplanted > share * POSES)
        return [f"{self.arm}: {what}" for what in missed]


def timed(call: Callable[[], Array | tuple[Array, ...]]) -> float:
    """Seconds of a call, the best of three."""
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def draw(given: Namespace) -> Iterator[tuple[str, Arm, PeerArm | None]]:
    yield from ((name, arm, PeerArm(OPW[name]) if name in OPW else None) for name, arm in ARMS.items())
    yield from ((f"{name} calibrated", calibrated(ARMS[name], seed=1), None) for name in CALIBRATED)


def compare(case: tuple[str, Arm, PeerArm | None]) -> Row:
    """Compare all results for one arm."""
    name, arm, peer = case
    q = np.random.default_rng(2026).uniform(-np.pi, np.pi, (POSES, 6))
    pinocchio = Pinocchio(arm)
    (T, J), (T_pin, J_pin) = forward_and_jacobian(arm, q), pinocchio.forward_and_jacobian(q)
    off = np.abs(J - J_pin)
    solutions = inverse(arm, T)
    back = pinocchio.forward(solutions.q[solutions.found])
    return Row(
        name,
        *pose_apart(T, T_pin),
        off[:, :3].max(),
        off[:, 3:].max(),
        *(pose_apart(T, peer.forward(q)) if peer else (np.nan, np.nan)),
        *pose_apart(back, T[np.nonzero(solutions.found)[0]]),
        int(solutions.found.sum()),
        *_against(arm, solutions.q, peer.inverse(T) if peer else np.empty((POSES, 0, 6))),
        unplanted=_absent(arm, solutions.q, q[:, None]),
        pace_jacobian=timed(lambda: forward_and_jacobian(arm, q)) / timed(lambda: pinocchio.forward_and_jacobian(q)),
        pace_forward=timed(lambda: forward(arm, q)) / timed(lambda: peer.forward(q)) if peer else np.nan,
        pace_inverse=timed(lambda: inverse(arm, T).q) / timed(lambda: peer.inverse(T)) if peer else np.nan,
    )


def _against(arm: Arm, q: Array, peers: Array) -> tuple[int, int]:
    """Return the number of branches found by the peer, and the number of those that rig does not find."""
    return int(np.isfinite(peers[..., 0]).sum()), _absent(arm, q, peers)


def _absent(arm: Arm, q: Array, wanted: Array) -> int:
    """How many of the wanted (n, m, 6), nan aside, are not among q (n, k, 6)."""
    absent = 0
    for slot in range(wanted.shape[1]):
        here = np.isfinite(wanted[:, slot, 0])
        present = (apart(arm, q[here], wanted[here, slot, None]) < SAME_RAD).any(axis=1)
        absent += int((~present).sum())
    return absent


HEAD = """\
                               against Pinocchio                 py-opw FK       our IK through    branches            lost of  time ours/peer
                               FK               Jacobian                         Pinocchio's FK    of      of py-      py-  pla-  FK+J   FK     IK
arm                    poses   mm      rad      mm/rad  rad/rad  mm      rad      mm      rad      ours    opw         opw  nted  /pin   /opw   /opw"""  # noqa: E501


def line(row: Row) -> str:
    """One line of the table."""
    small = (row.fk_mm, row.fk_rad, row.jacobian_mm, row.jacobian_rad, row.opw_mm, row.opw_rad, row.ik_mm, row.ik_rad)
    counts = (row.branches, row.peers or "-", row.missed if row.peers else "-", row.unplanted)
    paces = (row.pace_jacobian, row.pace_forward, row.pace_inverse)
    cells = [f"{row.arm:<22} {POSES:<6}", *(_cell(value, "8.1e") for value in small)]
    cells += [f"{count:<{width}}" for count, width in zip(counts, (7, 11, 4, 5), strict=True)]
    return " ".join([*cells, *(_cell(pace, "6.2f") for pace in paces)]).rstrip()


def _cell(value: float, form: str) -> str:
    text = "-" if np.isnan(value) else f"{value:{form}}".strip()
    return f"{text:<{int(form[0])}}"


def report(rows: Sequence[Row]) -> str:
    failures = [f"MISSED {failure}" for row in rows for failure in row.failures()]
    goals = (
        f"goals: {GOAL_MM:g} mm, {GOAL_RAD:g} rad, every branch of py-opw, every planted posture (calibrated: 99.9%)"
    )
    return "\n".join([HEAD, *map(line, rows), goals, *(failures or ["all reached"])])


def has_missed(rows: Sequence[Row]) -> bool:
    return any(row.failures() for row in rows)


TRIAL = Trial(
    draw,
    compare,
    report,
    line=lambda row: "",
    failed=has_missed,
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
