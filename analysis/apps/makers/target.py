"""Targets of robot programs in terms common to all dialects: points, their numbers in the text, and moves."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from analysis.apps.makers.program_machine import Unknown
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask
from rigs.schema.robot import LengthUnit

Form = Literal[
    "joints_rad", "joints_deg", "pulses", "rotation_vector", "roll_pitch_yaw", "inch_roll_pitch_yaw", "yaw_pitch_roll",
    "quaternion",
]  # fmt: skip
"""The meaning of the numbers of a target: joint angles 1 to 6, pulses, or a position followed by an orientation."""
JOINT_FORMS: tuple[Form, ...] = ("joints_rad", "joints_deg", "pulses")
Way = Literal["joint", "closest", "line"]
"""A joint move; one for which the controller, without configuration flags, chooses the closest solution; or a line or
arc."""


@dataclass(frozen=True)
class Number:
    """A number and its position in the text, from the character `begin` up to `end`."""

    begin: int
    end: int
    value: float


Agreeing = Callable[[Arm, Array, tuple[int, ...], float], Mask]
"""Mask (n,) of the solutions q (n, 6) rad, n at least 1, that agree with flag values, up to a tolerance in rad of an
angle beyond its sign, quadrant or turn."""


@dataclass(frozen=True)
class Flags:
    values: tuple[int, ...]
    agreeing: Agreeing
    renewed: Callable[[Arm, Array], tuple[int, ...]] | None = None
    """Computes the first flag values for joint angles (6,) rad, if rig may write them: the smallest correction takes an
    axis at the end of a quadrant out of it."""
    numbers: tuple[Number, ...] = ()
    """The flags in the text that may be written."""


@dataclass(frozen=True)
class Target:
    name: str
    file: int
    line: int
    form: Form
    numbers: tuple[Number, ...]
    """In the order of the form."""
    tool: Array | str = ""
    """A frame (4, 4) in mm, or its name in the program; also `frame`."""
    frame: Array | str = ""
    flags: Flags | None = None
    near: tuple[float, ...] | None = None
    offset: tuple[str, Array] | None = None
    """A frame (4, 4) in mm, added to the target with the index `of` in the "frame" or in the "tool"."""
    of: int | None = None
    unknown_offsets: bool = False
    external: tuple[tuple[str, float], ...] = ()
    """The external axes named by the target; others do not move."""
    remark: str = ""
    """Comment in the program that names the target."""

    @property
    def joints(self) -> bool:
        return self.form in JOINT_FORMS

    @property
    def is_reference(self) -> bool:
        """True if the target is a reference posture of the arm, such as home or a calibration mark, and not a point of
        the work. The joint angles must stay as they are."""
        if not self.joints:
            return False
        words = [word for name in (self.name, self.remark) for word in _WORD.findall(name)]
        return any(map(_REFERENCE.match, words)) or not any(number.value for number in self.numbers)


_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""A word of a name: XHOME, jHomePos, sync_pos_2."""
_REFERENCE = re.compile(r"[xpjq]?(?:home|sync|calib|master|(?:origin|zero)$)", re.IGNORECASE)
"""Words that name a reference posture, after the prefix that a dialect gives to points. `origin` and `zero` must be the
whole word, because original and zeroing name points of the work."""


@dataclass(frozen=True)
class UncorrectedTarget:
    file: int
    line: int
    name: str
    reason: Reason
    because: tuple[Unknown, ...] = ()


AT_BEGIN = -1


@dataclass(frozen=True)
class Arc:
    """An arc by target indices; None is an unknown position."""

    starts: frozenset[int | None]
    through: int | None
    end: int | None
    tangent: bool
    """True if the tool rotates with the tangent. Otherwise it rotates evenly from start to end, whatever the via point
    says."""


@dataclass(frozen=True)
class TargetMove:
    target: int
    comes_from: frozenset[int | None]
    """Possible targets; None for an unknown position, or AT_BEGIN."""
    way: Way = "joint"
    by_flags: bool = True
    """True if the configuration flags of the target are valid; otherwise the arm keeps its configuration."""
    arc: Arc | None = None


@dataclass(frozen=True)
class Notice:
    """A fact for the user's attention, which does not prevent a correction."""

    file: int
    line: int
    text: str


@dataclass(frozen=True)
class NamedFrame:
    """A tool or frame whose numbers the program sets, under the name that users state."""

    name: str
    kind: Literal["tool", "frame"]
    file: int
    line: int
    value: tuple[float, ...]
    """A frame (4, 4) in mm, row by row."""


@dataclass(frozen=True)
class Parsed:
    targets: tuple[Target, ...]
    steps: tuple[TargetMove, ...]
    left: tuple[UncorrectedTarget, ...]
    next_to_left: tuple[int, ...] = ()
    """Targets next to an uncorrected point, an entry per move."""
    sets: tuple[NamedFrame, ...] = ()
    notices: tuple[Notice, ...] = ()
    named: frozenset[tuple[str, str]] = frozenset()
    """Tools and frames that the user can state, by kind and name in lower case."""
    missing: tuple[str, ...] = ()
    """Called routines without text and unknown instructions, which the user can state as neutral."""


NEUTRAL = re.compile(r"\w[\w -]{0,39}|\$[\w.$\[\]]{1,60}\s*=\s*[\w.\[\]+-]{1,20}")
"""What a user can state to change nothing: a routine or macro, or the assignment of a system variable of FANUC."""


@dataclass(frozen=True)
class ProgramTexts:
    """The first `own` texts are corrected, the others are only read."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    own: int = 1
    neutral: tuple[str, ...] = ()
    """Names of routines that change nothing, as stated by the user; they have empty texts."""
    machine_unit: LengthUnit = "mm"
    """Unit of the lengths in the controller."""
    unread: tuple[str, ...] = ()
    """Names of encoded files, which have no text here."""
    is_directory: bool = False
    """True if the user gave the directory of all programs."""
    tables: tuple[tuple[str, str], ...] = ()
    """Names and texts of the files of a backup with the tools and frames of the controller."""
