"""An arm of any axes as a stranger makes it: product of exponentials, its own errors, poses and touches of it.

It shares no line with the model of rig. Every arm has what sound ones show: constants a little off, joints that yield
under gravity, a curve of each joint's angle error, scatter. Faults are hidden beside that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from analysis.runs.csv_tables import columns_of
from analysis.runs.loading import Measured, measured_of
from analysis.runs.tables import PoseTable, TouchTable
from daq.store import table_run
from rigs.rig import Rig
from rigs.schema.robot import Robot
from tests.worlds.stranger.screws import Arm, Constants, arm_from, pose, torque_nm

Array = NDArray[np.float64]
CAME_RAD = 0.15
"""How far a joint moves to a touch at the least: any play is taken up."""
SOUND_DEG, SOUND_MM = 0.015, 0.15
"""Standard deviations of zeros and twists, and of lengths, of a sound arm."""
SOUND_SOFT, SOUND_PLAY_DEG = (1e-6, 6e-6), (0.0, 0.004)
"""From least to most: compliance (rad/Nm) and play of a sound arm."""
KINDS = ("zero", "length", "play", "compliance")
"""Kinds of faults that `draw_faults` draws."""


@dataclass(frozen=True)
class Sizes:
    """What arms of a build show. Of sound ones: standard deviations of zeros and twists (deg) and of lengths (mm); from
    least to most the compliance (rad/Nm), the play (deg), the curve of a joint (deg) and the scatter of a coordinate
    (mm); counts of the encoder a turn, 0 where it is finer than all that. Of faults: from least to most the zero (deg),
    the length (mm) and the play (deg)."""

    angle_deg: float = SOUND_DEG
    length_mm: float = SOUND_MM
    soft: tuple[float, float] = SOUND_SOFT
    play_deg: tuple[float, float] = SOUND_PLAY_DEG
    curve_deg: tuple[float, float] = (0.005, 0.02)
    scatter_mm: tuple[float, float] = (0.02, 0.05)
    counts: int = 0
    kinds: tuple[str, ...] = KINDS
    zero_fault_deg: tuple[float, float] = (0.15, 0.5)
    length_fault_mm: tuple[float, float] = (1.5, 4.0)
    play_fault_deg: tuple[float, float] = (0.05, 0.15)


INDUSTRY = Sizes()
HOBBY = Sizes(
    angle_deg=0.2, length_mm=0.4, soft=(2e-5, 1e-4), play_deg=(0.3, 1.3), curve_deg=(0.02, 0.1),
    scatter_mm=(0.05, 0.2), counts=4096, kinds=("zero", "length", "play"), zero_fault_deg=(1.5, 4.0),
    length_fault_mm=(3.0, 6.0), play_fault_deg=(1.7, 1.95),
)  # fmt: skip
"""Servos with encoders of 12 bits on their output shafts, printed or cut brackets, joints that a person set by the eye.
Plays: 0.87 to 1.49 degrees were measured of new Feetech STS3215, whose data sheet allows 0.5 (robonine.com, 2025)."""


def sizes_of(robot: Robot) -> Sizes:
    """What arms built as this one show."""
    return HOBBY if robot.design == "servo" else INDUSTRY


@dataclass(frozen=True)
class Fault:
    """kind: zero, length, twist, play or compliance; axis from 1; field of a constant; size in deg, mm or deg/Nm."""

    kind: str
    axis: int
    size: float
    field: str = ""

    @property
    def name(self) -> str:
        """What rig calls it."""
        effects = {"zero": "joint_offset", "play": "backlash", "compliance": "compliance"}
        effect = effects.get(self.kind, "link_geometry")
        return f"{effect} {self.axis}.{self.field}" if self.field else f"{effect} {self.axis}"


@dataclass(frozen=True)
class Truth:
    """An arm as it really is. soft (axes,): rad/Nm; waves: joint, order, amplitude (rad), phase of each; play (axes,)
    rad; scatter_mm: of one coordinate; off: the constants less those of the rig
    file; slip: joint from 0, and beyond which angle (rad) its link is off by so many rad, as after a slipped tooth."""

    arm: Arm
    soft: Array
    waves: tuple[tuple[int, float, float, float], ...]
    play: Array
    scatter_mm: float
    off: Constants
    slip: tuple[int, float, float] | None = None
    counts: int = 0

    def reported(self, q: Array) -> Array:
        """What the controller reports where its joints stand at q: a count of the encoder is all that it knows."""
        count = 2 * np.pi / self.counts if self.counts else 0.0
        return np.asarray(np.round(q / count) * count if count else q)

    def size_of(self, fault: Fault) -> float:
        """What the arm really has at the place of a fault, in its unit: the fault and what sound arms have there."""
        k = fault.axis - 1
        sizes = {"zero": self.off.zero, "twist": self.off.alpha, "play": self.play, "compliance": self.soft}
        if fault.kind == "length":
            return float({"a": self.off.a, "d": self.off.d}[fault.field][k])
        return float(np.degrees(sizes[fault.kind][k]))

    def link_q(self, q: Array, came_from: Array) -> Array:
        """Link-side angles (n, axes) where the controller reports q (n, axes), each joint come from came_from."""
        out = q + torque_nm(self.arm, q) * self.soft
        for joint, order, amplitude, phase in self.waves:
            out[:, joint] += amplitude * np.sin(order * q[:, joint] + phase)
        if self.slip is not None:
            joint, beyond, step = self.slip
            out[:, joint] += np.where(q[:, joint] > beyond, step, 0.0)
        return out + self._lag(q, came_from)

    def _lag(self, q: Array, came_from: Array) -> Array:
        """Each link hangs at the flank that its joint left: a little motion takes up a part of the play."""
        lag, at = np.zeros_like(q), np.zeros(q.shape[1])
        for row, (here, before) in enumerate(zip(q, came_from, strict=True)):
            at = np.clip(at - (here - before), -self.play / 2, self.play / 2)
            lag[row] = at
        return lag

    def places(self, q: Array, came_from: Array, ball_mm: Array) -> Array:
        """Places (n, 3) mm of a ball at ball_mm on the tool."""
        posed = pose(self.arm, self.link_q(q, came_from))
        return np.asarray(posed.p + np.einsum("nij,j->ni", posed.R, ball_mm))


class Seen(Protocol):
    """What is measured of an arm: where balls on its tool really are, and how far readings scatter."""

    @property
    def scatter_mm(self) -> float:
        """Of one coordinate."""

    def reported(self, q: Array) -> Array:
        """The angles (n, axes) rad that the controller writes down."""

    def places(self, q: Array, came_from: Array, ball_mm: Array) -> Array:
        """Places (n, 3) mm of a ball at ball_mm on the tool."""


def constants_of(robot: Robot) -> Constants:
    """The constants of a rig file's robot without base and tool."""
    column = {key: np.array([getattr(axis, key) for axis in robot.axes], dtype=float) for key in _KEYS}
    return Constants(
        column["a_mm"], np.radians(column["alpha_deg"]), np.radians(column["beta_deg"]), column["d_mm"],
        np.radians(column["offset_deg"]), np.array(robot.coupling), np.eye(4), np.eye(4), column["mass_kg"],
        np.array([axis.centre_mm for axis in robot.axes], dtype=float), robot.payload_kg,
    )  # fmt: skip


_KEYS = ("a_mm", "alpha_deg", "beta_deg", "d_mm", "offset_deg", "mass_kg")


def draw_faults(robot: Robot, rng: np.random.Generator, count: int) -> tuple[Fault, ...]:
    """So many faults of different kinds that can show: those of the first joint are the set-up's, those of the last the
    tool's, and only a joint that carries weight yields. Each is at least five times what a sound arm shows, a play of a
    servo twice."""
    found, last, sizes = list[Fault](), len(robot.axes), sizes_of(robot)
    for kind in rng.choice(sizes.kinds, count, replace=False):
        axis, sign = int(rng.integers(2, last)), float(rng.choice([-1, 1]))
        match str(kind):
            case "zero":
                found.append(Fault("zero", axis, sign * rng.uniform(*sizes.zero_fault_deg)))
            case "length":
                field = "d" if abs(robot.axes[axis - 1].d_mm) > 1 else "a"
                found.append(Fault("length", axis, sign * rng.uniform(*sizes.length_fault_mm), field))
            case "play":
                found.append(Fault("play", axis, rng.uniform(*sizes.play_fault_deg)))
            case "compliance":
                carries = [2, 4] if last > 6 else [2, 3]
                found.append(Fault("compliance", int(rng.choice(carries)), rng.uniform(0.005, 0.02)))
    return tuple(found)


def draw_truth(robot: Robot, rng: np.random.Generator, faults: tuple[Fault, ...]) -> Truth:
    """A sound arm with faults, by the sizes of its build. The waves of a curve fall as one over their order."""
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
            case "twist":
                c.alpha[k] += rad
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
    """Joint angles (count, axes) rad over nine tenths of each range."""
    low, high = np.radians([axis.limits_deg for axis in robot.axes]).T
    middle, half = (low + high) / 2, 0.45 * (high - low)
    return np.asarray(middle + half * rng.uniform(-1, 1, (count, len(low))))


def seated(robot: Robot, rng: np.random.Generator, socket_mm: Array, ball_mm: Array, count: int) -> Array:
    """Joint angles (count, axes) rad at which the nominal arm has its ball in a socket: Newton from random postures,
    which differ as a person's do, in elbow and wrist. Raises ValueError where the arm does not reach it."""
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
    """The angles (n, axes) rad that the controller reports where the ball really is in the socket: a person guides the
    arm until the magnet seats it."""
    nominal, q = arm_from(constants_of(robot)), q.copy()
    for _ in range(6):
        posed = pose(nominal, q)
        ball = posed.p + np.einsum("nij,j->ni", posed.R, ball_mm)
        J = nominal.coupling.T @ np.cross(posed.axis, ball[:, None] - posed.point)
        away = socket_mm - truth.places(q, came_from, ball_mm)
        q += np.einsum("nij,nj->ni", np.linalg.pinv(J.transpose(0, 2, 1)), away)
    return q


def came_from(table: PoseTable | TouchTable) -> Array:
    """The angles (n, axes) rad from which each joint came: those of a touch, or of the pose before."""
    if isinstance(table, TouchTable) and table.came_from is not None:
        return table.came_from
    return np.vstack([table.q[:1], table.q[:-1]])


def pose_table(robot: Robot, truth: Seen, rng: np.random.Generator, ball_mm: Array, poses: int) -> PoseTable:
    """Places of a ball as a tracker saw them, one posture after the other, in a frame of its own."""
    q = draw_postures(robot, rng, poses)
    seen = truth.places(q, np.vstack([q[:1], q[:-1]]), ball_mm) + rng.normal(0, truth.scatter_mm, (poses, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return PoseTable(truth.reported(q), seen @ (turn * np.linalg.det(turn)).T + rng.normal(0, 1000, 3), None)


def reach_mm(robot: Robot) -> float:
    """How far an arm reaches at most, beside the base."""
    return float(sum(np.hypot(axis.a_mm, axis.d_mm) for axis in robot.axes[1:]))


def somewhere(rng: np.random.Generator, reach: float = np.inf) -> Array:
    """A place (3,) mm for a socket, 350 to 600 mm beside the base, of arms that reach less than 800 mm so much less."""
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
    """Touches of sockets A, B … somewhere, or at places (s, 3) mm, shared out equally."""
    q, names, came = [], [], []
    places = sockets if isinstance(sockets, np.ndarray) else [None] * sockets
    for number, given in enumerate(places):
        socket = somewhere(rng, reach_mm(robot)) if given is None else given
        count = touches // len(places)
        nominal = seated(robot, rng, socket, ball_mm, count)
        before = nominal + rng.choice([-1, 1], nominal.shape) * rng.uniform(CAME_RAD, 3 * CAME_RAD, nominal.shape)
        seat = socket + rng.normal(0, truth.scatter_mm, (count, 3))
        q += [
            corrected(robot, truth, here[None], there[None], place, ball_mm)[0]
            for here, there, place in zip(nominal, before, seat, strict=True)
        ]
        came += list(before)
        names += ["ABCD"[number]] * count
    return TouchTable(np.array(names), truth.reported(np.array(q)), np.array(came))


def run_of(rig: Rig, table: PoseTable | TouchTable, name: str = "seven", placement: str = "") -> Measured:
    """A table as a run that was imported."""
    test = "touch" if isinstance(table, TouchTable) else "pose"
    run = table_run(
        Path(name), columns_of(table), test=test, direction=None, rig_name=rig.name, rig_text="",
        operator="", source="generated", source_sha256="0" * 64, placement=placement,
    )  # fmt: skip
    return measured_of(run, rig)
