"""G-code of LinuxCNC. Rows: a program, and the lines that stay uncorrected, with the reason. All others are corrected,
and the erroneous arm then reaches the written pose."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.analysis.apps.correct.programs.test_safe_programs import Left, corrected_files, uncorrected, with_targets
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of
from tests.worlds.interpreters.arms import rig_of

RIG = rig_of("ur10e")
ANGLES = ((0, -80, 100, -20, 80, 0), (5, -75, 95, -25, 70, 15), (-5, -85, 105, -30, 75, -10), (3, -78, 98, -22, 72, 5))
HEAD = "G21 G90 G49 G40\nG92.1\nG10 L2 P1 X100 Y-50 Z20 A0 B0 C0 R0\nG54\nM68 E3 Q1\nM66 E0 L0\nG1 {q0} F600\n"
HEAD += "M68 E3 Q0\nM66 E0 L0\n"
FIRST = 10
"""Line after the head."""
ROWS: dict[str, tuple[str, Left]] = {
    "plain": ("G1 {p1} F500\n{p2}\nG0 {p3} ; near\n", []),
    "machine coordinates": ("G53 G1 {m1} F500\n", []),
    "an arc by its radius": ("G1 {p1}\nG2 {p2} R300\n", []),
    "a line that keeps words of the one before": (
        "G1 {p1}\nG1 {p2}\nG1 X500\nG1 {p3}\n",
        [(11, "changed"), (12, "incomplete"), (13, "no_posture")],
    ),
    "two of them": (
        "G1 {p1}\nY10\nX500\nG1 {p3}\n",
        [(10, "changed"), (11, "incomplete"), (12, "incomplete"), (13, "no_posture")],
    ),
    "an arc by its centre": (
        "G1 {p1}\nG3 {p2} I10 J0\n{p3} K4\n",
        [(10, "changed"), (11, "arc_centre"), (12, "arc_centre")],
    ),
    "relative": ("G1 {p1}\nG1 {p2}\nG91\nX1 Y0 Z0 A0 B0 C0\n", [(11, "changed"), (13, "relative")]),
    "inches": ("G20\nG1 {p1}\n", [(11, "switched")]),
    "a tool length": ("G43 H1\nG1 {p1}\n", [(11, "displaced")]),
    "an offset by G92": ("G1 {p1}\nG92 X0\nG1 {p2}\n", [(12, "displaced")]),
    "a computed word": ("G1 {p1}\nG1 {p2}\nG1 X[#1 + 2] Y1 Z1 A1 B1 C1\n", [(11, "changed"), (12, "computed")]),
    "an axis beyond six": ("G1 {p1} U5\n", [(10, "external_axes")]),
    "an unknown code": ("M428\nG1 {p1}\n", [(11, "not_understood")]),
    "a parameter of an offset": ("#5221 = 7\nG1 {p1}\n", [(11, "not_understood")]),
    "a parameter": ("#<count> = 7\nG1 {p1}\n", []),
    "a turn in the offset": ("G10 L2 P1 X100 Y-50 Z20 A0 B0 C5 R0\nG1 {p1}\n", [(11, "unknown_frame")]),
    "whole turns in the offset": (
        "G10 L2 P1 X100 Y-50 Z20 A[360 * ROUND[[#5423-1.0] / 360]] B0 C0 R0\nG1 {p1}\n",
        [],
    ),
    "an offset that nobody states": ("G55\nG1 {p1}\n", [(11, "unknown_frame")]),
    "one of two offsets": (
        "o1 if [#1 GT 3]\nG55\no1 endif\nG1 {p1}\n",
        [(13, "unknown_frame")],
    ),
    "a branch": ("o1 if [#1 GT 3]\nG1 {p1}\no1 else\nG1 {p2}\no1 endif\nG1 {p3}\n", []),
    "a loop that comes back to a partial line": (
        "G1 {p3}\no1 while [#1 LT 3]\nG1 X7\nG1 {p1}\no1 endwhile\n",
        [(10, "changed"), (12, "incomplete"), (13, "changed")],
    ),
    "a routine": ("o<go> call\nG1 {p2}\nM2\no<go> sub\nG1 {p1}\no<go> endsub\n", []),
    "a routine of another file": ("o<else> call\nG1 {p2}\n", [(11, "not_understood")]),
    "joints that may be poses": (
        "o1 if [#1 GT 3]\nM68 E3 Q1\no1 endif\nG1 {p1}\n",
        [(13, "switched")],
    ),
    "a line that may be skipped": ("G1 {p1}\n/G55\nG1 {p2}\n", [(12, "unknown_frame")]),
    "no code of motion after a branch": ("G1 {p1}\no1 if [1]\no1 endif\n{p2}\n", [(13, "not_understood")]),
}


def words(T: np.ndarray) -> str:  # type: ignore[type-arg]
    """Return the words of a flange frame (4, 4): roll, pitch, yaw about fixed axes."""
    values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)]
    return " ".join(f"{letter}{value:.7f}" for letter, value in zip("XYZABC", values, strict=True))


def filled(text: str) -> str:
    flanges = [flange_at(RIG, np.radians(q)) for q in ANGLES]
    shift = frame((100.0, -50.0, 20.0), Rotation.identity())
    text = with_targets(
        {"": text},
        lambda k: words(np.linalg.inv(shift) @ flanges[k]),
        lambda k: " ".join(f"{letter}{angle}" for letter, angle in zip("XYZABC", ANGLES[k], strict=True)),
        len(ANGLES),
    )[""]
    for k, flange in enumerate(flanges):
        text = text.replace(f"{{m{k}}}", words(flange))
    return text


@pytest.mark.parametrize("row", ROWS)
def test_g_code(row: str, tmp_path: Path) -> None:
    text, left = ROWS[row]
    found = corrected_files(RIG, tmp_path, {"a.ngc": filled(HEAD + text)}, frames=[])
    assert uncorrected(found) == left
    before, after = filled(HEAD + text).splitlines(), found.files["a.ngc"].decode().splitlines()
    lines = {number for number, _ in left}
    for number, (old, new) in enumerate(zip(before, after, strict=True), start=1):
        is_target = len(re.findall(r"(?<!\w)[XYZABC]-?\d+\.\d", old)) == 6 and "G10" not in old
        assert (old != new) == ((is_target and number not in lines) or number == 7), old


def test_corrected_pose_is_reached_by_the_erroneous_arm(tmp_path: Path) -> None:
    found = corrected_files(RIG, tmp_path, {"a.ngc": filled(HEAD + "G1 {p1}\n")})
    numbers = re.findall(r"[XYZABC](-?[\d.]+)", found.files["a.ngc"].decode().splitlines()[FIRST - 1])
    values = [float(number) for number in numbers]
    pose = frame(np.add(values[:3], [100, -50, 20]), Rotation.from_euler("xyz", values[3:], degrees=True))
    q = joints_of(RIG, pose, np.radians(ANGLES[1]))
    real, wanted = flange_at(RIG, q, hidden()), flange_at(RIG, np.radians(ANGLES[1]))
    assert np.linalg.norm(real[:3, 3] - wanted[:3, 3]) < 1e-3


def test_program_of_rig_itself_is_corrected_except_arcs_by_their_centre(tmp_path: Path) -> None:
    """Whole turns in the offset of G59.3 and the check of the start do not make the state unknown."""
    text = (
        "G21 G90 G17 G40 G49 G80 G93\nG92.1\nG10 L2 P9 X0 Y0 Z0 A0 B0 C0 R0\nG59.3\nM68 E3 Q1\nM66 E0 L0\n"
        "G1 {q0} F[60.00 / [0.01 + ABS[#5420-0.4382] + ABS[#5421+3]]]\nM68 E3 Q0\nM66 E0 L0\n"
        "o7 if [[ABS[#5420-5.1] + ABS[#5421-1.2]] GT 10]\n(MSG, differs)\nM2\no7 endif\n"
        "G10 L2 P9 X0 Y0 Z0 A[360 * ROUND[[#5423-180.0000] / 360]] B0 C0 R0\nG64 P0.001\nG1 {m1} F16\nG1 {m2} F16\nM2\n"
    )
    found = corrected_files(RIG, tmp_path, {"a.ngc": filled(text)})
    assert not found.left and len(found.names) == 3
