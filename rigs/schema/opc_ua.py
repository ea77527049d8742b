"""The axes that an OPC UA server shows by the Robotics companion specification (OPC 40010-1)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from rigs.schema.links import Port, tcp_address
from rigs.schema.origin import Origin
from rigs.schema.part import Part

AxisName = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,200}$")]
_NODE = re.compile(r"(ns=\d{1,5};)?(i=\d{1,10}|s=.+)")


class OPCUARobotics(Part):
    """OPC UA for Robotics: a server with a MotionDeviceSystem in its DeviceSet, from which is only read."""

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="robots of any maker with an OPC UA server of the Robotics companion specification",
        source="OPC 40010-1 1.02 (reference.opcfoundation.org/Robotics) with its nodeset (OPCFoundation/UA-Nodeset, "
        "Robotics); OPC 10000-4 and -6 for services and the wire, through asyncua's types",
        standing="confirmed",
        doubts="no controller has been read yet, only servers of the node-opcua and asyncua libraries; what instant "
        "a controller stamps; that a motor belongs to the axis that its power train moves",
    )

    interface: Literal["opc_ua_robotics"]
    port: Port
    path: str = Field(default="", pattern=r"^(/[^\s\x00-\x1f]{0,200})?$")
    """The path of the server's endpoint, as `/UA/Robot` of `opc.tcp://robot:4840/UA/Robot`."""
    device: str | None = Field(default=None, min_length=1, max_length=200)
    """The browse name of the robot below MotionDevices, where the server has several."""
    axes: tuple[AxisName, AxisName, AxisName, AxisName, AxisName, AxisName] | None = None
    """Browse names of q1 … q6 below Axes; or node ids of the variables of their positions, as `ns=2;s=A1.Pos`. Without
    them the robot must have six axes whose names end in numbers."""
    units: Literal["deg", "rad"] | None = None
    """The unit of the angles, where the server does not state it (EngineeringUnits)."""
    rate_hz: float = Field(default=100, ge=1, le=500)
    """How often the server is asked to sample; it may do so less often."""
    condition: bool = True
    """Whether the condition of the robot is read as well: task, stops, drives, speed, load, temperatures of motors."""
    timeout_s: float = Field(default=2.0, ge=0.1, le=60)
    """Without a message for so long it counts as silent."""

    @field_validator("port")
    @classmethod
    def _network(cls, port: str) -> str:
        if tcp_address(port) is None:
            raise ValueError(f"{port!r} is not a TCP port; write 'tcp://host:4840' for opc.tcp://host:4840")
        return port

    @field_validator("axes")
    @classmethod
    def _six(cls, axes: tuple[str, ...] | None) -> tuple[str, ...] | None:
        if axes and len(set(axes)) < len(axes):
            raise ValueError("an axis occurs twice; name q1 … q6, each once")
        if axes and len({are_nodes([axis]) for axis in axes}) > 1:
            raise ValueError("name all six axes, or give six node ids, not some of each")
        return axes


def are_nodes(axes: Sequence[str]) -> bool:
    """Return whether all of these are node ids (`ns=2;s=A1.Pos`) and not browse names."""
    return all(_NODE.fullmatch(axis) for axis in axes)
