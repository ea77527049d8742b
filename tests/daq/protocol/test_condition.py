from __future__ import annotations

import math
import struct

import pytest

import daq.feedback
from daq.acquisition.streams import robot_stream
from daq.protocol.conversation import FaultKind, Sample
from rigs.schema.condition import UNDISTURBED, ProgramState, SafetyState
from rigs.schema.feedback import Feedback
from tests.support.drivers import egm, j519, lines, rsi, rtde
from tests.support.simulated_conversation import Script

FIELDS = (
    "timestamp",
    "actual_q",
    "runtime_state",
    "safety_status",
    "speed_scaling",
    "target_speed_fraction",
    "payload",
    "joint_temperatures",
)
TYPES = ("DOUBLE", "VECTOR6D", "UINT32", "INT32", "DOUBLE", "DOUBLE", "DOUBLE", "VECTOR6D")
WARM = (31.5, 32.0, 30.25, 34.0, 35.5, 36.0)


def _packet(kind: bytes, payload: bytes = b"") -> bytes:
    return struct.pack(">HB", 3 + len(payload), kind[0]) + payload


def _last(feedback: Feedback, script: Script) -> dict[str, float]:
    sample = script.taken()[-1]
    assert isinstance(sample, Sample)
    columns = robot_stream(feedback).columns
    assert len(columns) == len(sample.values)
    return dict(zip(columns[6:], sample.values[6:], strict=True))


def _of_rtde(program: int = 2, safety: int = 1, scaling: float = 1.0, slider: float = 1.0) -> dict[str, float]:
    robot = rtde()
    script = Script(daq.feedback.host(robot))
    assert script.receive(_packet(b"V", b"\1")).send.endswith(",".join(FIELDS).encode())
    script.receive(_packet(b"O", b"\1" + ",".join(TYPES).encode()) + _packet(b"S", b"\1"))
    data = struct.pack(">B7dIi3d6d", 1, 12.5, *[0.1] * 6, program, safety, scaling, slider, 4.25, *WARM)
    script.receive(_packet(b"U", data))
    return _last(robot, script)


def test_condition_of_rtde():
    shown = _of_rtde(slider=0.4)
    assert shown.pop("speed_percent") == pytest.approx(40)
    assert shown == {
        "program_state": ProgramState.RUNNING,
        "safety_state": SafetyState.NORMAL,
        "payload_kg": 4.25,
        **{f"temperature{axis}_c": warm for axis, warm in enumerate(WARM, 1)},
    }
    assert _of_rtde(scaling=0.5, slider=0.5)["speed_percent"] == pytest.approx(25)  # both slow the robot down


@pytest.mark.parametrize(
    ("code", "state"), [(0, "STOPPED"), (1, "STOPPED"), (2, "RUNNING"), (3, "PAUSED"), (4, "PAUSED"), (5, "RUNNING")]
)
def test_the_states_of_a_program_in_rtde(code, state):
    assert _of_rtde(program=code)["program_state"] == ProgramState[state]


@pytest.mark.parametrize(
    ("code", "state"),
    [
        (2, "REDUCED"),
        (3, "PROTECTIVE_STOP"),
        (4, "RECOVERY"),
        (5, "SAFEGUARD_STOP"),
        (6, "EMERGENCY_STOP"),
        (7, "EMERGENCY_STOP"),
        (8, "FAULT"),
        (9, "FAULT"),
        (12, "SAFEGUARD_STOP"),
        (13, "SAFEGUARD_STOP"),
    ],
)
def test_the_states_of_safety_in_rtde(code, state):
    assert _of_rtde(safety=code)["safety_state"] == SafetyState[state]


def test_codes_that_rtde_does_not_define_are_not_known():
    shown = _of_rtde(program=77, safety=-5)
    assert math.isnan(shown["program_state"]) and math.isnan(shown["safety_state"])


@pytest.mark.parametrize("scaling", [math.inf, math.nan, 1e300])
def test_a_speed_that_none_can_be_is_not_known(scaling):
    assert math.isnan(_of_rtde(scaling=scaling)["speed_percent"])


def test_unknown_field_of_a_controller_costs_that_field_alone():
    robot = rtde()
    script = Script(daq.feedback.host(robot))
    script.receive(_packet(b"V", b"\1"))
    unknown = ("DOUBLE", "VECTOR6D", "UINT32", "NOT_FOUND", "DOUBLE", "DOUBLE", "NOT_FOUND", "VECTOR6D")
    again = script.receive(_packet(b"O", b"\0" + ",".join(unknown).encode())).send
    named = "timestamp,actual_q,runtime_state,safety_mode,speed_scaling,target_speed_fraction,joint_temperatures"
    assert again[11:].decode() == named  # an older controller has the mode in place of the status
    kinds = "DOUBLE,VECTOR6D,UINT32,NOT_FOUND,DOUBLE,DOUBLE,VECTOR6D"
    again = script.receive(_packet(b"O", b"\0" + kinds.encode())).send
    assert again[11:].decode() == named.replace("safety_mode,", "")
    assert script.receive(_packet(b"O", b"\2" + kinds.replace("NOT_FOUND,", "").encode())).send == _packet(b"S")
    script.receive(_packet(b"S", b"\1"))
    script.receive(_packet(b"U", struct.pack(">B7dI2d6d", 2, 12.5, *[0.1] * 6, 4, 1.0, 1.0, *WARM)))
    shown = _last(robot, script)
    assert {name for name, value in shown.items() if math.isnan(value)} == {"safety_state", "payload_kg"}
    assert shown["program_state"] == ProgramState.PAUSED and shown["temperature6_c"] == 36.0


def test_controller_without_joints_is_refused():
    script = Script(daq.feedback.host(rtde()))
    script.receive(_packet(b"V", b"\1"))
    step = script.receive(_packet(b"O", b"\0" + ",".join(["DOUBLE", *["NOT_FOUND"] * 7]).encode()))
    (fault,) = script.taken()
    assert fault.kind is FaultKind.DEVICE_ERROR and "actual_q" in fault.detail and step.hang_up


def test_a_controller_without_a_condition_knows_none_of_its_fields():
    script = Script(daq.feedback.device(rtde(condition=False), lambda now_ns: [0.0] * 6))
    asked = struct.pack(">d", 125) + b"timestamp,safety_mode"
    assert script.receive(_packet(b"O", asked)).send == _packet(b"O", b"\0DOUBLE,NOT_FOUND")


def test_recipe_with_trailing_comma_is_served():
    """SDU's ur_rtde 1.6.5 asks so, and calls the fields by their places in the answer."""
    script = Script(daq.feedback.device(rtde(), lambda now_ns: [0.0] * 6))
    asked = struct.pack(">d", 125) + b"timestamp,runtime_state,safety_mode,"
    assert script.receive(_packet(b"O", asked)).send == _packet(b"O", b"\1DOUBLE,UINT32,INT32")


@pytest.mark.parametrize(
    ("states", "motors", "program"),
    [
        (b"\x22\x02\x08\x01\x42\x02\x08\x02", 1.0, ProgramState.RUNNING),
        (b"\x22\x02\x08\x02\x42\x02\x08\x01", 0.0, ProgramState.STOPPED),
        (b"\x22\x02\x08\x00\x42\x02\x08\x00", math.nan, math.nan),
        (b"\x2a\x02\x08\x03", math.nan, math.nan),
        (b"\x22\x02\x08", None, None),
    ],
    ids=["on, running", "off, stopped", "undefined", "neither", "cut off"],
)
def test_motor_state_and_rapid_state_of_egm(states, motors, program):
    joints = b"\x0a\x36" + (b"\x09" + struct.pack("<d", 1.0)) * 6
    script = Script(daq.feedback.host(egm()))
    script.receive(b"\x0a\x04\x08\x01\x18\x02" + b"\x12\x38" + joints + states)
    if motors is None:
        assert not isinstance(script.taken()[-1], Sample)
        return
    shown = _last(egm(), script)
    assert {name: shown.pop(name) for name in ("program_state", "motors_on")} == pytest.approx(
        {"program_state": program, "motors_on": motors}, nan_ok=True
    )
    assert all(map(math.isnan, shown.values()))


def test_rtde_gives_the_flange_without_the_tool_set_in_the_controller():
    robot = rtde(condition=False, pose=True)
    script = Script(daq.feedback.host(robot))
    script.receive(_packet(b"V", b"\1"))
    script.receive(_packet(b"O", b"\1DOUBLE,VECTOR6D,VECTOR6D,VECTOR6D") + _packet(b"S", b"\1"))
    tool, offset = (0.4, -0.2, 0.3, 0.0, math.pi, 0.0), (0.0, 0.0, 0.15, 0.0, 0.0, 0.0)
    script.receive(_packet(b"U", struct.pack(">B19d", 1, 12.5, *[0.1] * 6, *tool, *offset)))
    shown = _last(robot, script)
    assert [shown[f"controller_{axis}_mm"] for axis in "xyz"] == pytest.approx([400, -200, 450])


def test_egm_gives_the_pose_of_the_tool():
    joints = b"\x0a\x36" + (b"\x09" + struct.pack("<d", 1.0)) * 6
    place = b"".join(bytes([key]) + struct.pack("<d", value) for key, value in ((9, 400.0), (17, -200.0), (25, 300.0)))
    turn = b"".join(
        bytes([key]) + struct.pack("<d", value)
        for key, value in ((9, math.sqrt(0.5)), (17, 0.0), (25, 0.0), (33, math.sqrt(0.5)))
    )
    cartesian = b"\x0a\x1b" + place + b"\x12\x24" + turn
    script = Script(daq.feedback.host(egm()))
    feedback = joints + b"\x12" + bytes([len(cartesian)]) + cartesian
    script.receive(b"\x0a\x04\x08\x01\x18\x02" + b"\x12" + bytes([len(feedback)]) + feedback)
    shown = _last(egm(), script)
    pose = [shown[f"controller_{name}"] for name in ("x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg")]
    assert pose == pytest.approx([400, -200, 300, 0, 0, 90])


@pytest.mark.parametrize(
    ("state", "robot", "contact", "safety"),
    [
        (0b0101, 0, 0, "NORMAL"),
        (0b0001, 0b010, 1, "NORMAL"),
        (0b0100, 0b001, 0, "FAULT"),
        (0b0100, 0b101, 2, "EMERGENCY_STOP"),
        (0b0100, 0, 2, "PROTECTIVE_STOP"),
        (0b0100, 0b001, 4, "RECOVERY"),
    ],
)
def test_the_bytes_of_state_of_stream_motion(state, robot, contact, safety):
    script = Script(daq.feedback.host(j519(version=3)))
    script.receive(struct.pack(">III4BI27ff256x", 202, 3, 1, state, robot, contact, 0, 1000, *[1.0] * 27, 1.0))
    shown = _last(j519(), script)
    assert shown == {"safety_state": SafetyState[safety], "motors_on": bool(state & 0b0100)}


ROB = b'<Rob Type="KUKA"><AIPos A1="1" A2="1" A3="1" A4="1" A5="1" A6="1"/>%b<IPOC>8</IPOC></Rob>'


@pytest.mark.parametrize(
    ("elements", "percent", "motors"),
    [
        (b'<Override>75</Override><Drives Kg="3" On="1"/>', 75, 1),
        (b'<Drives On= "0" /><Override> 100.0 </Override>', 100, 0),
        (b"<Override/><Drives/>", math.nan, math.nan),
        (b"<Override>1e300</Override>", math.nan, math.nan),
        (b'<Override>&lol;</Override><Drives On="yes"/>', math.nan, math.nan),
        (b'<Override>1e999</Override><Drives xOn="1"/>', math.nan, math.nan),
    ],
)
def test_the_elements_of_rsi_that_a_rig_file_names(elements, percent, motors):
    robot = rsi(condition={"speed_percent": "Override", "motors_on": "Drives.On"})
    script = Script(daq.feedback.host(robot))
    step = script.receive(ROB % elements)
    assert step.send  # the robot does not stop for it
    assert _last(robot, script) == pytest.approx({"speed_percent": percent, "motors_on": motors}, nan_ok=True)


def test_the_fields_of_a_line_that_a_rig_file_names():
    robot = lines(fields=("temperature2_c", *(f"q{axis}_deg" for axis in range(1, 7)), "signal", "program_state"))
    script = Script(daq.feedback.host(robot))
    script.receive(b"41.5,1,2,3,4,5,6,7,2\n")
    assert _last(robot, script) == {"signal": 7.0, "temperature2_c": 41.5, "program_state": ProgramState.PAUSED}
    script.receive(b",1,2,3,4,5,6,7,\n")
    shown = _last(robot, script)
    assert math.isnan(shown["temperature2_c"]) and math.isnan(shown["program_state"])  # left empty: not known


@pytest.mark.parametrize("robot", [rtde(), egm(), j519(version=3), rsi(condition={"payload_kg": "Load"})])
def test_emulated_robot_is_undisturbed_by_default(robot):
    device = daq.feedback.device(robot, lambda now_ns: [1.0] * 6)
    host = Script(daq.feedback.host(robot))
    controller = Script(device)
    answers = host.sent
    for _ in range(5):
        answers = host.receive(controller.receive(answers).send or controller.wake().send).send
    shown = _last(robot, host)
    assert shown.get("safety_state", 0) == 0
    assert shown.get("program_state", 1) == 1 and shown.get("motors_on", 1) == 1
    assert shown.get("speed_percent", 100) == 100


AMPERES = (0.5, -2.25, 1.75, 0.125, -0.5, 0.25)


def test_the_currents_of_rtde_and_of_an_older_controller_without():
    robot = rtde(currents=True, condition=False)
    script = Script(daq.feedback.host(robot))
    asked = script.receive(_packet(b"V", b"\1")).send
    assert asked.endswith(b"timestamp,actual_q,actual_current")
    script.receive(_packet(b"O", b"\1DOUBLE,VECTOR6D,VECTOR6D") + _packet(b"S", b"\1"))
    script.receive(_packet(b"U", struct.pack(">B7d6d", 1, 12.5, *[0.1] * 6, *AMPERES)))
    assert tuple(_last(robot, script).values()) == AMPERES
    script = Script(daq.feedback.host(robot))
    script.receive(_packet(b"V", b"\1"))
    assert script.receive(_packet(b"O", b"\0DOUBLE,VECTOR6D,NOT_FOUND")).send.endswith(b"timestamp,actual_q")
    script.receive(_packet(b"O", b"\1DOUBLE,VECTOR6D") + _packet(b"S", b"\1"))
    script.receive(_packet(b"U", struct.pack(">B7d", 1, 12.5, *[0.1] * 6)))
    assert all(math.isnan(value) for value in _last(robot, script).values())


def test_no_currents_are_asked_for_unless_the_rig_file_wants_them():
    script = Script(daq.feedback.host(rtde()))
    assert b"current" not in script.receive(_packet(b"V", b"\1")).send
    assert not [name for name in robot_stream(rtde()).columns if name.startswith("current")]


@pytest.mark.parametrize("version", [1, 3, 4])
def test_the_currents_of_stream_motion(version):
    """Nine floats each of pose, joints and currents."""
    places, joints = [1.0] * 9, [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 0.0, 0.0, 0.0]
    numbers = struct.pack(">27f", *places, *joints, *AMPERES, 7.0, 8.0, 9.0)
    if version == 1:
        data = struct.pack(">IIIBBHHHI", 0, 1, 1, 4, 0, 0, 0, 0, 1000) + numbers
    else:
        kind, rest = (202, 260) if version == 3 else (204, 288)
        data = struct.pack(">III4BI", kind, version, 1, 4, 0, 0, 0, 1000) + numbers + bytes(rest)
    robot = j519(version=version, currents=True)
    script = Script(daq.feedback.host(robot))
    script.receive(data)
    shown = _last(robot, script)
    assert tuple(shown[f"current{axis}_a"] for axis in range(1, 7)) == AMPERES


@pytest.mark.parametrize("robot", [rtde(currents=True), j519(version=3, currents=True), j519(version=1, currents=True)])
def test_an_emulated_robot_sends_its_currents(robot):
    beside = robot_stream(robot).columns[6:]
    undisturbed = [UNDISTURBED[name] for name in beside[: -len(AMPERES)]]
    device = daq.feedback.device(robot, lambda now_ns: [1.0] * 6 + undisturbed + list(AMPERES))
    host, controller = Script(daq.feedback.host(robot)), Script(device)
    answers = host.sent
    for _ in range(5):
        answers = host.receive(controller.receive(answers).send or controller.wake().send).send
    assert tuple(_last(robot, host).values())[-6:] == AMPERES


def test_kuka_has_no_currents_in_amperes():
    with pytest.raises(ValueError, match="unknown part 'current1_a'"):
        rsi(condition={"current1_a": "MACur.A1"})
