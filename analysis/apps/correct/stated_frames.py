"""Statements of the user on the controller: tools, frames, neutral routines, and postures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from analysis.apps.correct.postures import UNSTATED, ProgramPostures
from analysis.apps.makers.target import NEUTRAL
from analysis.correction.table_postures import stated_posture
from analysis.robot.kinematics.arm import Array, transform
from rigs.errors import UseError
from rigs.rig import Rig
from rigs.schema.probe import MM_PER_UNIT
from rigs.schema.robot import LengthUnit, Pose, Robot
from rigs.text import numbers_in

_HOW = "write NAME=X,Y,Z or NAME=X,Y,Z,RX,RY,RZ in mm and degrees, roll-pitch-yaw about fixed axes"
_NEAREST_MM = 5.0
"""Distance below which a tool or frame is probably in metres. Chosen: no arm is longer than 5 m."""
_FARTHEST_MM = 1e6
"""Maximum distance of a frame: a kilometre is a typing error."""
_MOST_TURNED_DEG = 1000.0
"""Maximum joint angle: arms turn less than three times."""


@dataclass(frozen=True)
class Frames:
    tools: Mapping[str, Array] = field(default_factory=dict)
    """Frames (4, 4) in mm from the flange, by name in lower case."""
    frames: Mapping[str, Array] = field(default_factory=dict)
    """User frames in the robot's base."""
    neutral: tuple[str, ...] = ()
    """Routines without a text that change nothing."""

    def stated(self, kind: str, name: str) -> Array | None:
        return (self.tools if kind == "tool" else self.frames).get(name.lower())

    def refuse_turns(self, language: str) -> None:
        """Raise UseError for a frame that turns, in a language whose frames only shift."""
        for name, frame in self.frames.items():
            if not np.allclose(frame[:3, :3], np.eye(3), atol=1e-9):
                problem = f"turns, but {language} adds A, B and C of a work offset to the numbers of the pose"
                remedy = "give X,Y,Z, and 0 for the angles; with other angles, rig cannot correct the program"
                raise UseError(f"--frame {name.upper()}", problem, remedy, code="usage")

    def doubts(self, named: set[tuple[str, str]] | None, unit: LengthUnit | None) -> list[str]:
        """Doubts about frames that are probably in metres or inches, or that no move uses. named: kinds and names in
        use, None without programs. unit: of the controller."""
        doubts = []
        for kind, frames in (("tool", self.tools), ("frame", self.frames)):
            for name, frame in frames.items():
                if unit == "inch" and np.any(frame[:3, 3]):
                    mm, inch = frame[:3, 3].tolist(), (frame[:3, 3] / MM_PER_UNIT["inch"]).tolist()
                    read = (
                        f"read as {', '.join(f'{x:g}' for x in mm)} mm, which are {', '.join(f'{x:.4g}' for x in inch)}"
                    )
                    doubts.append(f"--{kind} {name}: {read} inch; the controller counts in inches, so compare with it")
                if named is not None and (kind, name) not in named:
                    fact = f"the programs contain no move that certainly uses a {kind} of that name"
                    doubts.append(f"--{kind} {name}: {fact}")
                if 0 < (away_mm := float(np.linalg.norm(frame[:3, 3]))) < _NEAREST_MM:
                    fact = f"a distance of only {away_mm:.3g} mm; lengths are in mm; in metres"
                    doubts.append(f"--{kind} {name}: {fact} the distance would be {1e3 * away_mm:.4g} mm")
        return doubts


NO_FRAMES = Frames()


def frames_of(robot: Robot, tools: Sequence[str], frames: Sequence[str], neutral: Sequence[str] = ()) -> Frames:
    """Parse texts "name=x,y,z,rx,ry,rz", "name=0" or, for the tool of the rig file, "name=rig", and lists of routines.

    Raises UseError for any other text, and for a name with two different frames.
    """
    routines = tuple(name.strip() for text in neutral for name in text.split(","))
    for name in routines:
        if not NEUTRAL.fullmatch(name):
            problem, remedy = "is not the name of a routine", "write NAME or NAME,NAME"
            raise UseError(f"--neutral {name}", problem, remedy, code="usage")
    return Frames(_named("--tool", tools, transform(robot.tool)), _named("--frame", frames, None), routines)


def _named(option: str, texts: Sequence[str], of_rig: Array | None) -> dict[str, Array]:
    frames: dict[str, Array] = {}
    for text in texts:
        name, equals, values = (part.strip() for part in text.partition("="))
        if not equals or not name:
            raise UseError(f"{option} {text}", "is not NAME=…", _HOW, code="usage")
        if values == "rig" and of_rig is not None:
            frame = of_rig
        elif values == "0":
            frame = np.eye(4)
        else:
            shift = numbers_in(values)
            numbers = _six(f"{option} {text}", f"{values},0,0,0" if len(shift) == 3 else values, _FARTHEST_MM, _HOW)
            frame = transform(Pose(xyz_mm=tuple(numbers[:3]), rpy_deg=tuple(numbers[3:])))
        if not np.array_equal(frames.setdefault(name.lower(), frame), frame):
            problem = "is given twice, with different numbers"
            raise UseError(f"{option} {name}", problem, "give it once", code="usage")
    return frames


def postures_of(rig: Rig, near: str | None, start: str | None) -> ProgramPostures:
    """Parse what the user states about the postures in programs, as on the command line.

    Raises UseError for two statements, and for a text that is not a posture of the arm.
    """
    if near is not None:
        stated = stated_posture(rig, near, start)
        return UNSTATED if stated is None else ProgramPostures(near=tuple(stated.q.tolist()))
    how = "give the six joint angles in degrees at the start of the program"
    numbers = () if start is None else _six(f"--start-joints {start}", start, _MOST_TURNED_DEG, how)
    return ProgramPostures(start=tuple(np.radians(numbers).tolist()) or None)


def _six(argument: str, text: str, limit: float, how: str) -> tuple[float, ...]:
    numbers = numbers_in(text)
    if len(numbers) != 6 or not all(abs(value) < limit for value in numbers):
        raise UseError(argument, "is not six numbers", how, code="usage")
    return numbers
