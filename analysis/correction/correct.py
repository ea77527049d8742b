"""All corrections of a rig: zeros, link constants, and the targets of a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.correction.constants import Correction, joint_zeros, link_constants
from analysis.correction.controller_entries import ControllerEntries, as_entered, controller_entries
from analysis.correction.corrected_targets import Corrected, angles_for, corrected
from analysis.correction.support import Support, supports
from analysis.correction.target_path import TargetPath, hold_uncorrected, read_path
from rigs.errors import FileError, RigPlace, UseError
from rigs.rig import Rig
from rigs.schema.vocabulary import Maker


@dataclass(frozen=True)
class Corrections:
    """What can be corrected: the effects with their use, zeros and constants; at a controller, the entries in its
    words; and, if a path was given, the path and its corrected targets."""

    rig: Rig
    effects: tuple[Support, ...]
    zeros: tuple[Correction, ...]
    constants: tuple[Correction, ...]
    path: tuple[Path, TargetPath, Corrected] | None
    at_controller: ControllerEntries | None = None


def correct_rig(
    rig: Rig,
    path: Path | None,
    controller: Maker | None = None,
    scale: Sequence[float] | None = None,
    *,
    entered: bool = False,
) -> Corrections:
    """Return the corrections of a rig, at a controller where one is given, of which `scale` (6,) has the counts per
    degree or gear ratios; `entered` states that the controller has its entries, so that targets are for it with them.
    Raises FileError for a rig without effects, and for a path that cannot be read or reached; UseError for `entered`
    without what it needs."""
    if not rig.effects:
        raise FileError(
            RigPlace.of(rig.name),
            "has no effects to correct",
            "diagnose or calibrate it, and give the rig file written",
        )
    if entered and not (path and controller):
        raise UseError("--entered", "needs --path, and --controller or a feedback that names it", "give both")
    found = supports(rig)
    entries = controller_entries(rig, found, controller, scale) if controller else None
    zeros, constants = joint_zeros(found), link_constants(rig, found)
    targets = _targets(rig, found, path, entries if entered else None) if path else None
    return Corrections(rig, tuple(found), tuple(zeros), tuple(constants), targets, entries)


def _targets(
    rig: Rig, found: Sequence[Support], path: Path, entered: ControllerEntries | None
) -> tuple[Path, TargetPath, Corrected]:
    """Return a path and its corrected targets, for a controller as it was or with `entered`."""
    given = read_path(path)
    hold_uncorrected(given, str(path))
    q = np.radians(given.values) if given.joints else angles_for(rig, given.poses(), given.lines, str(path))
    targets = corrected(rig, found, q, given.lines, str(path))
    return path, given, as_entered(rig, targets, entered) if entered else targets
