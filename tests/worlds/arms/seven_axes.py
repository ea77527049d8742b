"""Independently simulated arms with any number of axes: product of exponentials, errors, poses and touches.

It shares no code with the model of rig. Every arm has the errors of a sound arm: constants, compliance under gravity,
joint angle curves, and scatter. Hidden faults are added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.runs.loading import Measured, measured_of
from analysis.runs.tables import PoseTable, TouchTable, columns_of
from daq.store import table_run
from rigs.rig import Rig
from rigs.schema.robot import Robot
from tests.worlds.stranger.screws import Arm, Constants, arm_from, pose, torque_nm

Array = NDArray[np.float64]
APPROACH_RAD = 0.15
"""Minimum joint motion before a touch, sufficient to take up any backlash."""
SOUND_DEG, SOUND_MM = 0.015, 0.15
"""Standard deviations of zeros and twists, and of lengths, of a sound arm."""
SOUND_SOFT, SOUND_PLAY_DEG = (1e-6, 6e-6), (0.0, 0.004)
"""Ranges of compliance (rad/Nm) and backlash of a sound arm."""


@dataclass(frozen=True)
class Sizes:
    """Error sizes of arms of a build. Sound arms: standard deviations of zeros and twists (deg) and of lengths (mm);
    ranges of compliance (rad/Nm), backlash (deg), joint curve (deg) and scatter of a coordinate (mm); encoder
    counts per turn, 0 for negligible steps.
    """

    angle_deg: float = SOUND_DEG
    length_mm: float = SOUND_MM
    soft: tuple[float, float] = SOUND_SOFT
    play_deg: tuple[float, float] = SOUND_PLAY_DEG
    curve_deg: tuple[float, float] = (0.005, 0.02)
    scatter_mm: tuple[float, float] = (0.02, 0.05)
    counts: int = 0


INDUSTRY = Sizes()
HOBBY = Sizes(
    angle_deg=0.2, length_mm=0.4, soft=(2e-5, 1e-4), play_deg=(0.3, 1.3), curve_deg=(0.02, 0.1),
    scatter_mm=(0.05, 0.2), counts=4096,
)  # fmt: skip
"""Arms with 12-bit encoders on the output shafts of servos, printed or cut brackets, and joints set by eye.
Backlash: 0.87 to 1.49 degrees were measured on new Feetech STS3215, specified as 0.5 (robonine.com, 2025).
"""


def sizes_of(robot: Robot) -> Sizes:
    """Error sizes for the build of an arm."""
    return HOBBY if robot.design == "servo" else INDUSTRY


@dataclass(frozen=True)
class Fault:
    """A fault. kind: zero, length, play or compliance; axis from 1; field of a constant; size in deg, mm or
    deg/Nm.
    """

    kind: str
    axis: int
    size: float
    field: str = ""

    @property
    def name(self) -> str:
        """Name of the fault in rig."""
        effects = {"zero": "joint_offset", "play": "backlash", "compliance": "compliance"}
        effect = effects.get(self.kind, "link_geometry")
        return f"{effect} {self.axis}.{self.field}" if self.field else f"{effect} {self.axis}"


@dataclass(frozen=True)
class Truth:
    """True errors of an arm. soft (axes,): rad/Nm; waves: joint, order, amplitude (rad) and phase of each; play
    (axes,) rad; scatter_mm: of a coordinate; off: errors of the constants relative to the rig file; slip: joint
    from 0, angle (rad) above which its link is displaced, and the displacement in rad, as after a slipped tooth.
    """

    arm: Arm
    soft: Array
    waves: tuple[tuple[int, float, float, float], ...]
    play: Array
    scatter_mm: float
    off: Constants
    slip: tuple[int, float, float] | None = None
    counts: int = 0

    def reported(self, q: Array) -> Array:
        """Angles reported at joint angles q, rounded to encoder counts."""
        count = 2 * np.pi / self.counts if self.counts else 0.0
        return np.asarray(np.round(q / count) * count if count else q)

    def link_q(self, q: Array, came_from: Array) -> Array:
        """Return link-side angles (n, axes) at reported angles q (n, axes), with each joint arriving from came_from."""
        out = q + torque_nm(self.arm, q) * self.soft
        for joint, order, amplitude, phase in self.waves:
            out[:, joint] += amplitude * np.sin(order * q[:, joint] + phase)
        if self.slip is not None:
            joint, beyond, step = self.slip
            out[:, joint] += np.where(q[:, joint] > beyond, step, 0.0)
        return out + self._lag(q, came_from)

    def _lag(self, q: Array, came_from: Array) -> Array:
        """Backlash deviation: the link stays at the flank of the departure until the motion takes up the
        backlash.
        """
        lag, at = np.zeros_like(q), np.zeros(q.shape[1])
        for row, (here, before) in enumerate(zip(q, came_from, strict=True)):
            at = np.clip(at - (here - before), -self.play / 2, self.play / 2)
            lag[row] = at
        return lag

    def places(self, q: Array, came_from: Array, ball_mm: Array) -> Array:
        """Positions (n, 3) mm of a ball at ball_mm on the tool."""
        posed = pose(self.arm, self.link_q(q, came_from))
        return np.asarray(posed.p + np.einsum("nij,j->ni", posed.R, ball_mm))


class Seen(Protocol):
    """A measurable arm: true ball positions and scatter of the readings."""

    @property
    def scatter_mm(self) -> float:
        """Standard deviation of a coordinate."""

    def reported(self, q: Array) -> Array:
        """Angles (n, axes) rad recorded by the controller."""

    def places(self, q: Array, came_from: Array, ball_mm: Array) -> Array:
        """Positions (n, 3) mm of a ball at ball_mm on the tool."""


def constants_of(robot: Robot) -> Constants:
    """Constants of a rig file's robot, excluding base and tool."""
    column = {key: np.array([getattr(axis, key) for axis in robot.axes], dtype=float) for key in _KEYS}
    return Constants(
        column["a_mm"], np.radians(column["alpha_deg"]), np.radians(column["beta_deg"]), column["d_mm"],
        np.radians(column["offset_deg"]), np.array(robot.coupling), np.eye(4), np.eye(4), column["mass_kg"],
        np.array([axis.centre_mm for axis in robot.axes], dtype=float), robot.payload_kg,
    )  # fmt: skip


_KEYS = ("a_mm", "alpha_deg", "beta_deg", "d_mm", "offset_deg", "mass_kg")


def draw_truth(robot: Robot, rng: np.random.Generator, faults: tuple[Fault, ...]) -> Truth:
    """Draw a sound arm of this build and add faults. The amplitudes of joint waves are inversely proportional to the
    order.
    """
    c, n, sizes = constants_of(robot), len(robot.axes), sizes_of(robot)
    nominal = c
    off = np.radians(sizes.angle_deg)
    c = replace(
        c, a=c.a + rng.normal(0, sizes.length_mm, n), d=c.d + rng.normal(0, sizes.length_mm, n),
        alpha=c.alpha + rng.normal(0, off, n), zero=c.zero + rng.normal(0, off, n),
    )  # fmt: skip
    soft, play = rng.uniform(*sizes.soft, n), np.radians(rng.uniform(*sizes.play_deg, n))
    for fault in faults:
        k, rad = fault.axis - 1, np.radians(fault.size)
        match fault.kind:
            case "zero":
                c.zero[k] += rad
            case "length":
                {"a": c.a, "d": c.d}[fault.field][k] += fault.size
            case "play":
                play[k] += rad
            case "compliance":
                soft[k] += rad
    waves = []
    for joint in range(n):
        width = np.radians(rng.uniform(*sizes.curve_deg))
        for order in (*rng.uniform(0.7, 12, 8), *rng.uniform(12, 60, 4)):
            waves.append((joint, float(order), width / (1 + order), float(rng.uniform(0, 2 * np.pi))))
    off_by = replace(c, a=c.a - nominal.a, d=c.d - nominal.d, alpha=c.alpha - nominal.alpha, zero=c.zero - nominal.zero)
    scatter_mm = float(rng.uniform(*sizes.scatter_mm))
    return Truth(arm_from(c), soft, tuple(waves), play, scatter_mm, off_by, counts=sizes.counts)


def draw_postures(robot: Robot, rng: np.random.Generator, count: int) -> Array:
    """Draw joint angles (count, axes) rad within nine tenths of each range."""
    low, high = np.radians([axis.limits_deg for axis in robot.axes]).T
    middle, half = (low + high) / 2, 0.45 * (high - low)
    return np.asarray(middle + half * rng.uniform(-1, 1, (count, len(low))))


def seated(robot: Robot, rng: np.random.Generator, socket_mm: Array, ball_mm: Array, count: int) -> Array:
    """Return joint angles (count, axes) rad of the nominal arm with the ball in a socket.

    Newton's method starts from random postures, which differ in elbow and wrist. Raises ValueError if the socket is out
    of reach.
    """
    nominal, low, high = arm_from(constants_of(robot)), *np.radians([axis.limits_deg for axis in robot.axes]).T
    found: list[Array] = []
    for _ in range(60):
        q = draw_postures(robot, rng, 200)
        for _ in range(25):
            posed = pose(nominal, q)
            ball = posed.p + np.einsum("nij,j->ni", posed.R, ball_mm)
            J = nominal.coupling.T @ np.cross(posed.axis, ball[:, None] - posed.point)
            step = np.einsum("nij,nj->ni", np.linalg.pinv(J.transpose(0, 2, 1)), socket_mm - ball)
            q += np.clip(step, -0.3, 0.3)
        posed = pose(nominal, q)
        away = np.linalg.norm(posed.p + np.einsum("nij,j->ni", posed.R, ball_mm) - socket_mm, axis=1)
        found += list(q[(away < 1e-6) & (q > low).all(axis=1) & (q < high).all(axis=1)])
        if len(found) >= count:
            return np.array(found[:count])
    raise ValueError(f"the arm does not reach {socket_mm}")


def corrected(robot: Robot, truth: Seen, q: Array, came_from: Array, socket_mm: Array, ball_mm: Array) -> Array:
    """Reported angles (n, axes) rad with the ball exactly in the socket, as if guided by hand into a
    magnet.
    """
    nominal, q = arm_from(constants_of(robot)), q.copy()
    for _ in range(6):
        posed = pose(nominal, q)
        ball = posed.p + np.einsum("nij,j->ni", posed.R, ball_mm)
        J = nominal.coupling.T @ np.cross(posed.axis, ball[:, None] - posed.point)
        away = socket_mm - truth.places(q, came_from, ball_mm)
        q += np.einsum("nij,nj->ni", np.linalg.pinv(J.transpose(0, 2, 1)), away)
    return q


def came_from(table: PoseTable | TouchTable) -> Array:
    """Angles (n, axes) rad from which each joint arrived: those given for a touch, or those of the
    previous pose.
    """
    if isinstance(table, TouchTable) and table.came_from is not None:
        return table.came_from
    return np.vstack([table.q[:1], table.q[:-1]])


def pose_table(robot: Robot, truth: Seen, rng: np.random.Generator, ball_mm: Array, poses: int) -> PoseTable:
    """Simulate ball positions measured by a tracker with an unknown frame, at one posture after another."""
    q = draw_postures(robot, rng, poses)
    seen = truth.places(q, np.vstack([q[:1], q[:-1]]), ball_mm) + rng.normal(0, truth.scatter_mm, (poses, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return PoseTable(truth.reported(q), seen @ (turn * np.linalg.det(turn)).T + rng.normal(0, 1000, 3), None)


def reach_mm(robot: Robot) -> float:
    """Largest horizontal reach of an arm."""
    return float(sum(np.hypot(axis.a_mm, axis.d_mm) for axis in robot.axes[1:]))


def somewhere(rng: np.random.Generator, reach: float = np.inf) -> Array:
    """A random socket place (3,) mm, 350 to 600 mm from the base; scaled down for arms with a reach below 800
    mm.
    """
    around, away, high = rng.uniform(-2, 2), rng.uniform(350, 600), rng.uniform(50, 450)
    return np.array([away * np.cos(around), away * np.sin(around), high]) * min(1.0, reach / 800)


def touch_table(
    robot: Robot,
    truth: Seen,
    rng: np.random.Generator,
    ball_mm: Array,
    sockets: int | Array,
    touches: int,
) -> TouchTable:
    """Simulate touches of sockets A, B … at random or given places (s, 3) mm, equally distributed."""
    q, names, came = [], [], []
    places = sockets if isinstance(sockets, np.ndarray) else [None] * sockets
    for number, given in enumerate(places):
        socket = somewhere(rng, reach_mm(robot)) if given is None else given
        count = touches // len(places)
        nominal = seated(robot, rng, socket, ball_mm, count)
        before = nominal + rng.choice([-1, 1], nominal.shape) * rng.uniform(
            APPROACH_RAD, 3 * APPROACH_RAD, nominal.shape
        )
        seat = socket + rng.normal(0, truth.scatter_mm, (count, 3))
        q += [
            corrected(robot, truth, here[None], there[None], place, ball_mm)[0]
            for here, there, place in zip(nominal, before, seat, strict=True)
        ]
        came += list(before)
        names += ["ABCD"[number]] * count
    return TouchTable(np.array(names), truth.reported(np.array(q)), np.array(came))


def run_of(rig: Rig, table: PoseTable | TouchTable, name: str = "seven", placement: str = "") -> Measured:
    test = "touch" if isinstance(table, TouchTable) else "pose"
    run = table_run(
        Path(name), columns_of(table), test=test, direction=None, rig_name=rig.name, rig_text="",
        operator="", source="generated", source_sha256="0" * 64, placement=placement,
    )  # fmt: skip
    return measured_of(run, rig)
