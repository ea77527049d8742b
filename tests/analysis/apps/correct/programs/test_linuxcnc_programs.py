"""G-code of LinuxCNC: the pose that the arm with errors reaches, and a program of rig itself."""

import re

import numpy as np
from scipy.spatial.transform import Rotation

from tests.analysis.apps.correct.programs.cells import (
    LINUXCNC,
    LINUXCNC_HEAD,
    NUMBER,
    corrected_cell,
)
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of
from tests.worlds.interpreters.arms import rig_of


def test_corrected_pose_is_reached_by_the_erroneous_arm(tmp_path):
    rig, files = rig_of("ur10e"), {"a.ngc": LINUXCNC_HEAD + "G1 {p1}\n"}
    line = corrected_cell("linuxcnc", tmp_path, files).files["a.ngc"].decode().splitlines()[-1]
    values = [float(number) for number in re.findall(rf"[XYZABC]({NUMBER})", line)]
    pose = frame(np.add(values[:3], [100, -50, 20]), Rotation.from_euler("xyz", values[3:], degrees=True))
    q = joints_of(rig, pose, np.radians(LINUXCNC[1]))
    real, wanted = flange_at(rig, q, hidden()), flange_at(rig, np.radians(LINUXCNC[1]))
    assert np.linalg.norm(real[:3, 3] - wanted[:3, 3]) < 1e-3


def test_program_of_rig_itself_is_corrected_except_arcs_by_their_centre(tmp_path):
    """Whole turns in the offset of G59.3 and the check of the start do not make the state unknown."""
    text = (
        "G21 G90 G17 G40 G49 G80 G93\nG92.1\nG10 L2 P9 X0 Y0 Z0 A0 B0 C0 R0\nG59.3\nM68 E3 Q1\nM66 E0 L0\n"
        "G1 {q0} F[60.00 / [0.01 + ABS[#5420-0.4382] + ABS[#5421+3]]]\nM68 E3 Q0\nM66 E0 L0\n"
        "o7 if [[ABS[#5420-5.1] + ABS[#5421-1.2]] GT 10]\n(MSG, differs)\nM2\no7 endif\n"
        "G10 L2 P9 X0 Y0 Z0 A[360 * ROUND[[#5423-180.0000] / 360]] B0 C0 R0\nG64 P0.001\nG1 {m1} F16\nG1 {m2} F16\nM2\n"
    )
    found = corrected_cell("linuxcnc", tmp_path, {"a.ngc": text})
    assert not found.left and len(found.names) == 3
