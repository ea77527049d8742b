"""Arms with faults that poses of a tracker or touches of sockets tell of, and an oracle of what shows in them.

Arms, scatter and faults are those of `tests.worlds.arms.seven_axes`. The oracle knows how large everything of a sound
arm is: it weighs what a fault does to the places against that and the scatter, with the set-up projected out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from analysis.runs.tables import PoseTable, TouchTable
from rigs.arms import load_arm
from rigs.schema.robot import Robot
from tests.trials.ground.plain_arm import Array, PlainArm, Poses, Touches, write_arm, write_poses, write_touches
from tests.worlds.arms.seven_axes import (
    SOUND_DEG,
    SOUND_MM,
    SOUND_PLAY_DEG,
    SOUND_SOFT,
    Truth,
    came_from,
    constants_of,
    draw_faults,
    draw_truth,
    pose_table,
    touch_table,
)
from tests.worlds.stranger.faults import SIZE, Key, healthy_of, name_of
from tests.worlds.stranger.real.oracle import SEEN
from tests.worlds.stranger.screws import Constants, arm_from, pose, torque_nm

ARMS = ("franka-fr3", "kuka-lbr-iiwa-14", "ur5e")
FAULTS = {"sound": 0, "one": 1, "two": 2}
"""Number of faults by kind of arm."""
SOCKETS = (2, 4)
BALL_MM, BESIDE_MM = np.array([0.0, 0.0, 120.0]), 20.0
"""Position of the ball relative to the flange, and variation in each direction."""
Seen = Literal["poses", "touches"]
STEP = 1e-4
"""Of numerical derivatives, in mm and rad."""
ALIKE = 1 - 1e-6
"""Cosine of the effects of two parts from which no readings tell them apart."""


@dataclass(frozen=True)
class Effect:
    """What a unit of a part does to the places (3 m,) mm, and how much of it sound arms have (standard deviation)."""

    keys: dict[str, Key]
    effect: str
    places: Array
    sound: float

    @property
    def name(self) -> str:
        """As in parts.csv: part and axis."""
        return name_of(self.effect, self.keys)


def write_arm_fault(kind: str, seen: Seen, count: int, rng: np.random.Generator, here: Path, sealed: Path) -> None:
    """Draw an arm, write the files of its task to `here` and its truth to `sealed`; count: of poses or touches."""
    robot = load_arm(ARMS[rng.integers(len(ARMS))]).robot
    faults = draw_faults(robot, rng, FAULTS[kind])
    truth = draw_truth(robot, rng, faults)
    ball_mm = BALL_MM + rng.uniform(-BESIDE_MM, BESIDE_MM, 3)
    table = (
        pose_table(robot, truth, rng, ball_mm, count)
        if seen == "poses"
        else touch_table(robot, truth, rng, ball_mm, int(rng.choice(SOCKETS)), count)
    )
    write_seen(here, robot, table)
    told = truth_of(robot, truth, table, ball_mm, [one.name for one in faults])
    sealed.write_text(json.dumps(told) + "\n", encoding="utf-8")


def write_seen(here: Path, robot: Robot, table: PoseTable | TouchTable) -> None:
    """Write the nominal arm, and its poses or touches."""
    if isinstance(table, TouchTable):
        write_touches(here / "touches.csv", Touches(table.q, came_from(table), table.socket))
    else:
        write_poses(here / "train.csv", Poses(table.q, table.xyz_mm, np.full(len(table.q), "tracker")), asked=False)
    c = constants_of(robot)
    write_arm(here / "arm.csv", PlainArm(c.a, c.alpha, c.d, c.zero, c.mass, c.centre))


def truth_of(
    robot: Robot, truth: Truth, table: PoseTable | TouchTable, ball_mm: Array, names: list[str]
) -> dict[str, Any]:
    """Return what the scorer needs: each fault with its size, what looks exactly as it does, and whether it shows, and
    all that the arm has beside it."""
    q, before = table.q, came_from(table)
    parts = list(effects_of(robot, q, before, ball_mm))
    Q = np.linalg.qr(setup_of(robot, table, ball_mm))[0]

    def clear(rows: Array) -> Array:
        return np.asarray((rows - (rows @ Q) @ Q.T) / truth.scatter_mm)

    seen = clear(np.array([one.places for one in parts]))
    apart = np.array([one.name in names for one in parts])
    sound = np.array([one.sound for one in parts])
    U = np.vstack([(seen * sound[:, None])[~apart], clear(waves_of(robot, truth, q, ball_mm))])
    lengths = np.linalg.norm(seen, axis=1)
    sizes = sizes_of(truth)

    def told(k: int) -> dict[str, Any]:
        own = parts[k]
        return {
            "name": own.name,
            "size": SIZE[own.effect],
            "parameters": {SIZE[own.effect]: sizes[own.name]},
            "healthy": healthy_of(own.effect, own.keys),
        }

    hidden = []
    for k in np.flatnonzero(apart):
        cosine = np.abs(seen @ seen[k]) / np.maximum(lengths * lengths[k], 1e-12)
        signal = seen[k] * sizes[parts[k].name]
        across = U @ signal
        left = signal @ signal - across @ np.linalg.solve(np.eye(len(U)) + U @ U.T, across)
        sigma = float(np.sqrt(max(left, 0.0)))
        alike = [one.name for one, own in zip(parts, cosine, strict=True) if own > ALIKE]
        hidden.append(told(int(k)) | {"class": alike, "sigma": sigma, "testable": sigma >= SEEN})
    kind = "one" if len(hidden) == 1 else "two" if hidden else "healthy"
    return {"kind": kind, "hidden": hidden, "background": [told(int(k)) for k in np.flatnonzero(~apart)]}


def sizes_of(truth: Truth) -> dict[str, float]:
    """True size of each part by its name, in deg, mm and deg/Nm."""
    off, found = truth.off, {"link_geometry 3.beta": 0.0}
    for k in range(len(off.a)):
        found |= {
            f"joint_offset {k + 1}": float(np.degrees(off.zero[k])),
            f"backlash {k + 1}": float(np.degrees(truth.play[k])),
            f"compliance {k + 1}": float(np.degrees(truth.soft[k])),
            f"link_geometry {k + 1}.a": float(off.a[k]),
            f"link_geometry {k + 1}.d": float(off.d[k]),
            f"link_geometry {k + 1}.alpha": float(np.degrees(off.alpha[k])),
        }
    return found


# ----------------------------------------------------------------------------------------------------------------------
# What each part does to the places, to first order about the nominal arm


def places_of(c: Constants, q: Array, ball_mm: Array) -> Array:
    """Return where the ball is (m, 3) mm."""
    posed = pose(arm_from(c), q)
    return np.asarray(posed.p + posed.R @ ball_mm)


def turning_of(robot: Robot, q: Array, ball_mm: Array) -> Array:
    """Return how far the ball moves when a joint turns, (m, axes, 3) mm/rad."""
    posed = pose(arm_from(constants_of(robot)), q)
    ball = posed.p + posed.R @ ball_mm
    return np.asarray(np.cross(posed.axis, ball[:, None] - posed.point))


def effects_of(robot: Robot, q: Array, before: Array, ball_mm: Array) -> Iterator[Effect]:
    """Yield every part that the generator varies, and the angle of the third axis for which it may be taken."""
    c, degree = constants_of(robot), np.radians(1)
    turning, torque = turning_of(robot, q, ball_mm), torque_nm(arm_from(c), q)
    soft, play = np.degrees(np.ptp(SOUND_SOFT)) / np.sqrt(12), np.ptp(SOUND_PLAY_DEG) / np.sqrt(12)
    for k in range(len(robot.axes)):
        shapes = {
            "joint_offset": (np.ones(len(q)), SOUND_DEG),
            "backlash": (-np.sign(q[:, k] - before[:, k]) / 2, play),
            "compliance": (torque[:, k], soft),
        }
        for effect, (shape, sound) in shapes.items():
            yield Effect({"axis": k + 1}, effect, (turning[:, k] * (degree * shape)[:, None]).ravel(), float(sound))
        fields = {"a": (1.0, SOUND_MM), "d": (1.0, SOUND_MM), "alpha": (degree, SOUND_DEG)}
        for field, (unit, sound) in (fields | ({"beta": (degree, 0.0)} if k == 2 else {})).items():
            step = STEP * np.eye(len(robot.axes))[k]
            ends = [places_of(replace(c, **{field: getattr(c, field) + own}), q, ball_mm) for own in (step, -step)]
            slope = (ends[0] - ends[1]).ravel() / (2 * STEP)
            yield Effect({"axis": k + 1, "field": field}, "link_geometry", unit * slope, sound)


def waves_of(robot: Robot, truth: Truth, q: Array, ball_mm: Array) -> Array:
    """Curves of the joints as rows (waves, 3 m) mm: sine and cosine of each, at its standard deviation."""
    turning, rows = turning_of(robot, q, ball_mm), []
    for joint, order, amplitude, _ in truth.waves:
        for wave in (np.sin, np.cos):
            rows.append((turning[:, joint] * (amplitude / np.sqrt(2) * wave(order * q[:, joint]))[:, None]).ravel())
    return np.array(rows)


def setup_of(robot: Robot, table: PoseTable | TouchTable, ball_mm: Array) -> Array:
    """Return what the set-up can do to the places, as columns (3 m, terms): the ball on the tool, and the frame of the
    instrument or the place of each socket."""
    posed = pose(arm_from(constants_of(robot)), table.q)
    if isinstance(table, TouchTable):
        sockets = [table.socket == name for name in np.unique(table.socket)]
        moved = [own[:, None, None] * np.eye(3) for own in sockets]
    else:
        ball, metre = posed.p + posed.R @ ball_mm, 1e3
        moved = [np.tile(np.eye(3), (len(ball), 1, 1)), np.cross(np.eye(3)[None], ball[:, None] / metre).swapaxes(1, 2)]
    return np.concatenate([posed.R, *moved], axis=2).reshape(3 * len(table.q), -1)
