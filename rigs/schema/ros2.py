"""The joint angles that a ROS 2 system publishes."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from rigs.schema.links import Port, tcp_address
from rigs.schema.origin import Origin
from rigs.schema.part import Part

JointName = Annotated[str, Field(pattern=r"^[\w./-]{1,100}$")]


class ROS2JointStates(Part):
    """ROS 2: a topic of `sensor_msgs/msg/JointState`, by a rosbridge server, to which only a subscription is sent."""

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
    port: Port
    topic: str = Field(default="/joint_states", pattern=r"^/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*$")
    joints: tuple[JointName, JointName, JointName, JointName, JointName, JointName]
    """The names of q1 … q6 in the messages, in whose order they need not be; other joints are left out."""
    timeout_s: float = Field(default=2.0, ge=0.01, le=60)
    """Without a message for so long it counts as silent."""

    @field_validator("port")
    @classmethod
    def _network(cls, port: str) -> str:
        if tcp_address(port) is None:
            raise ValueError(f"{port!r} is not a TCP port; write 'tcp://host:9090'")
        return port

    @field_validator("joints")
    @classmethod
    def _six(cls, joints: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(joints)) < len(joints):
            raise ValueError("a joint occurs twice; name q1 … q6, each once")
        return joints
