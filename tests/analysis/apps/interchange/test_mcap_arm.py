"""The arm in an MCAP file, moved by an independent reader of URDF."""

import json
from io import BytesIO

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from pytransform3d.urdf import UrdfTransformManager

from analysis.apps.interchange.mcap_export import write_mcap
from analysis.robot.kinematics.arm import arm_of, forward
from daq.store import read_run
from rigs.load import load
from tests.support.recorded_lap import recorded


def tool_by(urdf: str, joints: list[dict[str, float]]) -> np.ndarray:
    """Tool position in mm by an independent reader of URDF."""
    manager = UrdfTransformManager()
    manager.load_urdf(urdf)
    for joint in joints:
        manager.set_joint(str(joint["name"]), joint["position"])
    return 1000 * np.asarray(manager.get_transform("tool", "world"))[:3, 3]


def test_an_mcap_reader_moves_the_arm(tmp_path):
    run = read_run(recorded(tmp_path))
    file = BytesIO()
    write_mcap(run, file)
    reader = make_reader(BytesIO(file.getvalue()), validate_crcs=True)
    messages = {}
    for schema, channel, message in reader.iter_messages(["/joint_states", "/robot_description"]):
        assert schema.name in ("foxglove.JointStates", "std_msgs/String")
        messages.setdefault(channel.topic, []).append(json.loads(message.data))
    (described,) = messages["/robot_description"]
    (attached,) = (one for one in reader.iter_attachments() if one.name == "robot.urdf")
    assert attached.data.decode() == described["data"]
    rig = yaml.safe_load(run.manifest.rig_text)
    columns = run.streams["robot"]
    assert len(messages["/joint_states"]) == len(columns["q1_deg"])
    arm = arm_of(load("ur10e-cell")[0].robot)
    for number in (0, len(columns["q1_deg"]) // 2, -1):
        joints = messages["/joint_states"][number]["joints"]
        assert isinstance(joints, list) and [one["name"] for one in joints] == [
            one["name"] for one in rig["robot"]["axes"]
        ]
        q = np.radians([[columns[f"q{axis}_deg"][number] for axis in range(1, 7)]])
        assert tool_by(attached.data.decode(), joints) == pytest.approx(forward(arm, q)[0, :3, 3], abs=1e-6)
