"""Distance between the tools of two arms of the same model at equal joint angles.

It shows whether a program can move from one arm to the other: as the bases stand, and with frame and tool taught for
each arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.apps.interchange.exported_arm import joint_traits
from analysis.apps.report.blocks import Block, Heading, Sentence, Table, paragraphs
from analysis.correction.calibrated_arm import CalibratedArm
from analysis.correction.work import rest_mm
from analysis.robot.kinematics.arm import Array, pose_error
from analysis.robot.predict import geometric_arm, model_of
from analysis.runs.noise.readings import rms
from analysis.runs.tabular import for_json
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.robot import Pose
from rigs.text import escape_text

_POSTURES = 200
"""Chosen: they determine an rms to 5 %."""
_OTHER_MODEL_MM = 20.0
"""Arms of the same model, calibrated or not, agree within some mm."""
_SHOWN = 5e-5
"""Smallest difference of two constants that is shown: half of the last digit."""
_CONSTANTS = (("zero_deg", "offset"), ("a_mm", "a"), ("d_mm", "d"), ("alpha_deg", "alpha"), ("beta_deg", "beta"))


@dataclass(frozen=True)
class ArmsApart:
    """Second tool minus first in the bases of the arms, with the tool of the first on both."""

    names: tuple[str, str]
    q_deg: Array
    apart_mm: Array
    turned_deg: Array
    taught_mm: Array
    """Difference of position (n,) with frame and tool taught."""
    u_mm: Array
    """(n,), NaN if unknown for an arm."""
    constants: tuple[dict[str, float], ...]
    play_deg: tuple[dict[int, float], dict[int, float]]
    doubts: tuple[str, ...]

    @property
    def distance_mm(self) -> Array:
        distance: Array = np.linalg.norm(self.apart_mm, axis=1)
        return distance

    def to_dict(self) -> dict[str, Any]:
        poses = {"q_deg": self.q_deg, "apart_mm": self.apart_mm, "turned_deg": self.turned_deg}
        poses |= {"taught_mm": self.taught_mm, "u_mm": self.u_mm}
        rows = zip(*(values.tolist() for values in poses.values()), strict=True)
        return {
            "arms": list(self.names),
            "rms_mm": rms(self.distance_mm),
            "max_mm": float(self.distance_mm.max()),
            "taught_rms_mm": rms(self.taught_mm),
            "turned_rms_deg": rms(self.turned_deg),
            "u_rms_mm": None if np.isnan(self.u_mm).any() else rms(self.u_mm),
            "constants": [dict(of_axis) for of_axis in self.constants],
            "play_deg": [{str(axis): width for axis, width in of_arm.items()} for of_arm in self.play_deg],
            "doubts": list(self.doubts),
            "poses": for_json([dict(zip(poses, row, strict=True)) for row in rows]),
        }


def arms_apart(rig: Rig, second: Rig) -> ArmsApart:
    """Raises FileError for different models."""
    bare = {"base": Pose(), "tool": rig.robot.tool, "rail": None}
    first, other = (
        CalibratedArm(of.model_copy(update={"robot": of.robot.model_copy(update=bare)})) for of in (rig, second)
    )
    arms = first, other
    q_deg = _postures(*arms)
    nominal = [CalibratedArm(arm.rig.model_copy(update={"effects": (), "calibrated": None})) for arm in arms]
    places = [arm.forward(q_deg).T[:, :3, 3] for arm in nominal]
    if rms(np.linalg.norm(places[1] - places[0], axis=1)) > _OTHER_MODEL_MM:
        problem = f"the arm has a different build than that of {rig.name}: {second.robot.name}, not {rig.robot.name}"
        remedy = "compare arms of the same model, or add RUN… to compare both with runs"
        raise FileError(second.name, problem, remedy, code="runs.not_comparable")
    stands = [arm.forward(q_deg) for arm in arms]
    difference, u_mm = pose_error(stands[0].T, stands[1].T), np.hypot(stands[0].u_mm, stands[1].u_mm)
    doubts = [
        f"{arm.rig.name} has neither effects nor calibration: rig compares the nominal arm"
        for arm in arms
        if not model_of(arm.rig).effects
    ]
    if not doubts and (unknown := int(np.isnan(u_mm).sum())):
        doubts.append(f"no u: at {unknown} of {len(u_mm)} postures the uncertainty of both arms is unknown")
    return ArmsApart(
        (rig.name, second.name),
        q_deg,
        difference[:, :3],
        np.degrees(np.linalg.norm(difference[:, 3:], axis=1)),
        rest_mm(stands[1].T[:, :3, 3], stands[0].T),
        u_mm,
        _constants(arms[0].rig, arms[1].rig),
        (dict(joint_traits(rig).play_deg), dict(joint_traits(second).play_deg)),
        tuple(doubts),
    )


def _postures(*arms: CalibratedArm) -> Array:
    robots = [arm.rig.robot for arm in arms]
    if len({len(robot.axes) for robot in robots}) > 1:
        problem = f"the arm has {len(robots[1].axes)} axes, that of {arms[0].rig.name} has {len(robots[0].axes)}"
        raise FileError(arms[1].rig.name, problem, "compare arms of the same model", code="runs.not_comparable")
    ranges = [[axis.limits_deg for axis in robot.axes] for robot in robots]
    ranges += [list(arm.rig.calibrated.joints_deg) for arm in arms if arm.rig.calibrated]
    low, high = np.array(ranges)[:, :, 0].max(axis=0), np.array(ranges)[:, :, 1].min(axis=0)
    if (low > high).any():
        axis = int(np.flatnonzero(low > high)[0]) + 1
        problem = f"the two arms share no angle of axis {axis}, according to the limits and the calibration runs"
        remedy = "calibrate both over the same angles"
        raise FileError(arms[1].rig.name, problem, remedy, code="runs.not_comparable")
    return np.asarray(np.random.default_rng(0).uniform(low, high, (_POSTURES, len(low))))


def _constants(*rigs: Rig) -> tuple[dict[str, float], ...]:
    """Second arm minus first, by axis."""
    first, second = (geometric_arm(model_of(rig)) for rig in rigs)
    columns = {name: getattr(second, key) - getattr(first, key) for name, key in _CONSTANTS}
    columns |= {name: np.degrees(column) for name, column in columns.items() if name.endswith("deg")}
    return tuple({name: float(column[axis]) for name, column in columns.items()} for axis in range(first.axes))


def arms_apart_answer(apart: ArmsApart) -> list[Block]:
    seen = apart.to_dict()
    first, second = map(escape_text, apart.names)
    u = "" if seen["u_rms_mm"] is None else f", known to {seen['u_rms_mm']:.3f} mm (u)"
    head = (
        f"The tool of {second} is {seen['rms_mm']:.3f} mm rms from that of {first} at the same joint angles, at most "
        f"{seen['max_mm']:.3f} mm{u}. With frame and tool taught on each arm, {seen['taught_rms_mm']:.3f} mm rms "
        "are left."
    )
    place = ", ".join(f"{angle:z.0f}" for angle in apart.q_deg[int(np.argmax(apart.distance_mm))])
    columns = ("axis", "zero °", "a mm", "d mm", "alpha °", "beta °", f"play {first} °", f"play {second} °")
    rows = []
    for axis, constants in enumerate(apart.constants, start=1):
        differences = [f"{value:+z.4f}" if abs(value) > _SHOWN else "" for value in constants.values()]
        plays = [f"{width[axis]:z.4f}" if axis in width else "" for width in apart.play_deg]
        rows.append((f"{axis}", *differences, *plays))
    return [
        Sentence(head),
        Sentence(f"Farthest apart at joint angles {place} °."),
        Heading(f"{second} less {first}", 3),
        Table(columns, tuple(rows), frozenset(range(len(columns)))),
        *paragraphs(apart.doubts, "doubt"),
    ]
