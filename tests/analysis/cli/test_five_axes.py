import numpy as np
import pytest

from rigs.arms import load_arm
from tests.support.command_line import ran

HIDDEN = "effects: [{effect: joint_offset, axis: 2, offset_deg: 2}, {effect: backlash, axis: 3, width_deg: 1.2}]\n"


@pytest.fixture
def rig(tmp_path):
    file = tmp_path / "so.yaml"
    touch = "tests: {touch: {sockets: [A], ball_mm: [30, 0, -90], touches: 12}}\n"
    file.write_text(f"name: so\n{load_arm('so-101').text}\n{touch}")
    return file


def test_circles_and_programs_refuse_five_axes(rig, tmp_path):
    for command in (["simulate", str(rig), "--test", "yaw"], ["program", str(rig), "--for", "ur", "--test", "yaw"]):
        done = ran(*command, "-o", str(tmp_path / "out"))
        assert done.returncode == 3 and "5 axes" in done.stderr


def test_corrected_targets_keep_the_place_and_report_the_turn(rig, tmp_path):
    rig.write_text(rig.read_text() + HIDDEN)
    q = np.random.default_rng(2).uniform(-40, 40, (4, 5))
    table = tmp_path / "targets.csv"
    rows = "\n".join(",".join(f"{angle:.3f}" for angle in row) for row in q)
    table.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n" + rows + "\n")
    done = ran(f"correct {rig} --path {table} -o {tmp_path}/corrected --anyway")
    assert done.returncode == 0 and "2 ways" in " ".join((done.stdout + done.stderr).split())
    poses = tmp_path / "poses.csv"
    poses.write_text("x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n200,0,100,0,90,0\n")
    done = ran(f"correct {rig} --path {poses} -o {tmp_path}/more")
    assert done.returncode != 0 and "5 axes" in " ".join(done.stderr.split())


def test_sixth_joint_of_touches_is_a_gripper_unless_renamed(rig, tmp_path):
    """The software of an SO-101 counts its gripper as joint 6."""
    table = tmp_path / "touches.csv"
    header = "socket," + ",".join(f"q{axis}_deg" for axis in range(1, 7))
    table.write_text(header + "\nA,0,10,20,30,40,50\nA,0,11,20,30,40,50\n")
    arguments = ["import", str(table), "--rig", str(rig), "--test", "touch", "-o", str(tmp_path / "run")]
    done = ran(*arguments)
    assert done.returncode != 0 and "6 joints" in done.stderr
    table.write_text(table.read_text().replace("q6_deg", "gripper"))
    assert ran(*arguments).returncode == 0
