"""Targets of robot programs in terms common to all dialects: points, their numbers in the text, and moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from analysis.apps.makers.program_machine import Unknown
from analysis.correction.reasons import POSE_OF_UNKNOWN_CONTROLLER, Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

Form = Literal[
    "joints_rad", "joints_deg", "pulses", "rotation_vector", "roll_pitch_yaw", "yaw_pitch_roll", "quaternion"
]
"""The meaning of the numbers of a target: joint angles 1 to 6, pulses, or a position followed by an orientation."""
JOINT_FORMS: tuple[Form, ...] = ("joints_rad", "joints_deg", "pulses")
Way = Literal["joint", "closest", "line"]
"""A joint move; one for which the controller, without posture flags, chooses the closest solution; or a line or arc."""


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
    """The posture of a target: flag values in the notation of a maker, and the function that checks solutions."""

    values: tuple[int, ...]
    agreeing: Agreeing
    renewed: Callable[[Arm, Array], tuple[int, ...]] | None = None
    """Returns the first flag values for joint angles (6,) rad, if rig may write them: an axis at the end of a quadrant
    leaves the quadrant by the smallest correction."""
    numbers: tuple[Number, ...] = ()
    """The flags in the text that may be written."""


@dataclass(frozen=True)
class Target:
    """A target with numbers.

    file: index of the program file. numbers: in the order of the form, regardless of the order in the text. tool,
    frame: frames (4, 4) in mm, or the name used by the program. near (6,): joint angles in rad close to the solution,
    as stated by the program. of, offset: index of another target, and the frame (4, 4) in mm added to it, in the frame
    or in the tool.
    """

    name: str
    file: int
    line: int
    form: Form
    numbers: tuple[Number, ...]
    tool: Array | str = ""
    frame: Array | str = ""
    flags: Flags | None = None
    near: tuple[float, ...] | None = None
    offset: tuple[str, Array] | None = None
    of: int | None = None
    unknown_offsets: bool = False
    """True if moves add an unknown offset to the target."""
    external: tuple[tuple[str, float], ...] = ()
    """The coordinates of external axes named by the target; other axes do not move."""

    @property
    def joints(self) -> bool:
        """Return whether the target is a set of joint angles; otherwise it is a pose."""
        return self.form in JOINT_FORMS


WHY: dict[Reason, str] = {
    "relative": "is a relative move",
    "computed": "is computed by the program",
    "not_literal": "is not a point with numbers in this program",
    "handed": "is an argument of a routine, which may use a different tool, frame or posture",
    "array": "is in an array, which rig does not trace",
    "arc": "belongs to an arc with an angle in degrees, which does not end at the target",
    "arc_centre": "is the end of an arc with a centre relative to the start (I, J, K), which would have to move too",
    "arc_turns": "is on an arc along which the tool turns with the tangent: the orientation there is not as written, "
    "or is unknown",
    "changed": "is also used, or assigned, elsewhere in the program",
    "offset": "is reached with an offset that is unknown, or for which the correction of the point is wrong",
    "displaced": "is moved by a displacement that is or may be active there",
    "tracked": "is, or may be, followed on a conveyor, or moved by a sensor or a force, there",
    "external_tcp": "is, or may be, reached with a tool fixed outside of the robot",
    "coordinated": "is, or may be, coordinated with a different axis or robot there",
    "switched": "may have a different meaning there, after a switch of the language",
    "selected": "belongs to a frame or a tool that may not be selected there, which some controllers do not check: "
    "select both before the move (UFRAME_NUM=, UTOOL_NUM=)",
    "not_understood": "is reached after something that is not understood, which may move or change anything",
    "unused": "is not the target of any move that was understood",
    "external_axes": "has external axes that carry the arm, or such an axis may not be at zero there",
    "other_robot": "belongs to a different robot of the controller than the first group or the first job of the file",
    "incomplete": "does not have all six numbers",
    "no_scale": "is in pulses: give --scale with the counts per degree of each axis",
    "several_frames": "is used with several tools or frames",
    "unknown_tool": "is in a tool that is unknown: give --tool",
    "unknown_frame": "is in a frame that is unknown: give --frame",
    "no_posture": "has an uncertain posture: some paths to this point do not define the posture",
    "ambiguous": "can be reached in several postures, and the program does not select one",
    "other_flags": "has flags of posture that no solution of the nominal arm has",
    "two_postures": "is reached in two postures, which need two corrections",
    "past_singularity": "is reached past a singularity, where the controller chooses the wrist posture",
    "unreachable": "is out of the nominal arm's reach",
    "beyond_limits": "is, or would be, beyond a joint's limits",
    "singular": "is at a singularity or at a limit, where a correction is impossible",
    "too_large": "would move by more than is plausible for a correction",
    "changes_flags": "would get a posture or turn that differs from the flags: touch the point up by hand",
    "controller_unknown": POSE_OF_UNKNOWN_CONTROLLER,
}
"""Predicates that complete a sentence with the target as the subject."""


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
    """An arc by target indices: possible starts, via point and end. None is an unknown position.

    tangent: the arc rotates the tool with the tangent. Otherwise the orientation changes from start to end, and the
    controller uses only the position of the via point.
    """

    starts: frozenset[int | None]
    through: int | None
    end: int | None
    tangent: bool


@dataclass(frozen=True)
class TargetMove:
    """A move to a target.

    target: index of the target. comes_from: indices of the possible previous targets, None for an unknown position,
    AT_BEGIN for the position at the start. by_flags: the posture flags of the target are valid; otherwise the arm keeps
    the current posture. arc: the arc of the move, if its targets may be passed in orientations other than written.
    """

    target: int
    comes_from: frozenset[int | None]
    way: Way = "joint"
    by_flags: bool = True
    arc: Arc | None = None


@dataclass(frozen=True)
class Notice:
    """A fact at a place in the program for the user's attention. It does not prevent the correction of a target."""

    file: int
    line: int
    text: str


@dataclass(frozen=True)
class Parsed:
    """The targets of a program, the moves, and the parts that cannot be corrected.

    next_to_left: targets next to an uncorrected point, an entry per move. sets: tools and frames with numbers set by
    the program itself. named: tools and frames used by moves that the user can state, by kind and name in lower case.
    """

    targets: tuple[Target, ...]
    steps: tuple[TargetMove, ...]
    left: tuple[UncorrectedTarget, ...]
    next_to_left: tuple[int, ...] = ()
    sets: tuple[NamedFrame, ...] = ()
    notices: tuple[Notice, ...] = ()
    named: frozenset[tuple[str, str]] = frozenset()


@dataclass(frozen=True)
class NamedFrame:
    """A tool or frame whose numbers, a frame (4, 4) in mm, are set by the program, under the name available to the
    user."""

    name: str
    kind: Literal["tool", "frame"]
    file: int
    line: int
    value: tuple[float, ...]


@dataclass(frozen=True)
class ProgramTexts:
    """The texts of files with their names. The first `own` texts are corrected; the others in the directory are only
    read. neutral: names of routines that change nothing, as stated by the user; they have empty texts."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    own: int = 1
    neutral: tuple[str, ...] = ()
