"""Packets and recipes of Universal Robots' RTDE, protocol version 2, and the robot's condition in its fields.

Big-endian packets, `>HB`: size with header, type. A recipe is a list of fields, each with its type; a packet of data
has the recipe's number and then the fields in their order.

The condition: `runtime_state` (RuntimeState of UR's clients), `safety_status` or, on older software, `safety_mode`
(SafetyMode and SafetyStatus of UR's clients, which agree up to 9), `speed_scaling` times `target_speed_fraction` (as
UR's ROS driver reckons the speed: what the controller slows a motion down to, and the slider), `payload` in kg and
`joint_temperatures` in °C. Beside it `actual_current`, the currents of the joints' motors in A.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

from daq.protocol.framing import Sized
from daq.protocol.numerals import plausible
from rigs.schema.condition import CURRENTS, PAYLOAD, PROGRAM, SAFETY, SPEED, TEMPERATURES, ProgramState, SafetyState

Numbers = Sequence[float]
VERSION = struct.pack(">H", 2)
"""The payload that asks for this version of the protocol."""
_HEADER = struct.Struct(">HB")
_LONGEST = 520
"""No packet of our recipes is longer; a text is 516 at most."""
_FORMATS = {"DOUBLE": (1, "d"), "VECTOR6D": (6, "6d"), "UINT64": (1, "Q"), "UINT32": (1, "I"), "INT32": (1, "i")}
_SAFETY_FIELD = "safety_status"
CONDITION_TYPES = {
    "runtime_state": "UINT32",
    _SAFETY_FIELD: "INT32",
    "speed_scaling": "DOUBLE",
    "target_speed_fraction": "DOUBLE",
    "payload": "DOUBLE",
    "joint_temperatures": "VECTOR6D",
}
"""The fields of the condition. Any may be unknown to the software of a controller."""
CURRENT_TYPES = {"actual_current": "VECTOR6D"}
"""The field of the motors' currents, in A."""
OLDER = {_SAFETY_FIELD: "safety_mode"}
"""What a field was before; of the same type and codes."""
_PROGRAM = {
    0: ProgramState.STOPPED,  # stopping
    1: ProgramState.STOPPED,
    2: ProgramState.RUNNING,
    3: ProgramState.PAUSED,  # pausing
    4: ProgramState.PAUSED,
    5: ProgramState.RUNNING,  # resuming
}
_SAFETY = {
    1: SafetyState.NORMAL,
    2: SafetyState.REDUCED,
    3: SafetyState.PROTECTIVE_STOP,
    4: SafetyState.RECOVERY,
    5: SafetyState.SAFEGUARD_STOP,
    6: SafetyState.EMERGENCY_STOP,  # of the system
    7: SafetyState.EMERGENCY_STOP,  # of the robot
    8: SafetyState.FAULT,  # a violation
    9: SafetyState.FAULT,
    12: SafetyState.SAFEGUARD_STOP,  # in automatic mode
    13: SafetyState.SAFEGUARD_STOP,  # by the three-position enabling device
}
_UNKNOWN = -1
"""A code that neither has."""
_SHOWN_PROGRAM = {ProgramState.STOPPED: 1, ProgramState.RUNNING: 2, ProgramState.PAUSED: 4}
_SHOWN_SAFETY = {state: code for code, state in reversed(_SAFETY.items())}


def packet(kind: bytes, payload: bytes = b"") -> bytes:
    """Return a packet of a type with its header."""
    return _HEADER.pack(_HEADER.size + len(payload), kind[0]) + payload


def packets() -> Sized:
    """Return what cuts the stream of either side into packets, header included."""
    return Sized(_HEADER.size, _length)


def _length(head: bytes) -> int | None:
    size, kind = _HEADER.unpack(head)
    return size if _HEADER.size <= size <= _LONGEST and bytes([kind]).isalpha() else None


@dataclass(frozen=True)
class Recipe:
    """Fields in their order, each with its type."""

    types: Mapping[str, str]

    @cached_property
    def layout(self) -> struct.Struct:
        """The recipe's number, then the fields."""
        return struct.Struct(">B" + "".join(_FORMATS[kind][1] for kind in self.types.values()))

    def without(self, lacking: Collection[str]) -> Recipe:
        """Return the recipe without these fields, or with what they were before."""
        named = [(OLDER.get(name) if name in lacking else name, kind) for name, kind in self.types.items()]
        return Recipe({name: kind for name, kind in named if name})

    def read(self, payload: bytes) -> dict[str, Numbers]:
        """Return the numbers of each field in a packet of data of this recipe's size."""
        numbers = islice(self.layout.unpack(payload), 1, None)
        return {name: tuple(islice(numbers, _FORMATS[kind][0])) for name, kind in self.types.items()}

    def written(self, number: int, fields: Mapping[str, Numbers]) -> bytes:
        """Return a packet of data with these numbers."""
        return packet(b"U", self.layout.pack(number, *(value for name in self.types for value in fields[name])))


def condition_of(fields: Mapping[str, Numbers]) -> tuple[float, ...]:
    """Return the columns of the condition; nan where the field is missing, or its code is not known."""
    (program,) = fields.get("runtime_state", (_UNKNOWN,))
    (safety,) = fields.get(_SAFETY_FIELD) or fields.get(OLDER[_SAFETY_FIELD], (_UNKNOWN,))
    (limited,), (slider,) = fields.get("speed_scaling", (math.nan,)), fields.get("target_speed_fraction", (math.nan,))
    return (
        float(_PROGRAM.get(int(program), math.nan)),
        float(_SAFETY.get(int(safety), math.nan)),
        plausible(100 * limited * slider),
        *map(plausible, fields.get("payload", (math.nan,))),
        *map(plausible, fields.get("joint_temperatures", (math.nan,) * 6)),
    )


def currents_of(fields: Mapping[str, Numbers]) -> tuple[float, ...]:
    """Return the columns of the currents; nan where the field is missing."""
    (name,) = CURRENT_TYPES
    return tuple(map(plausible, fields.get(name, (math.nan,) * 6)))


def fields_of(shown: Mapping[str, float]) -> dict[str, Numbers]:
    """Return the fields by which a controller shows a condition and currents, where both are known."""
    fields = _condition_fields(shown) if PROGRAM in shown else {}
    (name,) = CURRENT_TYPES
    return fields | ({name: tuple(shown[current] for current in CURRENTS)} if CURRENTS[0] in shown else {})


def _condition_fields(condition: Mapping[str, float]) -> dict[str, Numbers]:
    safety = _SHOWN_SAFETY[SafetyState(int(condition[SAFETY]))]
    return {
        "runtime_state": (_SHOWN_PROGRAM[ProgramState(int(condition[PROGRAM]))],),
        _SAFETY_FIELD: (safety,),
        OLDER[_SAFETY_FIELD]: (safety,),
        "speed_scaling": (1.0,),
        "target_speed_fraction": (condition[SPEED] / 100,),
        "payload": (condition[PAYLOAD],),
        "joint_temperatures": tuple(condition[name] for name in TEMPERATURES),
    }
