"""The passport of a robot: how far its real arm is from the data sheet, the controller and the last visit."""

from __future__ import annotations

import math
from contextlib import suppress

from analysis.correction.pose_uncertainty import PoseUncertainty, frame_u_mm
from analysis.correction.work import rest_mm, rms_um, spread_angles, tool_poses
from analysis.diagnosis.evidence.significance import CERTAIN_SIGMA, SURE_SIGMA
from analysis.diagnosis.judge.probability import CONFIRMED
from analysis.diagnosis.judge.result import Diagnosis, Passport
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.description.controller_constants import data_sheet_of
from analysis.robot.kinematics.arm import Array, arm_of, controller_arm, forward
from analysis.robot.predict import model_of
from rigs.errors import FileError


def passport_of(diagnosis: Diagnosis) -> Passport | None:
    """Compare the calibrated arm of a diagnosis with the other arms of this robot; None without a calibrated model."""
    rig, calibrated = diagnosis.rig, diagnosis.calibrated
    if calibrated is None or not diagnosis.is_modelled:
        return None
    real = diagnosis.extended_rig.with_calibration(None, calibrated)
    uncertainty = PoseUncertainty(real, calibrated)
    q = spread_angles(real, uncertainty.joints_rad)  # a single circle would not determine base and tool
    of_posture = [effect for effect in model_of(real).effects if effect.compensation().use != "none"]
    places = tool_poses(model_of(real, of_posture), q)[:, :3, 3]
    u_um = rms_um(frame_u_mm(real, uncertainty, q, q))

    def distance(poses: Array) -> Quantity:
        um = rms_um(rest_mm(places, poses))
        is_unknown = u_um > diagnosis.accuracy.now_um and um < CERTAIN_SIGMA * u_um
        return Quantity(math.nan if is_unknown else um, u_um, "µm")

    data_sheet = None
    with suppress(FileError):  # constants of a controller whose data sheet is not in the library
        axes = data_sheet_of(rig.robot).axes
        update = {"axes": axes, "controller": None, "controller_axes": ()}
        data_sheet = distance(forward(arm_of(rig.robot.model_copy(update=update)), q))
    is_known = rig.controller != "unknown"
    controller = distance(forward(controller_arm(rig.robot), q)) if is_known else None
    last_visit = distance(tool_poses(model_of(rig), q)) if rig.is_calibrated else None
    changed = []
    for named in diagnosis.effects:
        is_certain = named.probability >= CONFIRMED and named.contribution_um > SURE_SIGMA * named.u_um
        # If constants of this robot are known, every certain difference from them is a change.
        differs = named.doubt == "usual" and is_certain and not rig.reference.is_data_sheet
        changed += [named.effect] * (named.is_confirmed or differs)
    return Passport(data_sheet, controller, last_visit, tuple(changed))
