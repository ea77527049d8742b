"""Conversion of the numbers of a target to joint angles or a frame and back, and to text in the style of the old."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.makers.program_text import fixed
from analysis.apps.makers.target import Form, Number, Target
from analysis.robot.kinematics.arm import Array, roll_pitch_yaw, transforms

_M_MM = 1e3
_MM_OF_INCHES = np.array([25.4, 25.4, 25.4, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Decimals:
    """Least and most decimals of a dialect. Between these limits a number keeps its decimals."""

    place: tuple[int, int]
    turn: tuple[int, int]


def joints_of(target: Target, scale: Sequence[float] | None) -> Array:
    """Joint angles (6,) rad of a joint target. scale (6,): counts per degree, for pulses."""
    values = np.array([number.value for number in target.numbers])
    if target.form == "pulses":
        values = values / np.asarray(scale)
    q: Array = values if target.form == "joints_rad" else np.radians(values)
    return q


def frame_of(form: Form, values: Sequence[float] | Array) -> Array:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    if form == "inch_roll_pitch_yaw":
        return frame_of("roll_pitch_yaw", np.asarray(values) * _MM_OF_INCHES)
    values = np.asarray(values, dtype=float)
    if form == "roll_pitch_yaw":
        return transforms(values)
    if form == "yaw_pitch_roll":
        return transforms(np.concatenate([values[:3], values[:2:-1]]))
    T = np.eye(4)
    if form == "quaternion":
        T[:3, :3] = Rotation.from_quat(values[3:], scalar_first=True).as_matrix()
        T[:3, 3] = values[:3]
    else:
        T[:3, :3] = Rotation.from_rotvec(values[3:]).as_matrix()
        T[:3, 3] = _M_MM * values[:3]
    return T


def is_frame(form: Form, values: Sequence[float]) -> bool:
    """True if the numbers of a pose are finite and of plausible size, and a quaternion has length 1 within rounding."""
    if not np.isfinite(values).all() or max(map(abs, values)) > _LARGEST:
        return False
    return form != "quaternion" or abs(float(np.linalg.norm(values[3:])) - 1) < _LENGTH_OFF


_LARGEST = 1e9
"""Limit for the coordinates of a robot. Pulses stay below it, and 9E9 stands for an absent axis."""
_LENGTH_OFF = 1e-2
"""Tolerance for the length of a quaternion. Chosen: four decimals, as typed by users, give an error below 1e-4."""


def joint_numbers(form: Form, q: Array, scale: Sequence[float] | None) -> Array:
    if form == "joints_rad":
        return q
    degrees: Array = np.degrees(q)
    return degrees * np.asarray(scale) if form == "pulses" else degrees


def frame_numbers(form: Form, T: Array, old: Array) -> Array:
    """Numbers (6,) or (7,) of a frame (4, 4) in mm: of the sets for one orientation, those nearest to the old ones."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    turn = Rotation.from_matrix(T[:3, :3])
    if form == "quaternion":
        quaternion = turn.as_quat(scalar_first=True)
        return np.concatenate([T[:3, 3], quaternion if quaternion @ old[3:] >= 0 else -quaternion])
    if form == "rotation_vector":
        vector = turn.as_rotvec()
        angle = float(np.linalg.norm(vector))
        # A zero rotation has no axis: the vector is zero.
        axis = vector / angle if angle > 0 else np.zeros(3)
        vectors = [axis * (angle + 2 * np.pi * turns) for turns in (-2, -1, 0, 1, 2)]
        return np.concatenate([T[:3, 3] / _M_MM, _nearest(vectors, old[3:])])
    roll, pitch, yaw = np.degrees(roll_pitch_yaw(T))
    sets = [np.array([roll, pitch, yaw]), np.array([roll + 180, 180 - pitch, yaw + 180])]
    if form == "yaw_pitch_roll":
        sets = [angles[::-1] for angles in sets]
    sets = [angles + 360 * np.rint((old[3:] - angles) / 360) for angles in sets]
    numbers = np.concatenate([T[:3, 3], _nearest(sets, old[3:])])
    return numbers / _MM_OF_INCHES if form == "inch_roll_pitch_yaw" else numbers


def _nearest(candidates: Sequence[Array], old: Array) -> Array:
    return min(candidates, key=lambda candidate: float(np.abs(candidate - old).max()))


def written(number: Number, text: str, value: float, form: Form, decimals: tuple[int, int]) -> str:
    """Format a new value in the style of the old number: decimals, leading zero and sign."""
    old = text[number.begin : number.end]
    if form == "pulses":
        return str(round(value))
    least, most = decimals
    if abs(value - number.value) <= 0.5 * 10.0**-most:
        return old
    decimals_of_old = most if re.search("[eE]", old) else len(old.partition(".")[2])
    new = fixed(value, max(least, min(decimals_of_old, most)))
    if float(new) == number.value:
        return old
    if re.match(r"[-+]?\.", old):
        new = re.sub(r"^(-?)0\.", r"\1.", new)
    return f"+{new}" if old.startswith("+") and not new.startswith("-") else new


def replaced(text: str, changes: Sequence[tuple[Number, str]]) -> str:
    """Put new numbers into the text. Spaces between an equals sign and a number give way, to keep the columns."""
    parts, at = [], 0
    for number, new in sorted(changes, key=lambda change: change[0].begin):
        before = text[at : number.begin]
        spaces = len(before) - len(before.rstrip(" "))
        wider = len(new) - (number.end - number.begin)
        if spaces > 1 and before[: len(before) - spaces].endswith("="):
            kept = max(1, spaces - wider)
            before = before[: len(before) - spaces] + " " * kept
        parts += [before, new]
        at = number.end
    return "".join([*parts, text[at:]])
