"""Foxglove's protocol by an independent client, and the arm in an MCAP file, moved by an independent reader of URDF."""

import json
import struct
import sys
import time
from contextlib import suppress
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from pytransform3d.urdf import UrdfTransformManager
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from analysis.apps.interchange.mcap_export import write_mcap
from analysis.apps.window.foxglove import Foxglove
from analysis.robot.kinematics.arm import arm_of, forward
from daq.store import read_run
from rigs.errors import CellError
from rigs.load import load
from tests.support.recorded_lap import recorded
from tests.support.simulated_laps import lap_run, watched_lap
from tests.support.windows import PATIENCE_S

_MESSAGE = struct.Struct("<BIQ")
"""A message of the protocol: its kind, the subscription, its time in ns (github.com/foxglove/ws-protocol)."""


def tool_by(urdf: str, joints: list[dict[str, float]]) -> np.ndarray:
    """Tool position in mm by an independent reader of URDF."""
    manager = UrdfTransformManager()
    manager.load_urdf(urdf)
    for joint in joints:
        manager.set_joint(str(joint["name"]), joint["position"])
    return 1000 * np.asarray(manager.get_transform("tool", "world"))[:3, 3]


def test_a_client_of_the_protocol_sees_gauges_and_moves_the_arm(tmp_path):
    rig, _ = load("ur10e")
    view = watched_lap(lap_run(tmp_path))
    one, known = Foxglove(0, rig), {}
    try:
        with connect(f"ws://127.0.0.1:{one.port}", subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
            names = {}
            last = {}
            end_s, passed_s = time.monotonic() + PATIENCE_S, 0.0
            while len(last) < 3:
                assert time.monotonic() < end_s, (names, last.keys())
                passed_s += 1000.0
                one.show(replace(view, rows=replace(view.rows, t_s=view.rows.t_s + passed_s)))
                with suppress(TimeoutError):
                    while True:
                        told = client.recv(timeout=0.2)
                        if isinstance(told, bytes):
                            _, number, _ = _MESSAGE.unpack_from(told)
                            last[names[number]] = json.loads(told[_MESSAGE.size :])
                        elif (said := json.loads(told))["op"] == "advertise":
                            for channel in said["channels"]:
                                names[channel["id"]] = channel["topic"]
                                known[channel["topic"]] = channel["schemaName"]
                                wanted = [{"id": channel["id"], "channelId": channel["id"]}]
                                client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        assert known["/joint_states"] == "foxglove.JointStates" and known["/gauges"] == "rig.gauges"
        gauges, joints = last["/gauges"], last["/joint_states"]["joints"]
        assert {"g1_mm", "g2_mm", "angle_deg"} <= gauges.keys()
        assert isinstance(joints, list) and [joint["name"] for joint in joints] == [
            axis.name for axis in rig.robot.axes
        ]
        q = np.array([joint["position"] for joint in joints])
        expected = forward(arm_of(rig.robot), q[None])[0, :3, 3]
        assert tool_by(str(last["/robot_description"]["data"]), joints) == pytest.approx(expected, abs=1e-6)
    finally:
        one.close()


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
    arm = arm_of(load("ur10e")[0].robot)
    for number in (0, len(columns["q1_deg"]) // 2, -1):
        joints = messages["/joint_states"][number]["joints"]
        assert isinstance(joints, list) and [one["name"] for one in joints] == [
            one["name"] for one in rig["robot"]["axes"]
        ]
        q = np.radians([[columns[f"q{axis}_deg"][number] for axis in range(1, 7)]])
        assert tool_by(attached.data.decode(), joints) == pytest.approx(forward(arm, q)[0, :3, 3], abs=1e-6)


def test_a_taken_port_and_a_missing_library_are_refused(monkeypatch):
    one = Foxglove(0, None)
    with pytest.raises(CellError) as taken:
        Foxglove(one.port, None)
    one.close()
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(CellError) as missing:
        Foxglove(0, None)
    assert (taken.value.code, missing.value.code) == ("window.port", "window.not_installed")
