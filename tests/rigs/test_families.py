import math

import pytest

from analysis.diagnosis.fit.selection_state import least_fault
from rigs.arms import load_arm
from rigs.calibration import CalibrationFile
from rigs.effects import JointOffset, LinkGeometry
from rigs.load import parse
from rigs.rig import Rig
from rigs.schema.robot import LinkConstants

TWIST = LinkGeometry(axis=4, field="alpha", delta=0.3)


def _rig(name: str) -> Rig:
    return parse(f"name: arm\n{load_arm(name).text}", name)


def _with(rig: Rig, **robot: object) -> Rig:
    return rig.model_copy(update={"robot": rig.robot.model_copy(update=robot)})


def _cases() -> dict[str, tuple[Rig, bool, float]]:
    ur5e, rows = _rig("ur5e"), tuple(LinkConstants() for _ in range(6))
    file = CalibrationFile(file="arm.calibration.json", sha256="0" * 64)
    return {
        "family": (ur5e, True, 0.29),
        "design": (_rig("kuka-kr-6-r900-2"), True, 0.02),
        "stated data sheet": (_with(ur5e, controller="data_sheet"), True, 0.29),
        "constants of the controller": (_with(ur5e, controller="constants"), False, 0.04),
        "constants next to the data sheet": (_with(ur5e, controller="constants", controller_axes=rows), True, 0.29),
        "calibration": (ur5e.model_copy(update={"calibration": file}), False, 0.04),
        "link constant in the file": (ur5e.model_copy(update={"effects": (TWIST,)}), False, 0.04),
        "other effect in the file": (ur5e.model_copy(update={"effects": (JointOffset(axis=3),)}), True, 0.29),
    }


@pytest.mark.parametrize("case", _cases())
def test_link_constant_is_a_fault_only_relative_to_its_robot(case):
    rig, is_data_sheet, usual_deg = _cases()[case]
    assert rig.reference.is_data_sheet == is_data_sheet
    assert TWIST.usual_times(rig.reference) * TWIST.healthy == pytest.approx(usual_deg)
    least = least_fault(TWIST, rig.reference)
    assert least == (math.inf if is_data_sheet else pytest.approx(5 * usual_deg / TWIST.healthy))
    assert least_fault(JointOffset(axis=3), rig.reference) < math.inf
