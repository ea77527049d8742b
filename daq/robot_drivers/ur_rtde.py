"""Universal Robots Real-Time Data Exchange, protocol version 2, read only.

The protocol is confirmed by UR's documents and client; only the layout of `M` is an assumption.

Packets are big-endian, `>HB`: size including the header, and type. The host requests the version (`V`), the recipe, a
list of typed fields, at a rate (`O`), and the start (`S`), each with an answer. Data packets (`U`), the recipe number
and the fields, follow at the requested rate, or at the lower rate of the controller. If the answer to the recipe marks
an optional field NOT_FOUND, the recipe is repeated without it. A loaded controller may skip packets, which only its
clock shows (fault SKIPPED). `M` is a text message: length, text, length, source, and level, from 0 exception to 3
information. `v` requests the controller version, four UINT32; the maker's client sends this request first.

The conversation requests a new link in three cases. A binary stream that is out of step cannot be resynchronised
safely. A refused request will not be granted later. A silent controller is gone: it also streams at standstill, and TCP
would not notice.

The codes of the condition are RuntimeState, SafetyMode and SafetyStatus of UR's clients (identical up to 9). The speed
is `speed_scaling` times `target_speed_fraction`, as in UR's ROS driver: reduction by the controller, and the slider.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

from daq.feedback import Read
from daq.protocol.conversation import ConversationStep, Device, Fault, FaultKind, Host
from daq.protocol.framing import Message, Sized
from daq.protocol.numerals import are_angles, plausible
from daq.protocol.poses import flange_pose, tool_fields
from daq.protocol.positions import SteadyDevice, SteadyRate, SteadySteps
from daq.protocol.streamed import GatheredStream, Reaction, StreamedDialect
from rigs.schema.condition import (
    CURRENTS,
    PAYLOAD,
    POSE,
    PROGRAM,
    SAFETY,
    SPEED,
    TEMPERATURES,
    ProgramState,
    SafetyState,
)
from rigs.schema.feedback import URRTDE, RTDESignal, condition_columns

Numbers = Sequence[float]
VERSION = struct.pack(">H", 2)
_HEADER = struct.Struct(">HB")
_LONGEST = 520
"""Packets of our recipes are shorter, and texts have at most 516 bytes."""
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
"""Optional, because they depend on the controller software."""
CURRENT_TYPES = {"actual_current": "VECTOR6D"}
POSE_TYPES = {"actual_TCP_pose": "VECTOR6D", "tcp_offset": "VECTOR6D"}
"""Tool in the base and in the flange, each x, y, z in m and a rotation vector in rad."""
OLDER = {_SAFETY_FIELD: "safety_mode"}
"""Earlier name of a field with the same type and codes."""
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
_SHOWN_PROGRAM = {ProgramState.STOPPED: 1, ProgramState.RUNNING: 2, ProgramState.PAUSED: 4}
_SHOWN_SAFETY = {state: code for code, state in reversed(_SAFETY.items())}


def packet(kind: bytes, payload: bytes = b"") -> bytes:
    return _HEADER.pack(_HEADER.size + len(payload), kind[0]) + payload


def packets() -> Sized:
    return Sized(_HEADER.size, _length)


def _length(head: bytes) -> int | None:
    size, kind = _HEADER.unpack(head)
    return size if _HEADER.size <= size <= _LONGEST and bytes([kind]).isalpha() else None


@dataclass(frozen=True)
class Recipe:
    types: Mapping[str, str]

    @cached_property
    def layout(self) -> struct.Struct:
        """Recipe number, then the fields."""
        return struct.Struct(">B" + "".join(_FORMATS[kind][1] for kind in self.types.values()))

    def without(self, lacking: Collection[str]) -> Recipe:
        named = [(OLDER.get(name) if name in lacking else name, kind) for name, kind in self.types.items()]
        return Recipe({name: kind for name, kind in named if name})

    def read(self, payload: bytes) -> dict[str, Numbers]:
        numbers = islice(self.layout.unpack(payload), 1, None)
        return {name: tuple(islice(numbers, _FORMATS[kind][0])) for name, kind in self.types.items()}

    def written(self, number: int, fields: Mapping[str, Numbers]) -> bytes:
        return packet(b"U", self.layout.pack(number, *(value for name in self.types for value in fields[name])))


def condition_of(fields: Mapping[str, Numbers]) -> tuple[float, ...]:
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


def pose_of(fields: Mapping[str, Numbers]) -> tuple[float, ...]:
    tool, offset = (fields.get(name) for name in POSE_TYPES)
    if tool is None or offset is None:
        return (math.nan,) * len(POSE)
    return tuple(map(plausible, flange_pose(tool, offset)))


def fields_of(shown: Mapping[str, float]) -> dict[str, Numbers]:
    fields: dict[str, Numbers] = {}
    if PROGRAM in shown:
        safety = _SHOWN_SAFETY[SafetyState(int(shown[SAFETY]))]
        fields = {
            "runtime_state": (_SHOWN_PROGRAM[ProgramState(int(shown[PROGRAM]))],),
            _SAFETY_FIELD: (safety,),
            OLDER[_SAFETY_FIELD]: (safety,),
            "speed_scaling": (1.0,),
            "target_speed_fraction": (shown[SPEED] / 100,),
            "payload": (shown[PAYLOAD],),
            "joint_temperatures": tuple(shown[name] for name in TEMPERATURES),
        }
    if CURRENTS[0] in shown:
        (currents,) = CURRENT_TYPES
        fields[currents] = tuple(shown[current] for current in CURRENTS)
    if POSE[0] in shown:
        fields |= dict(zip(POSE_TYPES, tool_fields([shown[name] for name in POSE], EMULATED_TOOL), strict=True))
    return fields


EMULATED_TOOL = (0.0, 0.02, 0.15, 0.0, 0.3, 0.0)
"""Tool set in the emulated controller: x, y, z in m and rotation vector in rad."""
_MOST_UNKNOWN = 3
_DISPENSABLE = {*CONDITION_TYPES, *OLDER.values(), *CURRENT_TYPES, *POSE_TYPES}
_MAX_CLOCK_S = 1e9
"""No controller runs for 30 years without a restart."""


def host(feedback: URRTDE) -> Host:
    return GatheredStream(_RTDEClient(feedback), feedback.timeout_s)


def device(feedback: URRTDE, read: Read) -> Device:
    return _RTDEController(feedback, read)


def _recipe(feedback: URRTDE) -> Recipe:
    signal = (
        {_signal_field(feedback.signal): ("UINT64" if feedback.signal.outputs else "INT32")} if feedback.signal else {}
    )
    condition = CONDITION_TYPES if feedback.condition else {}
    currents, pose = CURRENT_TYPES if feedback.currents else {}, POSE_TYPES if feedback.pose else {}
    return Recipe({"timestamp": "DOUBLE", "actual_q": "VECTOR6D", **signal, **condition, **currents, **pose})


def _signal_field(place: RTDESignal) -> str:
    return "actual_digital_output_bits" if place.outputs else f"output_int_register_{place.int_register}"


def _signal(place: RTDESignal, raw: int) -> float:
    if place.int_register is not None:
        return float(raw)
    return float(sum((raw >> output & 1) << bit for bit, output in enumerate(place.outputs)))


class _RTDEClient(StreamedDialect):
    check = "check that the controller is on and RTDE is not disabled under Settings › Security › Services"

    def __init__(self, feedback: URRTDE) -> None:
        self.frames = packets()
        self._rate_hz = feedback.rate_hz
        self._place = feedback.signal
        self._condition = feedback.condition
        self._currents, self._pose = feedback.currents, feedback.pose
        self._recipe = _recipe(feedback)
        self._awaited = b"V"
        self._number = 0
        self._unknown = 0
        self._steps = SteadySteps(feedback.rate_hz)

    def start(self) -> bytes:
        return packet(b"V", VERSION)

    def silent(self) -> Reaction:
        return Reaction(hang_up=True)

    def garbled(self, fault: Fault) -> Reaction:
        return Reaction((fault,), hang_up=True)

    def read(self, message: Message) -> Reaction:
        kind, payload = message.data[2:3], message.data[3:]
        if kind not in b"VOSPUM":
            self._unknown += 1
            if self._unknown > _MOST_UNKNOWN:
                return _out_of_step(message)
            detail = f"packet of type {kind.decode('latin-1')}, which is unknown; ignored"
            return Reaction((message.fault(FaultKind.GARBLED, detail),))
        self._unknown = 0
        if kind not in (b"M", self._awaited):
            return _out_of_step(message)
        meaning = {b"M": self._text, b"U": self._data, b"O": self._recipe_answer}.get(kind)
        return meaning(payload, message) if meaning else self._accepted(kind, payload, message)

    def _accepted(self, kind: bytes, payload: bytes, message: Message) -> Reaction:
        if payload not in {b"\0", b"\1"}:
            return _out_of_step(message)
        if payload == b"\0":
            refused = "protocol version 2, which requires software 3.4 or 5 and later" if kind == b"V" else "to start"
            return _refused(f"the controller rejects {refused}; update or restart the controller", message)
        if kind == b"S":
            self._awaited = b"U"
            return Reaction()
        self._awaited = b"O"
        return self._ask_for_recipe()

    def _ask_for_recipe(self) -> Reaction:
        names = ",".join(self._recipe.types).encode()
        return Reaction(send=packet(b"O", struct.pack(">d", self._rate_hz) + names))

    def _recipe_answer(self, payload: bytes, message: Message) -> Reaction:
        types = payload[1:].decode("ascii", "replace").split(",")
        if len(types) != len(self._recipe.types):
            return _out_of_step(message)
        asked = zip(self._recipe.types.items(), types, strict=True)
        deviating = {name: got for (name, expected), got in asked if got != expected}
        if name := next((name for name in deviating if name not in _DISPENSABLE), ""):
            remedy = (
                "close the other RTDE client" if deviating[name] == "IN_USE" else "update the controller's software"
            )
            return _refused(f"the controller answers {deviating[name]} for {name}; {remedy}", message)
        if deviating:
            self._recipe = self._recipe.without(deviating)
            return self._ask_for_recipe()
        self._number = payload[0]
        self._awaited = b"S"
        return Reaction(send=packet(b"S"))

    def _data(self, payload: bytes, message: Message) -> Reaction:
        if len(payload) != self._recipe.layout.size or payload[0] != self._number:
            return _out_of_step(message)
        fields = self._recipe.read(payload)
        (clock_s,), angles_rad = fields["timestamp"], fields["actual_q"]
        signal = (_signal(self._place, int(fields[_signal_field(self._place)][0])),) if self._place else ()
        condition = condition_of(fields) if self._condition else ()
        (name,) = CURRENT_TYPES
        currents = map(plausible, fields.get(name, (math.nan,) * 6)) if self._currents else ()
        pose = pose_of(fields) if self._pose else ()
        angles_deg = tuple(map(math.degrees, angles_rad))
        if not (0 <= clock_s < _MAX_CLOCK_S and are_angles(angles_deg)):
            detail = f"packet with time {clock_s:g} s and angles {angles_rad} rad; ignored"
            return Reaction((message.fault(FaultKind.GARBLED, detail),))
        sample = message.sample((*angles_deg, *signal, *condition, *currents, *pose), clock_s)
        return Reaction((*self._steps.check_stamp(clock_s, message.last_byte_ns), sample))

    def _text(self, payload: bytes, message: Message) -> Reaction:
        """Handle a text of the controller. Information is ignored."""
        text, remainder = _counted(payload)
        source, level = _counted(remainder)
        if len(level) != 1:
            return _out_of_step(message)
        if level[0] >= 3:
            return Reaction()
        name = ("exception", "error", "warning")[level[0]]
        detail = f"{name} from {source.decode('utf-8', 'replace')}: {text.decode('utf-8', 'replace')}"
        return Reaction((message.fault(FaultKind.DEVICE_ERROR, detail),))


def _counted(data: bytes) -> tuple[bytes, bytes]:
    end = 1 + data[0] if data else 0
    return data[1:end], data[end:]


def _out_of_step(message: Message) -> Reaction:
    detail = f"unexpected packet {message.data[:16].hex(' ')} ({message.size} bytes); reconnecting"
    return Reaction((message.fault(FaultKind.GARBLED, detail),), hang_up=True)


def _refused(detail: str, message: Message) -> Reaction:
    return Reaction((message.fault(FaultKind.DEVICE_ERROR, detail),), hang_up=True)


class _RTDEController(SteadyDevice):
    """Sends the requested fields at the requested rate, a packet per period even after late ticks."""

    CLOCK_START_S = 1000.0
    """Initial time of the clock. Controllers count from power-on."""
    SOFTWARE = (5, 11, 0, 0)
    MIN_RATE_HZ, MAX_RATE_HZ = 0.01, 500.0
    IS_STREAM = True

    def __init__(self, feedback: URRTDE, read: Read) -> None:
        super().__init__(read)
        self._place = feedback.signal
        self._condition = condition_columns(feedback)
        older = dict.fromkeys(OLDER.values(), "INT32") if feedback.condition else {}
        self._known = {**_recipe(feedback).types, **older}
        self._frames = packets()
        self._recipe = Recipe({})
        self._rate_hz = 0.0

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        answers = b""
        for message in self._frames.feed(data, now_ns):
            if isinstance(message, Fault):
                return ConversationStep(answers, hang_up=True)
            answers += self._answer(message.data[2:3], message.data[3:], now_ns)
        return self._step(answers)

    def _answer(self, kind: bytes, payload: bytes, now_ns: int) -> bytes:
        if kind == b"V":
            return packet(kind, bytes([payload == VERSION]))
        if kind == b"v":
            return packet(kind, struct.pack(">4I", *self.SOFTWARE))
        if kind == b"O":
            return packet(kind, self._set_up(payload))
        if kind == b"S":
            self._pace = SteadyRate(self._rate_hz, now_ns) if self._recipe.types else None
            return packet(kind, bytes([bool(self._recipe.types)]))
        if kind == b"P":
            self._pace = None
            return packet(kind, b"\1")
        return b""

    def _set_up(self, payload: bytes) -> bytes:
        # SDU's ur_rtde ends the list with a comma, which real controllers accept.
        names = payload[8:].decode("ascii", "replace").removesuffix(",").split(",")
        (rate_hz,) = struct.unpack(">d", payload[:8]) if len(payload) >= 8 else (math.nan,)
        types = [self._known.get(name, "NOT_FOUND") for name in names]
        good = "NOT_FOUND" not in types and self.MIN_RATE_HZ <= rate_hz <= self.MAX_RATE_HZ
        recipe = Recipe(dict(zip(names, types, strict=True)))
        self._recipe, self._rate_hz = (recipe, rate_hz) if good else (Recipe({}), 0.0)
        self._pace = None
        return bytes([good]) + ",".join(types).encode()

    def _message(self, instant_ns: int) -> bytes:
        clock_s = self.CLOCK_START_S + (instant_ns - self._connected_ns) * 1e-9
        shown = self._read(instant_ns)
        fields: dict[str, Numbers] = {"timestamp": (clock_s,), "actual_q": tuple(map(math.radians, shown[:6]))}
        if self._place:
            raw = signal = int(shown[6])
            if self._place.int_register is None:  # unnamed outputs are off
                raw = sum((signal >> bit & 1) << output for bit, output in enumerate(self._place.outputs))
            fields[_signal_field(self._place)] = (raw,)
        if self._condition:
            fields |= fields_of(dict(zip(self._condition, shown[-len(self._condition) :], strict=True)))
        return self._recipe.written(1, fields)
