"""Run the files of a program and return the driven path."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.emulate.pendant import interpret
from analysis.apps.makers import maker_by
from analysis.apps.makers.emulated import Array, Event, LinearMove, Machine, PointToPointMove, Round
from analysis.apps.makers.motion_plan import Demand, MotionPlan, demand_of
from analysis.apps.makers.writing import programs_of
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from tests.worlds.interpreters.arms import flange_of, pose_of

ROUNDING = 1e-6
"""Motion in mm and rad allowed for a line to the current position, due to rounded numbers in the program."""


def files_of(dialect: MakerName, plan: MotionPlan, demand: Demand | None = None) -> dict[str, str]:
    """The program of a plan as files by name, with the line ends of the maker."""
    newline = maker_by(dialect).writer.newline
    files = programs_of(dialect, [(plan, demand or demand_of(plan))])
    return {name: text.replace("\n", newline) for name, text in files.items()}


def run(dialect: MakerName, files: dict[str, str], rig: Rig) -> list[Event]:
    """Run a program, given as files by name, on the arm of a rig. Raises ProgramError if it is refused."""
    machine = Machine(flange_of(rig), pose_of(rig.robot.tool) if maker_by(dialect).driver.tool_entered else None)
    interpret(dialect, files, machine)
    return machine.events


def along(pieces: list[LinearMove | Round], distance_mm: Array) -> tuple[Array, Rotation]:
    """Return positions (n, 3) mm and orientations at increasing distances (n,) mm from the start of the first piece."""
    places, quaternions = np.empty((len(distance_mm), 3)), np.empty((len(distance_mm), 4))
    begin = 0.0
    for number, piece in enumerate(pieces):
        end = begin + piece.length_mm
        here = (distance_mm >= begin) & ((distance_mm < end) | (number == len(pieces) - 1))
        if here.any():
            at, turns = piece.at((distance_mm[here] - begin) / max(piece.length_mm, 1e-9))
            places[here], quaternions[here] = at, turns.as_quat()
        begin = end
    return places, Rotation.from_quat(quaternions)


def paths(events: list[Event]) -> list[LinearMove | Round]:
    """Lines and arcs longer than zero."""
    return [event for event in events if isinstance(event, LinearMove | Round) and event.length_mm > ROUNDING]


def stops(events: list[Event]) -> tuple[Array, Rotation]:
    """Return positions (n, 3) mm and orientations of all stops after a motion."""
    poses = [event.pose if isinstance(event, PointToPointMove) else event.end for event in events if _ends(event)]  # type: ignore[union-attr]
    return np.array([pose.place for pose in poses]), Rotation.concatenate([pose.turn for pose in poses])


def _ends(event: Event) -> bool:
    if isinstance(event, LinearMove | Round):
        moves = event.length_mm > ROUNDING or (event.begin.turn.inv() * event.end.turn).magnitude() > ROUNDING
        return event.stops and moves
    return isinstance(event, PointToPointMove)
