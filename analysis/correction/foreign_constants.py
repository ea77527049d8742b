"""Detection of controller constants that belong to another robot of the same type.

The links of a robot do not change after the factory measured them, so they lie near the constants of its controller.
The constants of another robot are as far from them as two robots of the type are from each other. Joint zeros can
change, and base and tool are fitted, so they do not count.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.correction.pose_uncertainty import PoseUncertainty, frame_u_mm, pose_uncertainty
from analysis.correction.support import supports
from analysis.correction.work import rms_um, spread_angles, tool_poses
from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.judge.act_list import CHECK_CONSTANTS
from analysis.robot.description.controller_constants import data_sheet_of
from analysis.robot.kinematics.arm import Arm, Array, arm_of, controller_arm, forward
from analysis.robot.predict import model_of
from analysis.runs.loading import Measured, rig_of
from rigs.effects.link_geometry import LinkGeometry
from rigs.errors import FileError, RigPlace
from rigs.rig import Rig
from rigs.schema.robot import constants_hash

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis

_DOUBTED_SHARE = 0.7
"""Distance from the controller's constants, relative to that from the data sheet, above which they are doubted. The
expected ratio is 0 for constants of this robot, and √2 for those of another one: 1.29 to 3.2 for eight UR arms."""
_HEALTHY_UM = 3000.0
"""Twice the largest distance of the links of nine delivered UR arms from the data sheet (1530 µm). If the links are
farther away, a crash is likely."""
_STEP_RAD = 1e-5


@dataclass(frozen=True)
class LinkDistances:
    """RMS tool distances in µm caused by the links alone."""

    controller_um: float
    data_sheet_um: float
    u_um: float

    @property
    def ratio(self) -> float:
        """Distance from the controller relative to that from the data sheet; 0 if the uncertainty explains it."""
        significant = self.controller_um > SURE_SIGMA * self.u_um
        return self.controller_um / max(self.data_sheet_um, 1e-9) if significant else 0.0

    def __str__(self) -> str:
        return (
            f"its links differ from these constants by {self.controller_um:.0f} ± {self.u_um:.0f} µm rms at the tool, "
            f"and from the data sheet by {self.data_sheet_um:.0f} µm"
        )


def refuse_constants_of_another(rig: Rig, name: str, *, anyway: bool) -> None:
    """Refuse constants that a diagnosis doubted, unless `anyway`, and constants given after a diagnosis that the
    calibrated links contradict more than those of the rig file.

    Raises FileError.
    """
    judged = rig.calibrated.judged if rig.calibrated else None
    if judged and judged.measure_why == CHECK_CONSTANTS.why and not anyway:
        problem = "was calibrated with constants that may be those of another robot"
        remedy = "diagnose again with --calibration FILE of this robot; --anyway writes the files with a remark"
        raise FileError(name, problem, remedy, code="robot.other")
    given = rig.robot.controller_axes
    if not given or not rig.is_calibrated or constants_hash(given) == constants_hash(rig.robot.axes):
        return
    uncertainty = pose_uncertainty(rig, supports(rig))
    found = _distances(rig, controller_arm(rig.robot), arm_of(rig.robot), uncertainty)
    if found.ratio > _DOUBTED_SHARE:
        remedy = "give the file of this robot; if it is, diagnose again with --calibration FILE"
        problem = f"the constants are probably those of another robot: {found}"
        raise FileError(name, problem, remedy, code="robot.other")


def with_controller_doubts(diagnosis: Diagnosis, runs: Iterable[Measured]) -> Diagnosis:
    """Add doubts about the constants with which an arm was diagnosed from runs. If its links contradict them, the only
    action is to check them, and the calibrated model states it.

    Raises FileError if the links are nearer to the data sheet than to these constants.
    """
    of_links = doubt_links(diagnosis)
    stated = "" if any(map(_shows_data_sheet, runs)) else diagnosis.rig.controller_doubt
    diagnosis = replace(diagnosis, doubts=(*filter(None, (of_links, stated)), *diagnosis.doubts))
    if not of_links or diagnosis.given:
        return diagnosis
    calibrated = diagnosis.calibrated
    if calibrated is not None and calibrated.judged is not None:
        first = {"measure_first": True, "measure_why": CHECK_CONSTANTS.why}
        calibrated = calibrated.with_values(judged=calibrated.judged.model_copy(update=first))
    return replace(diagnosis, acts=(CHECK_CONSTANTS,), calibrated=calibrated)


def _shows_data_sheet(run: Measured) -> bool:
    """True if the controller is simulated, or if its poses in the run are those of the data sheet."""
    return run.is_simulated or (run.rig.controller == "data_sheet" and rig_of(run.run).robot.controller is None)


def doubt_links(diagnosis: Diagnosis) -> str:
    """Doubt about constants that the calibrated links contradict; empty if they fit. Raises FileError if the links are
    farther from them than from the data sheet."""
    rig, calibrated = diagnosis.rig, diagnosis.calibrated
    if calibrated is None or not rig.has_controller_constants or rig.robot.linear_units:
        return ""
    real = diagnosis.extended_rig.with_calibration(None, calibrated)
    sheet = None
    with suppress(FileError):
        sheet = rig.robot.model_copy(update={"axes": data_sheet_of(rig.robot).axes})
    if sheet is None:
        return ""
    found = _distances(real, arm_of(rig.robot), arm_of(sheet), PoseUncertainty(real, calibrated))
    if found.ratio <= _DOUBTED_SHARE:
        return ""
    if found.ratio < 1 or found.data_sheet_um > _HEALTHY_UM:
        return f"the constants of the controller may be those of another robot: {found}"
    problem = f"the constants of the controller do not fit the readings: {found}"
    remedy = "give the file of this robot, or diagnose without --calibration, against the data sheet"
    raise FileError(RigPlace.of(rig.name, "robot"), problem, remedy, code="robot.other")


def _distances(rig: Rig, controller: Arm, sheet: Arm, uncertainty: PoseUncertainty) -> LinkDistances:
    q = spread_angles(rig, uncertainty.joints_rad)
    links = [effect for effect in model_of(rig).effects if isinstance(effect, LinkGeometry)]
    places = tool_poses(model_of(rig, links), q)[:, :3, 3]
    others = _placement_and_zeros(sheet, q)

    def distance_um(arm: Arm) -> float:
        moves = (places - forward(arm, q)[:, :3, 3]).ravel()
        rest = moves - others @ np.linalg.lstsq(others, moves, rcond=None)[0]
        return rms_um(np.linalg.norm(rest.reshape(-1, 3), axis=1))

    u_um = rms_um(frame_u_mm(rig, uncertainty, q, q))
    return LinkDistances(distance_um(controller), distance_um(sheet), u_um)


def _placement_and_zeros(arm: Arm, q: Array) -> Array:
    """Tool displacements (3n, 9 + axes) caused by base, tool and joint zeros."""
    T = forward(arm, q)
    places, turns = T[:, :3, 3], T[:, :3, :3]
    zeros = [(forward(arm, q + _STEP_RAD * unit)[:, :3, 3] - places) / _STEP_RAD for unit in np.eye(q.shape[1])]
    base = [np.broadcast_to(unit, places.shape) for unit in np.eye(3)]
    rotations = [np.cross(unit, places) for unit in np.eye(3)]
    tool = [turns[:, :, k] for k in range(3)]
    return np.stack([*base, *rotations, *tool, *zeros], axis=-1).reshape(3 * len(q), -1)
