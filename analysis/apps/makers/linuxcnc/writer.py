"""Writer of G-code for LinuxCNC with the kinematics genserkins.

Sources: LinuxCNC 2.9, G-code reference, Switchable Kinematics, manual page kins(9); linuxcnc-uspace 2.9.0 drove the
programs.

- X Y Z A B C is the pose of the flange, with roll, pitch and yaw: genserkins has no tool. Paths become lines, along
  which A, B, C change evenly, or G2 and G3 if the flange moves on a circle in a coordinate plane.
- Joint moves select the second kinematics. Its X, Y, Z are joints in the unit of the machine: G20 if it is inch.
- Each move states its duration (G93), because F would count the path of the flange and not that of the tool.
- A change of kinematics takes A, B, C into ±180. The offset of G59.3 restores whole turns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from analysis.apps.makers.motion_plan import (
    Arc,
    Demand,
    JointMove,
    MotionPlan,
    PlannedTarget,
    Signal,
    StraightMove,
    ToolRotation,
    end_of,
    start_of,
)
from analysis.apps.makers.program_text import (
    DEG_DECIMALS,
    MM_DECIMALS,
    Words,
    fixed,
    fixed_xyz_deg,
    heading,
    identifier,
    labelled,
    shown_pose,
)
from analysis.apps.makers.program_writer import BY_ITSELF, ProgramWriter
from analysis.apps.makers.tool_paths import ToolPath, circular_path, rotation_path, straight_path
from analysis.robot.geometry.circle import circles_through
from analysis.robot.kinematics.arm import Array, transforms
from rigs.errors import FileError
from rigs.schema.feedback import LinuxCNC

_WORDS = Words("G4 P{}", 3, "M64 P{}", "M65 P{}", "; {}", 100, "M0")
_NAME_LENGTH = 60
_CHORD_MM, _COARSE_MM = 1e-3, 2e-2
"""Largest deviation of the tool from a curve: the resolution of probes that read along it. Between the stops of a test
only the link has to follow, which has some 0.1 mm of play for the probes."""
_SHORTEST = 2.0**-14
"""Smallest share of a move for a line. A shorter line would be needed where B passes ±90°."""
_LEAST_S = 0.5
"""Duration of a line without length, which moves by some mm if constants were entered since."""
_AWAY_MM = 10.0
"""Difference between the start and the displayed pose, summed over X, Y and Z, above which units or arm are wrong.
Chosen: larger than any correction of constants."""
_JOINTS, _POSES = ("M68 E3 Q1", "M66 E0 L0"), ("M68 E3 Q0", "M66 E0 L0")
"""Change of the kinematics and synchronisation, by the usual output of motion.switchkins-type."""
_ZERO = "G10 L2 P9 X0 Y0 Z0 A0 B0 C0 R0"


@dataclass
class _Program:
    plan: MotionPlan
    lines: list[str] = field(default_factory=list)
    numbers: Array = field(default_factory=lambda: np.zeros(6))
    """The last commanded X … C."""
    at: PlannedTarget | None = None
    stops: bool | None = None
    """The mode at the ends of moves: exact stop, or blending."""

    def joints(self, step: JointMove) -> None:
        joints = np.degrees(step.target.q)
        inch = self.plan.length_unit == "inch"
        degrees_min = 60 * np.degrees(step.speed_rad_s)
        if self.at is None:
            # The joints stand anywhere. The sum of their ways limits the fastest of them.
            ways = " + ".join(f"ABS[#{5420 + k}{-value:+z.4f}]" for k, value in enumerate(joints))
            rate = f"[{fixed(degrees_min, 2)} / [0.01 + {ways}]]"
        else:
            rate = fixed(degrees_min / max(float(np.abs(joints - np.degrees(self.at.q)).max()), 0.01), 6)
        self._ends(stops=True)
        # In the unit of an inch machine X, Y and Z are joint angles.
        self.lines += [_ZERO, *_JOINTS, *["G20"] * inch, f"G1 {_words(joints)} F{rate}", *_POSES, *["G21"] * inch]
        T = self.flanges(step.target.T[None])[0]
        self.numbers, self.at = np.array([*T[:3, 3], *fixed_xyz_deg(T)]), step.target
        self._check_start()

    def _check_start(self) -> None:
        """Compare the displayed pose with that of the rig file, and take whole turns of A, B and C as offsets."""
        number = len(self.lines)
        away = " + ".join(f"ABS[#{5420 + k}{-value:+z.4f}]" for k, value in enumerate(self.numbers[:3]))
        turns = " ".join(
            f"{letter}[360 * ROUND[[#{5423 + k}{-value:+z.4f}] / 360]]"
            for k, (letter, value) in enumerate(zip("ABC", self.numbers[3:], strict=True))
        )
        self.lines += [
            f"o{number} if [[{away}] GT {_AWAY_MM:g}]",
            "(MSG, the pose differs from the rig file: compare units, genserkins and HOME_OFFSET)",
            "M2",
            f"o{number} endif",
            f"G10 L2 P9 X0 Y0 Z0 {turns} R0",
        ]

    def _path(self, step: StraightMove | ToolRotation | Arc, shares: Array | None = None) -> ToolPath:
        assert self.at is not None  # noqa: S101 - the first step is a joint move
        begin = self.at.T
        match step:
            case Arc(via, end, speed_mm_s):
                return circular_path(begin, via.T[:3, 3], end.T, speed_mm_s, shares)
            case ToolRotation(target, _, speed_rad_s):
                return rotation_path(begin, target.T, speed_rad_s, shares)
            case StraightMove(target, speed_mm_s):
                return straight_path(begin, target.T, speed_mm_s, shares)

    def flanges(self, tools: Array) -> Array:
        return np.asarray(tools @ np.linalg.inv(self.plan.arm.T_flange_tool))

    def along(self, step: StraightMove | ToolRotation | Arc) -> None:
        path, stops = self._path(step), isinstance(step, ToolRotation) or step.stops
        coarse = self.plan.has_link and not (isinstance(step, Arc) and step.with_path)
        numbers = self._unwound(path.poses)
        if isinstance(step, Arc) and (words := _arc_words(self.numbers, numbers)):
            self._ends(stops=stops)
            self.lines.append(f"{words} F{_per_minute(path.seconds)}")
        else:
            shares, numbers = self._refined(partial(self._path, step), _COARSE_MM if coarse else _CHORD_MM)
            for k, (share, row) in enumerate(zip(np.diff(shares), numbers, strict=True), start=1):
                self._ends(stops=stops and k == len(numbers))
                self.lines.append(f"G1 {_words(row)} F{_per_minute(share * path.seconds)}")
        self.numbers, self.at = numbers[-1], end_of(step)

    def _unwound(self, tools: Array) -> Array:
        """Numbers X … C (n - 1, 6) of tool poses (n, 4, 4) after the first, without jumps by turns."""
        flanges = self.flanges(tools[1:])
        angles, before = fixed_xyz_deg(flanges), self.numbers[3:]
        for row in angles:
            row[:] = before = _nearest(row[None], before[None])[0]
        return np.concatenate([flanges[:, :3, 3], angles], axis=1)

    def _refined(self, path: Callable[[Array], ToolPath], chord_mm: float) -> tuple[Array, Array]:
        """Shares (n + 1,) of a path between which lines keep flange and tool on it, and their numbers (n, 6)."""
        begins, ends, fine = np.zeros(1), np.ones(1), list[Array]()
        while len(begins):
            if ends[0] - begins[0] < _SHORTEST:
                problem = "B of the flange passes ±90°, where A and C have no definite values"
                remedy = "turn the tool on the flange, or choose a different posture"
                raise FileError(self.plan.name, problem, remedy, code="path.impossible")
            middles = (begins + ends) / 2
            first, middle, last = np.split(self.flanges(path(np.concatenate([begins, middles, ends])).poses), 3)
            # The middle of a line is at the mean of the numbers of its ends.
            begin_deg = fixed_xyz_deg(first)
            mean_deg = (begin_deg + _nearest(fixed_xyz_deg(last), begin_deg)) / 2
            off = transforms(np.concatenate([(first + last)[:, :3, 3] / 2, mean_deg], axis=1)) - middle
            at_tool = off @ self.plan.arm.T_flange_tool
            off_mm = np.linalg.norm([off[:, :3, 3], at_tool[:, :3, 3]], axis=2).max(axis=0)
            split = off_mm > chord_mm
            fine.append(ends[~split])
            begins = np.concatenate([begins[split], middles[split]])
            ends = np.concatenate([middles[split], ends[split]])
        shares = np.concatenate([[0.0], np.sort(np.concatenate(fine))])
        return shares, self._unwound(path(shares).poses)

    def _ends(self, *, stops: bool) -> None:
        """Select an exact stop at the ends of the next moves, or blending."""
        if self.stops is not stops:
            self.lines.append("G61.1" if stops else f"G64 P{_CHORD_MM:g}")
            self.stops = stops


def _nearest(angles: Array, to: Array) -> Array:
    """Angles A, B, C (n, 3) of the same orientations nearest to others (n, 3), in degrees."""
    sets = np.stack([angles, angles * [1, -1, 1] + 180])  # each orientation has two sets of angles
    sets += 360 * np.rint((to - sets) / 360)
    return np.asarray(sets[np.abs(sets - to).max(axis=2).argmin(axis=0), np.arange(len(angles))])


_PLANES = ((17, 2, (0, 1), "IJ"), (18, 1, (2, 0), "KI"), (19, 0, (1, 2), "JK"))
"""Plane, its normal, its axes so that G3 turns from the first to the second, and the words of the centre."""
_PLANE_MM, _EVEN_DEG = 1e-7, 1e-7


def _arc_words(begin: Array, numbers: Array) -> str:
    """Words of a G2 or G3 along numbers X … C (n, 6) at equal shares of a path.

    Empty unless they lie on a circle in a coordinate plane, and A, B, C change evenly.
    """
    rows = np.concatenate([begin[None], numbers])
    shares = np.linspace(0, 1, len(rows))[:, None]
    if np.abs(rows[:, 3:] - rows[0, 3:] - shares * (rows[-1, 3:] - rows[0, 3:])).max() > _EVEN_DEG:
        return ""
    for plane, normal, (first, second), letters in _PLANES:
        if np.ptp(rows[:, normal]) > _PLANE_MM:
            continue
        flat = np.stack([rows[:, first], rows[:, second], np.zeros(len(rows))], axis=1)
        if np.linalg.norm(flat[-1] - flat[0]) < _PLANE_MM:
            return ""
        centres, axes, _ = circles_through(flat[[0, len(flat) // 2, -1]][None])
        away = np.linalg.norm(flat - centres[0], axis=1)
        if np.ptp(away) > _PLANE_MM:
            return ""
        centre = centres[0] - flat[0]
        words = f"{letters[0]}{fixed(centre[0], MM_DECIMALS)} {letters[1]}{fixed(centre[1], MM_DECIMALS)}"
        return f"G{plane} G{3 if axes[0, 2] > 0 else 2} {_words(rows[-1])} {words}"
    return ""


def _words(numbers: Array) -> str:
    places = labelled("{}{}", "XYZ", numbers[:3], MM_DECIMALS)
    return " ".join(places + labelled("{}{}", "ABC", numbers[3:], DEG_DECIMALS))


def _per_minute(seconds: float) -> str:
    return fixed(60 / max(seconds, _LEAST_S if seconds < 1e-6 else 0.0), 6)


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    program = _Program(plan)
    flange = program.flanges(start_of(plan).T[None])[0]
    program.lines += _WORDS.remarks(*heading(plan, demand, shown_pose(flange, "ABC")))
    program.lines += ["G21 G90 G17 G40 G49 G80 G93", "G92.1", _ZERO, "G59.3"]
    for step in plan.steps:
        match step:
            case Signal(value) if plan.signal_place.int_register is not None:
                program.lines.append(f"M68 E{plan.signal_place.int_register} Q{value}")
            case JointMove():
                program.joints(step)
            case StraightMove() | ToolRotation() | Arc():
                program.along(step)
            case _:
                program.lines += _WORDS.lines(plan, step, lambda _: [])
    return {f"{identifier(plan.name, _NAME_LENGTH)}.ngc": "\n".join([*program.lines, "G94", "M2", ""])}


WRITER = ProgramWriter(write, {LinuxCNC: BY_ITSELF}, "\n", range(64))
"""LinuxCNC has 4 digital outputs by default, and 64 with num_dio of motmod."""
