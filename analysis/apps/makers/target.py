"""Targets of robot programs in terms common to all dialects: points, their numbers in the text, and moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from analysis.apps.makers.program_machine import Unknown
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

Form = Literal[
    "joints_rad", "joints_deg", "pulses", "rotation_vector", "roll_pitch_yaw", "yaw_pitch_roll", "quaternion"
]
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
"""Function returning a mask (n,) of the solutions q (n, 6) rad, n at least 1, that agree with flag values. The last
argument is the tolerance in rad of an angle beyond its sign, quadrant or turn."""


@dataclass(frozen=True)
class Flags:
    """The configuration of a target in the notation of a maker, and the function that checks solutions."""

    values: tuple[int, ...]
    agreeing: Agreeing
    renewed: Callable[[Arm, Array], tuple[int, ...]] | None = None
    """Returns the first flag values for joint angles (6,) rad, if rig may write them: an axis at the end of a quadrant
    leaves the quadrant by the smallest correction."""
    numbers: tuple[Number, ...] = ()
    """The flags in the text that may be written."""


@dataclass(frozen=True)
class Target:
    name: str
    file: int
    line: int
    form: Form
    numbers: tuple[Number, ...]
    """In the order of the form, regardless of the order in the text."""
    tool: Array | str = ""
    """A frame (4, 4) in mm, or the name used by the program; also `frame`."""
    frame: Array | str = ""
    flags: Flags | None = None
    near: tuple[float, ...] | None = None
    """Joint angles (6,) in rad close to the solution, as stated by the program."""
    offset: tuple[str, Array] | None = None
    """A frame (4, 4) in mm added to the target with the index `of`, in the "frame" or in the "tool"."""
    of: int | None = None
    unknown_offsets: bool = False
    """True if moves add an unknown offset to the target."""
    external: tuple[tuple[str, float], ...] = ()
    """The coordinates of external axes named by the target; other axes do not move."""

    @property
    def joints(self) -> bool:
        """True for a set of joint angles, False for a pose."""
        return self.form in JOINT_FORMS


@dataclass(frozen=True)
class UncorrectedTarget:
    """An uncorrected part of a program: place, name, reason, and the places that cause it."""

    file: int
    line: int
    name: str
    reason: Reason
    because: tuple[Unknown, ...] = ()


AT_BEGIN = -1
"""Index for the position of the arm at the start of the program."""


@dataclass(frozen=True)
class Arc:
    """An arc by target indices; None is an unknown position."""

    starts: frozenset[int | None]
    through: int | None
    end: int | None
    tangent: bool
    """True if the arc rotates the tool with the tangent. Otherwise the orientation changes from start to end, and the
    controller uses only the position of the via point."""


@dataclass(frozen=True)
class TargetMove:
    """A move to the target with an index, from one of several possible targets."""

    target: int
    comes_from: frozenset[int | None]
    """None for an unknown position, AT_BEGIN for the position at the start."""
    way: Way = "joint"
    by_flags: bool = True
    """True if the configuration flags of the target are valid; otherwise the arm keeps its configuration."""
    arc: Arc | None = None
    """The arc of the move, if its targets may be passed in orientations other than written."""


@dataclass(frozen=True)
class Notice:
    """A fact at a place in the program for the user's attention. It does not prevent the correction of a target."""

    file: int
    line: int
    text: str


@dataclass(frozen=True)
class NamedFrame:
    """A tool or frame whose numbers, a frame (4, 4) in mm, are set by the program, under the name that users state."""

    name: str
    kind: Literal["tool", "frame"]
    file: int
    line: int
    value: tuple[float, ...]


@dataclass(frozen=True)
class Parsed:
    """The targets of a program, the moves, and the parts that cannot be corrected."""

    targets: tuple[Target, ...]
    steps: tuple[TargetMove, ...]
    left: tuple[UncorrectedTarget, ...]
    next_to_left: tuple[int, ...] = ()
    """Targets next to an uncorrected point, an entry per move."""
    sets: tuple[NamedFrame, ...] = ()
    notices: tuple[Notice, ...] = ()
    named: frozenset[tuple[str, str]] = frozenset()
    """Tools and frames used by moves that the user can state, by kind and name in lower case."""


@dataclass(frozen=True)
class ProgramTexts:
    """The texts of files with their names. The first `own` texts are corrected, the others are only read."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    own: int = 1
    neutral: tuple[str, ...] = ()
    """Names of routines that change nothing, as stated by the user; they have empty texts."""
