"""Configurations of all drivers, in every mode with different traffic on the wire."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

from pydantic import TypeAdapter

from rigs.schema.feedback import (
    ABBEGM,
    KUKARSI,
    URRTDE,
    FANUCStreamMotion,
    Feedback,
    LineFeed,
    LinuxCNC,
    ModbusJoints,
    OPCUARobotics,
    ROS2JointStates,
)
from rigs.schema.gauges import Gauge

_GAUGE: TypeAdapter[Any] = TypeAdapter(Gauge)

SERIAL, TCP = "/dev/ttyUSB0", "tcp://127.0.0.1:502"
BAUMER: dict[str, object] = {
    "rate_hz": 1e10,  # the request at once, in simulated time
    "line": "57600 8E1",
    "unit": 1,
    "function": 4,
    "address": 200,
    "count": 13,
    "word_order": "little",
    "value": {"address": 202, "type": "float32"},
    "status": {"address": 200, "type": "uint16", "good": (0,), "doubtful": (1,)},
    "clock_s": {"address": 209, "type": "uint32"},
    "clock_us": {"address": 211, "type": "uint32"},
}


def gauge(interface: str, **changes: object) -> Any:
    return _GAUGE.validate_python(
        {"interface": interface, "port": SERIAL, "offset_mm": 25} | NEEDED[interface] | changes
    )


LINE = {"line": "57600 8N1"}
NEEDED: dict[str, dict[str, object]] = {
    "sylvac_opto_rs": {},
    "keyence_dl_rs1a": {},
    "tesa_tt": {},
    "mahr_c1202": {},
    "mahr_c1208": LINE,
    "heidenhain_nd281b": {},
    "heidenhain_nd287": LINE,
    "magnescale_lt": LINE,
    "magnescale_mg80": LINE | {"address": "01", "request": "D"},
    "mitutoyo_usb": {},
    "mitutoyo_qm_height": {},
    "cdi_iq": {},
    "micro_epsilon_ild1420": {"range_mm": 10},
    "solartron_orbit": LINE | {"parameter": 2, "status_parameter": 3},
    "modbus_map": BAUMER,
}
"""Settings required by each interface in addition to port and position."""


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

SCALED = {"address": 202, "type": "int32", "scale": 1e-4, "offset": -5.0}
PLAIN = {"status": None, "clock_s": None, "clock_us": None}

# name, gauges, resolution in mm
GAUGES: list[tuple[str, Sequence[Gauge], float]] = [
    *((f"sylvac {unit}", [sylvac(units=unit)], 0.0003) for unit in ("mm", "um", "inch")),
    *((f"sylvac continuous {u}", [sylvac(units=u, mode="continuous")], 0.0003) for u in ("mm", "um", "inch")),
    *((f"keyence {u}", [keyence(units=u, channel=2), keyence(units=u)], 0.001) for u in ("mm", "um", "inch")),
    ("keyence one of three", [keyence(channel=3)], 0.001),
    *((f"modbus rtu {unit}", [modbus(units=unit)], 1e-5) for unit in ("mm", "um", "inch")),
    ("modbus tcp", [modbus(port=TCP)], 1e-5),
    ("modbus scaled", [modbus(value=SCALED, word_order="big", function=3)], 1e-4),
    ("modbus without status", [modbus(**PLAIN)], 1e-5),
    ("modbus swapped bytes", [modbus(byte_order="little")], 1e-5),
    ("modbus 64 bits", [modbus(value={"address": 203, "type": "float64"})], 1e-9),
    ("modbus ascii", [modbus(framing="ascii")], 1e-5),
    *((f"tesa {u}", [gauge("tesa_tt", units=u)], resolution) for u, resolution in (("mm", 0.006), ("um", 1e-5))),
    *((f"mahr c1202 {u}", [gauge("mahr_c1202", units=u, channel=2)], 0.0003) for u in ("mm", "um", "inch")),
    ("mahr c1202 two", [gauge("mahr_c1202", channel=3), gauge("mahr_c1202")], 0.0001),
    *((f"mahr c1208 {u}", [gauge("mahr_c1208", units=u)], 0.0003) for u in ("mm", "um", "inch")),
    ("mahr c1208 m1240", [gauge("mahr_c1208", protocol="m1240")], 0.0001),
    *((f"nd281b {u}", [gauge("heidenhain_nd281b", units=u)], 0.0002) for u in ("mm", "inch")),
    *((f"nd287 {u}", [gauge("heidenhain_nd287", units=u)], 0.0002) for u in ("mm", "inch")),
    *((f"magnescale lt {u}", [gauge("magnescale_lt", units=u)], 0.0015) for u in ("mm", "inch")),
    ("magnescale lt two", [gauge("magnescale_lt", channel=2), gauge("magnescale_lt")], 0.0001),
    *((f"magnescale mg80 {u}", [gauge("magnescale_mg80", units=u)], 0.0015) for u in ("mm", "inch")),
    *((f"mitutoyo usb {u}", [gauge("mitutoyo_usb", units=u)], 0.0006) for u in ("mm", "inch")),
    *((f"qm-height {u}", [gauge("mitutoyo_qm_height", units=u)], 0.0006) for u in ("mm", "inch")),
    *((f"cdi {u}", [gauge("cdi_iq", units=u)], 0.0002) for u in ("mm", "inch")),
    ("ild1420 continuous", [gauge("micro_epsilon_ild1420", zero_mm=5)], 0.0001),
    ("orbit", [gauge("solartron_orbit")], 1e-6),
    ("orbit ascii", [gauge("solartron_orbit", framing="ascii", function=4, word_order="little")], 1e-6),
]
TEN_MICRODEGREES = [{"address": 100 + 2 * axis, "type": "int32", "scale": 1e-5} for axis in range(6)]
RADIANS = ("_", *(f"q{axis}_rad" for axis in (2, 1, 3, 4, 5, 6)), "t_us")
FEEDBACKS: list[tuple[str, Feedback]] = [
    ("rtde 500", rtde()),
    ("rtde 125", rtde(rate_hz=125)),
    ("rtde outputs", rtde(signal={"outputs": [3, 9]})),
    ("rtde register", rtde(signal={"int_register": 24})),
    ("rtde joints alone", rtde(condition=False)),
    ("rtde currents", rtde(currents=True)),
    ("lines", lines()),
    ("lines signal", lines(fields=("t_ms", *(f"q{axis}_deg" for axis in range(1, 7)), "signal"))),
    ("lines rad", lines(fields=RADIANS, separator=" ")),
    ("lines serial", lines(port=SERIAL, separator=";")),
    ("lines condition", lines(fields=("speed_percent", *(f"q{axis}_deg" for axis in range(1, 7)), "motors_on", "t_s"))),
    ("lines that call", lines(listens=True)),
    ("lines by udp", lines(port="udp://127.0.0.1:9000", listens=True)),
    ("rsi 4 ms", rsi()),
    (
        "rsi condition",
        rsi(condition={"speed_percent": "Override", "motors_on": "Drives.On", "payload_kg": "Drives.Kg"}),
    ),
    ("rsi 12 ms", rsi(cycle_ms=12, sentype="Rig")),
    ("rsi onlysend", rsi(onlysend=True)),
    ("egm", egm()),
    ("j519 currents", j519(currents=True)),
    ("linuxcnc", LinuxCNC(interface="linuxcnc", port="tcp://127.0.0.1:5480")),
    ("linuxcnc 2 ms", LinuxCNC(interface="linuxcnc", port="tcp://127.0.0.1:5480", servo_period_ms=2)),
    ("j519", j519()),
    *((f"j519 version {version}", j519(version=version)) for version in (1, 2, 4)),
    ("joint states", joint_states()),
    ("joints polled", joints()),
    ("joints polled rad", joints(units="rad", function=4, word_order="little", status=None)),
    ("joints polled scaled", joints(joints=TEN_MICRODEGREES)),
]
if OPC_UA:
    FEEDBACKS += [
        ("opc ua", opc_ua()),
        ("opc ua rad", opc_ua(units="rad", rate_hz=250, path="/robot", device="R 1")),
        ("opc ua axes alone", opc_ua(condition=False, axes=("S", "L", "U", "R", "B", "T"))),
        ("opc ua nodes", opc_ua(condition=False, axes=NODES)),
    ]
