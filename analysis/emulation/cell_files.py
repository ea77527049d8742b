"""The files of an emulated cell: its rig file, and what a perfect measurement would find in it."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.simulation.emulated_robot import EmulatedRobot, truth
from daq.store import durable
from rigs.errors import FileError
from rigs.rig import Rig

RIG, TRUTH = "rig.yaml", "truth.json"


def write_cell_files(directory: Path, rig: Rig, robot: EmulatedRobot, text: str) -> Path:
    """Write the files of an emulated cell into a directory, in place of those of an earlier one; return the rig file.

    text: of the rig file by which its daemon reads it. Raises FileError where they cannot be written.
    """
    path = directory / RIG
    try:
        directory.mkdir(parents=True, exist_ok=True)
        durable.replace(directory / TRUTH, (json.dumps(truth(rig, robot.traces), indent=2) + "\n").encode())
        for name, content in rig.beside.items():
            durable.replace(directory / name, content)
        durable.replace(path, text.encode())  # the last: by the others it is known as an emulated cell's
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None
    return path
