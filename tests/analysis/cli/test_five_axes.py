import numpy as np
import pytest

from rigs.arms import load_arm
from tests.support.command_line import errors_of, succeeded
from tests.support.written_files import JOINTS, PLACES, TURNS, write_columns

HIDDEN = "effects: [{effect: joint_offset, axis: 2, offset_deg: 2}, {effect: backlash, axis: 3, width_deg: 1.2}]\n"


@pytest.fixture
def rig(tmp_path):
    file = tmp_path / "so.yaml"
    touch = "tests: {touch: {sockets: [A], ball_mm: [30, 0, -90], touches: 12}}\n"
    file.write_text(f"name: so\n{load_arm('so-101').text}\n{touch}")
    return file


def test_circles_and_programs_refuse_five_axes(rig, tmp_path):
    for command in (["simulate", str(rig), "--test", "yaw"], ["program", str(rig), "--for", "ur", "--test", "yaw"]):
        assert "5 axes" in errors_of(*command, "-o", str(tmp_path / "out"))


def test_corrected_targets_keep_the_place_and_report_the_turn(rig, tmp_path):
    rig.write_text(rig.read_text() + HIDDEN)
    q = np.random.default_rng(2).uniform(-40, 40, (4, 5))
    table = write_columns(tmp_path / "targets.csv", JOINTS[:5], q)
    done = succeeded(f"correct {rig} --path {table} -o {tmp_path}/corrected --anyway")
    assert "2 ways" in " ".join((done.stdout + done.stderr).split())
    poses = write_columns(tmp_path / "poses.csv", [*PLACES, *TURNS], [[200, 0, 100, 0, 90, 0]])
    assert "5 axes" in " ".join(errors_of(f"correct {rig} --path {poses} -o {tmp_path}/more").split())


def test_sixth_joint_of_touches_is_a_gripper_unless_renamed(rig, tmp_path):
    """The software of an SO-101 counts its gripper as joint 6."""
    q = [[0, 10, 20, 30, 40, 50], [0, 11, 20, 30, 40, 50]]
    table = write_columns(tmp_path / "touches.csv", ["socket", *JOINTS], ["A", "A"], q)
    words = f"import {table} --rig {rig} --test touch -o {tmp_path}/run"
    assert "6 joints" in errors_of(words)
    table.write_text(table.read_text().replace("q6_deg", "gripper"))
    succeeded(words)
