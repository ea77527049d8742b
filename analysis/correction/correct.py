"""All corrections of a rig: zeros, link constants, and the targets of a path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.correction.constants import Correction, joint_zeros, link_constants
from analysis.correction.corrected_targets import Corrected, angles_for, corrected
from analysis.correction.support import Support, supports
from analysis.correction.target_path import TargetPath, read_path
from rigs.errors import FileError
from rigs.rig import Rig


@dataclass(frozen=True)
class Corrections:
    """What can be corrected: the effects with their use, zeros and constants, and, if a path was given, the path and
    its corrected targets."""

    rig: Rig
    effects: tuple[Support, ...]
    zeros: tuple[Correction, ...]
    constants: tuple[Correction, ...]
    path: tuple[Path, TargetPath, Corrected] | None


def correct_rig(rig: Rig, path: Path | None) -> Corrections:
    """Return the corrections of a rig. Raises FileError for a rig without effects, and for a path that cannot be read
    or reached."""
    if not rig.effects:
        raise FileError(
            rig.name, "has no effects to correct", "diagnose or calibrate it, and give the rig file written"
        )
    found = supports(rig)
    targets = None
    if path:
        given = read_path(path)
        q = np.radians(given.values) if given.joints else angles_for(rig, given.poses(), given.lines, str(path))
        targets = path, given, corrected(rig, found, q, given.lines, str(path))
    return Corrections(rig, tuple(found), tuple(joint_zeros(found)), tuple(link_constants(rig, found)), targets)
