"""Sources of the robot position.

These are interfaces of makers, OPC UA servers with the Robotics companion specification (OPC 40010-1), and ROS 2 joint
states. `interface` is the name of a file in `daq/robot_drivers/`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from rigs.schema.condition import CONDITION, CURRENTS, MOTORS, PAYLOAD, POSE, PROGRAM, SAFETY, SPEED, TEMPERATURES
from rigs.schema.links import AnyPort, Line, Port, UDPPort, tcp_port, udp_address
from rigs.schema.modbus import SLOWEST_HZ, RegisterBlock, StatusRegister, ValueRegister
from rigs.schema.part import Origin, Part
from rigs.schema.plugins import extended

AxisName = Annotated[str, Field(min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")]
_NODE = re.compile(r"(ns=\d{1,5};)?(i=\d{1,10}|s=.+)")


class OPCUARobotics(Part):
    """OPC UA for Robotics (OPC 40010-1): a server at `tcp://server:4840`, read only."""

    driver: ClassVar[str] = "daq.opc_ua.robotics"
    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="robots of any maker with an OPC UA server of the Robotics companion specification",
        source="OPC 40010-1 1.02 (reference.opcfoundation.org/Robotics) with its nodeset (OPCFoundation/UA-Nodeset, "
        "Robotics); OPC 10000-4 and -6 for services and the wire, through asyncua's types",
        standing="confirmed",
        doubts="not tested on a real controller, only on servers of the node-opcua and asyncua libraries; the "
        "instant of the controller's timestamp; whether a motor belongs to the axis of its power train",
    )

    interface: Literal["opc_ua_robotics"]
    port: Annotated[Port, tcp_port(4840)]
    path: str = Field(default="", pattern=r"^(/[^\s\x00-\x1f]{0,200})?$")
    """Path of the server endpoint, such as `/UA/Robot` in `opc.tcp://robot:4840/UA/Robot`."""
    device: str | None = Field(default=None, min_length=1, max_length=200)
    """Browse name of the robot below MotionDevices, if the server has several."""
    axes: tuple[AxisName, AxisName, AxisName, AxisName, AxisName, AxisName] | None = None
    """Browse names of q1 … q6 below Axes, or node ids of the position variables, such as `ns=2;s=A1.Pos`. By default
    the robot must have six axes with names ending in numbers.
    """
    units: Literal["deg", "rad"] | None = None
    """Angle unit, if not given by the server (EngineeringUnits)."""
    rate_hz: float = Field(default=100, ge=1, le=500)
    """Requested sampling rate. The server may reduce it."""
    condition: bool = True
    """Read the condition of the robot: task, stops, drives, speed, load, motor temperatures."""
    timeout_s: float = Field(default=2.0, ge=0.1, le=60)
    """Longest time between messages; after it the robot counts as silent."""

    @field_validator("axes")
    @classmethod
    def _six(cls, axes: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if axes and len(set(axes)) < len(axes):
            raise ValueError("an axis is listed twice; list q1 … q6 once each")
        if axes and len({are_nodes([axis]) for axis in axes}) > 1:
            raise ValueError("give all six axes by name or all by node id")
        return axes


def are_nodes(axes: Sequence[str]) -> bool:
    return all(_NODE.fullmatch(axis) for axis in axes)


# A repetition of \w with a limit takes the regular expressions of pydantic 25 ms to compile.
JointName = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[\w./-]+$")]


class ROS2JointStates(Part):
    """ROS 2: a topic of `sensor_msgs/msg/JointState` from a rosbridge server, usually `tcp://server:9090`."""

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="any robot with a ROS 2 driver that publishes joint_states, by a rosbridge server "
        "(ros2 launch rosbridge_server rosbridge_websocket_launch.xml)",
        source="RobotWebTools/rosbridge_suite, ROSBRIDGE_PROTOCOL.md 3.2 and 3.3, message_conversion.py; "
        "ros2/common_interfaces, sensor_msgs/msg/JointState.msg; RFC 6455 through wsproto",
        standing="confirmed",
        doubts="no server of ROS has been read yet, only one made of the websockets library; what instant a driver "
        "stamps: JointState.msg says that of the measurement, and many drivers stamp when they publish",
    )

    interface: Literal["ros2_joint_states"]
    port: Annotated[Port, tcp_port(9090)]
    topic: str = Field(default="/joint_states", pattern=r"^/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$")
    joints: tuple[JointName, JointName, JointName, JointName, JointName, JointName]
    """Joint names of q1 … q6 in the messages, in any order. Other joints are ignored."""
    timeout_s: float = Field(default=2.0, ge=0.01, le=60)
    """Longest time between messages; after it the robot counts as silent."""

    @field_validator("joints")
    @classmethod
    def _six(cls, joints: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(joints)) < len(joints):
            raise ValueError("a joint is listed twice; list q1 … q6 once each")
        return joints


LINUXCNC_PORT = 5480
"""TCP port of the program that serves the joints of LinuxCNC. Chosen: next to 5005 to 5007 of linuxcncrsh, and free."""
JOINT_FIELDS = {f"q{axis}_{unit}" for axis in range(1, 7) for unit in ("deg", "rad")}
CLOCK_FIELDS = {"t_s", "t_ms", "t_us"}
SIGNAL = "signal"
"""Column with the program number in the samples of the robot, and the field name in a line."""
_TAG = re.compile(r"[A-Za-z_][A-Za-z0-9_-]{0,63}(\.[A-Za-z_][A-Za-z0-9_-]{0,63})?")
"""Tag of an element, or of an attribute as `Element.Attribute`, in the Ethernet configuration of KUKA."""


class RTDESignal(Part):
    """Location of the program number on the controller: digital outputs or a register."""

    outputs: tuple[Annotated[int, Field(ge=0, le=17)], ...] = ()
    """Bits of a binary number, the lowest first: 0-7 standard, 8-15 configurable, 16 and 17 of the tool."""
    int_register: int | None = Field(default=None, ge=0, le=47)

    @model_validator(mode="after")
    def _one_place(self) -> RTDESignal:
        if bool(self.outputs) == (self.int_register is not None):
            raise ValueError("give either outputs: [0, …], or int_register")
        if len(set(self.outputs)) < len(self.outputs):
            raise ValueError("an output occurs twice")
        return self


class _Feedback(Part):
    """Base of all interfaces. listens: `port` is a local address, contacted by the controller."""

    timeout_s: float = Field(default=2.0, ge=0.01, le=60)
    """Longest time between messages; after it the robot counts as silent."""


class NoFeedback(_Feedback):
    """No robot: only a tracker measures the cell. Never named in a rig file."""

    listens: ClassVar[bool] = False

    interface: Literal["none"] = "none"
    port: str = ""


class URRTDE(_Feedback):
    """Universal Robots, Real-Time Data Exchange (RTDE), at `tcp://robot:30004`."""

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="Universal Robots CB3, e-Series",
        source="maker's Python client and documents; the codes of the condition: UniversalRobots' client library and "
        "ROS driver",
        standing="confirmed",
        doubts="whether a controller without a field of the condition accepts a second recipe on the same link "
        "(if not, write condition: false)",
    )

    interface: Literal["ur_rtde"]
    port: Port
    rate_hz: float = Field(default=500, ge=1, le=500)
    signal: RTDESignal | None = None
    condition: bool = True
    """Request the condition of the robot: program, safety, speed, payload, temperatures.

    Fields unknown to the controller are omitted.
    """
    currents: bool = False
    """Record the joint motor currents, which reveal the friction."""
    pose: bool = True
    """Record the flange pose that the controller computes, which shows its own constants."""


ASKED_INSTEAD = "; for RTDE of a Universal Robots arm write interface: ur_rtde"
"""Advice if nothing arrives over TCP: the controller may send only on request."""


class LineFeed(_Feedback):
    """Lines printed by a user program on the controller, with a sample per line, over TCP, UDP or a serial port."""

    origin: ClassVar[Origin] = Origin(
        instruments="any controller whose program prints lines over TCP, UDP or a serial port: FANUC KAREL and others",
        source="depends on the user's program",
        standing="confirmed",
    )

    interface: Literal["line_feed"]
    port: AnyPort
    listens: bool = False
    """The program connects to this computer. `port` is then a local address for a single program at a time."""
    fields: tuple[str, ...] = ("t_ms", *(f"q{axis}_deg" for axis in range(1, 7)))
    """Field names in order of the line: q1_deg … q6_deg (or _rad), at most one of t_s, t_ms, t_us, at most one
    `signal`, and printed condition columns (program_state, speed_percent …). `_` is skipped.
    """
    separator: str = Field(default=",", min_length=1)
    """A blank represents any sequence of blanks and tabs."""
    line: Line = Line(baud=9600, bits=8, parity="N", stop=1)
    """Settings of a serial port. 100 lines of 60 characters per second need 115200 baud."""

    @field_validator("fields")
    @classmethod
    def _check_fields(cls, fields: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in fields if name not in JOINT_FIELDS | CLOCK_FIELDS | {SIGNAL, *CONDITION, "_"}]
        if unknown:
            raise ValueError(
                f"unknown field {unknown[0]!r}; known: q1_deg … q6_deg, q1_rad …, t_s, t_ms, t_us, signal, "
                f"{', '.join(CONDITION)}, _"
            )
        axes = [name[:2] for name in fields if name in JOINT_FIELDS]
        if sorted(axes) != [f"q{axis}" for axis in range(1, 7)]:
            raise ValueError("each of q1 … q6 must occur once in the line, in _deg or _rad")
        if len(CLOCK_FIELDS & set(fields)) > 1:
            raise ValueError("only one of t_s, t_ms, t_us can be the controller's clock")
        if twice := [name for name in (SIGNAL, *CONDITION) if fields.count(name) > 1]:
            raise ValueError(f"{twice[0]} can occur only once in the line")
        return fields

    @model_validator(mode="after")
    def _who_calls(self) -> LineFeed:
        if udp_address(self.port) and not self.listens:
            raise ValueError("a program that sends datagrams calls us; add listens: true, and give our address as port")
        if self.listens and self.port.startswith("/"):
            raise ValueError("listens applies only to network ports; remove the key for a serial port")
        return self


class KUKARSI(_Feedback):
    """KUKA Robot Sensor Interface (RSI): the controller sends to `port`, a `udp://` address of this computer."""

    listens: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="KUKA KR C4 and KR C5 with RobotSensorInterface (RSI Ethernet)",
        source="public code: kroshu/kuka_drivers (its parser's tests), RSI-3 clients with their RSI_EthernetConfig.xml",
        standing="confirmed",
        doubts="cycles of 4 and 12 ms, IPOC in ms, and whether an answer without corrections means zero (true if "
        "nothing was corrected before: HOLDON keeps the last value)",
    )
    interface: Literal["kuka_rsi"]
    port: UDPPort
    cycle_ms: Literal[4, 12] = 4
    """Cycle of the controller: 4 for IPO_FAST, 12 for IPO. A longer IPOC step means missing datagrams."""
    onlysend: bool = False
    """ONLYSEND of the Ethernet configuration: the controller neither expects nor receives answers."""
    timeout_s: float = Field(default=1.0, ge=0.01, le=60)
    """Also the silence after which a restarted program, which is a new sender, is accepted."""
    sentype: str = Field(default="ImFree", pattern=r"^[A-Za-z0-9_.-]{1,64}$")
    """SENTYPE of the Ethernet configuration. The controller ignores answers with other names."""
    condition: dict[str, str] = Field(default_factory=dict)
    """TAG in SEND of the Ethernet configuration for each transmitted part of the condition, such as `speed_percent:
    Override` or `motors_on: Drives.On`.
    """

    @field_validator("condition")
    @classmethod
    def _of_the_condition(cls, condition: dict[str, str]) -> dict[str, str]:
        parts = [name for name in CONDITION if name not in CURRENTS]  # $CURR_ACT of KUKA is a share, not A
        if unknown := [name for name in condition if name not in parts]:
            raise ValueError(f"unknown part {unknown[0]!r}; known: {', '.join(parts)}")
        if odd := [tag for tag in condition.values() if not _TAG.fullmatch(tag)]:
            raise ValueError(f"{odd[0]!r} is not a TAG; write Element or Element.Attribute")
        return condition


class ABBEGM(_Feedback):
    """ABB Externally Guided Motion, position stream: the controller sends to `port`, a `udp://` address of this
    computer, usually with the number 6510.
    """

    listens: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="ABB IRC5 (RobotWare 6.10 and later) and OmniCore with Externally Guided Motion",
        source="ABB's egm.proto, as ros-industrial/abb_libegm publishes it (proto/egm.proto)",
        standing="confirmed",
        doubts="that feedBack.time is good for more than its ms (public code calls it useless on some controllers), "
        "from which software on positions are streamed, and whether motorState and rapidExecState come with them",
    )
    interface: Literal["abb_egm"]
    port: UDPPort
    timeout_s: float = Field(default=1.0, ge=0.01, le=60)
    """Also the silence after which a restarted program, which is a new sender, is accepted."""


class FANUCStreamMotion(_Feedback):
    """FANUC Stream Motion (J519), status only, on request: `port` is the controller, `udp://robot:60015`."""

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="FANUC R-30iB Plus and later with Stream Motion (option J519), versions 1 to 4",
        source="versions 1 and 2: manual B-84904EN tables 3.3(a), (b) and (d) as public clients quote them "
        "(kumar-nikhil/stream_motion_interface, intelligent-control-lab/Stream_Motion_Controller); versions 3 and 4, "
        "and the question for the version: FANUC-CORPORATION/fanuc_driver, stream_motion/packets.hpp and stream.cpp",
        standing="confirmed",
        doubts="the timestamp in ms (in steps of 2) and its overflow; whether the status comes from the port of "
        "the request; whether version 2 starts and sends like version 1; whether a controller of version "
        "1 ignores the version request (an unknown packet type may post HOST-380: then set `version`); "
        "whether bit 2 of the status is SYSRDY in every version; whether the currents are in A",
    )
    interface: Literal["fanuc_stream_motion"]
    port: UDPPort
    version: int | None = Field(default=None, ge=1, le=4)
    """Stream Motion version. By default it is requested from the controller."""
    currents: bool = False
    """Record the joint motor currents, which are part of every status."""


class LinuxCNC(_Feedback):
    """LinuxCNC: a line for each servo period from `halsampler`, served by the program that `rig init` writes, at
    `tcp://robot:5480`.

    The samples also contain the number in `motion.analog-out-00`, set by `M68 E0 Q…`.
    """

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="LinuxCNC 2.9 with six joints in degrees, such as arms with genserkins",
        source="manual pages sampler(9), halsampler(1) and motion(9) of LinuxCNC 2.9; a session with the package "
        "linuxcnc-uspace 2.9.0 of Debian 12 (docs/evidence/linuxcnc.md)",
        standing="confirmed",
        doubts="drives: the controller ran without hardware, so its joints follow the commands at once",
    )
    interface: Literal["linuxcnc"]
    port: Annotated[Port, tcp_port(LINUXCNC_PORT)]
    servo_period_ms: float = Field(default=1.0, ge=0.1, le=100)
    """Period of the servo thread: SERVO_PERIOD in the section EMCMOT of the INI file, there in ns."""
    linear_units: Literal["mm", "inch"] = "mm"
    """LINEAR_UNITS in the section TRAJ of the INI file, as `linear_units` of `robot`."""


class ModbusJoints(_Feedback, RegisterBlock):
    """Joint angles in registers of a controller, read over Modbus TCP, `tcp://robot:502`."""

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="any controller with joint angles in Modbus TCP registers",
        source="the Modbus application protocol; the register map is in the rig file",
        standing="confirmed",
        doubts="no controller's own map: which registers, and whether the angles of one read are of one instant",
    )
    framing: ClassVar[Literal["rtu"]] = "rtu"
    """Framing of a serial line, not used with TCP."""
    interface: Literal["modbus_joints"]
    port: Annotated[Port, tcp_port(502)]
    function: Literal[3, 4] = 3
    rate_hz: float = Field(default=100.0, ge=SLOWEST_HZ)
    joints: tuple[ValueRegister, ValueRegister, ValueRegister, ValueRegister, ValueRegister, ValueRegister]
    """Registers of q1 … q6, each `raw * scale + offset` in `units`."""
    units: Literal["deg", "rad"] = "deg"
    status: StatusRegister | None = None
    """State of controller or program. Unlisted values are errors."""

    @model_validator(mode="after")
    def _readable(self) -> ModbusJoints:
        joints = {f"joints[{axis}]": register for axis, register in enumerate(self.joints)}
        self.check_inside(**joints, status=self.status)
        return self


Feedback = Annotated[
    URRTDE
    | LineFeed
    | KUKARSI
    | ABBEGM
    | FANUCStreamMotion
    | LinuxCNC
    | ModbusJoints
    | ROS2JointStates
    | OPCUARobotics,
    Field(discriminator="interface"),
]
if not TYPE_CHECKING:
    Feedback = extended(Feedback, "rig.robots", Part)


def carries_signal(feedback: Feedback) -> bool:
    match feedback:
        case URRTDE():
            return feedback.signal is not None
        case LineFeed():
            return SIGNAL in feedback.fields
    return isinstance(feedback, LinuxCNC)


def signal_of_outputs(feedback: Feedback) -> RTDESignal | None:
    if isinstance(feedback, LinuxCNC):
        return RTDESignal(int_register=0)
    return feedback.signal if isinstance(feedback, URRTDE) else None


def columns_beside_joints(feedback: Feedback) -> tuple[str, ...]:
    return (*((SIGNAL,) if carries_signal(feedback) else ()), *condition_columns(feedback))


def condition_columns(feedback: Feedback) -> tuple[str, ...]:
    columns: tuple[str, ...] = ()
    match feedback:
        case URRTDE():
            columns = (PROGRAM, SAFETY, SPEED, PAYLOAD, *TEMPERATURES) if feedback.condition else ()
        case OPCUARobotics(condition=True):
            columns = (PROGRAM, SAFETY, MOTORS, SPEED, PAYLOAD, *TEMPERATURES)
        case LineFeed():
            columns = tuple(name for name in feedback.fields if name in CONDITION)
        case KUKARSI():
            columns = tuple(feedback.condition)
        case ABBEGM():
            columns = (PROGRAM, MOTORS, *POSE)
        case FANUCStreamMotion():
            columns = (SAFETY, MOTORS)
    if isinstance(feedback, URRTDE | FANUCStreamMotion) and feedback.currents:
        columns += CURRENTS
    return (*columns, *POSE) if isinstance(feedback, URRTDE) and feedback.pose else columns
