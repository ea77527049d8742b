"""G-code against the interpreter of LinuxCNC: rig reads each move as it is executed, or leaves it unchanged."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct.solved_program import solve_program
from analysis.apps.correct.stated_frames import frames_of
from tests.analysis.apps.correct.programs.cells import LINUXCNC
from tests.support.changed_rigs import with_robot
from tests.worlds.arms.faulty_arm import flange_at, frame
from tests.worlds.interpreters.arms import rig_of
from tests.worlds.linuxcnc.canonical import RS274, reached_by

JOINTS = " ".join(f"{letter}{value:g}" for letter, value in zip("XYZABC", LINUXCNC[1], strict=True))
POSE = "X{} Y{} Z{} A{} B{} C{}"
HEAD = f"G21 G90 G54 G40 G49 G92.1 G8\nG10 L2 P1 X5 Y5 Z5 A0 B0 C0 R0\nM68 E3 Q1\nN1 G0 {JOINTS}\nM68 E3 Q0\n"
FOLLOWED = {
    "a pose": "",
    "the switch with zeros": "M068 E03 Q+0.0",
    "another output": "M68 E2 Q1\nM67 E2 Q1",
    "digital outputs and inputs": "M62 P1\nM63 P1\nM64 P2\nM65 P2\nM66 P0 L0\nM66 E0 L0",
    "an offset in mm": "G10 L2 P1 X1 Y2 Z3 A0 B0 C0 R0",
    "an offset in inches": "G20\nG10 L2 P1 X.1 Y.2 Z-.1 A0 B0 C0 R0\nG21",
    "an offset with the unit behind it": "G10 L2 P1 X.1 Y.2 Z-.1 A0 B0 C0 R0 G20\nG21",
    "an offset under G91": "G91\nG10 L2 P1 X1 Y2 Z3 A0 B0 C0 R0\nG90",
    "an offset of another system": "G10 L2 P2 X50 Y2 Z3 A10 B0 C0 R0",
    "the tool table": "G10 L1 P1 Z5\nG10 L10 P1 Z7\nG10 L11 P1 Z8",
    "a poll of the inch": "G20\nG21",
    "G92 and back": "G92 X500\nG92.1",
    "G92.2": "G92 X500\nG92.2",
    "diameters and back": "G7\nG8",
    "parameters": "#1=5 #2=[3*[2+1]]\n#4=SQRT[4]\n#3 = #1",
    "an own routine": "o9 sub\nG64\no9 endsub\no9 call",
}
LEFT = {
    "M67": "M67 E3 Q1",
    "M67 back": "M67 E3 Q0",
    "M67 with zeros": "m067 e03 q1",
    "computed kinematics": "#1=1\nM68 E3 Q#1",
    "computed output": "#1=3\nM68 E#1 Q1",
    "third kinematics": "M68 E3 Q2",
    "G10 L20": "G10 L20 P1 X0 Y0 Z0 A0 B0 C0",
    "G10 L2 P0": "G10 L2 P0 X7",
    "a part of an offset": "G10 L2 P1 X7",
    "an offset with a turn": "G10 L2 P1 X1 Y2 Z3 A5 B0 C0 R0",
    "a rotated system": "G10 L2 P1 X1 Y2 Z3 A0 B0 C0 R30",
    "G52": "G52 X10",
    "G92": "G92 X500",
    "G92.3": "G92 X500\nG92.2\nG92.3",
    "diameters": "G7",
    "a parameter of an offset": "#5221=20",
    "a parameter with zeros": "#05221=20",
    "a computed parameter": "#[5200+21]=20",
    "an assignment with a unit": "#1=5 G20",
    "an assignment with a distance": "#1=5 G91",
    "restored codes": "G20\no9 sub\nM73\nG21\no9 endsub\no9 call",
    "a sub with inches": "o9 sub\nG20\no9 endsub\no9 call",
    "inches on one path": "#1=1\no7 if [#1 GT 0]\nG20\no7 endif",
}
UNKNOWN = "unknown_frame"


def read(tmp_path, text: str, unit: str = "mm"):
    """Return the poses (4, 4) or joints (6,) that rig reads, by line, the uncorrected lines, and the interpreter's."""
    file = tmp_path / "a.ngc"
    file.write_text(text)
    rig = with_robot(rig_of("ur10e"), name="arm", linear_units=unit, tool=rig_of("ur10e").robot.base)
    program = solve_program(rig, file, frames_of(rig.robot, [], []))
    names = {line: int(word.split()[0][1:]) for line, word in enumerate(text.splitlines(), 1) if word.startswith("N")}
    meant = {
        names[target.line]: np.degrees(program.q[k]) if target.joints else program.wanted[k]
        for k, target in enumerate(program.targets)
        if k not in program.reasons
    }
    return meant, reached_by(file)


def moves(unit_mm: float = 1.0) -> str:
    pose = frame_numbers(flange_at(rig_of("ur10e"), np.radians(LINUXCNC[2])))
    words = POSE.format(*(f"{value / unit_mm:.7f}" for value in pose[:3]), *(f"{value:.9f}" for value in pose[3:]))
    return f"N2 G1 {words} F1000\nM2\n"


def frame_numbers(T) -> list[float]:
    return [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)]


def agrees(meant, reached) -> bool:
    if reached.joints:
        return meant.shape == (6,) and np.allclose(meant, reached.numbers, atol=1e-3)
    turn = Rotation.from_euler("xyz", reached.numbers[3:], degrees=True)
    return meant.shape == (4, 4) and np.allclose(meant, frame(reached.numbers[:3], turn), atol=0.02)


pytestmark = pytest.mark.skipif(RS274 is None, reason="needs rs274 of linuxcnc-uspace")


@pytest.mark.parametrize("between", FOLLOWED.values(), ids=FOLLOWED)
def test_moves_are_read_as_linuxcnc_executes_them(tmp_path, between):
    meant, reached = read(tmp_path, f"{HEAD}{between}\n{moves()}")
    assert set(meant) == set(reached) == {1, 2}
    assert all(agrees(meant[line], reached[line]) for line in meant)


@pytest.mark.parametrize("between", LEFT.values(), ids=LEFT)
def test_moves_after_codes_that_rig_does_not_follow_stay(tmp_path, between):
    meant, reached = read(tmp_path, f"{HEAD}{between}\n{moves()}")
    assert 2 not in meant and 2 in reached


def test_poses_in_inches_are_read_in_the_unit_of_the_program(tmp_path):
    meant, reached = read(tmp_path, f"{HEAD}G20\n{moves(25.4)}")
    assert set(meant) == {1, 2} and agrees(meant[2], reached[2])


@pytest.mark.parametrize(
    ("unit", "code", "read_as_joints"), [("inch", "G20", True), ("inch", "G21", False), ("mm", "G20", False)]
)
def test_joint_moves_are_read_only_in_the_unit_of_the_machine(tmp_path, unit, code, read_as_joints):
    meant, _ = read(tmp_path, HEAD.replace("M68 E3 Q1", f"{code}\nM68 E3 Q1") + "M2\n", unit)
    assert (1 in meant) is read_as_joints
