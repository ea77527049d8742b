"""Configurations of all drivers, which drivers.yaml has, and others with changes."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml
from pydantic import TypeAdapter

from rigs.schema.feedback import (
    ABBEGM,
    KUKARSI,
    URRTDE,
    FANUCStreamMotion,
    Feedback,
    LineFeed,
    ModbusJoints,
    OPCUARobotics,
    ROS2JointStates,
)
from rigs.schema.gauges import Gauge

_GAUGE: TypeAdapter[Any] = TypeAdapter(Gauge)

SERIAL, TCP = "/dev/ttyUSB0", "tcp://127.0.0.1:502"
_ALL: dict[str, Any] = yaml.safe_load((Path(__file__).parent / "drivers.yaml").read_text(encoding="utf-8"))
NEEDED: dict[str, dict[str, object]] = _ALL["needed"]
"""Settings required by each interface in addition to port and position."""
LINE = {"line": "57600 8N1"}


def gauge(interface: str, **changes: object) -> Any:
    return _GAUGE.validate_python(
        {"interface": interface, "port": SERIAL, "offset_mm": 25} | NEEDED[interface] | changes
    )


def sylvac(**changes: object) -> Any:
    return gauge("sylvac_opto_rs", **changes)


def keyence(**changes: object) -> Any:
    return gauge("keyence_dl_rs1a", **changes)


def modbus(**changes: object) -> Any:
    return gauge("modbus_map", **changes)


def rtde(**changes: object) -> URRTDE:
    defaults = {"interface": "ur_rtde", "port": "tcp://127.0.0.1:30004", "pose": False}
    return URRTDE.model_validate(defaults | changes)


def lines(**changes: object) -> LineFeed:
    return LineFeed.model_validate({"interface": "line_feed", "port": "tcp://127.0.0.1:9000"} | changes)


def rsi(**changes: object) -> KUKARSI:
    return KUKARSI.model_validate({"interface": "kuka_rsi", "port": "udp://127.0.0.1:49152"} | changes)


def egm(**changes: object) -> ABBEGM:
    return ABBEGM.model_validate({"interface": "abb_egm", "port": "udp://127.0.0.1:6510"} | changes)


def j519(**changes: object) -> FANUCStreamMotion:
    fields = {"interface": "fanuc_stream_motion", "port": "udp://127.0.0.1:60015"}
    return FANUCStreamMotion.model_validate(fields | changes)


def joints(**changes: object) -> ModbusJoints:
    """A register map with six float32 joints from register 100 and the program state in register 112."""
    fields = {
        "interface": "modbus_joints",
        "port": TCP,
        "address": 100,
        "count": 13,
        "rate_hz": 200,
        "joints": [{"address": 100 + 2 * axis, "type": "float32"} for axis in range(6)],
        "status": {"address": 112, "good": (2,), "doubtful": (4,)},
    }
    return ModbusJoints.model_validate(fields | changes)


PANDA = tuple(f"panda_joint{axis}" for axis in range(1, 7))


def joint_states(**changes: object) -> ROS2JointStates:
    fields = {"interface": "ros2_joint_states", "port": "tcp://127.0.0.1:9090", "joints": PANDA}
    return ROS2JointStates.model_validate(fields | changes)


OPC_UA = find_spec("asyncua") is not None
"""Whether the optional package `asyncua` is installed."""


def opc_ua(**changes: object) -> OPCUARobotics:
    return OPCUARobotics.model_validate({"interface": "opc_ua_robotics", "port": "tcp://127.0.0.1:4840"} | changes)


NODES = tuple(f"ns=4;s=A{axis}.Pos" for axis in range(1, 7))

PLAIN = {"status": None, "clock_s": None, "clock_us": None}

# name, gauges, resolution in mm
GAUGES: list[tuple[str, Sequence[Gauge], float]] = [
    (name, [gauge(**one) for one in gauges], resolution) for name, resolution, *gauges in _ALL["gauges"]
]
FEEDBACKS: list[tuple[str, Feedback]] = [
    (name, TypeAdapter(Feedback).validate_python(robot))
    for name, robot in _ALL["feedbacks"]
    if OPC_UA or robot["interface"] != "opc_ua_robotics"
]
