"""Running the files of a program, and the path that it drove."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.emulate.pendant import interpret
from analysis.apps.makers.emulated import Array, Event, LinearMove, Machine, Round, Stood
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from tests.worlds.interpreters.arms import flange_of, pose_of

ROUNDING = 1e-6
"""mm and rad by which a line to where the arm stands already may move it, from the decimals of a program."""


def run(dialect: MakerName, files: dict[str, str], rig: Rig) -> list[Event]:
    """What the arm of a rig does with a program; its files by name. Raises ProgramError for one that is refused."""
    machine = Machine(flange_of(rig), pose_of(rig.robot.tool) if dialect == "yaskawa" else None)
    interpret(dialect, files, machine)
    return machine.events


def along(pieces: list[LinearMove | Round], distance_mm: Array) -> tuple[Array, Rotation]:
    """Places (n, 3) mm and orientations at rising distances (n,) mm from the beginning of the first piece."""
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
    """The lines and arcs that have a length."""
    return [event for event in events if isinstance(event, LinearMove | Round) and event.length_mm > ROUNDING]


def stops(events: list[Event]) -> tuple[Array, Rotation]:
    """Places (n, 3) mm and orientations at which moves ended with a stop; those that move nothing left out."""
    poses = [event.pose if isinstance(event, Stood) else event.end for event in events if _ends(event)]  # type: ignore[union-attr]
    return np.array([pose.place for pose in poses]), Rotation.concatenate([pose.turn for pose in poses])


def _ends(event: Event) -> bool:
    if isinstance(event, LinearMove | Round):
        moves = event.length_mm > ROUNDING or (event.begin.turn.inv() * event.end.turn).magnitude() > ROUNDING
        return event.stops and moves
    return isinstance(event, Stood)
