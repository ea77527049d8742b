"""Numbers of a target to joint angles or a frame and back, and their text in the place and the style of the old one.

A remark at the end of a program, in the words and at the place that its language allows.

Sources: as for the dialects' readers. A remark of a pendant has at most 32 characters (FANUC B-83284EN, 4.13; Yaskawa
RE-CKI-A457), so a longer one takes several lines.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.correction.programs.target import Form, Number, Target
from analysis.kinematics.arm import Array, roll_pitch_yaw, transform
from analysis.robot_programs.text import fixed
from rigs.schema.robot import Pose

_M_MM = 1e3


@dataclass(frozen=True)
class Decimals:
    """How many decimals a dialect's numbers have: a number keeps its own, but not fewer than `least`, nor more than
    `most`. `place` is for coordinates, `turn` for angles and the parts of a quaternion."""

    place: tuple[int, int]
    turn: tuple[int, int]


def joints_of(target: Target, scale: Sequence[float] | None) -> Array:
    """Return the joint angles (6,) rad of a joint target; `scale` (6,) are the counts per degree of pulses."""
    values = np.array([number.value for number in target.numbers])
    if target.form == "pulses":
        values = values / np.asarray(scale)
    q: Array = values if target.form == "joints_rad" else np.radians(values)
    return q


def frame_of(form: Form, values: Sequence[float] | Array) -> Array:
    """Return the frame (4, 4) in mm of the numbers (6,) or (7,) of a pose."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    values = np.asarray(values, dtype=float)
    if form == "roll_pitch_yaw":
        return transform(Pose(xyz_mm=tuple(values[:3]), rpy_deg=tuple(values[3:])))
    if form == "yaw_pitch_roll":
        return transform(Pose(xyz_mm=tuple(values[:3]), rpy_deg=tuple(values[:2:-1])))
    T = np.eye(4)
    if form == "quaternion":
        T[:3, :3] = Rotation.from_quat(values[3:], scalar_first=True).as_matrix()
        T[:3, 3] = values[:3]
    else:
        T[:3, :3] = Rotation.from_rotvec(values[3:]).as_matrix()
        T[:3, 3] = _M_MM * values[:3]
    return T


def is_frame(form: Form, values: Sequence[float]) -> bool:
    """Whether numbers are finite, of a robot's size, and in a quaternion of length 1 within the rounding of a
    program."""
    if not np.isfinite(values).all() or max(map(abs, values)) > _LARGEST:
        return False
    return form != "quaternion" or abs(float(np.linalg.norm(values[3:])) - 1) < _LENGTH_OFF


_LARGEST = 1e9
"""A number beyond it is no coordinate of a robot; pulses stay below, too, and 9E9 is RAPID's word for no axis."""
_LENGTH_OFF = 1e-2
"""Chosen: quaternions with four decimals, as people type them, are within 1e-4; farther off it is a typing error."""


def joint_numbers(form: Form, q: Array, scale: Sequence[float] | None) -> Array:
    """Return the numbers (6,) of joint angles q (6,) rad."""
    if form == "joints_rad":
        return q
    degrees: Array = np.degrees(q)
    return degrees * np.asarray(scale) if form == "pulses" else degrees


def frame_numbers(form: Form, T: Array, old: Array) -> Array:
    """Return the numbers (6,) or (7,) of a frame (4, 4) in mm that are nearest to the `old` ones: an orientation has
    several sets of angles."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import

    turn = Rotation.from_matrix(T[:3, :3])
    if form == "quaternion":
        quaternion = turn.as_quat(scalar_first=True)
        return np.concatenate([T[:3, 3], quaternion if quaternion @ old[3:] >= 0 else -quaternion])
    if form == "rotation_vector":
        vector = turn.as_rotvec()
        angle = float(np.linalg.norm(vector))
        # A turn by no angle has every axis: it stays zero.
        axis = vector / angle if angle > 0 else np.zeros(3)
        vectors = [axis * (angle + 2 * np.pi * turns) for turns in (-2, -1, 0, 1, 2)]
        return np.concatenate([T[:3, 3] / _M_MM, _nearest(vectors, old[3:])])
    roll, pitch, yaw = np.degrees(roll_pitch_yaw(T))
    sets = [np.array([roll, pitch, yaw]), np.array([roll + 180, 180 - pitch, yaw + 180])]
    if form == "yaw_pitch_roll":
        sets = [angles[::-1] for angles in sets]
    sets = [angles + 360 * np.rint((old[3:] - angles) / 360) for angles in sets]
    return np.concatenate([T[:3, 3], _nearest(sets, old[3:])])


def _nearest(candidates: Sequence[Array], old: Array) -> Array:
    return min(candidates, key=lambda candidate: float(np.abs(candidate - old).max()))


def written(number: Number, text: str, value: float, form: Form, decimals: tuple[int, int]) -> str:
    """Return the text of a new value in the style of the old number: its decimals, its leading zero, its sign."""
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
    """Return the text with new numbers; where spaces stand between an equals sign and a number, as in the columns of
    FANUC's listings, they make up its width."""
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


_PENDANT = 32
"""Characters of a remark at the pendants of FANUC and Yaskawa."""
_LONGEST = 100
_BEFORE = {
    ".mod": re.compile(rb"^[ \t]*ENDMODULE\b", re.MULTILINE | re.IGNORECASE),
    ".dat": re.compile(rb"^[ \t]*ENDDAT\b", re.MULTILINE | re.IGNORECASE),
    ".ls": re.compile(rb"^/POS\b", re.MULTILINE),
    ".jbi": re.compile(rb"^[ \t]*END\b", re.MULTILINE),
}
"""What the remark stands before, in its last place in the file; it is the last line of other files."""
_NUMBERED = re.compile(rb"^[ \t]*(\d+):", re.MULTILINE)


def with_remark(name: str, data: bytes, remark: str) -> bytes:
    """Return the bytes of a program's file, by its name, with a remark in lines of their own; all else stays."""
    suffix = name[name.rfind(".") :].lower()
    returns = b"\r\n" if b"\r\n" in data else b"\r" if b"\r" in data and b"\n" not in data else b"\n"
    places = (
        [match.start() for match in _BEFORE[suffix].finditer(data.replace(b"\r", b"\n"))] if suffix in _BEFORE else []
    )
    at = places[-1] if places else len(data)
    lines = textwrap.wrap(remark, _PENDANT if suffix in (".ls", ".jbi") else _LONGEST)
    number = max([int(match[1][:9]) for match in _NUMBERED.finditer(data[:at].replace(b"\r", b"\n"))], default=0)
    begins = {".ls": "{:4d}:  !", ".jbi": "'", ".mod": "  ! ", ".script": "# ", ".urscript": "# "}
    begin = begins.get(suffix, "; ")
    remark_lines = [
        f"{begin.format(number + k)}{line}{' ;' if suffix == '.ls' else ''}" for k, line in enumerate(lines, start=1)
    ]
    whole = returns.join(line.encode("ascii") for line in remark_lines)
    if at == len(data) and data and not data.endswith((b"\n", b"\r")):
        return data + returns + whole
    return data[:at] + whole + returns + data[at:]
